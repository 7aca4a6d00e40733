"""The order of events on the participant's screen, without a clock: what begins, ends, and is broken off."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from srl.runtime.ipc.rows import Condition
from srl.runtime.web.panel.session import GRACE, LATE, LEAD, Phase, Session
from srl.runtime.web.panel.source import Reading
from srl.runtime.web.panel.trial import ScreenTrial, Trial

TRIAL = Trial((0.2, 0.8, 0.4), duration=2.0, settle=1.0, number=2, of=9)
STEP = 0.01
NO_ROWS = np.empty((0, 2))


class Bench:
    """A session whose time is told to it."""

    def __init__(self) -> None:
        self.session, self.outcomes, self.now = Session(), list[ScreenTrial](), 100.0
        self.session.ended = self.outcomes.append
        self.reading = Reading(self.now, 0.5, Condition.LIVE, "", 0)

    def tick(
        self, condition: Condition = Condition.LIVE, words: str = "", generation: int = 0, row: bool = True
    ) -> None:
        self.now += STEP
        stamp = self.now if row else self.reading.stamp
        self.reading = Reading(stamp, 0.5, condition, words, generation)
        rows = np.array([[self.now, 0.5]]) if row else NO_ROWS
        self.session.tick(rows, self.reading, 0, self.now)

    def started(self, trial: Trial = TRIAL) -> Bench:
        self.session.offer(trial, self.now)
        self.tick()
        assert self.session.begin(self.now) == ""
        return self

    def until(self, t: float) -> Bench:
        """Time passes until t s after the curve's beginning."""
        began = self.session.began
        while self.now - began < t and self.session.phase is Phase.RUNNING:
            self.tick()
        return self

    @property
    def outcome(self) -> ScreenTrial:
        assert len(self.outcomes) == 1
        return self.outcomes[0]


def test_a_trial_gives_the_loops_own_rows_from_its_beginning_to_its_end() -> None:
    bench = Bench().started()
    began = bench.session.began
    assert began == pytest.approx(bench.now + LEAD + TRIAL.settle)
    bench.until(TRIAL.duration + 0.05)
    assert not bench.outcomes  # the page's last frames may come
    assert bench.session.frames([[began + 1.99, 0.5, 0.004]], True, 0.001) == ""
    bench.tick()
    done = bench.outcome
    assert done.aborted == ""
    assert done.samples[:, 0] == pytest.approx(np.arange(len(done.samples)) * STEP + done.samples[0, 0])
    assert 0 <= done.samples[0, 0] < STEP
    assert TRIAL.duration - STEP < done.samples[-1, 0] <= TRIAL.duration
    assert done.samples[:, 1] == pytest.approx(np.interp(done.samples[:, 0], [0, 1, 2], [0.2, 0.8, 0.4]))
    assert done.frames == pytest.approx(np.array([[1.99, 0.5, 0.004]]), abs=1e-6)
    assert bench.session.phase is Phase.IDLE


def test_a_page_that_sends_no_last_frames_keeps_no_trial_from_its_end() -> None:
    bench = Bench().started().until(TRIAL.duration + LATE + 0.05)
    assert bench.outcome.aborted == ""


def test_nothing_begins_without_a_trial_or_before_the_break_is_over_or_while_the_pointer_does_not_follow() -> None:
    bench = Bench()
    assert bench.session.begin(bench.now)
    bench.session.offer(Trial((0.0, 1.0), rest=3 * STEP), bench.now)
    bench.tick()
    assert "break" in bench.session.begin(bench.now)
    for _ in range(4):
        bench.tick(Condition.HELD, "held")
    assert "follows" in bench.session.begin(bench.now)
    bench.tick()
    assert bench.session.begin(bench.now) == ""
    assert bench.session.begin(bench.now)  # once


