"""What the wearer feels: level, rise, time without a pause, mean; off at once; cues that are felt as such."""

from __future__ import annotations

from dataclasses import replace
from math import inf, nan
from typing import Any

import numpy as np
import pytest
from helpers.guard import guard_of
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.drivers.vibration_motors import VibrationMotors, VibrationMotorsConfig
from srl.runtime.cli.check import check_guards
from srl.runtime.contracts.cue import FELT, Cue
from srl.runtime.contracts.errors import SrlError, WiringError
from srl.runtime.contracts.signals import Command, Kind, Limits, Signal, Stop
from srl.runtime.guard import IntensityGuard
from srl.runtime.guard.intensity import LEAD, PAUSE, RESERVE, WINDOW
from srl.runtime.profile import profile, wiring
from srl.sim.devices.vibration_motors.felt import FeltMotor

DT = 0.01
LIMITS = {"level": 0.9, "level_rate": 20.0, "on_time": 2.0, "duty": 0.4}
USUAL = {"level": 1.0, "level_rate": 50.0, "on_time": 20.0, "duty": 0.5}  # of a motor, and of the profile with one


def felt(**limits: float) -> IntensityGuard:
    made = guard_of(Kind.INTENSITY, dt=DT, **LIMITS | limits)
    assert isinstance(made, IntensityGuard)
    made.bind(np.zeros(1))
    made.reset(np.zeros(1))
    return made


def step(guard: IntensityGuard, wanted: float, dt: float = DT) -> float:
    guard.step(np.array([wanted]), None, dt)
    return float(guard.applied[0])


wanted = st.one_of(st.floats(-1, 3), st.sampled_from([nan, inf, -inf, 1.0, 0.0, 1e300]))
pieces = st.lists(st.tuples(wanted, st.integers(1, 400), st.floats(0.002, 0.04)), min_size=1, max_size=8)


@given(pieces)
@settings(max_examples=60, deadline=None)
def test_limits_hold_for_any_demand(pieces: list[tuple[float, int, float]]) -> None:
    guard, before, on, off, time, total = felt(), 0.0, 0.0, 0.0, 0.0, 0.0
    for value, count, dt in pieces:
        for _ in range(count):
            level = step(guard, value, dt)
            assert 0.0 <= level <= min(LIMITS["level"], before + LIMITS["level_rate"] * dt + 1e-12)
            off = 0.0 if level > 0.0 else off + dt
            on = 0.0 if off >= PAUSE else on + dt * (level > 0.0)
            assert on <= LIMITS["on_time"] + 0.08  # two of the longest cycles
            time, total, before = time + dt, total + level * dt, level
    assert total <= LIMITS["duty"] * (time + WINDOW) + 0.1


def test_it_rises_within_its_rate_and_falls_at_once() -> None:
    guard = felt()
    assert [round(step(guard, 1.0), 2) for _ in range(5)] == [0.2, 0.4, 0.6, 0.8, 0.9]
    assert guard.limited
    assert step(guard, 0.0) == 0.0


def test_after_its_time_it_pauses() -> None:
    guard = felt(duty=1.0)
    levels = [step(guard, 0.5) for _ in range(600)]
    off = [i for i, level in enumerate(levels) if level == 0.0]
    assert off[0] == pytest.approx(2.0 / DT, abs=2)
    assert len([i for i in off if i < off[0] + 100]) == pytest.approx(PAUSE / DT, abs=2)


def test_a_gap_of_one_cycle_is_no_pause() -> None:
    guard = felt(duty=1.0)
    levels = [step(guard, 0.0 if i % 100 == 99 else 0.5) for i in range(250)]
    assert levels[-30:] == [0.0] * 30


def test_a_contact_that_lasts_fades_and_is_felt_all_the_time() -> None:
    guard = felt(**USUAL)
    levels = np.array([step(guard, 1.0) for _ in range(1900)])
    assert levels.max() > 0.98
    assert (np.diff(levels[5:]) <= 0.0).all()
    assert levels[1000] == pytest.approx(0.57, abs=0.01)
    assert levels[:1000].mean() == pytest.approx(0.72, abs=0.01)


