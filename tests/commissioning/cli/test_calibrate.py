"""`srl calibrate`: the command line, with a person made of formulas; the simulated wearer end to end."""

from __future__ import annotations

import json
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.calibration import PROFILE, Actor, Person
from helpers.edited import edited
from helpers.run import call, ended, environment, srl, summary
from helpers.wait import until

from srl.commissioning.calibration import method
from srl.commissioning.calibration.ikns import report
from srl.commissioning.calibration.ikns.procedure import Procedure
from srl.commissioning.calibration.ikns.steps import Kind
from srl.commissioning.calibration.sources import RowFile
from srl.control.ikns import record
from srl.control.ikns.thresholds import Thresholds
from srl.runtime.cli import main

QUICK = ["static=0.5", "exploration=4", "trial=1.5", "settle=0.3", "patience=3", "samples=60"]
OPTIONS = [word for option in QUICK for word in ("--option", option)]
Command = Callable[..., int]
drawn = report.draw


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "worn.yaml").write_text(PROFILE)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def command(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Command:
    """`srl calibrate worn.yaml ikns ...` with the actor in place of the simulated wearer.

    `picture`: whether the report is drawn, which takes as long as all the rest; else it is an empty file.
    """

    def run(*arguments: str, actor: Actor | None = None, picture: bool = False) -> int:
        monkeypatch.setattr(method, "Simulated", lambda *_: actor or Actor())
        monkeypatch.setattr(report, "draw", drawn if picture else lambda _, png: png.touch())
        return main(["calibrate", "worn.yaml", "ikns", *OPTIONS, *arguments])

    return run


@pytest.mark.slow
def test_the_file_goes_where_the_profile_says(
    command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    actor = Actor()
    assert command("--sim", "--person", "P07", actor=actor, picture=True) == 0
    assert actor.closed
    assert (folder / "p07.json.report.png").read_bytes().startswith(b"\x89PNG")
    assert record.read(folder / "p07.json").person == "P07"
    assert {p.name for p in folder.iterdir()} == {"worn.yaml", "p07.json", "p07.json.report.png"}
    output = capsys.readouterr()
    assert "Take the hand to point 10 of 10" in output.err
    assert [Path(line).name for line in output.out.splitlines()[-2:]] == ["p07.json", "p07.json.report.png"]


def test_the_law_reads_it_and_without_it_the_profile_lacks_it(
    command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", "worn.yaml"]) == 2
    assert "Make it with `srl calibrate PROFILE ikns`" in capsys.readouterr().err
    assert command("--sim", "--person", "P07") == 0
    assert main(["check", "worn.yaml"]) == 0


@pytest.mark.slow
def test_one_object_says_all(command: Command, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command("--sim", "--person", "P07", "--json", "-o", "other.json", "--flip", "swivel") == 0
    reported = json.loads(capsys.readouterr().out)
    assert reported["file"] == "other.json"
    assert len(reported["points"]) == 10
    assert command("--sim", "--person", "P07", "-o", "plain.json") == 0
    flipped, plain = (record.read(folder / name).calibration() for name in ("other.json", "plain.json"))
    assert (flipped.directions == -plain.directions).all()
    assert (flipped.lower == -plain.upper).all()


def test_a_refused_calibration_writes_nothing(
    command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    actor = Actor(person=Person(wander={3: 0.1}, swing={5: 0.02}))
    assert command("--sim", "--person", "P07", "--json", actor=actor) == 2
    output = capsys.readouterr()
    assert "srl calibrate: point 3: " in output.err
    assert "srl calibrate: point 5: the range is 0.02 rad" in output.err
    assert "Redo the point" in output.err
    assert {r["place"] for r in json.loads(output.out)["refusals"]} == {"point 3", "point 5"}
    assert [p.name for p in folder.iterdir()] == ["worn.yaml"]


@pytest.mark.slow
def test_a_file_that_is_there_stays_without_yes(
    command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command("--sim", "--person", "P07") == 0
    before = (folder / "p07.json").read_bytes()
    assert command("--sim", "--person", "P07", "--flip", "swivel") == 2
    assert "a calibration is there already" in capsys.readouterr().err
    assert (folder / "p07.json").read_bytes() == before
    assert command("--sim", "--person", "P07", "--flip", "swivel", "--yes") == 0
    assert (folder / "p07.json.old").read_bytes() == before
    assert (folder / "p07.json").read_bytes() != before


@pytest.mark.slow
def test_every_file_that_was_replaced_is_kept(command: Command, folder: Path) -> None:
    before = []
    for _ in range(3):
        assert command("--sim", "--person", "P07", "--yes", "--flip", "swivel") == 0
        before.append((folder / "p07.json").read_bytes())
    assert len(set(before)) == 2  # turned round each time
    assert (folder / "p07.json.old").read_bytes() == before[0]
    assert (folder / "p07.json.old.2").read_bytes() == before[1]
    assert not [p.name for p in folder.iterdir() if p.name.endswith(".new")]


@pytest.mark.slow
def test_a_link_is_followed(command: Command, folder: Path) -> None:
    (folder / "kept").mkdir()
    (folder / "p07.json").symlink_to("kept/own.json")
    assert command("--sim", "--person", "P07") == 0
    assert command("--sim", "--person", "P07", "--yes") == 0
    assert (folder / "p07.json").is_symlink()
    assert {p.name for p in (folder / "kept").iterdir()} == {"own.json", "own.json.old", "own.json.report.png"}


@pytest.mark.slow
def test_a_shipped_profile_keeps_its_file(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(method, "Simulated", lambda *_: Actor())
    assert main(["calibrate", "ikns-finger", "ikns", "--sim", "--person", "P07", "--yes"]) == 2
    assert "-o: the profile 'ikns-finger' comes with srl" in capsys.readouterr().err
    typed = ("--set", "controllers.1.calibration=p07.json")
    assert main(["calibrate", "ikns-finger", "ikns", "--sim", "--person", "P07", *typed, *OPTIONS]) == 0
    assert (folder / "p07.json").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--sim"], "--person: it isn't said whose"),
        (["--sim", "--person", "Ada"], "'Ada' isn't anonymous"),
        (["--sim", "--person", "P07", "-o", "none/p.json"], "none: the folder can't be written"),
        (["--sim", "--person", "P07", "--option", "smaples=3"], "Did you mean 'samples'"),
        (["--sim", "--person", "P07", "--option", "static=-1"], "--option static: it should be greater than 0"),
        (["--sim", "--person", "P07", "--points", "3"], "--option points: it should be greater than or equal to 8"),
        (["--sim", "--person", "P07", "--dofs", "swivel,swivel"], "a degree of freedom is named twice"),
        (["--sim", "--person", "P07", "--dofs", "a b"], "--dofs: 'a b' is no name"),
        (["--sim", "--person", "P07", "--dofs", f"swivel,{65 * 'a'}"], "a' is no name"),
        (["--recording", "a.rrd", "--dofs", "a b"], "--dofs: 'a b' is no name"),
        (["--sim", "--person", "P07", "--dofs", "swivle"], "knows no motion 'swivle'. Did you mean 'swivel'"),
        (["--sim", "--person", "P07", "--redo", "3"], "it isn't said what the other points come from"),
        (["--sim", "--person", "P07", "--from", "a.rrd"], "--from: it goes with --redo"),
        (["--recording", "a.rrd"], "a.rrd: there is no such file"),
        (["--sim", "--person", "P07", "--flip", "twist"], "no degree of freedom 'twist'"),
        (["--sim", "--person", "P07", "--flip", "swivel", "--flip", "swivel"], "'swivel' is named twice"),
        (["--sim", "--person", "P07", "--direction", "none.json"], "none.json: it can't be read"),
        (["--person", "P07", "--instance", "Ada's"], "'Ada's' is no name"),
    ],
)
def test_wrong_arguments_are_named(
    arguments: list[str], words: str, command: Command, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command(*arguments) == 2
    assert words in capsys.readouterr().err


def test_a_home_that_isnt_there_is_named(command: Command, capsys: pytest.CaptureFixture[str]) -> None:
    there = ("--set", "controllers.1.calibration=~nosuchuser/p07.json")
    assert command("--sim", "--person", "P07", *there) == 2
    assert "'~nosuchuser' is no user's home here. Write the path in full" in capsys.readouterr().err
    assert main(["check", "worn.yaml", *there]) == 2
    assert "--set controllers.1.calibration: '~nosuchuser' is no user's home here" in capsys.readouterr().err


def test_a_profile_without_the_law_is_named(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", "sixth-finger", "ikns", "--sim", "--person", "P07"]) == 2
    assert "the profile has no law 'ikns'" in capsys.readouterr().err


@pytest.mark.slow
def test_a_recording_gives_the_same_file_and_a_point_is_done_again(
    command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = Actor(person=Person(wander={3: 0.1}))
    assert command("--sim", "--person", "P07", actor=bad) == 2
    recorded(bad, folder / "bad.rrd")
    assert command("--recording", "bad.rrd") == 2
    assert "point 3: " in capsys.readouterr().err
    again = Actor()
    assert command("--sim", "--person", "P07", "--redo", "3", "--from", "bad.rrd", actor=again) == 0
    assert "Take the hand to point 4" not in capsys.readouterr().err
    recorded(again, folder / "again.rrd")
    assert command("--recording", "bad.rrd", "again.rrd", "-o", "both.json") == 0
    assert (folder / "both.json").read_bytes() == (folder / "p07.json").read_bytes()
    assert command("--sim", "--person", "P08", "--redo", "3", "--from", "bad.rrd", "-o", "p08.json") == 2
    assert "bad.rrd: it is of P07" in capsys.readouterr().err


@pytest.mark.slow
def test_a_trial_in_which_a_recording_ends_replaces_no_whole_one(
    command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    actor = Actor()
    assert command("--sim", "--person", "P07", actor=actor) == 0
    recorded(actor, folder / "good.rrd")
    broken = Actor()
    redo = Procedure(("swivel",), Thresholds(samples=60), None, np.random.default_rng(0).uniform(-0.2, 0.2, (99, 3)))
    redo.redo(3)
    broken.begin(redo)
    for _ in range(20):
        broken.take()
    redo.go_on()
    assert redo.step.kind is Kind.TRIAL
    broken.begin(redo)
    for _ in range(20):
        broken.take()
    recorded(broken, folder / "broken.rrd")
    assert command("--recording", "good.rrd", "broken.rrd", "-o", "both.json") == 0
    assert (folder / "both.json").read_bytes() == (folder / "p07.json").read_bytes()


@pytest.mark.slow
def test_a_recordings_own_thresholds_stand_but_for_those_that_are_typed(command: Command, folder: Path) -> None:
    actor = Actor()
    actor.channel_map.layout.meta["profile"] = actor.channel_map.layout.meta["profile"].replace(
        "wander: 0.02", "wander: 0.015"
    )
    assert command("--sim", "--person", "P07", "-o", "first.json", actor=actor) == 0
    recorded(actor, folder / "run.rrd")
    # `command` types samples=60 and times of the procedure.
    for options, samples, wander in (
        ([], 60, 0.015),
        (["--option", "samples=70", "--option", "wander=0.03"], 70, 0.03),
    ):
        assert command("--recording", "run.rrd", "-o", f"{samples}.json", *options) == 0
        made = record.read(folder / f"{samples}.json").thresholds
        assert (made.samples, made.wander, made.points) == (samples, wander, 10)


def along(one: Path, other: Path) -> Any:
    """(N, k), cosine between the directions of two files with the same points."""
    a, b = record.read(one).calibration(), record.read(other).calibration()
    return (a.directions * b.directions).sum(axis=2)


@pytest.mark.slow
def test_the_sense_that_a_person_is_used_to_stays(
    command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    actor = Actor()
    assert command("--sim", "--person", "P07", "-o", "plain.json", actor=actor) == 0
    recorded(actor, folder / "run.rrd")
    assert command("--sim", "--person", "P07", "--flip", "swivel") == 0
    used = folder / "p07.json"
    assert (along(used, folder / "plain.json") < -0.99).all()
    # Computed again in place of the file, elsewhere with the profile's, and with another that is named.
    for i, where in enumerate((["--yes"], ["-o", "b.json"], ["-o", "c.json", "--direction", "plain.json"])):
        capsys.readouterr()
        assert command("--recording", "run.rrd", "--json", *where) == 0
        reported = json.loads(capsys.readouterr().out)
        assert Path(reported["direction"]["file"]).name == ("plain.json" if i == 2 else "p07.json")
        assert reported["direction"]["turned"] == ([] if i == 2 else ["swivel"])
        assert (along(Path(reported["file"]), folder / "plain.json") * (1 if i == 2 else -1) > 0.99).all()
    # A point done again, and a turn that is wanted.
    assert command("--sim", "--person", "P07", "--redo", "3", "--from", "run.rrd", "--yes") == 0
    assert "swivel turned round for it" in capsys.readouterr().err
    assert (along(used, folder / "b.json") > 0.99).all()
    assert command("--recording", "run.rrd", "--yes", "--flip", "swivel") == 0
    assert (along(used, folder / "plain.json") > 0.99).all()


@pytest.mark.slow
def test_a_recording_alone_says_that_it_holds_no_sense(
    command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    actor = Actor()
    assert command("--sim", "--person", "P07", "-o", "plain.json", actor=actor) == 0
    recorded(actor, folder / "run.rrd")
    capsys.readouterr()
    assert command("--recording", "run.rrd") == 0
    assert "what was turned round before (--flip, f) isn't in a recording" in capsys.readouterr().err
    edited(folder / "plain.json", lambda made: made.update(person="P08"), folder / "p08.json")
    assert command("--recording", "run.rrd", "--yes", "--direction", "p08.json") == 2
    assert "--direction p08.json: it is of P08" in capsys.readouterr().err


@pytest.mark.slow
def test_another_body_and_a_mixture_are_refused(
    command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    actor = Actor()
    assert command("--sim", "--person", "P07", actor=actor) == 0
    recorded(actor, folder / "run.rrd")
    assert record.read(folder / "p07.json").simulated
    redo = ("--person", "P07", "--redo", "3", "--from", "run.rrd", "--yes")
    assert command(*redo, "--sim", "--set", "models.body.stature=1.6") == 2
    assert "run.rrd: it was made with another body 'body': stature 1.75, now 1.6" in capsys.readouterr().err
    assert command("--recording", "run.rrd", "--yes", "--set", "models.body.stature=1.6") == 2
    assert "another body" in capsys.readouterr().err
    actor.graph.layout.meta["simulated"] = []
    recorded(actor, folder / "live.rrd")
    assert command("--recording", "live.rrd", "-o", "live.json") == 0
    assert not record.read(folder / "live.json").simulated
    assert command("--recording", "run.rrd", "live.rrd", "--yes") == 2
    assert "live.rrd: it is of a person, the rest is simulated" in capsys.readouterr().err
    assert command(*redo) == 2
    assert "run.rrd: it is simulated, the rest isn't" in capsys.readouterr().err


def recorded(actor: Actor, path: Path) -> None:
    file = RowFile(actor.graph.layout, path)
    for rows in actor.rows:
        file.add(rows)
    file.close()


# The simulated wearer

SIM = ["--sim", "--person", "P07", "--option", "exploration=20"]  # a shorter trial spans less, so c is noisier


@pytest.mark.slow
def test_the_simulated_wearer_is_calibrated_and_recorded(tmp_path: Path) -> None:
    (tmp_path / "worn.yaml").write_text(PROFILE)
    done = call(tmp_path, "calibrate", "worn.yaml", "ikns", *SIM, "--record", "run.rrd", "--json")
    reported: dict[str, Any] = summary(done)
    assert reported["refusals"] == []
    assert reported["noise_per_mm"]["swivel"] == pytest.approx(0.006, abs=0.0015)
    assert all(point["dofs"]["swivel"]["range"] > 1.0 for point in reported["points"])
    call(tmp_path, "calibrate", "worn.yaml", "ikns", "--recording", "run.rrd", "-o", "again.json")
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "p07.json").read_bytes()


@pytest.mark.slow
def test_ctrl_c_leaves_nothing_half(tmp_path: Path) -> None:
    (tmp_path / "worn.yaml").write_text(PROFILE)
    command = srl("calibrate", "worn.yaml", "ikns", *SIM)
    with ended(command, env=environment(tmp_path), cwd=tmp_path) as process:
        lines: list[str] = []
        assert process.stderr is not None
        until(lambda: lines.append(process.stderr.readline()) or "point 2 " in lines[-1], what="point 2")
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "Traceback" not in err
    assert out == ""
    assert [p.name for p in tmp_path.iterdir() if p.is_file()] == ["worn.yaml"]