@pytest.mark.parametrize("condition", [Condition.ENDED, Condition.STOPPED])
def test_a_stop_or_the_runs_end_breaks_a_trial_off(condition: Condition) -> None:
    bench = Bench().started().until(0.5)
    bench.tick(condition, "The limb is stopped")
    assert bench.outcome.aborted == "The limb is stopped"
    assert bench.session.last_outcome == "The trial was broken off: the limb is stopped"
    bench.started()  # it can be repeated
    assert bench.session.phase is Phase.RUNNING


def test_a_loop_that_was_started_again_breaks_a_trial_off() -> None:
    bench = Bench().started().until(0.5)
    bench.tick(generation=1)
    assert "started again" in bench.outcome.aborted


def test_a_short_silence_is_told_and_a_long_one_breaks_the_trial_off() -> None:
    bench = Bench().started().until(0.2)
    for _ in range(20):
        bench.tick(Condition.SILENT, "no data", row=False)
    assert not bench.outcomes
    bench.tick()
    for _ in range(int(GRACE / STEP) + 2):
        bench.tick(Condition.SILENT, "no data", row=False)
    assert [words for _, words in bench.outcome.events] == ["no data", "The pointer follows again", "no data"]
    assert bench.outcome.aborted == "no data"


def test_a_held_value_is_told_and_breaks_nothing_off() -> None:
    bench = Bench().started().until(0.2)
    for _ in range(150):
        bench.tick(Condition.HELD, "held")
    bench.until(TRIAL.duration + LATE + 0.05)
    assert bench.outcome.aborted == ""
    (first, held), (second, again) = bench.outcome.events
    assert (held, again) == ("held", "The pointer follows again")
    assert second - first == pytest.approx(150 * STEP)


def test_a_new_trial_takes_the_place_of_one_that_waits() -> None:
    bench = Bench()
    bench.session.offer(TRIAL, bench.now)
    bench.session.offer(TRIAL, bench.now)
    assert "another trial" in bench.outcome.aborted
    assert bench.session.phase is Phase.WAITING


def test_more_frames_than_a_screen_can_show_are_refused() -> None:
    bench = Bench().started()
    answers = [bench.session.frames([[0.0, 0.0, 0.0]] * 500, False, 0.0) for _ in range(6)]
    assert not answers[0]
    assert answers[-1]


@given(
    steps=st.lists(
        st.sampled_from(["offer", "begin", "abort", "tick", "held", "silent", "stopped", "again", "frames", "final"]),
        max_size=60,
    )
)
def test_every_trial_has_exactly_one_outcome(steps: list[str]) -> None:
    bench = Bench()
    trial = Trial((0.0, 1.0), duration=3 * STEP, settle=0.0)
    offered = 0
    for step in steps:
        match step:
            case "offer":
                bench.session.offer(trial, bench.now)
                offered += 1
            case "begin":
                bench.session.begin(bench.now)
            case "abort":
                bench.session.abort("why", bench.now)
            case "frames" | "final":
                bench.session.frames([[bench.now, 0.0, 0.0]], step == "final", 0.0)
            case "held" | "stopped":
                bench.tick(Condition(step), step)
            case "silent":
                bench.tick(Condition.SILENT, "silent", row=False)
            case _:
                bench.tick(generation=int(step == "again"))
        waits = bench.session.phase is not Phase.IDLE
        assert len(bench.outcomes) == offered - waits
        assert (bench.session.trial is not None) == waits


@pytest.mark.parametrize(
    "wrong",
    [
        {"curve": (0.5,)}, {"curve": (0.0, 1.1)}, {"curve": (0.0, float("nan"))}, {"duration": 0.0},
        {"settle": float("inf")}, {"rest": -1.0}, {"number": 3, "of": 2}, {"number": 0},
    ],
)  # fmt: skip
def test_a_trial_that_makes_no_sense_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"curve|trial"):
        Trial(**({"curve": (0.0, 1.0)} | wrong))  # type: ignore[arg-type]
