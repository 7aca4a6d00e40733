"""What no joint and no sensor can have done is no sample; what they can have done is taken, and never late."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.compiled import needs_c
from hypothesis import given
from hypothesis import strategies as st

from srl.runtime.contracts.compiled import undone
from srl.runtime.contracts.plausible import plausible
from srl.runtime.contracts.signals import Signal
from srl.runtime.contracts.terms import POSE, WRENCH
from srl.runtime.guard.samples import AGREE, HAND, SLACK, SPEED, SampleCheck

DT = 10_000_000  # ns
FAST = 2.0  # rad/s
JOINTS = ("one", "two")
SIGNALS = (
    Signal(name="position", shape=(2,), unit="rad", labels=JOINTS),
    Signal(name="velocity", shape=(2,), unit="rad/s", labels=JOINTS),
)
REACH = SLACK["rad"] + SPEED * FAST * DT * 1e-9


class Arm:
    """Two joints whose samples are judged."""

    def __init__(self, in_c: bool = True, signals: tuple[Signal, ...] = SIGNALS) -> None:
        self.row = np.zeros(sum(s.size for s in signals))
        self.arrays, at = {}, 0
        for s in signals:
            self.arrays[s.name] = self.row[at : at + s.size].reshape(s.shape)
            at += s.size
        self.check = SampleCheck(signals, self.arrays)
        if not in_c:
            self.check._steps = [(undone, piece, rows) for _, piece, rows in self.check._steps]
        self.now = 0

    def was_active(self) -> Arm:
        self.check.expect("position", np.full(2, FAST))
        return self

    def at(self, *position: float, new: bool = True, cycles: int = 1, **others: float) -> bool:
        for _ in range(cycles):
            self.now += DT
            self.arrays["position"][:] = position
            for name, value in others.items():
                self.arrays[name][:] = value
            taken = self.check.take(self.now if new else self.check._seen, self.now)
        return taken

    @property
    def place(self) -> list[float]:
        return [float(v) for v in self.arrays["position"]]


@pytest.mark.parametrize("wrong", [0.3, -0.3, 1.5, 100.0, 1e300, -3e38])
def test_one_wrong_sample_is_not_taken_and_the_one_before_stays(wrong: float) -> None:
    arm = Arm().was_active()
    arm.at(0.1, 0.2, cycles=AGREE)
    assert not arm.at(wrong, 0.2)
    assert arm.place == [0.1, 0.2]
    assert arm.check.odd is not None
    assert (arm.check.odd.signal, arm.check.odd.element) == ("position", "one")
    assert arm.at(0.1, 0.2)
    assert arm.check.refused == 1


def test_a_value_that_is_not_known_is_none_that_is_wrong() -> None:
    arm = Arm().was_active()
    arm.at(0.1, 0.2, cycles=AGREE)
    assert arm.at(np.nan, 0.2)
    assert not arm.at(0.5, 0.2)  # and it hides no jump
    assert arm.at(0.1, 0.2)


@pytest.mark.parametrize("place", [np.inf, -np.inf])
def test_a_joint_that_is_at_infinity_is_wrong_not_unknown(place: float) -> None:
    arm = Arm().was_active()
    arm.at(0.1, 0.2, cycles=AGREE)
    assert not arm.at(place, 0.2)
    assert arm.place == [0.1, 0.2]
    assert arm.at(0.1, 0.2)


def test_a_refused_sample_that_stands_still_grows_old() -> None:
    arm = Arm().was_active()
    arm.at(0.1, 0.2, cycles=AGREE)
    assert not arm.at(0.9, 0.2)
    assert not arm.at(*arm.place, new=False, cycles=5)
    assert arm.place == [0.1, 0.2]


def test_the_first_samples_must_agree_before_any_counts() -> None:
    arm = Arm().was_active()
    arm.at(3.0, 0.2)
    arm.at(0.1, 0.2)
    arm.at(0.1, 0.2, cycles=AGREE - 2)
    assert not arm.check.settled
    arm.at(0.1, 0.2, new=False, cycles=5)
    assert not arm.check.settled, "the same sample agrees with itself"
    arm.at(0.1, 0.2)
    assert arm.check.settled
    assert arm.place == [0.1, 0.2]


def test_what_stays_where_it_jumped_to_is_taken_and_said() -> None:
    arm = Arm().was_active()
    arm.at(0.1, 0.2, cycles=AGREE)
    taken = [arm.at(0.9, 0.2) for _ in range(AGREE)]
    assert taken == [False] * (AGREE - 1) + [True]
    assert arm.check.jumped
    arm.at(0.9, 0.2)
    assert not arm.check.jumped


def test_a_joint_without_a_command_may_be_anywhere() -> None:
    arm = Arm()
    arm.at(0.1, 0.2, cycles=AGREE)
    assert arm.at(3.0, 0.2)


def test_after_a_loss_it_may_be_anywhere() -> None:
    arm = Arm().was_active()
    arm.at(0.1, 0.2, cycles=AGREE)
    arm.check.forget()
    arm.at(1.2, 0.2, cycles=AGREE)
    assert arm.check.settled
    assert not arm.check.jumped
    assert arm.place == [1.2, 0.2]


motion = st.lists(st.floats(-1, 1), min_size=2, max_size=60)


@given(motion, st.floats(-3, 3), st.sampled_from((1, 3, 16)))
def test_no_motion_within_the_limit_is_ever_refused(speeds: list[float], start: float, every: int) -> None:
    """A device may sample more slowly than the loop runs."""
    arm, q = Arm().was_active(), start
    arm.at(q, 0.0, cycles=AGREE)
    for k, share in enumerate(speeds):
        q += share * FAST * DT * 1e-9 * (k % every == 0)
        assert arm.at(q, 0.0, new=k % every == 0)


@given(st.floats(1, 15), st.floats(20, 300))
def test_a_hand_moves_a_limp_joint_faster_than_any_command_and_no_sample_is_refused(top: float, push: float) -> None:
    arm, q, v = Arm().was_active(), 0.0, 0.0
    arm.at(q, 0.0, cycles=AGREE)
    dt = DT * 1e-9
    for _ in range(60):
        v = min(v + min(push, (SLACK["rad"] + SPEED * FAST * dt) / dt**2) * dt, top)
        q += v * dt
        assert arm.at(q, 0.0)
        assert not arm.check.jumped


@given(motion, st.integers(0, 59), st.floats(allow_nan=False))
def test_no_single_sample_moves_what_is_used_beyond_what_a_joint_can_do(
    speeds: list[float], when: int, wrong: float
) -> None:
    when %= len(speeds)
    arm, q = Arm().was_active(), 0.0
    arm.at(q, 0.0, cycles=AGREE)
    for k, share in enumerate(speeds):
        before = arm.place[0]
        q += share * FAST * DT * 1e-9
        arm.at(wrong if k == when else q, 0.0)
        if np.isfinite(arm.place[0]):
            assert abs(arm.place[0] - before) <= 2 * REACH
        else:
            arm.arrays["position"][0] = before


samples = st.lists(
    st.tuples(
        *[st.floats(width=32) | st.sampled_from((0.0, 0.01, 0.02, 0.3, np.nan, np.inf, 1e300))] * 4,
        st.booleans(), st.sampled_from((0, 1, 10, 100)),
    ),
    max_size=30,
)  # fmt: skip


@needs_c
@pytest.mark.slow
@given(samples)
def test_c_judges_as_python_does(series: list[tuple[Any, ...]]) -> None:
    both = Arm(True).was_active(), Arm(False).was_active()
    for *values, new, step in series:
        for arm in both:
            arm.now += step * DT
            arm.row[:] = values
            arm.check.take(arm.now if new else arm.check._seen, arm.now)
        one, other = both
        assert one.row.tobytes() == other.row.tobytes()
        assert one.check._state.tobytes() == other.check._state.tobytes()
        assert (one.check.odd, one.check.jumped, one.check.refused) == (
            other.check.odd, other.check.jumped, other.check.refused,
        )  # fmt: skip


def test_a_force_beyond_the_sensor_is_none_and_a_jump_needs_more_than_one_sample() -> None:
    signal = Signal(name="position", shape=(6,), unit="N, N m", labels=WRENCH)
    arm = Arm(signals=(signal,))
    most = np.array([800.0] * 3 + [40.0] * 3)
    arm.check.narrow("position", -most, most)
    zero = [0.0] * 6
    arm.at(*zero, cycles=AGREE)
    assert not arm.at(0, 0, 801.0, 0, 0, 0)
    assert not arm.at(0, 0, 300.0, 0, 0, 0)
    assert arm.at(0, 0, 100.0, 0, 0, 0)
    assert [arm.at(0, 0, 400.0, 0, 0, 0) for _ in range(AGREE)] == [False] * (AGREE - 1) + [True]


@pytest.mark.parametrize("ranges", [[(-1.0, 2.0)], [(-1.0, 9.0), (-9.0, 2.0)], [(-9.0, 2.0), (-1.0, 9.0)]])
def test_what_narrows_a_range_widens_no_side_of_it(ranges: list[tuple[float, float]]) -> None:
    """The signal's own range is -3 to 3."""
    signal = Signal(name="position", shape=(1,), unit="1", plausible=(-3.0, 3.0))
    arm = Arm(signals=(signal,))
    arm.check.narrow("position", np.array([-5.0]), np.array([5.0]))
    assert arm.at(-2.9)
    assert arm.at(2.9)
    assert not arm.at(-3.1)
    assert not arm.at(3.1)
    for low, high in ranges:
        arm.check.narrow("position", np.array([low]), np.array([high]))
    assert arm.at(-0.9)
    assert arm.at(1.9)
    assert not arm.at(-1.1)
    assert not arm.at(2.1)


