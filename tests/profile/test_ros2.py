"""The profile's `bus.ros2:`: one word turns it on, and who may command is never everybody by accident."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from srl.runtime.profile import profile, wiring
from srl.runtime.profile.bus import BusConfig, Ros2Config


@pytest.mark.parametrize(("given", "wanted"), [(True, Ros2Config()), (False, None), (None, None)])
def test_one_word_turns_it_on_or_off(given: Any, wanted: Ros2Config | None) -> None:
    assert BusConfig.model_validate({"ros2": given}).ros2 == wanted
    assert not Ros2Config().commands


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"router": "tcp/10.0.0.5:7447", "commands": True}, "anyone on the network could move the limb"),
        ({"router": "tls/10.0.0.5:7447"}, "needs `tls:`"),
        ({"router": "127.0.0.1:7447"}, "must read tcp/HOST:PORT"),
        ({"router": "tcp/127.0.0.1:99999"}, "must read tcp/HOST:PORT"),
        ({"namespace": "left"}, "pattern"),
        ({"namespace": "/left arm"}, "pattern"),
        ({"domain": 233}, "232"),
        ({"rate": 0}, "greater than 0"),
        ({"distribution": "foxy"}, "humble"),
        ({"topics": []}, "topics"),
    ],
)
def test_what_cant_be_is_refused(options: dict[str, Any], text: str) -> None:
    with pytest.raises(ValidationError, match=text):
        BusConfig.model_validate({"ros2": options})


def test_a_router_elsewhere_may_be_told_what_the_limb_does() -> None:
    assert BusConfig.model_validate({"ros2": {"router": "tcp/10.0.0.5:7447"}}).ros2 is not None


@pytest.mark.parametrize(("commands", "count"), [("true", 1), ("false", 0)])
def test_commands_over_a_plain_router_are_warned_of(commands: str, count: int) -> None:
    warnings = wiring.build(*profile.load("servo-jog", [f"bus.ros2.commands={commands}"]), []).warnings
    assert len([each for each in warnings if "may move the limb" in each]) == count
