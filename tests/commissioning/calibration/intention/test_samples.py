"""Which samples of a calibration's run belong to which repetition of an action."""

from __future__ import annotations

import numpy as np
import pytest

from srl.commissioning.calibration.intention.marks import IDLE, STAND, VOID, mark_of
from srl.commissioning.calibration.intention.method import IntentionMethod
from srl.commissioning.calibration.intention.procedure import Kind, Plan, Procedure
from srl.commissioning.calibration.intention.samples import Samples, trials
from srl.commissioning.calibration.marks import ended
from srl.control.intention.features import FRAME
from srl.control.intention.training import Thresholds, Trial
from srl.runtime.contracts.signals import Array

ACTIONS = ("overhead", "wave")
PLAIN = Thresholds(lead=0.0, settle=0.0)


def run(*parts: tuple[int, float, float], pauses: tuple[float, ...] = ()) -> Samples:
    """A run of parts (mark, value of all features, s) at 100 Hz; after each part `pauses` s without a sample."""
    times, frames, marks, t = [], [], [], 0.0
    for (mark, value, span), pause in zip(parts, pauses or (0.0,) * len(parts), strict=True):
        n = round(span * 100)
        times.append(t + np.arange(n) * 0.01)
        frames.append(np.full((n, FRAME), value))
        marks.append(np.full(n, mark, np.intp))
        t += span + pause
    return Samples(np.concatenate(times), np.concatenate(frames), np.concatenate(marks))


def values(found: list[Trial]) -> dict[tuple[str, int], Array]:
    return {(trial.label, trial.group): trial.frames[:, 0] for trial in found}


def test_a_repetition_that_was_broken_off_replaces_none() -> None:
    wave, stand = mark_of(0, 1), mark_of(0, STAND)
    samples = run(
        (stand, 9.0, 2), (wave, 1.0, 3), (IDLE, 0.0, 1), (wave, 2.0, 1), (VOID, 0.0, 1), (mark_of(0, 0), 3.0, 3)
    )
    found = values(trials([samples], ACTIONS, PLAIN))
    assert set(found) == {("stand", 0), ("wave", 0), ("overhead", 0)}
    assert set(found["wave", 0]) == {1.0}
    assert len(found["wave", 0]) == pytest.approx(60, abs=1)


def test_one_in_which_a_recording_ends_replaces_none() -> None:
    wave = mark_of(0, 1)
    whole = run((wave, 1.0, 3), (IDLE, 0.0, 1))
    broken = run((IDLE, 0.0, 1), (wave, 2.0, 1))
    counted = IntentionMethod.counted.__contains__
    cut = [ended(each, counted) for each in (whole, broken)]
    assert set(values(trials(cut, ACTIONS, PLAIN))["wave", 0]) == {1.0}
    assert set(values(trials([whole, broken], ACTIONS, PLAIN))["wave", 0]) == {2.0}
    assert (cut[0].marks == whole.marks).all()


def test_a_stop_is_cut_out() -> None:
    wave = mark_of(0, 1)
    stopped = run((wave, 1.0, 1), (wave, 2.0, 2), pauses=(40.0, 0.0))
    found = values(trials([stopped], ACTIONS, PLAIN))["wave", 0]
    assert len(found) == pytest.approx(60, abs=2)
    assert (found == 1.0).sum() == pytest.approx(20, abs=2)


@pytest.mark.parametrize("broken", [True, False])
def test_what_redo_breaks_off_is_marked(broken: bool) -> None:
    procedure = Procedure(ACTIONS, Plan(rounds=3))
    while procedure.step.kind is not Kind.ACTION:
        procedure.go_on()
    left = procedure.step
    if not broken:
        procedure.go_on()
    assert procedure.redo(2 - left.action) == ""
    assert (procedure.step.kind, procedure.step.mark) == (Kind.PAUSE, VOID if broken else IDLE)
    steps = []
    while not procedure.done:
        steps.append(procedure.step)
        procedure.go_on()
    assert (left in steps) == broken
    assert all(step.mark in (VOID, IDLE) for step in steps if step.kind is Kind.PAUSE)


def test_an_action_that_nobody_saw_is_weak() -> None:
    procedure = Procedure(ACTIONS, Plan(rounds=3))
    while not procedure.done:
        procedure.go_on()
    assert all(state.endswith("nothing was seen") for state in procedure.view().states)