def test_each_sample_that_is_refused_is_counted_once() -> None:
    arm = Arm().was_active()
    arm.at(0.1, 0.2, cycles=AGREE)
    assert arm.check.refused == 0
    for count in (1, 2, 3):
        assert not arm.at(1e6 * count, 0.2)
        assert not arm.at(*arm.place, new=False, cycles=4)
        assert arm.check.refused == count
        assert arm.at(0.1, 0.2)
    arm.check.forget()
    assert arm.check.refused == 3, "it is the count since the start"


@pytest.mark.parametrize(
    ("signal", "inside", "outside"),
    [
        (Signal(name="a", shape=(7,), unit="m", labels=POSE), [9e3, 0, 0, 1, 0, 0, 0], [2e4, 0, 0, 1, 0, 0, 0]),
        (Signal(name="a", shape=(7,), unit="m", labels=POSE), [0, 0, 0, 1, 0, 0, 0], [0, 0, 0, 1.1, 0, 0, 0]),
        (Signal(name="a", shape=(1,), unit="m/s^2"), [300.0], [5e3]),
        (Signal(name="a", shape=(1,), unit="degC"), [80.0], [1e3]),
        (Signal(name="a", shape=(1,), unit="furlong"), [1e6], [1e12]),
        (Signal(name="a", shape=(2,), unit="rad", labels=JOINTS, plausible=(-3.0, (3.0, 4.0))), [-3, 4], [0, 4.1]),
    ],
)
def test_the_range_is_that_of_the_unit_the_quantity_or_the_device(
    signal: Signal, inside: list[float], outside: list[float]
) -> None:
    low, high = plausible(signal)
    assert ((low <= inside) & (inside <= high)).all()
    assert not ((low <= outside) & (outside <= high)).all()


