"""What every part must do: the rules that authors of parts get, put to all registered ones."""

from __future__ import annotations

from typing import Any

import pytest

from srl.runtime.contracts import registry
from srl.testing import PartConformance

OPTIONS: dict[str, dict[str, Any]] = {  # those that a part can't do without
    "actuator-chain": {"axes": {"one": {"model": "DM4310"}}},
    "box": {"size": [0.1, 0.1, 0.1]},
    "dynamixel-chain": {"axes": {"one": {"model": "MX-64"}}},
    "feetech-chain": {"axes": {"one": {"model": "STS3215"}}},
    "object": {"shape": "box", "size": [0.1, 0.1, 0.1], "mass": 1},
    "obstacles": {"boxes": [{"position": [1.0, 0.0, 0.5], "size": [0.4, 0.2, 1.0]}]},
    "push": {"pushes": "other_thing/body", "force": [1.0, 0.0, 0.0], "times": [[0.0, 0.5]]},
    "wall": {"touches": "other_thing/body"},
}


class TestOurs(PartConformance):
    @pytest.fixture(autouse=True, params=registry.names("parts"))
    def _each(self, request: pytest.FixtureRequest) -> None:
        self.part = request.param
        self.options = OPTIONS.get(self.part, {})
