"""The state machine: faults stop, requests are answered, the first cause stands, an emergency overrules."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from srl.runtime.contracts.signals import Stop
from srl.runtime.ipc import latches
from srl.runtime.ipc.header import Cause, Latch, Origin, State
from srl.runtime.ipc.requests import Answer, RequestKind
from srl.runtime.loop.machine import Fault, Machine, OverrunCounter
from srl.runtime.profile.profile import EmergencyInput, Faults, OverrunEscalation

EMERGENCY = [EmergencyInput(signal="panel.buttons", category=Stop.LIMP)]


def machine(automatic: bool = True, latched: Latch = latches.NONE, **faults: object) -> Machine:
    return Machine(Faults.model_validate(faults), EMERGENCY, automatic, latched)


def active() -> Machine:
    m = machine(**{"intent-loss": "hold"})
    m.start_if_ready(None)
    m.settle(True)
    assert m.state is State.ACTIVE
    return m


def test_nothing_moves_before_all_is_well() -> None:
    m = machine()
    m.start_if_ready(Fault(Cause.INTENT_LOSS, 0))
    assert m.state is State.READY
    m.start_if_ready(None)
    assert m.state is State.HOMING


def test_without_being_asked_a_manual_profile_stays_ready() -> None:
    m = machine(automatic=False)
    m.start_if_ready(None)
    assert m.state is State.READY
    assert m.request(RequestKind.START, Origin.LOCAL, 0, None) is Answer.DONE
    assert m.state is State.HOMING


@pytest.mark.parametrize("granted", [False, True])
def test_the_first_start_is_a_persons_unless_the_profile_grants_it(granted: bool) -> None:
    """A client could start a limb without feedback before anyone had placed it, also by a stop and a reset."""
    given = latches.GRANTED | Latch.START if granted else latches.GRANTED
    m = Machine(Faults(), EMERGENCY, False, granted=given)
    if not granted:
        assert m.request(RequestKind.START, Origin.BUS, 0, None) is Answer.REFUSED_LATCH
        assert m.request(RequestKind.STOP, Origin.BUS, 0, None) is Answer.DONE
        assert m.request(RequestKind.RESET, Origin.BUS, 0, None) is Answer.REFUSED_LATCH
        assert m.latches == Latch.START | Latch.BUS
        assert m.request(RequestKind.RESET, Origin.LOCAL, 0, None) is Answer.DONE
    else:
        assert m.request(RequestKind.START, Origin.BUS, 0, None) is Answer.DONE
    assert m.latches == latches.NONE


def test_a_run_after_a_crash_begins_in_the_stop() -> None:
    m = machine(latched=Latch.RESTART)
    m.start_if_ready(None)
    assert (m.state, m.cause) == (State.STOPPED, Cause.RESTART)
    assert m.request(RequestKind.RESET, Origin.LOCAL, 0, None) is Answer.DONE


@pytest.mark.parametrize("cause", [Cause.INTENT_LOSS, Cause.DEVICE_LOSS, Cause.OVERRUN, Cause.DRIVER_ERROR])
def test_a_fault_stops_and_stays_until_a_reset(cause: Cause) -> None:
    m = active()
    m.stop(Fault(cause, 3))
    assert (m.state, m.cause, m.fault_source) == (State.STOPPING, cause, 3)
    m.settle(False)
    assert m.state is State.STOPPING
    m.settle(True)
    assert m.state is State.STOPPED
    m.start_if_ready(None)
    assert m.state is State.STOPPED
    assert m.request(RequestKind.RESET, Origin.LOCAL, 0, Fault(cause, 3)) is Answer.REFUSED_FAULT
    assert m.request(RequestKind.RESET, Origin.LOCAL, 0, None) is Answer.DONE
    assert (m.state, m.cause) == (State.HOMING, Cause.NONE)


def test_the_first_cause_stands_but_an_emergency_overrules() -> None:
    m = active()
    m.stop(Fault(Cause.INTENT_LOSS, 0))
    assert m.override is Stop.HOLD
    m.stop(Fault(Cause.DEVICE_LOSS, 1))
    assert m.cause is Cause.INTENT_LOSS
    m.stop(Fault(Cause.EMERGENCY, 0))
    assert (m.cause, m.override) == (Cause.EMERGENCY, Stop.LIMP)


def test_what_the_profile_ignores_does_not_stop() -> None:
    m = active()
    m.request(RequestKind.FAULT, Origin.LOCAL, Cause.BUS_LOSS, None)
    assert m.state is State.ACTIVE  # bus-loss is ignored by default


def test_exit_ends_after_the_stop() -> None:
    m = active()
    assert m.request(RequestKind.EXIT, Origin.LOCAL, Cause.END, None) is Answer.DONE
    assert m.state is State.STOPPING
    assert m.request(RequestKind.RESET, Origin.LOCAL, 0, None) is Answer.REFUSED_STATE
    m.settle(True)
    assert (m.state, m.cause) == (State.ENDED, Cause.END)


events = st.one_of(
    st.tuples(st.just("fault"), st.sampled_from([c for c in Cause if c not in (Cause.NONE, Cause.EMERGENCY)])),
    st.tuples(st.just("ask"), st.sampled_from([RequestKind.START, RequestKind.STOP, RequestKind.RESET])),
    st.tuples(st.just("settle"), st.booleans()),
)


@given(events=st.lists(events, max_size=30))
def test_no_way_into_motion_but_an_explicit_one(events: list[tuple[str, object]]) -> None:
    m = machine(automatic=False)
    for what, value in events:
        before = m.state
        if what == "fault":
            m.stop(Fault(value, 0))  # type: ignore[arg-type]
        elif what == "ask":
            m.request(value, Origin.LOCAL, 0, None)  # type: ignore[arg-type]
        else:
            m.settle(bool(value))
        m.start_if_ready(None)
        began = m.state is State.HOMING and before is not State.HOMING
        assert not began or (what == "ask" and value in (RequestKind.START, RequestKind.RESET))
        assert m.state is not State.ACTIVE or before in (State.ACTIVE, State.HOMING)


@pytest.mark.parametrize(
    ("rate", "given", "holds"),
    [(100, {}, (5, 20)), (10, {}, (4, 5)), (1, {}, (0, 1)), (100, {"stop": 2000}, (5, 50)),
     (500, {"window": 10.0, "stop": 10_000, "tolerate": 9000}, (2499, 2500))],
)  # fmt: skip
def test_a_loop_that_misses_every_other_cycle_is_stopped(
    rate: int, given: dict[str, Any], holds: tuple[int, int]
) -> None:
    found = OverrunEscalation(**given).at(Fraction(rate))
    assert (found.tolerate, found.stop) == holds
    overruns = OverrunCounter(found.tolerate, found.window, found.stop)
    stopped = [overruns.count(2 * i * 10**9 // rate, 1)[1] for i in range(6 * rate)]
    assert stopped[-1]


def test_the_overrun_ladder() -> None:
    overruns = OverrunCounter(tolerate=2, window=1.0, stop=5)
    second = 1_000_000_000
    assert overruns.count(0, 2) == (False, False)
    assert overruns.count(1, 1) == (True, False)
    assert overruns.count(2, 2) == (True, True)
    assert overruns.count(3 * second, 0) == (False, False)