def test_each_state_has_its_own_range_and_only_what_is_commanded_its_steps() -> None:
    """The position stands between two others."""
    signals = (
        Signal(name="temperature", shape=(1,), unit="degC"),
        *SIGNALS,
        Signal(name="force", shape=(1,), unit="N"),
    )
    arm = Arm(signals=signals).was_active()
    arm.check.narrow("force", np.array([-20.0]), np.array([20.0]))
    arm.at(0.1, 0.2, cycles=AGREE, temperature=20.0, velocity=0.0, force=0.0)
    assert arm.at(0.1, 0.2, temperature=90.0, velocity=5.0)
    for wrong, name in ({"temperature": 1e3}, "temperature"), ({"force": 21.0}, "force"), ({"force": 6.0}, "force"):
        assert not arm.at(0.1, 0.2, **wrong)
        assert arm.check.odd is not None
        assert arm.check.odd.signal == name
        assert arm.at(0.1, 0.2)
    assert not arm.at(0.1, 0.6)
    assert arm.check.odd is not None
    assert (arm.check.odd.signal, arm.check.odd.element) == ("position", "two")
    assert f"{0.6:g} rad after 0.2" in arm.check.last


def test_a_joint_that_slides_has_a_margin_of_its_own_unit() -> None:
    slide = Signal(name="position", shape=(2,), unit="m", labels=JOINTS)
    arm = Arm(signals=(slide,)).was_active()
    arm.at(0.1, 0.2, cycles=AGREE)
    assert not arm.at(0.1 + SLACK["m"] + SPEED * FAST * DT * 1e-9 + 1e-6, 0.2)
    assert arm.at(0.1 + SLACK["m"], 0.2)


def test_two_wrong_samples_in_a_line_are_no_motion() -> None:
    """They became a position, and the start of a command."""
    arm = Arm().was_active()
    arm.at(0.0, 0.2, cycles=AGREE)
    assert [arm.at(wrong, 0.2) for wrong in (0.4, 0.8, 1.2)] == [False] * 3
    assert arm.place == [0.0, 0.2]


