from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from srl.runtime.contracts.errors import ProfileError
from srl.runtime.profile.keys import Keys, check, slug


def test_keys_of_an_instance() -> None:
    keys = Keys("sixth-finger")
    assert keys.state("finger.position_command.applied") == "srl/sixth_finger/state/finger/position_command/applied"
    assert keys.command("stop") == "srl/sixth_finger/cmd/stop"
    assert keys.parameter("object-mapping.pull") == "srl/sixth_finger/param/object_mapping/pull"
    assert keys.setpoint("client.force") == "srl/sixth_finger/setpoint/client/force"
    assert (keys.status, keys.alive) == ("srl/sixth_finger/status", "srl/sixth_finger/alive")


@given(st.text(min_size=1))
def test_a_slug_is_legal_in_ros2(name: str) -> None:
    assert re.fullmatch("[a-z0-9_]+", slug(name))


def test_names_that_are_one_key_are_refused() -> None:
    with pytest.raises(ProfileError, match="same key as 'a-b"):
        check(["a-b.x", "a_b.x"], "signal")
    with pytest.raises(ProfileError, match="metadata of 'a"):
        check(["a.x", "a.x.meta"], "signal")
    check(["a.x", "a.x.applied", "b.x"], "signal")
