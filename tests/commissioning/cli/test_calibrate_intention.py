"""`srl calibrate PROFILE intention`: the command line, with a simulated person; the simulated body end to end."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.intention_calibration import PROFILE, Person, Pretender
from helpers.run import call, summary
from rich.console import Console

from srl.commissioning.calibration import method
from srl.commissioning.calibration.intention import report as intention_report
from srl.commissioning.calibration.intention.procedure import ACTIONS, Kind, Plan, Procedure
from srl.commissioning.calibration.screen import picture
from srl.commissioning.calibration.sources import RowFile
from srl.control.intention.record import Record
from srl.runtime.cli import main
from srl.runtime.ipc.header import CYCLE, State
from srl.runtime.models import record_file

_SHORT = ("rounds=3", "pause=1.5", "stand=4", "walk=5", "everyday=0")
QUICK = [word for option in _SHORT for word in ("--option", option)]
FOUR = "overhead,bend,turn-left,wave"
Command = Callable[..., int]
drawn = intention_report.draw


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "suit.yaml").write_text(PROFILE)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def command(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Command:
    """`srl calibrate suit.yaml intention ...` of four actions, without physics.

    `picture`: whether the report is drawn, which takes as long as all the rest; else it is an empty file.
    """

    def run(*arguments: str, actor: Pretender | None = None, actions: str | None = FOUR, picture: bool = False) -> int:
        monkeypatch.setattr(intention_report, "draw", drawn if picture else lambda _, png: png.touch())
        monkeypatch.setattr(method, "Simulated", lambda *_: actor or Pretender(actions=actions))
        named = ("--actions", actions) if actions and "--recording" not in arguments else ()
        return main(["calibrate", "suit.yaml", "intention", *QUICK, *named, *arguments])

    return run


def read(path: Path) -> Record:
    return record_file.read(Record, path)


@pytest.mark.slow
def test_the_ten_actions_are_recorded_and_the_law_reads_the_file(
    command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    actor = Pretender()
    assert command("--sim", "--person", "P07", actor=actor, actions=None, picture=True) == 0
    assert actor.closed
    made = read(folder / "p07.json")
    assert (made.person, made.simulated, made.actions) == ("P07", True, ACTIONS)
    assert made.held_out > 0.95
    output = capsys.readouterr()
    assert "Lift both hands over your head" in output.err
    assert "(overhead, 3 of 3)" in output.err
    assert [Path(line).name for line in output.out.splitlines()[-2:]] == ["p07.json", "p07.json.report.png"]
    assert (folder / "p07.json.report.png").read_bytes()[:4] == b"\x89PNG"
    assert main(["check", "suit.yaml"]) == 0


@pytest.mark.slow
def test_one_object_says_all(command: Command, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command("--sim", "--person", "P07", "--json", "-o", "other.json") == 0
    reported = json.loads(capsys.readouterr().out)
    assert reported["file"] == "other.json"
    assert list(reported["actions"]) == FOUR.split(",")
    assert reported["simulated"]
    assert all(row["trials"] == 3 and row["found"] == 3 for row in reported["actions"].values())
    windows = reported["confusion"]["windows"]
    assert [sum(row) for row in windows[:4]] == [row["windows"] for row in reported["actions"].values()]
    assert reported["confusion"]["labels"] == [*FOUR.split(","), "stand", "walk", "rejected"]


@pytest.mark.slow
def test_who_doesnt_do_an_action_is_refused_and_nothing_is_written(
    command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    actor = Pretender(Person(lazy={"bend"}), FOUR)
    assert command("--sim", "--person", "P07", "--json", "--option", "patience=1", actor=actor) == 2
    output = capsys.readouterr()
    assert "srl calibrate" in output.err
    assert "action bend: " in output.err
    assert {r["place"] for r in json.loads(output.out)["refusals"]} == {"action bend"}
    assert [p.name for p in folder.iterdir()] == ["suit.yaml"]


def test_a_suit_that_isnt_seen_is_refused(command: Command, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    actor = Pretender(Person(hidden={"wave"}), FOUR)
    assert command("--sim", "--person", "P07", "--option", "patience=1", actor=actor) == 2
    assert "action wave: 100% of the samples of repetition 1 are missing" in capsys.readouterr().err
    assert [p.name for p in folder.iterdir()] == ["suit.yaml"]


@pytest.mark.slow
def test_a_recording_gives_the_same_file_and_an_action_is_done_again(
    command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = Pretender(Person(lazy={"bend"}), FOUR)
    assert command("--sim", "--person", "P07", "--option", "patience=1", actor=bad) == 2
    recorded(bad, folder / "bad.rrd")
    assert command("--recording", "bad.rrd") == 2
    capsys.readouterr()
    again = Pretender(actions=FOUR)
    assert command("--sim", "--person", "P07", "--redo", "2", "--from", "bad.rrd", actor=again) == 0
    output = capsys.readouterr().err
    assert "Bend forward" in output
    assert "Lift" not in output
    recorded(again, folder / "again.rrd")
    assert command("--recording", "bad.rrd", "again.rrd", "-o", "both.json") == 0
    assert (folder / "both.json").read_bytes() == (folder / "p07.json").read_bytes()
    assert command("--sim", "--person", "P08", "--redo", "2", "--from", "bad.rrd", "-o", "p08.json") == 2
    assert "bad.rrd: it is of P07" in capsys.readouterr().err


@pytest.mark.slow
def test_a_recordings_own_thresholds_stand_but_for_those_that_are_typed(command: Command, folder: Path) -> None:
    slow = Pretender(actions=FOUR, option=("dwell=0.7",))
    assert command("--sim", "--person", "P07", actor=slow) == 0
    recorded(slow, folder / "slow.rrd")
    assert command("--recording", "slow.rrd", "--option", "confidence=0.6", "-o", "typed.json") == 0
    kept = read(folder / "typed.json").thresholds
    assert (kept.dwell, kept.confidence) == (0.7, 0.6)


@pytest.mark.slow
def test_a_file_that_is_there_stays_without_yes(
    command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command("--sim", "--person", "P07") == 0
    before = (folder / "p07.json").read_bytes()
    assert command("--sim", "--person", "P07") == 2
    assert "a calibration is there already" in capsys.readouterr().err
    assert command("--sim", "--person", "P07", "--yes") == 0
    assert (folder / "p07.json.old").read_bytes() == before
    (folder / "p07.json").write_text("{}")
    assert command("--sim", "--person", "P07", "--yes") == 2
    assert (folder / "p07.json").read_text() == "{}"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--sim"], "--person: it isn't said whose"),
        (["--sim", "--person", "P07", "--dofs", "swivel"], "--dofs: it is of 'ikns', not of 'intention'"),
        (["--sim", "--person", "P07", "--flip", "swivel"], "--flip: it is of 'ikns'"),
        (["--sim", "--person", "P07", "--actions", "overhead,wve"], "Did you mean 'wave'"),
        (["--sim", "--person", "P07", "--actions", "wave"], "one alone can't be told from others"),
        (["--sim", "--person", "P07", "--actions", "wave,stand"], "'stand' is no action"),
        (["--sim", "--person", "P07", "--actions", "wave,wave"], "an action is named twice"),
        (["--sim", "--person", "P07", "--option", "rounds=1"], "greater than or equal to 3"),
        (["--sim", "--person", "P07", "--option", "repetitions=4"], "3 rounds give fewer than 4 repetitions"),
        (["--sim", "--person", "P07", "--option", "exploration=4"], "there is no such option"),
        (["--recording", "a.rrd"], "a.rrd: there is no such file"),
        (["--sim", "--person", "P07", "--actions", "wave,a b"], "--actions: 'a b' is no name"),
        (["--sim", "--person", "P07", "--set", "controllers.0.recogniser=~nobody-here/p.json"], "nobody-here"),
    ],
)
def test_wrong_arguments_are_named(
    arguments: list[str], words: str, command: Command, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command(*arguments, actions=None) == 2
    assert words in capsys.readouterr().err


def test_the_file_of_a_profile_that_comes_with_srl_stays(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", "suit-intention", "intention", "--sim", "--person", "P07", "--yes"]) == 2
    assert "the profile 'suit-intention' comes with srl" in capsys.readouterr().err


@pytest.mark.slow
def test_every_file_that_was_there_is_kept_and_a_link_stays(command: Command, folder: Path) -> None:
    (folder / "files").mkdir()
    (folder / "p07.json").symlink_to("files/p07.json")
    for _ in range(3):
        assert command("--sim", "--person", "P07", "--yes") == 0
    assert (folder / "p07.json").is_symlink()
    there = {p.name for p in (folder / "files").iterdir()}
    assert there == {"p07.json", "p07.json.old", "p07.json.old.2", "p07.json.report.png"}


def test_samples_are_of_what_ran() -> None:
    actor = Pretender(actions=FOUR)
    rows = actor.take()
    rows[3:7, CYCLE.state] = State.STOPPED
    assert len(actor.channel_map.samples(rows)) == len(rows) - 4
    assert actor.channel_map.samples(rows).times.tolist() == actor.channel_map.times(rows)[[0, 1, 2, 7, 8, 9]].tolist()


def test_actions_are_not_for_ikns(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", "suit.yaml", "ikns", "--sim", "--person", "P07", "--actions", "wave,bend"]) == 2
    assert "--actions: it is of 'intention', not of 'ikns'" in capsys.readouterr().err


def test_the_screen_shows_what_to_do() -> None:
    procedure = Procedure(("overhead", "wave"), Plan(rounds=3))
    while procedure.step.kind is not Kind.ACTION:
        procedure.go_on()
    console = Console(file=io.StringIO(), width=110, force_terminal=False)
    console.print(picture("calibrate", procedure.view()))
    shown = console.file.getvalue()  # type: ignore[attr-defined]
    for words in ("go on until the next word", "1 of 3", "actions ", "q quit"):
        assert words in shown


def test_every_action_comes_in_every_round_and_the_order_changes() -> None:
    procedure, steps = Procedure(ACTIONS, Plan(rounds=4)), []
    while not procedure.done:
        steps.append(procedure.step)
        procedure.go_on()
    orders = [[s.action for s in steps if s.kind is Kind.ACTION and s.turn == turn] for turn in range(4)]
    assert all(sorted(order) == list(range(10)) for order in orders)
    assert len({tuple(order) for order in orders}) == 4
    marks = [s.mark for s in steps if s.kind in (Kind.ACTION, Kind.STAND, Kind.WALK)]
    assert len(set(marks)) == len(marks) == 4 * 12
    assert {s.mark for s in steps if s.kind is Kind.PAUSE} == {0}


def recorded(actor: Pretender, path: Path) -> None:
    file = RowFile(actor.graph.layout, path)
    for rows in actor.rows:
        file.add(rows)
    file.close()


@pytest.mark.exhaustive
@pytest.mark.slow
def test_the_simulated_body_is_calibrated_and_then_recognised(tmp_path: Path) -> None:
    (tmp_path / "suit.yaml").write_text(PROFILE.replace("rate: 20", "rate: 100"))
    arguments = ["--sim", "--person", "P07", *QUICK]
    reported: dict[str, Any] = summary(call(tmp_path, "calibrate", "suit.yaml", "intention", *arguments, "--json"))
    assert reported["refusals"] == []
    assert reported["found"] == 1.0
    ran = summary(call(tmp_path, "run", "suit.yaml", "--sim", "--fast", "--duration", "57", "--json"))
    assert ran["result"]["intention"]["actions"] == dict.fromkeys(ACTIONS, 1)
