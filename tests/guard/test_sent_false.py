"""A report of what was sent that can't be true: it moves nothing, and it is said once it has lasted."""

from __future__ import annotations

import numpy as np
import pytest

from srl.runtime.contracts.signals import Command, Kind, Stop
from srl.runtime.guard import GUARDS, GuardLimits
from srl.runtime.guard.sent import SentTracker

DT, PERIOD, RESOLUTION = 0.01, 0.1, 0.01
WAIT = PERIOD + DT  # s that a command may wait for its link
LASTS = round(WAIT / DT)  # cycles
# What the report of a cycle is: of what was applied, as far off as is normal, or something else.
EXACT, NEAR, FALSE, NOTHING = "exact", "near", "false", "nothing is transmitted"


class Link:
    """A guard at work, and a driver that reports now the truth and now something else."""

    def __init__(self, kind: Kind = Kind.POSITION, resolution: float = RESOLUTION) -> None:
        command = Command(name="c", shape=(2,), unit="1", kind=kind, period=PERIOD, resolution=resolution)
        limits = GuardLimits(velocity=1.0, acceleration=10.0, effort=20.0, effort_rate=50.0, inertia=1.0)
        self.guard = GUARDS[kind]("guard.c", command, limits.to_limits((2,), "guard.c"), DT)
        self.applied, self.sent = np.zeros(2), np.full(2, np.nan)
        self.guard.bind(self.applied, np.zeros(2), np.zeros(2), self.sent)
        self.guard.reset(np.zeros(2))
        self.left, self.cycles = False, 0

    def cycle(self, report: str, by: float = 1.0, side: float = 1.0) -> bool:
        """The guard's cycle, then the driver's; whether what the driver said before can't be true any more."""
        self.guard.resynchronise(self.left, DT)
        self.cycles += 1
        self.guard.step(np.full(2, 0.3 * side * np.sin(0.05 * self.cycles)), None, DT)
        self.left = report != NOTHING
        if self.left:
            self.sent[:] = self.applied
            self.sent[1] += {EXACT: 0.0, NEAR: RESOLUTION / 2, FALSE: by}[report]
        return self.guard.misreported

    def run(self, *reports: str) -> bool:
        return [self.cycle(report) for report in reports][-1]


def until_it_is_said(link: Link, *pattern: str) -> int:
    """Cycles with false reports until it is said."""
    for k in range(1000):
        if link.guard.misreported:
            return sum(pattern[i % len(pattern)] is FALSE for i in range(k - 1))
        link.cycle(pattern[k % len(pattern)])
    return -1


def test_a_false_report_is_said_once_it_has_lasted_for_as_long_as_a_command_may_wait() -> None:
    link = Link()
    link.run(*[NEAR] * 30)
    assert LASTS <= until_it_is_said(link, FALSE) <= LASTS + 1
    assert not link.run(EXACT, EXACT), "and no more once all is sent as applied"


def test_reports_that_were_true_for_long_excuse_no_more_than_the_false_ones_before_them() -> None:
    link = Link()
    link.run(*[FALSE] * 5, *[NEAR] * 500)
    assert LASTS <= until_it_is_said(link, FALSE) <= LASTS + 1


def test_a_report_that_can_be_true_makes_up_for_one_that_cannot() -> None:
    assert until_it_is_said(Link(), FALSE, NEAR) == -1
    assert until_it_is_said(Link(), NEAR, NEAR, FALSE) == -1
    two_of_three = until_it_is_said(Link(), FALSE, FALSE, NEAR)
    assert 2 * LASTS - 4 <= two_of_three <= 2 * LASTS + 2


def test_a_cycle_in_which_nothing_is_transmitted_shows_nothing() -> None:
    link = Link()
    assert LASTS <= until_it_is_said(link, FALSE, NOTHING, NOTHING) <= LASTS + 1
    assert link.run(*[NOTHING] * 5)
    assert until_it_is_said(Link(), NEAR, NOTHING, NOTHING) == -1


@pytest.mark.parametrize("kind", [kind for kind in Kind if kind is not Kind.INTENSITY])
@pytest.mark.parametrize("by", [50.0, -50.0])
def test_a_false_report_leaves_the_motion_and_the_stop_as_they_are(kind: Kind, by: float) -> None:
    link, other = Link(kind), Link(kind)
    for k in range(200):
        link.cycle(FALSE if k % 20 > 10 else EXACT, by)
        other.cycle(EXACT)
        if k % 50 > 40:
            for each in (link, other):
                each.guard.stop(Stop.HOLD, DT)
                each.sent[0] = each.applied[0]
        assert not link.guard.resynchronised
        assert link.applied.tolist() == other.applied.tolist()


# -- the tracker alone