def test_thirty_minutes_of_a_full_demand_keep_the_duty_and_a_reset_forgets_nothing() -> None:
    guard = felt()
    levels = []
    for i in range(30 * 60 * 100):
        if i % 5000 == 0:
            guard.reset(np.zeros(1))
        levels.append(step(guard, 1.0))
    windows = np.array(levels).reshape(-1, 6000).mean(axis=1)  # of a minute
    assert LIMITS["duty"] * 0.7 < windows.min()
    assert windows.max() < LIMITS["duty"] + 0.1


def test_a_long_cycle_is_charged_as_long_as_it_was() -> None:
    stalled, steady = felt(**USUAL), felt(**USUAL)
    for guard in (stalled, steady):
        step(guard, 1.0, 0.05)
    step(stalled, 1.0, 3.0)
    for _ in range(300):
        step(steady, 1.0)
    assert stalled._mean[0] == pytest.approx(steady._mean[0], rel=0.15)


def test_what_was_sent_is_charged_where_it_is_more() -> None:
    """A link that takes nothing, not even the off, leaves the motor on."""
    guard, sent = felt(duty=1.0), np.zeros(1)
    guard.bind(guard.applied, sent=sent)
    sent[0] = step(guard, 0.5)
    for _ in range(250):
        step(guard, 0.0)
    assert step(guard, 0.5) == 0.0  # it has had its time


def test_what_a_driver_says_it_sent_less_is_charged_as_it_was_applied() -> None:
    guard, sent = felt(**USUAL), np.zeros(1)
    guard.bind(guard.applied, sent=sent)
    total, count = 0.0, 6000
    for _ in range(count):
        guard.resynchronise(True, DT)
        total += step(guard, 1.0)
        sent[0] = 0.0  # it has sent what was applied
    assert total / count < USUAL["duty"] + 0.1


def test_a_device_that_isnt_commanded_rests() -> None:
    guard = felt(**USUAL)
    for _ in range(1900):
        step(guard, 1.0)
    for _ in range(6000):
        guard.idle(DT)
    assert max(step(guard, 1.0) for _ in range(10)) > 0.98


def test_an_element_that_is_no_number_is_off_and_the_others_go_on() -> None:
    guard = guard_of(Kind.INTENSITY, joints=3, dt=DT, **USUAL)
    guard.bind(np.zeros(3))
    guard.reset(np.zeros(3))
    for odd in (nan, inf, -inf):
        for _ in range(3):
            guard.step(np.array([0.5, odd, 1e308]), None, DT)
        assert guard.applied.tolist()[:2] == [0.5, 0.0]
        assert guard.applied[2] > 0.9
        assert guard.rejected


@pytest.mark.parametrize("category", [Stop.OFF, Stop.HOLD, Stop.RETRACT])
def test_every_stop_is_off_at_once_and_at_rest(category: Stop) -> None:
    guard = felt()
    step(guard, 1.0)
    guard.stop(category, DT)
    assert guard.applied[0] == 0.0
    assert guard.at_rest


def test_what_is_not_finite_is_off() -> None:
    guard = felt()
    step(guard, 1.0)
    assert step(guard, nan) == 0.0
    assert guard.rejected


def stopped(guard: IntensityGuard, loss: bool, seconds: float = 3.0) -> list[float]:
    """The levels of a stop."""
    guard.announce(loss)
    levels = []
    for _ in range(round(seconds / DT)):
        guard.stop(Stop.OFF, DT)
        assert guard.at_rest
        levels.append(float(guard.applied[0]))
    return levels


@pytest.mark.parametrize(("loss", "pulses"), [(False, 2), (True, 3)])
def test_a_cue_is_given_once_within_the_limits(loss: bool, pulses: int) -> None:
    guard = felt()
    guard.stop_cue, guard.loss_cue = Cue(pulses=2), Cue(pulses=3, level=1.0)
    levels = stopped(guard, loss)
    on = np.array(levels) > 0.0
    assert (np.diff(on.astype(int)) == 1).sum() == pulses
    assert max(levels) <= LIMITS["level"]
    assert not on[:24].any()
    assert not on[130:].any()
    guard.reset(np.zeros(1))
    guard.stop(Stop.OFF, DT)
    assert guard.applied[0] == 0.0  # a reset ends it


