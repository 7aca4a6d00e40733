"""A package's class with a method's name of before is refused: nobody would call the method."""

from __future__ import annotations

import pytest

from srl.runtime.contracts.controller import Controller
from srl.runtime.contracts.driver import Driver, Sensor
from srl.runtime.contracts.world import Twin


@pytest.mark.parametrize(
    ("base", "old", "new"),
    [
        (Controller, "weigh", "update_gravity"),
        (Controller, "doubts", "warnings"),
        (Controller, "figures", "metrics"),
        (Driver, "figures", "metrics"),
        (Sensor, "figures", "metrics"),
        (Twin, "figures", "metrics"),
    ],
)
def test_a_method_of_before_is_refused_with_its_new_name(base: type, old: str, new: str) -> None:
    with pytest.raises(ImportError, match=f"'{old}' is now called '{new}'"):
        type("Mine", (base,), {old: lambda self: None})
    mixin = type("Mixin", (), {old: lambda self: None})
    with pytest.raises(ImportError, match="rename it"):
        type("Mine", (mixin, base), {})
    type("Mine", (base,), {new: lambda self: None})
