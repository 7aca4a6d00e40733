"""Two limbs in one run: a stall, a loss or a way home of one of them isn't taken for that of the other."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import toy
from helpers.toy import SPEED, Bench

from srl.runtime.ipc.header import LINK_ACTIVE, LINK_CONNECTED, LINK_FAULT, LINK_STALE, Cause, State
from srl.runtime.loop import device as device_module

LIMITS = "{{lower: -2, upper: 2, velocity: {speed}, acceleration: 10}}"
FAR, NEAR = -0.5, 0.6  # rad; a servo's home is 0.7


def two_servos(monkeypatch: pytest.MonkeyPatch) -> None:
    """The toy's profile with a second servo, `leg`, and a hand for each."""
    monkeypatch.setattr(device_module, "RETRY", 0.01)
    more = "  leg: {{driver: toy, part: servo}}\n  foot: {{driver: toy, part: hand}}\n"
    law = "  - {{use: law, name: other, in: {{x: foot.position}}, out: {{q: leg.command}}}}\n"
    text = toy.PROFILE.replace("controllers:", f"{more}controllers:").replace("guard:", f"{law}guard:")
    text = text.replace("guard: {{arm.command:", f"guard: {{{{leg.command: {LIMITS}, arm.command:")
    monkeypatch.setattr(toy, "PROFILE", text)


def value(b: Bench, name: str) -> Any:
    return b.graph.layout.value(b.rows(), name)[:, 0]


def ways_home(b: Bench, arm: float, leg: float, lost: str) -> tuple[Any, Any, int]:
    """Both servos are led somewhere; some are lost, and a reset follows. What was applied, and when motion began."""
    servo, foot = b.others

    def script(k: int) -> None:
        b.hand.values["position"][:], foot.values["position"][:] = arm, leg
        if k == 250:
            b.arm.gone_in_write, servo.gone_in_write = lost in ("both", "arm"), lost in ("both", "leg")
        if k == 260:
            for driver in (b.arm, servo):
                if not driver.health.connected:
                    b.until_back(driver)
        if k == 265:
            b.ask("reset")

    b.run(1200, script)
    states = b.header("state")
    first = 260 + int(np.flatnonzero(states[260:] == State.ACTIVE)[0])
    assert states[first - 1] == State.HOMING
    return value(b, "arm.command.applied"), value(b, "leg.command.applied"), first


@pytest.mark.parametrize(("arm", "leg"), [(FAR, NEAR), (NEAR, FAR)])
def test_motion_begins_once_the_last_one_is_at_home(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arm: float, leg: float
) -> None:
    two_servos(monkeypatch)
    b = Bench(tmp_path, arm="servo", emergency="")
    *both, first = ways_home(b, arm, leg, "both")
    assert first - 265 >= (0.7 - FAR) / (SPEED / 4) / 0.01 - 5
    for applied in both:
        assert applied[first] == pytest.approx(0.7)


@pytest.mark.parametrize("lost", ["arm", "leg"])
def test_the_one_that_was_not_lost_waits_where_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lost: str
) -> None:
    two_servos(monkeypatch)
    b = Bench(tmp_path, arm="servo", emergency="")
    arm, leg, first = ways_home(b, FAR, NEAR, lost)
    for name, applied, place in (("arm", arm, FAR), ("leg", leg, NEAR)):
        assert applied[245] == pytest.approx(place)
        assert applied[first] == pytest.approx(0.7 if name == lost else place)


@pytest.mark.parametrize("first", ["arm", "hand"])
def test_a_device_that_takes_nothing_for_too_long_stops_the_limb_whichever_of_them_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, first: str
) -> None:
    hand, arm = ("  hand: {{driver: toy, part: hand}}\n", "  arm: {{driver: toy, part: {arm}}}\n")
    assert hand + arm in toy.PROFILE
    if first == "arm":
        monkeypatch.setattr(toy, "PROFILE", toy.PROFILE.replace(hand + arm, arm + hand))
    b = Bench(tmp_path, emergency="")
    one, other = (b.hand, b.arm) if first == "arm" else (b.arm, b.hand)
    assert one.commands
    assert not other.commands

    def script(k: int) -> None:
        other.values["position"][:] = np.sin(0.05 * k)
        one.stalled = k >= 50

    b.run(400, script)
    assert b.states[200][0] is State.ACTIVE
    assert b.states[-1] == (State.STOPPED, Cause.DEVICE_FAULT)
    assert "'arm' has taken no commands as they are for too long" in b.events


def test_a_limb_that_was_moved_from_where_it_is_held_starts_there_at_the_second_reset(tmp_path: Path) -> None:
    """The first one is refused, and says why; from then on it isn't held any more."""
    b = Bench(tmp_path, emergency="")
    place = 0.0

    def script(k: int) -> None:
        nonlocal place
        b.hand.values["position"][:] = 0.0, place
        if k == 50:
            b.ask("stop")
        if k >= 70:  # a hand pushes it aside
            place = min(0.03 * (k - 70), 0.36)
            b.arm.values["position"][:] = 0.0, place
        if k in (84, 100):
            b.ask("reset")

    b.run(130, script)
    assert {state for state, _ in b.states[60:100]} == {State.STOPPED}
    assert b.states[-1][0] is State.ACTIVE
    assert [event for event in b.events if "no start" in event and "isn't followed: elbow is" in event]
    active = (b.header("arm.link") & LINK_ACTIVE) > 0
    assert active[82]
    assert not active[86:99].any()
    assert active[110]
    applied = b.graph.layout.value(b.rows(), "arm.command.applied")
    assert applied[101:105] == pytest.approx(np.tile([0.0, 0.36], (4, 1)), abs=0.01)


def test_a_limb_that_goes_limp_is_still_what_it_was_but_for_being_commanded(tmp_path: Path) -> None:
    b = Bench(tmp_path, emergency="", more="stop: {arm: limp}")
    b.run(100, lambda k: b.ask("stop") if k == 50 else None)
    link = b.header("arm.link")[:-1]
    assert (link[20:50] == LINK_CONNECTED | LINK_ACTIVE).all()
    assert not (link[55:] & LINK_ACTIVE).any()
    assert not (link[20:] & (LINK_STALE | LINK_FAULT)).any()
    assert (link[20:] & LINK_CONNECTED).all()


@pytest.mark.parametrize(
    ("own", "override", "goes_limp"),
    [
        ("hold", "limp", True),
        ("limp", "hold", False),
        ("hold", "damp", False),
        ("limp", "damp", True),
        ("limp", "", True),
    ],
)
def test_the_stop_is_the_inputs_where_the_limb_can_do_it_and_else_its_own(
    tmp_path: Path, own: str, override: str, goes_limp: bool
) -> None:
    category = f", category: {override}" if override else ""
    emergency = f"{{signal: panel.buttons, element: first{category}}}"
    b = Bench(tmp_path, emergency=emergency, more=f"stop: {{arm: {own}}}")

    def script(k: int) -> None:
        b.panel.values["buttons"][0] = k >= 50

    b.run(80, script)
    assert b.states[-1] == (State.STOPPED, Cause.EMERGENCY)
    assert bool(b.header("arm.link")[75] & LINK_ACTIVE) != goes_limp
