"""The rules for a device of a profile: options, files and world are those that a run would have."""

from __future__ import annotations

from pathlib import Path

import pytest

from srl.drivers.cyberglove import CyberGlove
from srl.runtime.contracts.errors import ProfileError, RequestError
from srl.runtime.profile import profile
from srl.testing import DriverConformance


class TestGlove(DriverConformance):
    profile, device = "sixth-finger", "glove"


class TestFinger(DriverConformance):
    profile, device = "sixth-finger", "finger"


def test_the_options_are_the_profiles_and_the_port_is_nobodys() -> None:
    glove = TestGlove().driver()
    assert isinstance(glove, CyberGlove)
    given = profile.load("sixth-finger")[0].devices["glove"].options
    assert glove.config.model_dump()["port"] == TestGlove.nowhere != given["port"]
    for name in set(given) - {"port"}:
        assert getattr(glove.config, name) is not None


def test_a_class_that_doesnt_say_what_it_tests_is_told(tmp_path: Path) -> None:
    class Empty(DriverConformance):
        pass

    class Wrong(DriverConformance):
        profile, device = "sixth-finger", "gluve"

    with pytest.raises(RequestError, match="Empty: it doesn't say what is tested"):
        Empty().test_it_describes_itself()
    for rule in (Wrong().driver, Wrong().simulated, Wrong().bench):
        with pytest.raises(ProfileError, match=r"there is no 'gluve'\. Did you mean 'glove'"):
            rule()