@pytest.mark.parametrize("before", [0.0, 0.5, 30.0, 1800.0])
@pytest.mark.parametrize("pulses", [1, 2, 3])
def test_the_wearer_feels_each_pulse_of_a_cue_even_after_a_long_contact(before: float, pulses: int) -> None:
    guard, motor, now = felt(**USUAL), FeltMotor(0.0, 1.0, 0.1), 0
    guard.stop_cue = Cue(pulses=pulses)
    for _ in range(round(before / DT)):
        motor.drive(step(guard, 1.0), now)
        now += round(DT * 1e9)
    had = motor.felt
    for level in stopped(guard, loss=False):
        motor.drive(level, now)
        now += round(DT * 1e9)
    motor.vibration(now)
    assert motor.felt - had == pulses


cues = st.builds(
    Cue, pulses=st.integers(1, 5), on=st.floats(0.1, 0.5), off=st.floats(0.15, 0.5), level=st.floats(FELT, 1.0)
)


@given(cues, st.floats(0.2, 1.0), st.floats(FELT, 1.0), st.floats(3.0, 100.0), st.floats(0.0, 60.0), st.integers(1, 4))
@settings(max_examples=60, deadline=None)
def test_each_pulse_of_any_allowed_cue_is_felt_after_any_contact_and_any_stops(
    cue: Cue, duty: float, level: float, rate: float, before: float, stops: int
) -> None:
    dt = 0.01
    guard, motor, now = felt(level=level, level_rate=rate, duty=duty, on_time=20.0), FeltMotor(0.0, 1.0, 0.1), 0
    try:
        guard.take_cues(cue, None)
    except WiringError:
        return
    for _ in range(round(before / dt)):
        motor.drive(step(guard, 1.0), now)
        now += round(dt * 1e9)
    for _ in range(stops):
        for k, each in enumerate(stopped(guard, loss=False, seconds=5.0)):
            motor.drive(each, now)
            now += round(dt * 1e9)
            if k == round(LEAD / dt) - 1:  # a contact that had just begun is felt until here
                had = motor.felt
        motor.vibration(now)
        assert motor.felt - had == cue.pulses
        guard.reset(np.zeros(1))


@given(st.lists(st.tuples(st.floats(0.05, 3.0), st.floats(0.05, 3.0)), min_size=1, max_size=12))
@settings(max_examples=30, deadline=None)
def test_contacts_and_stops_in_any_order_stay_within_the_reserve(turns: list[tuple[float, float]]) -> None:
    guard, total, time = felt(**USUAL), 0.0, 0.0
    guard.stop_cue = Cue(pulses=5, on=0.5, off=0.15, level=1.0)
    for contact, stop in turns:
        guard.reset(np.zeros(1))
        levels = [step(guard, 1.0) for _ in range(round(contact / DT))] + stopped(guard, False, stop)
        total, time = total + sum(levels) * DT, time + len(levels) * DT
    assert total <= RESERVE * USUAL["duty"] * (time + WINDOW) + 0.1


@pytest.mark.parametrize(
    ("kind", "limits", "words"),
    [
        (Kind.INTENSITY, LIMITS | {"velocity": 1.0}, "of kind intensity has no velocity"),
        (Kind.INTENSITY, {"level": 1.0}, "needs level_rate, on_time, duty.*Add level_rate there"),
        (Kind.POSITION, {"velocity": 1.0, "acceleration": 1.0, "level": 1.0}, "of kind position has no level"),
    ],
)
def test_limits_that_say_something_else_are_refused(kind: Kind, limits: dict[str, float], words: str) -> None:
    with pytest.raises(WiringError, match=words):
        guard_of(kind, dt=DT, **limits)


def test_a_link_that_stalled_at_a_level_goes_off_first() -> None:
    """The board goes on with what it had; the guard goes on from there, and falls at once."""
    guard, sent = felt(), np.zeros(1)
    guard.bind(guard.applied, sent=sent)
    for _ in range(10):
        guard.resynchronise(True, DT)
        sent[0] = step(guard, 0.9)
    for _ in range(50):  # nothing leaves
        guard.resynchronise(False, DT)
        step(guard, 0.2)
    assert guard.resyncs
    guard.resynchronise(False, DT)
    guard.stop(Stop.OFF, DT)
    assert guard.applied[0] == 0.0


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("guard.cuff.intensity_command.level", "5", "less than or equal to 1"),
        ("guard.cuff.intensity_command.duty", "50", "less than or equal to 1"),
        ("guard.cuff.intensity_command.following_error", "{window: 0.1}", "nothing measures what is felt"),
        ("guard.thumb.position_command.stop_cue", "{pulses: 2}", "of kind position gives no cues"),
    ],
)
def test_a_profile_that_says_something_else_is_refused(key: str, value: str, words: str) -> None:
    with pytest.raises(SrlError, match=words):
        wiring.build(*profile.load("third-thumb", ["feedback=cuff", f"{key}={value}"]))


