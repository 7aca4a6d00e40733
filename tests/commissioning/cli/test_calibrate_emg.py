"""`srl calibrate PROFILE emg`: hidden gains of muscles are found, or what can't work is refused."""

from __future__ import annotations

import datetime
import io
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.acted_calibration import calibrate, feed, recorded
from helpers.edited import edited
from helpers.emg_calibration import GAINS, NAMES, PROFILE, QUICK, Electrodes
from helpers.run import call, summary
from rich.console import Console

from srl.commissioning.calibration.emg import report as emg_report
from srl.commissioning.calibration.emg.fit import Thresholds
from srl.commissioning.calibration.emg.procedure import Kind, Procedure
from srl.commissioning.calibration.emg.samples import Plan
from srl.commissioning.calibration.screen import picture
from srl.control.emg.record import EmgRecord
from srl.runtime.cli import calibrations, main
from srl.runtime.models import record_file

Command = Callable[..., int]
MEAN = np.sqrt(2.0 / np.pi)  # of a rectified normal signal of RMS 1
TYPED = [word for option in QUICK for word in ("--option", option)]
PLAN = Plan.model_validate(dict(option.split("=") for option in QUICK))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "worn.yaml").write_text(PROFILE)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def command(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Command:
    return calibrate(monkeypatch, emg_report, "worn.yaml", "emg", Electrodes, TYPED)


def read(path: Path) -> EmgRecord:
    return record_file.read(EmgRecord, path)


@pytest.mark.slow
def test_hidden_gains_are_found_and_the_profile_reads_them(
    command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", "worn.yaml"]) == 2
    assert "Make it with `srl calibrate PROFILE emg`" in capsys.readouterr().err
    actor = Electrodes()
    assert command("--sim", actor=actor, picture=True) == 0
    assert actor.closed
    assert actor.reported == ["biceps", "biceps", "triceps", "triceps"]
    made = read(folder / "p07.json")
    assert (made.person, made.simulated, made.signal, tuple(made.muscles)) == ("P07", True, "emg.samples", NAMES)
    for name, muscle in made.muscles.items():
        assert muscle.mvc == pytest.approx(MEAN * GAINS[name], rel=0.12)
        assert muscle.rest == pytest.approx(MEAN * 2.2e-6, rel=0.5)
        assert len(muscle.repeats) == 2
    output = capsys.readouterr()
    assert "NOW contract biceps as hard as you can" in output.err
    assert (folder / "p07.json.report.png").read_bytes()[:4] == b"\x89PNG"
    assert main(["check", "worn.yaml"]) == 0
    assert "controllers.0.calibration: it was made in simulation, and 'emg' is real" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("actor", "words"),
    [
        ({"dead": ["biceps"]}, r"biceps: its channel is dead: one value all the time"),
        ({"limit": {"biceps": 3e-4}}, r"biceps: it is saturated: \d+ samples lie at the end of its range"),
        ({"hum": {"triceps": 3e-5}}, r"triceps: the mains' hum \(50 Hz\) is 9\d% of what it gives at rest"),
        ({"crossed": True}, r"biceps: it is active while triceps contracts.*Their electrodes are exchanged"),
        ({"tone": {"triceps": 0.3}}, r"triceps: its greatest contraction is .* [23]\.\d times what it gives at rest"),
        ({"contracts": {"triceps": "biceps"}}, r"triceps: while it contracts biceps gives \d+% of its own contraction"),
        (
            {"strengths": {"triceps": [0.2, 0.2], "biceps": [4.0, 4.0]}},
            r"biceps: while it contracts triceps gives \d+% of its own contraction. .* triceps was weak, r 2",
        ),
        ({"strengths": {"biceps": [0.6]}}, r"biceps: its contractions differ by \d\d% \(.* uV\), 20% are allowed"),
    ],
)  # fmt: skip
def test_what_cant_work_is_refused_with_its_reason(
    actor: dict[str, Any], words: str, command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = sorted(folder.iterdir())
    assert command("--sim", "-o", "new.json", actor=Electrodes(**actor)) == 2
    output = capsys.readouterr().err
    assert re.search(words, output), output
    assert "Traceback" not in output
    assert sorted(folder.iterdir()) == before


def test_a_hum_that_is_small_beside_the_contraction_does_no_harm(command: Command) -> None:
    assert command("--sim", actor=Electrodes(hum={"biceps": 5e-6})) == 0


def test_the_old_file_is_kept_and_a_changed_one_refused(
    command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command("--sim") == 0
    first = (folder / "p07.json").read_bytes()
    assert command("--sim") == 2
    assert "a calibration is there already" in capsys.readouterr().err
    assert command("--sim", "--yes", actor=Electrodes(gains={"biceps": 3e-4, "triceps": 3e-4})) == 0
    assert (folder / "p07.json.old").read_bytes() == first
    text = (folder / "p07.json").read_text()
    (folder / "p07.json").write_text(re.sub(r'"mvc": [\d.e-]+', '"mvc": 0.01', text, count=1))
    assert main(["check", "worn.yaml"]) == 2
    assert "it was changed after it was written" in capsys.readouterr().err


def test_a_recording_gives_the_same_file_and_a_muscle_is_done_again(
    command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = Electrodes(strengths={"triceps": [0.5]})
    assert command("--sim", actor=bad) == 2
    recorded(bad, folder / "bad.rrd")
    assert command("--recording", "bad.rrd", person=False) == 2
    again = Electrodes(seed=6)
    assert command("--sim", "--redo", "2", "--from", "bad.rrd", actor=again) == 0
    assert again.reported == ["triceps", "triceps"]
    recorded(again, folder / "again.rrd")
    assert command("--recording", "bad.rrd", "again.rrd", "-o", "both.json", person=False) == 0
    assert (folder / "both.json").read_bytes() == (folder / "p07.json").read_bytes()
    other = "devices.emg.channels={biceps: 5, triceps: 4}"
    capsys.readouterr()
    assert command("--recording", "bad.rrd", "again.rrd", "-o", "other.json", "--set", other, person=False) == 2
    assert "it is of other muscles or slots than the profile's: biceps: 3" in capsys.readouterr().err
    recorded(strange := Electrodes(person="P08"), folder / "strange.rrd")
    assert strange.rows == []
    assert command("--recording", "bad.rrd", "--set", "devices.emg.channels={biceps: 3}", "-o", "x.json") == 2


def test_a_recording_of_another_person_is_refused(
    command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    actor, procedure = Electrodes(person="P08"), procedure_of()
    feed(actor, procedure, 4.0)
    recorded(actor, folder / "short.rrd")
    assert command("--recording", "short.rrd") == 2
    assert "it is of P08" in capsys.readouterr().err
    assert command("--recording", "short.rrd", person=False) == 2
    assert re.search(r"(bi|tri)ceps, contraction \d: it wasn't done to its end", capsys.readouterr().err)


@pytest.mark.parametrize("how", ["hole", "gone"])
def test_a_contraction_in_which_samples_are_missing_is_done_again(how: str) -> None:
    actor, procedure = Electrodes(), procedure_of()
    while procedure.step.kind is not Kind.CONTRACT:
        feed(actor, procedure, 0.2)
    feed(actor, procedure, 0.6)
    getattr(actor, how).update(range(actor._t + 1, actor._t + 4))
    feed(actor, procedure, 0.6)
    assert procedure.step.kind is Kind.PAUSE
    assert (procedure.step.muscle, procedure.step.repeat) == (1, 1)
    feed(actor, procedure, 60.0)
    assert procedure.done
    assert actor.reported.count("biceps") == 3


def test_a_contraction_that_never_comes_ends() -> None:
    actor, procedure = Electrodes(strengths={"biceps": [0.0, 0.0]}), procedure_of()
    feed(actor, procedure, 60.0)
    assert procedure.done


def test_a_sensor_out_of_reach_is_named() -> None:
    actor, procedure = Electrodes(limit={"triceps": 0.0}), procedure_of()
    feed(actor, procedure, 5.0)
    assert procedure.step.kind is Kind.READY
    assert procedure.view().missing == "not measured: triceps"


def test_another_rate_of_samples_is_told(command: Command, capsys: pytest.CaptureFixture[str]) -> None:
    assert command("--sim", "--option", "rate=1500", actor=Electrodes((*QUICK, "rate=1500"))) == 2
    assert "rest: 2000 samples came in a second, 1500 are expected" in capsys.readouterr().err


def test_keys() -> None:
    actor, procedure = Electrodes(), procedure_of()
    assert procedure.go_on() == "the muscles aren't measured"
    feed(actor, procedure, 0.4)
    assert procedure.skip().startswith("every muscle is needed")
    assert procedure.redo(3) == "the muscles are 1 to 2, 0 is the rest"
    assert procedure.redo(2) == ""
    assert procedure.step.kind is Kind.READY  # no onset is known before the rest level is
    feed(actor, procedure, 60.0)
    assert procedure.done
    assert actor.reported == ["triceps", "triceps", "biceps", "biceps"]
    assert procedure.redo(0) == ""
    feed(actor, procedure, 10.0)
    assert procedure.done


def test_the_screen_shows_what_to_do_and_what_each_muscle_gives() -> None:
    actor, procedure = Electrodes(), procedure_of()
    while procedure.step.kind is not Kind.CONTRACT:
        feed(actor, procedure, 0.2)
    console = Console(file=io.StringIO(), width=110, force_terminal=False)
    console.print(picture("calibrate", procedure.view()))
    shown = console.file.getvalue()  # type: ignore[attr-defined]
    for words in ("NOW contract biceps", "triceps", "uV", "muscles ", "q quit"):
        assert words in shown


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--option", "low=1500"], "a band of 1500 to 450 Hz at 2000 Hz"),
        (["--option", "repeats=1"], "--option repeats"),
        (["--option", "pause=nan"], "--option pause"),
        (["--dofs", "swivel"], "--dofs: it is of 'ikns', not of 'emg'"),
        (["--person", "Anna"], "isn't anonymous"),
        (["--set", "controllers=[]"], "the profile has no law 'emg-activation'"),
        (["--set", "controllers.0.in.count=other.count"], "'samples' and 'count' aren't those of one device"),
    ],
)
def test_wrong_arguments_are_named(
    arguments: list[str], words: str, command: Command, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command("--sim", *arguments) == 2
    output = capsys.readouterr().err
    assert words in output
    assert "Traceback" not in output


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda made: made["muscles"]["biceps"].update(mvc=1e-7), "a contraction must give more"),
        (
            lambda made: (made["muscles"].update(calf=made["muscles"].pop("biceps")), made.pop("channels")),
            "components differ",
        ),
        (lambda made: made["muscles"].update(calf=made["muscles"].pop("biceps")), "the slots aren't those of its"),
        (lambda made: made.update(band=[20.0, 1500.0]), "a band of 20 to 1500 Hz at 2000 Hz"),
        (lambda made: made.update(format="srl-ft-1"), "format"),
    ],
)  # fmt: skip
def test_a_file_that_doesnt_fit_is_refused(
    change: Callable[[dict[str, Any]], None], words: str, command: Command, folder: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    assert command("--sim") == 0
    edited(folder / "p07.json", change)
    capsys.readouterr()
    assert main(["check", "worn.yaml"]) == 2
    output = capsys.readouterr().err
    assert words in output
    assert "Traceback" not in output


def test_exchanged_slots_are_refused_and_a_file_of_before_is_doubted(
    command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command("--sim") == 0
    swapped = ["--set", "devices.emg.channels={biceps: 4, triceps: 3}"]
    capsys.readouterr()
    assert main(["check", "worn.yaml", *swapped]) == 2
    output = capsys.readouterr().err
    assert "controllers.0.in.samples" in output
    assert "made with emg.channels {'biceps': 3, 'triceps': 4}, now it is {'biceps': 4, 'triceps': 3}" in output
    assert main(["check", "worn.yaml", "--set", "devices.emg.channels={triceps: 4, biceps: 3}"]) == 2  # another order
    yesterday = {"simulated": False, "date": str(datetime.date.today() - datetime.timedelta(days=2))}
    edited(folder / "p07.json", lambda made: made.update(yesterday))
    assert main(["check", "worn.yaml"]) == 0
    reported = " ".join(capsys.readouterr().out.split())
    assert "p07.json: it was made 2 days ago, and holds only while the electrodes stay on the skin" in reported
    edited_again = json.loads((folder / "p07.json").read_text()) | {"date": str(datetime.date.today())}
    (folder / "p07.json").write_text(json.dumps(edited_again))
    assert main(["check", "worn.yaml", "--json"]) == 0
    assert not [each for each in json.loads(capsys.readouterr().out)["warnings"] if "days ago" in each]


def test_files_of_two_persons_are_doubted() -> None:
    today = datetime.date(2026, 1, 2)

    def file(**output: object) -> bytes:
        return json.dumps(output).encode()

    one, two = file(person="P07"), file(person="P08", format="srl-suit-1", date="2026-01-02")
    assert calibrations.warnings({"a.json": one, "b.json": one, "c.urdf": b"<robot/>"}, today) == []
    (output,) = calibrations.warnings({"a.json": one, "b.json": two}, today)
    assert output.startswith("the files are of 2 persons: P07 (a.json), P08 (b.json)")
    assert calibrations.warnings({"a.json": one, "b.json": file(person="P08", simulated=True)}, today) == []
    (output,) = calibrations.warnings({"b.json": two}, datetime.date(2026, 1, 1))
    assert "on a day that hasn't come yet" in output


@pytest.mark.slow
def test_the_simulated_muscles_of_the_shipped_profile_are_calibrated(tmp_path: Path) -> None:
    gains = "sim.devices.emg.gains={biceps: 0.0008, triceps: 0.0003}"
    reported: dict[str, Any] = summary(
        call(
            tmp_path, "calibrate", "emg-station", "emg", "--sim", "--person", "P07", "-o", "p07.json", "--json",
            "--option", "pause=1", "--option", "repeats=2", "--option", "hold=2", "--set", gains,
            "--set", "devices.emg.channels={biceps: 3, triceps: 4}",
        )
    )  # fmt: skip
    assert reported["refusals"] == []
    for name, gain in (("biceps", 8e-4), ("triceps", 3e-4)):
        assert reported["muscles"][name]["mvc"] == pytest.approx(MEAN * gain, rel=0.08)


def procedure_of() -> Procedure:
    return Procedure(NAMES, PLAN, Thresholds())
