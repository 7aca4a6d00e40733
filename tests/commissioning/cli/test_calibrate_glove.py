"""`srl calibrate PROFILE glove`: hidden characteristics of sensors are found, or what can't work is refused."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.acted_calibration import calibrate, feed, recorded
from helpers.edited import edited
from helpers.glove_calibration import GAIN, NAMES, OFFSET, PROFILE, Gloved
from helpers.run import call, summary
from rich.console import Console

from srl.commissioning.calibration.glove import report as glove_report
from srl.commissioning.calibration.glove.fit import Thresholds
from srl.commissioning.calibration.glove.procedure import Kind, Procedure
from srl.commissioning.calibration.glove.samples import Plan
from srl.commissioning.calibration.glove.shapes import Angles
from srl.commissioning.calibration.screen import picture
from srl.drivers.cyberglove import calibration
from srl.runtime.cli import main
from srl.runtime.contracts.errors import ProfileError
from srl.runtime.contracts.files import KeptFile
from srl.runtime.contracts.glove_record import GloveRecord
from srl.runtime.models import record_file

Command = Callable[..., int]
FITTED = NAMES[:19]
SHORT = ("--option", "read=1")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "worn.yaml").write_text(PROFILE)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def command(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Command:
    return calibrate(monkeypatch, glove_report, "worn.yaml", "glove", Gloved)


def read(path: Path) -> GloveRecord:
    return record_file.read(GloveRecord, path)


@pytest.mark.slow
def test_hidden_characteristics_are_found_and_the_profile_reads_them(
    command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", "worn.yaml"]) == 2
    assert "Make it with `srl calibrate PROFILE glove`" in capsys.readouterr().err
    actor = Gloved()
    assert command("--sim", actor=actor, picture=True) == 0
    assert actor.closed
    made = read(folder / "p07.json")
    assert (made.person, made.hand, made.simulated, made.signal) == ("P07", "right", True, "glove.raw")
    assert tuple(made.sensors) == FITTED
    assert made.average == NAMES[19:]
    np.testing.assert_allclose([s.offset for s in made.sensors.values()], OFFSET[:19], atol=0.5)
    np.testing.assert_allclose([s.gain for s in made.sensors.values()], GAIN[:19], rtol=0.02)
    output = capsys.readouterr()
    assert "Make a fist" in output.err
    assert [Path(line).name for line in output.out.splitlines()[-2:]] == ["p07.json", "p07.json.report.png"]
    assert (folder / "p07.json.report.png").read_bytes()[:4] == b"\x89PNG"
    assert main(["check", "worn.yaml"]) == 0
    assert "devices.glove.calibration: it was made in simulation, and the device is real" in capsys.readouterr().out


def test_the_driver_gives_the_hand_s_angles_with_it(command: Command, folder: Path) -> None:
    assert command("--sim") == 0
    loaded = calibration.load(KeptFile.read(folder / "p07.json"), 22)
    assert (loaded.person, loaded.hand, loaded.simulated) == ("P07", "right", True)
    assert "palm_arch, wrist_pitch, wrist_yaw: of an average hand" in loaded.note
    angles = np.random.default_rng(3).uniform(0.0, 1.0, 22)
    found = np.empty(22)
    loaded.angles(bytes(np.clip(np.round(OFFSET + angles / GAIN), 1, 255).astype(np.uint8)), found)
    inside = np.abs(OFFSET + angles / GAIN - 128.0) < 126.0
    inside[19:] = False
    np.testing.assert_allclose(found[inside], angles[inside], atol=0.03)
    average = calibration.default(22).table[19:]
    np.testing.assert_array_equal(loaded.table[19:], average)


@pytest.mark.parametrize(
    ("actor", "words"),
    [
        ({"dead": {"ring_pij": 120.0}}, r"ring_pij: it doesn't move: 120.0 to 120.0 counts in all shapes"),
        ({"gain": {"index_mpj": 0.2}}, r"index_mpj: flat hand and shape 2 \(fist\) differ by \d+ counts, 20 are"),
        ({"gain": {"middle_mpj": -0.004}}, r"middle_mpj: it reads \d+, the end of its scale, in shape 2 \(fist\)"),
        ({"noise": {"thumb_ij": 8.0}, "option": ("steady=20",)}, r"thumb_ij: its noise is \d\.\d counts, 4 are"),
        (
            {"swapped": [("index_pij", "middle_pij")]},
            r"index_pij: it shows -?\d% of the fist while the index finger alone is bent. "
            r"Are its cable and that of middle_pij exchanged",
        ),
        (
            {"off": {5: {"middle_mpj": 1.4}}},
            r"middle_mpj: it shows \d+% of the fist while the index finger alone is bent. Bend one finger alone",
        ),
        (
            {"off": {n: {"ring_mpj": 0.6} for n in (1, 9)}},
            r"ring_mpj: in shape \d it is straighter by \d+% of the fist than in the flat hand. The hand wasn't flat",
        ),
        ({"off": {9: {"pinkie_pij": 0.4}}}, r"pinkie_pij: the flat hand differs by 0\.\d+ rad between"),
        ({"off": {2: {"index_pij": -0.7}}}, r"index_pij: in shape 5 it is bent further than in the fist: 16\d%"),
        ({"off": {2: {n: -1.4 for n in NAMES}}}, r"index_mpj: flat hand and shape 2 \(fist\) differ by \d counts"),
    ],
)  # fmt: skip
def test_what_cant_work_is_refused_with_its_reason(
    actor: dict[str, Any], words: str, command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "p07.json").write_text("{}")
    before = sorted(folder.iterdir())
    typed = [word for option in actor.get("option", ()) for word in ("--option", option)]
    assert command("--sim", "-o", "new.json", *typed, actor=Gloved(**actor)) == 2
    output = capsys.readouterr().err
    assert re.search(words, output), output
    assert "Traceback" not in output
    assert sorted(folder.iterdir()) == before


def test_fingers_that_bend_together_by_half_are_a_hand_s_own(command: Command) -> None:
    """Nobody bends the ring finger quite alone."""
    half = {n: a / 2.0 for n, a in (("middle_mpj", 1.45), ("pinkie_mpj", 1.45), ("pinkie_pij", 1.75))}
    assert command("--sim", actor=Gloved(off={7: half})) == 0


def test_the_old_file_is_kept(command: Command, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command("--sim") == 0
    first = (folder / "p07.json").read_bytes()
    assert command("--sim") == 2
    assert "a calibration is there already" in capsys.readouterr().err
    assert command("--sim", "--yes", actor=Gloved(gain={"index_mpj": 0.016})) == 0
    assert (folder / "p07.json.old").read_bytes() == first
    assert read(folder / "p07.json").sensors["index_mpj"].gain == pytest.approx(0.016, rel=0.02)


def test_a_hand_written_calibration_isnt_replaced(
    command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "p07.json").write_text("person: P07\n")
    assert command("--sim", "--yes") == 2
    assert "it is no JSON" in capsys.readouterr().err
    assert (folder / "p07.json").read_text() == "person: P07\n"


def test_a_full_disk_is_said_before_anybody_begins(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("srl.commissioning.calibration.session.free_bytes", lambda _: 1 << 20)
    assert main(["calibrate", "worn.yaml", "glove", "--person", "P07"]) == 2
    assert "its disk has less than 64 MiB free" in capsys.readouterr().err
    assert [path.name for path in folder.iterdir()] == ["worn.yaml"]


@pytest.mark.slow
def test_a_recording_gives_the_same_file_and_a_shape_is_done_again(command: Command, folder: Path) -> None:
    bad = Gloved(off={9: {"pinkie_pij": 0.4}})
    assert command("--sim", actor=bad) == 2
    recorded(bad, folder / "bad.rrd")
    assert command("--recording", "bad.rrd", person=False) == 2
    again = Gloved()
    assert command("--sim", "--redo", "9", "--from", "bad.rrd", actor=again) == 0
    assert again.shaped == 1
    recorded(again, folder / "again.rrd")
    assert command("--recording", "bad.rrd", "again.rrd", "-o", "both.json", person=False) == 0
    assert (folder / "both.json").read_bytes() == (folder / "p07.json").read_bytes()
    assert command("--recording", "bad.rrd", "again.rrd", "-o", "other.json", "--set", "devices.glove.hand=left") == 2


def test_a_broken_sensor_is_left_to_an_average_hand_later(
    command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    actor = Gloved(dead={"ring_pij": 120.0})
    assert command("--sim", actor=actor) == 2
    assert "--option average=...,ring_pij" in capsys.readouterr().err
    recorded(actor, folder / "bad.rrd")
    average = "average=palm_arch,wrist_pitch,wrist_yaw,ring_pij"
    assert command("--recording", "bad.rrd", "--option", average) == 0
    made = read(folder / "p07.json")
    assert set(made.average) == {*NAMES[19:], "ring_pij"}
    assert "ring_pij" not in made.sensors
    assert command("--recording", "bad.rrd", "--option", "average=ring", "-o", "x.json") == 2
    assert "the glove has no sensor 'ring'" in capsys.readouterr().err


def test_a_broken_sensor_that_is_left_out_holds_nobody_up() -> None:
    actor = Gloved(noise={"ring_pij": 90.0})
    average = "palm_arch,wrist_pitch,wrist_yaw,ring_pij"
    procedure = Procedure(NAMES, Plan(read=1.0, average=average), Angles(), Thresholds())
    feed(actor, procedure, 90.0)
    assert procedure.done


def test_a_recording_of_another_person_or_that_ended_early_is_refused(
    command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    actor, procedure = Gloved(person="P08"), procedure_of()
    feed(actor, procedure, 20.0)
    recorded(actor, folder / "short.rrd")
    assert command("--recording", "short.rrd") == 2
    assert "it is of P08" in capsys.readouterr().err
    assert command("--recording", "short.rrd", person=False) == 2
    assert re.search(r"shape \d \(\w+\): it wasn't held to its end", capsys.readouterr().err)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--option", "average=palm"], "--option average: the glove has no sensor 'palm'"),
        (["--option", "average=palm_arch"], "wrist_pitch: no shape bends it by a known angle"),
        (["--option", f"average={','.join(NAMES)}"], "no sensor is left to calibrate"),
        (["--option", "device=hand"], "'hand' is no device that is calibrated by 'glove'"),
        (["--option", "mpj=90"], "--option mpj: it should be less than or equal to 2"),
        (["--option", "mpj=nan"], "--option mpj"),
        (["--dofs", "swivel"], "--dofs: it is of 'ikns', not of 'glove'"),
        (["--person", "Anna"], "isn't anonymous"),
        (["--redo", "10", "--from", "x.rrd"], "x.rrd"),
        (["--set", "devices.glove.calibration=null"], "the profile names no calibration file"),
        (["--set", "devices.glove.driver=gamepad"], "none of its devices is calibrated by 'glove'"),
        (["--set", "sim.parts.hand.part=person"], "0 parts 'human-hand'"),
    ],
)
def test_wrong_arguments_are_named(
    arguments: list[str], words: str, command: Command, capsys: pytest.CaptureFixture[str]
) -> None:
    option = [] if arguments[0] != "--option" or arguments[1] != "average=palm_arch" else [arguments[1]]
    assert command("--sim", *arguments, actor=Gloved(option)) == 2
    output = capsys.readouterr().err
    assert words in output
    assert "Traceback" not in output


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda made: made["sensors"]["index_mpj"].update(gain=0.0), "index_mpj.gain: gain must be"),
        (lambda made: made["sensors"].pop("index_mpj"), "sensors.index_mpj: the sensor is missing"),
        (lambda made: made["sensors"].update(toe=made["sensors"]["index_mpj"]), "toe: a glove of 22 sensors"),
        (lambda made: made["average"].append("index_mpj"), "'index_mpj' is named twice"),
        (lambda made: made.update(format="srl-ft-1"), "format: "),
        (lambda made: made.update(hand="left"), "is of a left hand, the profile says right"),
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


@pytest.mark.parametrize("text", ["{", '{"a": 1, "a": 2}', '{"x":' * 5000, "{}", '{"sensors": NaN}'])
def test_no_text_is_taken_for_a_calibration(text: str, folder: Path) -> None:
    (folder / "p07.json").write_text(text)
    with pytest.raises(ProfileError):
        calibration.load(KeptFile.read(folder / "p07.json"), 22)


def test_a_file_that_was_changed_is_refused(command: Command, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command("--sim") == 0
    text = (folder / "p07.json").read_text()
    (folder / "p07.json").write_text(text.replace('"hand": "right"', '"hand": "right" '))
    assert main(["check", "worn.yaml"]) == 0
    (folder / "p07.json").write_text(re.sub(r'"gain": (-?)0\.01', r'"gain": \g<1>0.02', text, count=1))
    capsys.readouterr()
    assert main(["check", "worn.yaml"]) == 2
    assert "it was changed after it was written" in capsys.readouterr().err


@pytest.mark.parametrize("how", ["lost", "stale"])
def test_the_last_counts_of_a_lost_glove_count_for_nothing(how: str) -> None:
    actor, procedure = Gloved(), procedure_of()
    setattr(actor, how, (2,))
    feed(actor, procedure, 20.0)
    assert (procedure.step.kind, procedure.step.number) == (Kind.GO, 2)
    assert procedure.view().missing == "the glove isn't measured"
    setattr(actor, how, ())
    feed(actor, procedure, 90.0)
    assert procedure.done


def test_a_hand_that_stays_or_moves_isnt_taken() -> None:
    actor, procedure = Gloved(stays=(3,)), procedure_of()
    feed(actor, procedure, 20.0)
    assert (procedure.step.kind, procedure.step.number) == (Kind.GO, 3)
    assert procedure.view().lack == "it reads as in the shape before"
    actor.stays, actor.off = (), {3: {"index_mpj": 0.5}}
    actor.begin(procedure)
    while procedure.step.kind is not Kind.HOLD:
        feed(actor, procedure, 0.2)
    actor._from, actor._to, actor._since = actor._to, np.full(22, 0.3), actor._t / 50.0
    feed(actor, procedure, 1.6)
    assert (procedure.step.kind, procedure.step.number) == (Kind.GO, 3)
    assert procedure.skip() == "every shape is needed"
    assert procedure.redo(10) == "the shapes are 1 to 9"


def test_the_first_shape_waits_until_it_was_read() -> None:
    actor, procedure = Gloved(), Procedure(NAMES, Plan(read=6.0), Angles(), Thresholds())
    feed(actor, procedure, 5.0)
    assert procedure.step.kind is Kind.GO
    feed(actor, procedure, 2.0)
    assert procedure.step.kind is Kind.HOLD


def test_the_screen_shows_what_to_do_and_what_the_glove_reads() -> None:
    actor, procedure = Gloved(), procedure_of()
    feed(actor, procedure, 1.0)
    console = Console(file=io.StringIO(), width=110, force_terminal=False)
    console.print(picture("calibrate", procedure.view()))
    shown = console.file.getvalue()  # type: ignore[attr-defined]
    for words in ("Lay the hand flat", "thumb", "pinkie", "shapes ", "q quit"):
        assert words in shown


@pytest.mark.slow
def test_the_simulated_glove_of_a_shipped_profile_is_calibrated(tmp_path: Path) -> None:
    """A hand that misses what it is told a little, a radio that loses records, and a glove of 18 sensors."""
    hidden = "{index_mpj: {gain: -0.02, offset: 190.0}, thumb_ij: {gain: 0.015, offset: 60.0}}"
    settings = (
        f"sim.devices.glove.characteristic={hidden}", "devices.glove.sensors=18", "sim.devices.glove.dropout=0.05",
        "sim.parts.hand.wearer.miss=0.02",
    )  # fmt: skip
    arguments = [word for each in settings for word in ("--set", each)]
    reported: dict[str, Any] = summary(
        call(
            tmp_path, "calibrate", "sixth-finger", "glove", "--sim", "--person", "P07", "-o", "p07.json", "--json",
            *arguments, "--option", "hold=1", "--option", "read=1",
        )
    )  # fmt: skip
    assert reported["refusals"] == []
    assert len(reported["sensors"]) == 15
    # Both ends are off by what the hand misses: 0.02 rad at each.
    for name, gain, offset in (("index_mpj", -0.02, 190.0), ("thumb_ij", 0.015, 60.0)):
        assert reported["sensors"][name]["gain"] == pytest.approx(gain, rel=0.08)
        assert reported["sensors"][name]["offset"] == pytest.approx(offset, abs=3.0)


def procedure_of() -> Procedure:
    return Procedure(NAMES, Plan(read=1.0), Angles(), Thresholds())


@pytest.mark.parametrize(
    ("sim", "words"),
    [(["glov"], "--sim glov: the profile has no such device. Did you mean 'glove'"),
     (["finger"], "--sim: a simulated person can't move what is real: glove. Name it, too")],
)  # fmt: skip
def test_sim_names_what_the_person_moves(sim: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", "sixth-finger", "glove", "--person", "P07", "--out", "x.json", "--sim", *sim]) == 2
    assert words in capsys.readouterr().err
