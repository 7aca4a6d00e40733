"""Buttons that reset: a press counts, once; what is held, stuck, unplugged or old never does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.toy import Bench, _load

from srl.runtime.contracts import registry
from srl.runtime.ipc.header import CYCLE, Latch, Origin, State
from srl.runtime.ipc.requests import Answer, RequestKind, RequestWriter
from srl.runtime.loop import device as device_module
from srl.runtime.loop.replay import replay

RESET = "reset: {inputs: [{signal: panel.buttons, element: third}]}"


def pressed_at(*cycles: int, count: int = 160, held: int = 5, tmp_path: Path) -> Bench:
    """A run that a person stops in cycle 50, with a button that is pressed for a while in some cycles."""
    b = Bench(tmp_path, emergency="", more=RESET)

    def script(k: int) -> None:
        b.panel.values["buttons"][2] = any(0 <= k - cycle < held for cycle in cycles)
        if k == 50:
            b.ask("stop")

    return b.run(count, script)


def test_a_press_resets_a_persons_stop_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    b = pressed_at(100, tmp_path=tmp_path)
    assert [state for state, _ in b.states[60:100]] == [State.STOPPED] * 40
    assert b.states[-1][0] is State.ACTIVE
    rows = b.rows()
    (at,) = np.flatnonzero(rows[:, CYCLE.request_origin] == Origin.INPUT)
    assert at == 101
    assert rows[at, CYCLE.request_kind] == RequestKind.RESET
    assert rows[at, CYCLE.request_result] == Answer.DONE
    assert rows[-2, CYCLE.latches] == 0
    assert "reset (input)" in b.events
    monkeypatch.setattr(registry, "load", _load)
    assert replay(b.graph.layout, rows[:-1], "toy").identical


@pytest.mark.parametrize(("cycle", "held"), [(20, 10), (48, 200), (50, 200)])
def test_a_press_before_the_stop_and_a_held_button_do_not(tmp_path: Path, cycle: int, held: int) -> None:
    b = pressed_at(cycle, held=held, tmp_path=tmp_path)
    assert {state for state, _ in b.states[60:]} == {State.STOPPED}
    assert not (b.rows()[:, CYCLE.request_origin] == Origin.INPUT).any()


@pytest.mark.parametrize("how", ["silent", "unplugged", "no number"])
def test_a_button_counts_only_while_it_can_be_read_and_after_it_was_seen_released(
    tmp_path: Path, how: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(device_module, "RETRY", 0.01)
    b = Bench(tmp_path, emergency="", more=RESET)

    def script(k: int) -> None:
        b.panel.values["buttons"][2] = k == 49 or 80 <= k < 120 or k >= 150
        if k == 50:
            b.ask("stop")
        away = k == 50 if how == "no number" else 51 <= k < 90
        b.panel.silent = away and how == "silent"
        b.panel.gone = away and how == "unplugged"
        if how == "no number" and 50 <= k < 80:
            b.panel.values["buttons"][2] = np.nan
        if k == 91 and how == "unplugged":
            b.until_back(b.panel)

    b.run(200, script)
    assert {state for state, _ in b.states[60:150]} == {State.STOPPED}  # not with the press of 80
    assert b.states[-1][0] is State.ACTIVE  # but with that of 150


@pytest.mark.parametrize("when", [0.0, 1.0])
def test_a_button_whose_contact_bounces_as_it_is_let_go_does_not_reset(tmp_path: Path, when: float) -> None:
    """A button that is held over a stop: letting it go gives edges, too, and so does a contact that flickers."""
    b = Bench(tmp_path, emergency="", more=RESET.replace("third}", f"third, when: {when}}}"))

    def script(k: int) -> None:
        pressed = 45 <= k < 100 or k in (101, 103, 104) or k >= 150
        b.panel.values["buttons"][2] = when if pressed and k != 70 else 1 - when
        if k == 50:
            b.ask("stop")

    b.run(170, script)
    assert {state for state, _ in b.states[60:150]} == {State.STOPPED}
    assert b.states[-1][0] is State.ACTIVE  # a press after that counts


def test_a_press_in_the_cycle_of_an_emergency_does_not_reset_after_it(tmp_path: Path) -> None:
    """The emergency input is released in the next cycle, in which the press would be taken."""
    b = Bench(tmp_path, emergency="{signal: panel.buttons, element: second}", more=RESET)

    def script(k: int) -> None:
        b.panel.values["buttons"][1] = k == 100
        b.panel.values["buttons"][2] = k >= 100
        if k == 50:
            b.ask("stop")

    b.run(120, script)
    assert {state for state, _ in b.states[60:]} == {State.STOPPED}
    assert b.rows()[-2, CYCLE.latches] == Latch.PERSON | Latch.EMERGENCY


def test_what_a_button_gave_before_its_device_was_lost_is_no_release_after_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The device is back before its last sample is old, and the first one after it finds the button held."""
    monkeypatch.setattr(device_module, "RETRY", 0.01)
    b = Bench(tmp_path, emergency="", more=RESET)
    b.cycle._faults._max_age = [10_000_000_000] * 3

    def script(k: int) -> None:
        if k == 50:
            b.ask("stop")
        b.panel.gone = 80 <= k < 90
        b.panel.silent = 80 <= k < 110  # it is back, and hasn't given a sample yet
        b.panel.values["buttons"][2] = k >= 110
        if k == 91:
            b.until_back(b.panel)

    b.run(150, script)
    assert {state for state, _ in b.states[60:]} == {State.STOPPED}


def test_a_press_is_refused_as_other_resets_are_and_limited(tmp_path: Path) -> None:
    b = Bench(tmp_path, emergency="{signal: panel.buttons, element: second}", more=RESET)

    def script(k: int) -> None:
        b.panel.values["buttons"][1] = k >= 50  # an emergency input stays pressed
        b.panel.values["buttons"][2] = k % 8 < 2

    b.run(150, script)
    rows = b.rows()
    answers = rows[rows[:, CYCLE.request_origin] == Origin.INPUT, CYCLE.request_result].tolist()
    assert set(answers) == {Answer.REFUSED_FAULT, Answer.REFUSED_RATE}
    assert rows[-2, CYCLE.refused] == len(answers)
    assert answers.count(Answer.REFUSED_FAULT) <= 5 + 5


def test_a_press_gets_through_a_crowd_at_the_bus_but_not_before_a_stop(tmp_path: Path) -> None:
    b = Bench(tmp_path, emergency="", more=RESET)
    ring = RequestWriter(b.run_folder.requests)

    def script(k: int) -> None:
        b.panel.values["buttons"][2] = k in (100, 130)
        for _ in range(3):
            ring.send(RequestKind.RESET, 1 << 62)
        if k in (50, 120, 131):
            b.ask("stop")

    b.run(160, script)
    assert b.states[110][0] is State.ACTIVE
    assert b.states[-1][0] is State.STOPPED  # the stop came while the press waited
    assert b.rows()[-2, CYCLE.latches] == Latch.PERSON
