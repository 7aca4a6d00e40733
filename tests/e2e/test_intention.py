"""The profile `suit-intention`: actions are recognised; a lost suit is a loss, and a reset begins anew."""

from __future__ import annotations

import numpy as np
import pytest

from srl.runtime.ipc.header import CYCLE, Cause, State
from srl.runtime.ipc.requests import RequestKind
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.profile import profile, wiring

pytestmark = pytest.mark.slow

PAUSE, ACTION = 2.5, 3.0  # s, of the simulated wearer's plan


def lockstep(**suit: object) -> Lockstep:
    checked, source = profile.load("suit-intention", [f"sim.devices.suit.{k}={v}" for k, v in suit.items()])
    return Lockstep(wiring.build(checked, source, []), lambda text: None)


def test_its_wearer_is_recognised_action_by_action() -> None:
    run, held = lockstep(), list[str]()
    layout = run.graph.layout
    labels = layout.fields["intention.action"].labels
    for _ in range(round(100 * 4 * (PAUSE + ACTION))):
        run.step()
        on = run.graph.row.views["intention.action"]
        now = labels[int(on.argmax())] if on.any() else ""
        if now and (not held or held[-1] != now):
            held.append(now)
    assert held == ["overhead", "forward", "reach-left", "reach-right"]


def test_only_the_action_that_a_press_confirms_becomes_active() -> None:
    """As docs/intention.md shows it: the wearer does four actions and presses the ring during the first."""
    pressed = [
        "devices.ring={driver: ring, port: /dev/input/event0}", "controllers.0.confirm=press",
        "controllers.0.in.confirm=ring.buttons", "sim.devices.ring.presses=[[4.8, 5.0]]",
    ]  # fmt: skip
    checked, source = profile.load("suit-intention", pressed)
    run, held = Lockstep(wiring.build(checked, source, []), lambda text: None), set[str]()
    labels = run.graph.layout.fields["intention.action"].labels
    for _ in range(round(100 * 4 * (PAUSE + ACTION))):
        run.step()
        on = run.graph.row.views["intention.action"]
        held |= {labels[int(on.argmax())]} if on.any() else set()
    assert held == {"overhead"}


def test_a_lost_suit_stops_the_run_and_a_reset_begins_with_an_empty_window() -> None:
    run = lockstep(loss="[[5.0, 5.5]]")  # while the hands are over the head
    views, ints = run.graph.row.views, run.graph.row.ints
    seen = False
    for _ in range(490):
        run.step()
        seen = seen or bool(views["intention.action"].any())
    assert seen
    for _ in range(80):
        run.step()
    assert State(int(ints[CYCLE.state])) is State.STOPPED
    assert Cause(int(ints[CYCLE.cause])) is Cause.INTENT_LOSS
    run.step(RequestKind.RESET)
    for _ in range(30):
        run.step()
    assert State(int(ints[CYCLE.state])) is State.ACTIVE
    assert not views["intention.action"].any()
    assert not views["intention.confidence"].any()
    for _ in range(100):
        run.step()
    assert np.all(views["intention.confidence"] > 0.0)
