"""`as_published`: the paper's law without what is added to it here."""

from __future__ import annotations

from math import inf
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from srl.control.hand.object_mapping import ObjectMappingConfig
from srl.testing import Lab


@pytest.mark.parametrize(
    ("options", "words"),
    [({"gain_limit": 4.0}, "has no gain_limit"), ({"deformation": "concentric"}, "has no deformation concentric")],
)
def test_with_an_addition_it_isnt_as_published(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        ObjectMappingConfig(as_published=True, **options)


def test_the_additions_are_off() -> None:
    config = ObjectMappingConfig(as_published=True)
    assert config.bounds[::2] == (inf, inf)
    assert config.bounds[1] < 1e-5
    assert ObjectMappingConfig().bounds == (4.0, 0.01, 0.03)


def moved(*given: str) -> Any:
    with Lab("sixth-finger", list(given)) as lab:
        lab.until("active")
        lab.run(3.0)
        return lab["finger.position_command"].copy(), lab["mapping.drift_pull"]


def test_it_moves_the_finger_by_a_law_of_its_own() -> None:
    usual, pull = moved()
    published, none = moved("controllers.1.as_published=true")
    assert (float(pull), float(none)) == (5.0, 0.0)
    assert np.abs(published - usual).max() > 1e-3
