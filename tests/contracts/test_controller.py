"""The contract of a law: what is said of one whose optional hook is missing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.errors import RecordingError


class Half(Controller):
    """Says that it writes files, and can't."""

    exports = ("bvh",)

    def reset(self) -> None:
        """Nothing begins."""

    def update(self, dt: float) -> None:
        """Nothing is computed."""


def test_a_law_that_names_a_form_without_its_method_is_told_what_is_missing(tmp_path: Path) -> None:
    law = Half("copy", ControllerConfig())
    with pytest.raises(RecordingError) as caught:
        law.export("bvh", {"x": np.zeros((3, 1))}, 0.01, tmp_path / "x.bvh")
    assert caught.value.place == "controllers.copy"
    assert "Half" in caught.value.problem
    assert "bvh" in caught.value.problem
    assert "`export`" in caught.value.problem
    assert "Half" in caught.value.remedy
