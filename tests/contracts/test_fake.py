"""A fake declares what its driver declares, unless its own class says otherwise."""

from __future__ import annotations

from srl.drivers.cyberglove import CyberGlove
from srl.runtime.contracts.world import Fake
from srl.sim.devices.cyberglove.fake import FakeCyberGlove


def test_it_takes_its_drivers_declarations() -> None:
    for name in ("Config", "summary", "gives", "takes", "max_age"):
        assert getattr(FakeCyberGlove, name) == getattr(CyberGlove, name)


def test_what_a_class_says_itself_stays_also_in_classes_derived_from_it() -> None:
    class Slow(FakeCyberGlove):
        max_age = 0.5

    class Slower(Slow):
        summary = "another"

    assert (Slow.max_age, Slow.summary) == (0.5, CyberGlove.summary)
    assert (Slower.max_age, Slower.summary) == (0.5, "another")


def test_one_without_a_driver_declares_for_itself() -> None:
    class Own(Fake):
        max_age = 0.3

    assert Own.max_age == 0.3
    assert Own.real is None