@pytest.mark.parametrize(
    ("options", "home", "words"),
    [
        ({"stops": (Stop.HOLD,)}, False, "stops by: hold.*stops=.Stop.OFF"),
        ({"stops": (Stop.OFF, Stop.HOLD)}, False, "stops by: off, hold"),
        ({"feedback": "felt"}, False, "has a feedback or a home"),
        ({}, True, "has a feedback or a home"),
    ],
)
def test_a_driver_whose_intensity_is_more_than_that_is_refused(
    monkeypatch: pytest.MonkeyPatch, options: dict[str, Any], home: bool, words: str
) -> None:
    begin = VibrationMotors.__init__

    def other(self: VibrationMotors, name: str, config: VibrationMotorsConfig) -> None:
        begin(self, name, config)
        (command,) = self.commands
        self.commands = (replace(command, **options),)
        self.states = (Signal(name="felt", shape=(1,), unit="1"),)
        if home:
            self.home["intensity_command"] = np.zeros(1)

    monkeypatch.setattr(VibrationMotors, "__init__", other)
    with pytest.raises(WiringError, match=words):
        wiring.build(*profile.load("third-thumb", ["feedback=cuff"]))


@pytest.mark.parametrize(
    ("rate", "limits", "words"),
    [
        (16, {}, "0.1 s is less than two cycles of 0.0625 s"),
        (100, {"level": 0.2}, "reach 0.2 of full intensity"),
        (100, {"level_rate": 1.0}, "reach 0.1 of full intensity"),
        (100, {"level": {"wrist": 0.1}}, "reach 0.1 of full intensity"),
    ],
)
@pytest.mark.parametrize("key", ["stop_cue", "loss_cue"])
def test_a_cue_that_may_not_be_felt_is_refused(key: str, rate: int, limits: dict[str, Any], words: str) -> None:
    entry = "guard.cuff.intensity_command"
    given = ["feedback=cuff", f"rate={rate}", f"{entry}.stop_cue=null", f"{entry}.loss_cue=null"]
    given += [f"{entry}.{key}={{on: 0.1}}", *(f"{entry}.{name}={value}" for name, value in limits.items())]
    graph = wiring.build(*profile.load("third-thumb", given))
    with pytest.raises(WiringError, match=f"{entry}.{key}.*{words}"):
        check_guards(graph)


def test_a_driver_whose_own_limits_hide_a_cue_is_refused() -> None:
    with pytest.raises(WiringError, match=r"stop_cue.*reach 0.25 of full intensity"):
        felt(level=0.25).take_cues(Cue(), None)


@pytest.mark.parametrize(("name", "value"), [("duty", 2.0), ("duty", 0.1), ("level", 255.0)])
def test_what_a_driver_gives_in_percent_or_bytes_is_refused(name: str, value: float) -> None:
    values = {key: np.array([each]) for key, each in (USUAL | {name: value}).items()}
    command = Command(name="it", shape=(1,), unit="1", kind=Kind.INTENSITY, stops=(Stop.OFF,))
    with pytest.raises(WiringError, match=f"the {name} of an intensity is .*: it must be from"):
        IntensityGuard("guard.it", command, Limits(**values), DT)


@pytest.mark.parametrize(("above", "share"), [(0.2, 51 / 255), (1e-9, 0.0)])
def test_a_simulated_motor_that_comes_to_rest_at_the_threshold_is_counted_on(above: float, share: float) -> None:
    motor = FeltMotor(0.0, 1.0, above)
    motor.drive(1.0, 0)
    motor.drive(share, 10**9)
    for k in range(2000):
        motor.vibration(10**9 + k * 50_000_000)
    assert motor.felt == 1