def tracker(kind: Kind = Kind.POSITION) -> SentTracker:
    """Of two elements, to which 1 was applied and sent."""
    made = SentTracker(kind, 5 * DT, [0.25, 0.25])
    made.restart([1.0, 1.0])
    assert made.compare([1.0, 1.0], [1.0, 1.0], True, DT) == []
    return made


@pytest.mark.parametrize(
    ("kind", "sent", "false"),
    [
        (Kind.POSITION, 1.25, False), (Kind.POSITION, 2.25, False), (Kind.POSITION, 0.75, False),
        (Kind.POSITION, 0.625, True), (Kind.POSITION, 2.375, True), (Kind.POSITION, -1.0, True),
        (Kind.VELOCITY, 0.625, False), (Kind.VELOCITY, 2.375, True), (Kind.VELOCITY, -0.25, False),
        (Kind.VELOCITY, -0.375, True), (Kind.TORQUE, 0.0, False), (Kind.TORQUE, -1.0, True),
        (Kind.POSITION, np.nan, False), (Kind.POSITION, np.inf, False),
    ],
)  # fmt: skip
def test_only_what_was_applied_since_one_was_taken_can_have_been_sent(kind: Kind, sent: float, false: bool) -> None:
    """From 1 to 2 was applied, with a resolution of 0.25. A velocity or torque may end, too."""
    made = tracker(kind)
    for applied in (1.5, 1.75, 2.0):
        assert made.compare([1.0, 1.0], [1.0, applied], False, DT) == []
    parted = made.compare([1.0, sent], [1.0, 2.0], True, DT)
    assert made.false == (DT if false else 0.0)
    if false:
        assert parted == []


def test_the_other_elements_part_from_the_guard_beside_one_that_is_false() -> None:
    made = tracker()
    made.compare([1.0, 1.0], [1.5, 1.5], False, DT)
    made.compare([1.0, 1.0], [2.0, 2.0], False, DT)
    assert made.compare([50.0, 1.5], [2.5, 2.5], True, DT) == [1]
    assert made.restart_at[1] == 1.5
    assert made.false == DT


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("off", [0.0, 0.125])
def test_what_was_applied_before_the_newest_one_that_was_taken_cannot_be_sent_any_more(side: float, off: float) -> None:
    """It was taken as it is, or as near as the device can tell apart."""
    made = SentTracker(Kind.POSITION, 5 * DT, [0.25])
    made.restart([side])
    assert made.compare([side], [side], True, DT) == []
    assert made.compare([2.0 * side + off], [2.0 * side], True, DT) == []
    assert not made.stalled
    made.compare([side], [3.0 * side], True, DT)
    assert made.false == DT


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("sent", "false"), [(2.0, 0.0), (2.5, 0.0), (3.0, 0.0), (1.0, DT), (3.5, DT)])
def test_after_one_that_left_in_the_next_read_the_range_is_that_of_two_cycles(
    side: float, sent: float, false: float
) -> None:
    made = SentTracker(Kind.POSITION, 5 * DT, [0.25])
    made.restart([side])
    made.compare([side], [side], True, DT)
    assert made.compare([side], [2.0 * side], True, DT) == []
    assert made.compare([2.0 * side], [3.0 * side], True, DT) == []
    assert not made.stalled
    made.compare([sent * side], [3.0 * side], True, DT)
    assert made.false == false


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_what_was_applied_as_the_newest_one_was_taken_stays_in_the_range(side: float) -> None:
    made = SentTracker(Kind.POSITION, 5 * DT, [0.25])
    made.restart([side])
    made.compare([side], [side], True, DT)
    for sent, applied, transmitted in ((1.0, 2.0, True), (2.0, 3.0, True), (2.0, 2.5, False), (3.0, 2.0, True)):
        made.compare([sent * side], [applied * side], transmitted, DT)
    assert made.false == 0.0


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("kind", [kind for kind in Kind if kind is not Kind.INTENSITY])
def test_what_was_sent_last_is_believed_within_what_was_applied(kind: Kind, side: float) -> None:
    """A start begins there: in another unit or sign it would be anywhere."""
    link = Link(kind, resolution=0.0)
    for _ in range(10):
        link.cycle(EXACT, side=side)
    first = link.applied.copy()
    for _ in range(3):
        link.cycle(NOTHING, side=side)
    assert link.guard.last_sent().tolist() == first.tolist()
    last = link.applied.copy()
    assert (side * last > side * first).all()
    for sent, accepted in ((1e6 * side, last), (-1e6 * side, first if kind is Kind.POSITION else np.zeros(2))):
        link.sent[:] = sent
        assert link.guard.last_sent().tolist() == accepted.tolist()
    link.sent[:] = (first + last) / 2
    assert link.guard.last_sent().tolist() == link.sent.tolist()
    link.sent[1] = np.nan
    assert np.isnan(link.guard.last_sent()).tolist() == [False, True]
