"""Faults, requests and stale samples in any order against Cycle."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
from helpers.toy import PERIOD, SPEED, wired
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.runtime.ipc.header import CYCLE, DEVICE, LINK_ACTIVE, LINK_CONNECTED, Cause, Latch, Origin, State
from srl.runtime.ipc.latches import NONE
from srl.runtime.ipc.requests import Answer, Request, RequestKind
from srl.runtime.loop.cycle import Cycle
from srl.runtime.loop.guards import limits_of

# Any order of events


step = st.fixed_dictionaries(
    {
        "ask": st.sampled_from(
            [RequestKind.NONE] * 6
            + [
                RequestKind.START,
                RequestKind.RESET,
                RequestKind.RESET,
                RequestKind.STOP,
                RequestKind.FAULT,
                RequestKind.EXIT,
            ]
        ),
        "origin": st.sampled_from([Origin.LOCAL, Origin.BUS, Origin.OPERATOR, Origin.ENGINEER, Origin.SERVICE]),
        "target": st.sampled_from([Cause.NONE, Cause.BUS_LOSS, Cause.OVERRUN]),
        "stale": st.sampled_from([""] * 5 + ["hand", "arm", "panel"]),
        "lost": st.sampled_from([""] * 6 + ["hand", "arm", "panel"]),
        "button": st.sampled_from([0.0] * 6 + [1.0]),
        "reset": st.sampled_from([0.0] * 4 + [1.0, 1.0, np.nan]),
        "x": st.sampled_from([0.0, 0.5, -3.0, 1.9, np.nan, np.inf, 1e300]),
        "periods": st.sampled_from([1] * 8 + [2, 7, 40]),
        "times": st.integers(1, 30),
    }
)


def _request(kind: RequestKind, s: dict[str, Any]) -> Request | None:
    # Only the service gives a cause.
    target = int(s["target"]) if s["origin"] is Origin.SERVICE else 0
    return Request(0, kind, target, 0, np.empty(0), s["origin"]) if kind else None


def _cycles(steps: list[dict[str, Any]], automatic: bool, latched: Latch) -> Any:
    """Runs them; yields what each cycle began with and ended with."""
    graph = wired(
        emergency="{signal: panel.buttons, element: first, category: retract}",
        more="reset: {inputs: [{signal: panel.buttons, element: third}], bus: [bus, fault]}",
    )
    cycle = Cycle(graph, limits_of(graph), automatic, latched)
    ints, views = graph.row.ints, graph.row.views
    devices = dict(zip(graph.layout.devices, graph.row.devices, strict=True))
    applied, measured, sent = views["arm.command.applied"], views["arm.position"], views["arm.command.sent"]
    now = 1_000_000_000
    stamps = dict.fromkeys(("hand", "arm", "panel"), now)
    for s in steps:
        for k in range(s["times"]):
            now += s["periods"] * PERIOD
            ints[CYCLE.now], ints[CYCLE.dt] = now, s["periods"] * PERIOD
            for name in stamps:
                stamps[name] = stamps[name] if name == s["stale"] else now
                words, connected = devices[name], LINK_CONNECTED * (name != s["lost"])
                words[DEVICE.stamp] = stamps[name]
                words[DEVICE.link] = (words.item(DEVICE.link) & LINK_ACTIVE) | connected
            views["panel.buttons"][0], views["hand.position"][:] = s["button"], s["x"]
            views["panel.buttons"][2] = s["reset"]
            before, was, stood = applied.copy(), cycle.machine.state, cycle.machine.latches
            ask = s["ask"] if k == 0 else RequestKind.NONE
            cycle.check(s["periods"] - 1, _request(ask, s))
            present = cycle._fault
            cycle.control()
            cycle.guard()
            state, active = cycle.machine.state, bool(devices["arm"][DEVICE.link] & LINK_ACTIVE)
            yield SimpleNamespace(
                was=was, state=state, present=present, stood=stood, latches=cycle.machine.latches,
                asked=(ints.item(CYCLE.request_kind), ints.item(CYCLE.request_origin)),
                granted=ints.item(CYCLE.request_result) == Answer.DONE, pressed=(stamps["panel"] == now, s["reset"]),
                active=active, before=before,
                applied=applied.copy(), measured=measured.copy(), dt=min(s["periods"], 5) * PERIOD * 1e-9,
                connected=bool(devices["arm"][DEVICE.link] & LINK_CONNECTED),
            )  # fmt: skip
            if active:
                sent[:] = measured[:] = applied  # the arm is where it was told to be
                devices["arm"][DEVICE.commands] += 1
            if state is State.ENDED:
                return


latched = st.sampled_from([NONE, NONE, Latch.PERSON, Latch.BUS, Latch.RESTART | Latch.BUS])


@settings(max_examples=150, deadline=None)
@given(steps=st.lists(step, min_size=1, max_size=12), automatic=st.booleans(), latched=latched)
def test_no_order_of_events_steps_or_moves_unasked(
    steps: list[dict[str, Any]], automatic: bool, latched: Latch
) -> None:
    for c in _cycles(steps, automatic, latched):
        assert np.isfinite(c.applied).all()
        assert (np.abs(c.applied) <= 2 + 1e-9).all()
        assert (np.abs(c.applied - c.before) <= SPEED * c.dt * (1 + 1e-6) + 1e-9).all()
        assert c.state is not State.READY or not c.active
        assert c.state is not State.ACTIVE or c.present is None
        began = c.was in (State.READY, State.STOPPED) and c.state in (State.HOMING, State.ACTIVE)
        asked = c.granted and c.asked[0] == (RequestKind.START if c.was is State.READY else RequestKind.RESET)
        assert not began or (asked or (automatic and c.was is State.READY))
        assert not began or c.present is None


@settings(max_examples=150, deadline=None)
@given(steps=st.lists(step, min_size=1, max_size=12), automatic=st.booleans(), latched=latched)
def test_no_order_of_events_ends_a_stop_that_its_origin_may_not_end(
    steps: list[dict[str, Any]], automatic: bool, latched: Latch
) -> None:
    released = False  # whether the reset input was seen released
    for c in _cycles(steps, automatic, latched):
        kind, origin = c.asked
        assert not (c.latches and c.state in (State.HOMING, State.ACTIVE))
        assert c.state is not State.READY or c.latches in (NONE, Latch.START)
        gone = c.stood & ~c.latches
        assert not gone or (kind in (RequestKind.RESET, RequestKind.START) and c.granted)
        assert kind != RequestKind.START or gone in (NONE, Latch.START)
        assert not gone & ~(Latch.BUS | Latch.FAULT) or origin in (Origin.LOCAL, Origin.INPUT)
        assert not gone or origin is not Origin.SERVICE
        if kind == RequestKind.STOP:
            assert c.latches & (Latch.PERSON if origin == Origin.LOCAL else Latch.BUS) or origin == Origin.SERVICE
        assert origin != Origin.INPUT or released
        released |= c.pressed == (True, 0.0)


@settings(max_examples=30, deadline=None)
@given(steps=st.lists(step, min_size=1, max_size=8))
def test_after_the_end_nothing_changes(steps: list[dict[str, Any]]) -> None:
    graph = wired()
    cycle = Cycle(graph, limits_of(graph), True)
    cycle.machine.state, cycle.machine.exiting = State.ENDED, True
    for s in steps:
        cycle.check(s["periods"] - 1, _request(s["ask"], s))
        cycle.control()
        cycle.guard()
        assert cycle.machine.state is State.ENDED
