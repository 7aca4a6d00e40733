"""The control value and its condition, from a made-up loop's rows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.panel import SIGNAL, MadeUpLoop

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.ipc.header import LINK_CONNECTED, LINK_STALE, State
from srl.runtime.ipc.rows import LOOK, SILENCE, Condition
from srl.runtime.web.panel.source import Source


@pytest.fixture
def loop(tmp_path: Path) -> MadeUpLoop:
    return MadeUpLoop(tmp_path / "run")


def test_every_row_comes_once_with_its_time(loop: MadeUpLoop) -> None:
    source = Source(loop.folder, SIGNAL)
    taken = []
    for i in range(50):
        loop.value = i / 50
        loop.step(10 + i / 100)
        if i % 7 == 0 or i == 49:
            taken.append(source.take(10 + i / 100)[0])
    rows = np.concatenate(taken)
    assert rows[:, 0] == pytest.approx(10 + np.arange(50) / 100)
    assert rows[:, 1] == pytest.approx(np.arange(50) / 50)
    assert source.lost == 0


def test_the_value_is_mapped_by_the_span(loop: MadeUpLoop) -> None:
    source = Source(loop.folder, SIGNAL, span=(-1.0, 3.0))
    loop.value = 2.0
    loop.step(10.0)
    assert source.take(10.0)[1].value == pytest.approx(0.75)


def test_before_the_first_row_there_is_no_data(loop: MadeUpLoop) -> None:
    reading = Source(loop.folder, SIGNAL).take(10.0)[1]
    assert reading.condition is Condition.SILENT
    assert np.isnan(reading.value)


@pytest.mark.parametrize(
    ("change", "condition", "words"),
    [
        ({}, Condition.LIVE, ""),
        ({"link": LINK_CONNECTED | LINK_STALE}, Condition.HELD, "vicon"),
        ({"link": 0}, Condition.HELD, "vicon"),
        ({"held": 1.0}, Condition.HELD, "seen"),
        ({"value": float("nan")}, Condition.HELD, "no value"),
        ({"state": State.STOPPED}, Condition.STOPPED, "stopped"),
        ({"state": State.READY}, Condition.STOPPED, "start"),
    ],
)
def test_what_keeps_the_value_from_following_is_said(
    loop: MadeUpLoop, change: dict[str, object], condition: Condition, words: str
) -> None:
    source = Source(loop.folder, SIGNAL, held="law.held")
    vars(loop).update(change)
    loop.step(10.0)
    reading = source.take(10.0)[1]
    assert reading.condition is condition
    assert words in reading.words
    assert bool(reading.words) == (condition is not Condition.LIVE)


def test_a_silent_loop_and_an_ended_one_are_told_apart(loop: MadeUpLoop) -> None:
    source = Source(loop.folder, SIGNAL)
    loop.step(10.0)
    assert source.take(10.0 + 0.9 * SILENCE)[1].condition is Condition.LIVE
    assert source.take(10.0 + 1.1 * SILENCE)[1].condition is Condition.SILENT
    loop.ring.finish()
    assert source.take(10.0)[1].condition is Condition.ENDED


def test_a_new_run_of_the_loop_is_followed_and_told(loop: MadeUpLoop) -> None:
    source = Source(loop.folder, SIGNAL)
    loop.step(10.0)
    before = source.take(10.0)[1].generation
    loop.begin()
    loop.value = 0.9
    loop.step(11.0)
    reading = source.take(11.0 + LOOK)[1]
    assert reading.generation > before
    assert reading.value == pytest.approx(0.9)


def test_a_loop_that_writes_on_from_its_first_cycle_is_told(loop: MadeUpLoop) -> None:
    source = Source(loop.folder, SIGNAL)
    for _ in range(3):
        loop.step(10.0)
    before = source.take(10.0)[1].generation
    loop.cycle = 0
    loop.step(10.1)
    assert source.take(10.1)[1].generation > before


@pytest.mark.parametrize(("signal", "words"), [("law.d", "law.c"), ("law.held", "2 numbers"), ("law.c[9]", "9")])
def test_a_signal_that_is_not_one_number_is_refused(loop: MadeUpLoop, signal: str, words: str) -> None:
    with pytest.raises(RecordingError, match=words):
        Source(loop.folder, signal)


def test_an_element_is_found_by_its_name(loop: MadeUpLoop) -> None:
    loop.held = 0.25
    source = Source(loop.folder, "law.held[elbow]")
    loop.step(10.0)
    assert source.take(10.0)[1].value == pytest.approx(0.25)


def test_where_nothing_runs_this_is_said(tmp_path: Path) -> None:
    loop = MadeUpLoop(tmp_path / "run")
    loop.folder.layout.unlink()
    with pytest.raises(RecordingError, match=r"layout\.json"):
        Source(loop.folder, SIGNAL)
