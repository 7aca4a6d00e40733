"""`srl study ikns-grasping --person`: the experimenter's keys, the stored order, and a session that goes on."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from helpers.run import refused

from srl.runtime.contracts.errors import RequestError
from srl.studies.ikns import grasping_person, people
from srl.studies.ikns.grasping_person import judged, ordered, session
from srl.studies.tasks import journal, table
from srl.studies.toolkit.errors import StudyError


def reported(lines: list[str], seconds: list[float]) -> dict[str, Any]:
    """A trial with what is typed and what the clock shows."""
    answers, times = iter(lines), iter(seconds)
    return judged(lambda question: next(answers), lambda: next(times))


def test_enter_is_a_success_and_a_letter_a_reason() -> None:
    assert reported(["", ""], [10.0, 17.5]) == {"success": True, "reason": "", "duration": 7.5}
    assert reported(["", "d\n"], [0.0, 3.0]) == {"success": False, "reason": "dropped", "duration": 3.0}


def test_twenty_seconds_are_too_long() -> None:
    assert reported(["", ""], [0.0, 20.5])["reason"] == "out of time"
    assert reported(["", "g"], [0.0, 20.5])["reason"] == "off the goal"


@pytest.mark.parametrize("key", ["x", "?"])
def test_a_trial_that_doesnt_count_is_done_again(key: str) -> None:
    assert reported(["", key, "", ""], [0.0, 5.0, 100.0, 106.0]) == {"success": True, "reason": "", "duration": 6.0}


def test_the_order_is_one_condition_after_the_other() -> None:
    drawn = {seed: ordered(seed, "ABC") for seed in range(40)}
    for order in drawn.values():
        assert sorted(order) == [(c, o) for c in ("ikns", "ring") for o in "ABC"]
        assert len({c for c, _ in order[:3]}) == 1
    assert len({tuple(order) for order in drawn.values()}) > 10
    assert {order[0][0] for order in drawn.values()} == {"ikns", "ring"}


@pytest.fixture
def keys(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What the experimenter types, line by line; at the end the power goes. A run is there, simulated."""
    typed: list[str] = []

    def answer(question: str) -> str:
        if not typed:
            raise KeyboardInterrupt
        return typed.pop(0)

    clock: Iterator[float] = (7.0 * i for i in range(1000))
    run = SimpleNamespace(simulated=True, layout=SimpleNamespace(meta={"sha256": "ab"}))
    monkeypatch.setattr(grasping_person, "typed", answer)
    monkeypatch.setattr(grasping_person, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    monkeypatch.setattr(people, "beside", lambda *_: run)
    return typed


def test_a_session_goes_on_where_it_was(tmp_path: Path, keys: list[str]) -> None:
    keys += ["", "", "", "d", ""]  # two trials; the third begins
    with pytest.raises(KeyboardInterrupt):
        session(tmp_path, "P07", quick=True)
    first = table.read(tmp_path / "P07" / table.FILE)
    assert [row["reason"] for row in first] == ["", "dropped"]
    keys += ["", "", "", ""]
    result = session(tmp_path, "P07", quick=True)
    rows = table.read(tmp_path / "P07" / table.FILE)
    assert [row["key"] for row in rows[:2]] == [row["key"] for row in first]
    assert len(rows) == 4
    assert result.simulated
    assert {claim.id for claim in result.claims} >= {"success-rate"}
    assert sum(row["success"] for row in rows) == 3
    session(tmp_path, "P07", quick=True)  # nobody is asked
    with pytest.raises(RequestError, match="4 trials"):
        session(tmp_path, "P07")


def test_a_person_who_isnt_through_isnt_in_the_table(tmp_path: Path, keys: list[str]) -> None:
    keys += 8 * [""]
    session(tmp_path, "P07", quick=True)
    keys += ["", ""]
    with pytest.raises(KeyboardInterrupt):
        session(tmp_path, "P08", quick=True)
    assert {row["wearer"] for row in people.through(tmp_path)} == {"P07"}


def test_a_trial_says_who_did_it_beside_what(tmp_path: Path, keys: list[str]) -> None:
    keys += 8 * [""]
    session(tmp_path, "P07", quick=True)
    rows = people.through(tmp_path)
    order = json.loads((tmp_path / "P07" / people.ORDER).read_text())["order"]
    assert [[row["condition"], row["object"]] for row in rows] == order
    assert [(row["wearer"], row["place"], row["simulated"]) for row in rows] == [("P07", i, True) for i in range(1, 5)]
    assert {row["profile_sha256"] for row in table.read(tmp_path / "P07" / table.FILE)} == {"ab"}


def in_the_middle(own: Path, whole: bytes) -> None:
    """The second line can't be read, and the last trial isn't there."""
    lines = whole.splitlines(keepends=True)
    (own / journal.FILE).write_bytes(b"".join([lines[0], lines[1].replace(b"ikns", b"inks"), *lines[2:-1]]))


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda own, whole: (own / people.ORDER).write_text("{"), "order.json is damaged"),
        (lambda own, whole: (own / people.ORDER).write_text("[]"), "order.json is damaged"),
        (lambda own, whole: (own / people.ORDER).write_bytes(b"\xff"), "order.json is damaged"),
        (lambda own, whole: (own / journal.FILE).unlink(), "trials.journal isn't there"),
        (lambda own, whole: [(own / journal.FILE).unlink(), (own / journal.FILE).mkdir()], "Is a directory"),
        (in_the_middle, "lines of trials.journal are damaged: 1"),
    ],
)
def test_trials_of_another_that_cannot_be_read_are_said(
    tmp_path: Path, keys: list[str], spoil: Callable[[Path, bytes], Any], words: str
) -> None:
    keys += 16 * [""]
    session(tmp_path, "P07", quick=True)
    own = tmp_path / "P07"
    spoil(own, (own / journal.FILE).read_bytes())
    with pytest.raises(RequestError, match=re.escape(words)) as raised:
        session(tmp_path, "P08", quick=True)
    assert (raised.value.place, raised.value.remedy.partition(",")[0]) == (str(own), "Put it right")
    own.rename(tmp_path.parent / f"{tmp_path.name}-P07")
    session(tmp_path, "P08", quick=True)  # its trials were kept, nobody is asked
    assert {row["wearer"] for row in people.through(tmp_path)} == {"P08"}


def test_a_trial_that_was_being_written_is_no_damage(tmp_path: Path, keys: list[str]) -> None:
    keys += 8 * [""]
    session(tmp_path, "P07", quick=True)
    own = tmp_path / "P07"
    whole = (own / journal.FILE).read_bytes()
    (own / journal.FILE).write_bytes(whole[:-10])
    assert people.through(tmp_path) == []
    assert (own / journal.FILE).read_bytes() == whole[:-10]  # who looks doesn't write


def test_an_order_that_was_spoiled_is_refused(tmp_path: Path, keys: list[str]) -> None:
    keys += 8 * [""]
    session(tmp_path, "P07", quick=True)
    path = tmp_path / "P07" / people.ORDER
    path.write_text(path.read_text().replace('"A"', '"Z"'))
    with pytest.raises(StudyError, match="this study hasn't"):
        session(tmp_path, "P07", quick=True)
    path.write_text("{")
    with pytest.raises(StudyError, match="can't be read"):
        session(tmp_path, "P07", quick=True)


def test_a_name_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert "anonymous" in refused("study", "ikns-grasping", "--person", "Anna")