def test_steps_that_grow_are_believed_as_far_as_a_hand_can_move_a_joint() -> None:
    arm, steps = Arm().was_active(), [0.0]
    arm.at(0.0, 0.2, cycles=AGREE)
    for k in range(1, 40):
        arm.at(0.02 * k * k, 0.2)
        steps.append(arm.place[0])
    assert np.diff(steps).max() <= HAND * DT * 1e-9 + REACH


def test_what_wasn_t_known_before_an_absurd_sample_isn_t_known_after_it() -> None:
    arm = Arm().was_active()
    arm.at(0.1, 0.2, cycles=AGREE, velocity=1.0)
    assert arm.at(0.1, 0.2, velocity=np.nan)
    assert not arm.at(1e12, 0.2, velocity=np.nan)
    assert np.isnan(arm.arrays["velocity"]).all()
    assert arm.place == [0.1, 0.2]


def test_a_stamp_that_lies_ahead_hardly_widens_the_margin() -> None:
    arm = Arm().was_active()
    arm.at(0.1, 0.2, cycles=AGREE)
    arm.now += DT
    arm.arrays["position"][:] = 0.1 + SLACK["rad"] + 2.1 * SPEED * FAST * DT * 1e-9, 0.2
    assert not arm.check.take(arm.now + 10 * DT, arm.now)


def test_an_element_without_a_name_is_called_by_its_number_and_one_alone_by_none() -> None:
    signals = (
        Signal(name="position", shape=(2, 3), unit="1", plausible=(-1.0, 1.0)),
        Signal(name="single", shape=(), unit="1", plausible=(-1.0, 1.0)),
    )
    arm = Arm(signals=signals)
    for i in range(6):
        values = np.zeros((2, 3))
        values.flat[i] = 9.0
        arm.now += DT
        arm.arrays["position"][:] = values
        assert not arm.check.take(arm.now, arm.now)
        assert arm.check.odd is not None
        assert arm.check.odd.element == str(i // 3)
        assert arm.check.last.startswith(f"position[{i // 3}] 9")
    arm.now += DT
    arm.arrays["position"][:], arm.arrays["single"][...] = 0.0, 9.0
    assert not arm.check.take(arm.now, arm.now)
    assert arm.check.odd is not None
    assert (arm.check.odd.signal, arm.check.odd.element) == ("single", "")
    assert arm.check.last.startswith("single 9")


def test_until_it_is_settled_the_first_samples_are_shown() -> None:
    arm = Arm().was_active()
    for k in range(1, AGREE + 1):
        arm.at(0.1, 0.2)
        assert arm.place == [0.1, 0.2]
        assert arm.check.settled == (k == AGREE)


def test_a_velocity_that_is_not_that_of_its_position_is_replaced_and_nothing_beside_it() -> None:
    signals = (*SIGNALS, Signal(name="force", shape=(3,), unit="N"))
    arm = Arm(signals=signals).was_active()
    arm.check.compare("position", "velocity")
    arm.arrays["force"][:] = 1.0, 2.0, 3.0
    q = 0.0
    for k in range(100):
        q += 1.0 * DT * 1e-9
        arm.arrays["velocity"][:] = (5.0 if k >= 30 else 1.0), 0.0
        assert arm.at(q, 0.2)
        if k >= 40:
            assert arm.arrays["velocity"] == pytest.approx([1.0, 0.0], abs=0.3)
        assert arm.arrays["force"].tolist() == [1.0, 2.0, 3.0]
    assert "velocity[one]" in arm.check.untrue
    stands = arm.row.copy()
    assert not arm.at(1e6, 0.2)
    assert arm.row.tolist() == stands.tolist()


def test_a_stamp_that_lies_ahead_widens_the_margin_by_one_cycle() -> None:
    for cycles, taken in ((1.9, True), (2.1, False)):
        arm = Arm().was_active()
        arm.at(0.1, 0.2, cycles=AGREE)
        arm.now += DT
        arm.arrays["position"][:] = 0.1 + SLACK["rad"] + cycles * SPEED * FAST * DT * 1e-9, 0.2
        assert arm.check.take(arm.now + 10 * DT, arm.now) == taken


@pytest.mark.parametrize("step", [0.1, 0.2, -0.2])
def test_a_joint_that_is_moved_at_once_as_fast_as_a_hand_can_is_believed_at_the_third_sample(step: float) -> None:
    arm = Arm().was_active()
    arm.at(0.0, 0.2, cycles=AGREE)
    assert [arm.at(k * step, 0.2) for k in range(1, 6)] == [False, False, True, True, True]
    assert not arm.check.jumped
