"""`srl calibrate PROFILE suit`: a hidden heading and drift are found, or what can't work is refused."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.acted_calibration import calibrate, feed
from helpers.edited import edited
from helpers.run import call, summary
from helpers.suit_calibration import BODY, PROFILE, QUICK, Suited
from rich.console import Console

from srl.commissioning.calibration.screen import picture
from srl.commissioning.calibration.sources import RowFile
from srl.commissioning.calibration.suit import report as suit_report
from srl.commissioning.calibration.suit.fit import PER_MINUTE
from srl.commissioning.calibration.suit.procedure import Kind, Procedure
from srl.drivers.noitom.config import NoitomConfig
from srl.drivers.noitom.pose import Pose
from srl.drivers.noitom.protocol import Frame
from srl.runtime.cli import main
from srl.runtime.contracts.files import KeptFile
from srl.runtime.contracts.rotation import euler_angles, matrices
from srl.runtime.contracts.suit_record import SuitRecord
from srl.runtime.models import record_file

Command = Callable[..., int]
TYPED = [word for option in QUICK for word in ("--option", option)]
MINUTE = 1.0 / PER_MINUTE  # rad/s, of a degree a minute


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "worn.yaml").write_text(PROFILE)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def command(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Command:
    return calibrate(monkeypatch, suit_report, "worn.yaml", "suit", Suited, TYPED)


def read(path: Path) -> SuitRecord:
    return record_file.read(SuitRecord, path)


@pytest.mark.slow
def test_a_hidden_heading_and_drift_are_found_and_the_profile_reads_them(
    command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", "worn.yaml"]) == 2
    assert "Make it with `srl calibrate PROFILE suit`" in capsys.readouterr().err
    hidden = {"LeftForeArm": 1.5 * MINUTE, "Head": -1.2 * MINUTE, "RightFoot": 0.8 * MINUTE}
    actor = Suited(heading=-2.5, drift=hidden, scatter=0.002)
    assert command("--sim", actor=actor, picture=True) == 0
    assert actor.closed
    made = read(folder / "p07.json")
    assert (made.person, made.simulated, made.signal, made.pose, made.stands) == ("P07", True, "suit.rotation", "n", 4)
    assert made.heading == pytest.approx(-2.5, abs=0.01)
    for name, found in made.drifts.items():
        assert found.measured
        assert PER_MINUTE * found.rate == pytest.approx(PER_MINUTE * hidden.get(name, 0.0), abs=0.4)
        assert PER_MINUTE * found.uncertain < 0.4
    output = capsys.readouterr()
    assert "Come back: stand on the marks" in output.err
    assert (folder / "p07.json.report.png").read_bytes()[:4] == b"\x89PNG"
    assert main(["check", "worn.yaml"]) == 0
    assert "devices.suit.calibration: it was made in simulation, and the device is real" in capsys.readouterr().out


@pytest.mark.slow
def test_a_drift_of_hips_and_chest_is_in_the_heading_at_the_end(command: Command, folder: Path) -> None:
    all_of_it = {name: 1.5 * MINUTE for name in BODY.names}
    actor = Suited(heading=0.2, drift=all_of_it, scatter=0.001)
    assert command("--sim", actor=actor) == 0
    assert read(folder / "p07.json").heading == pytest.approx(0.2 + 1.5 * MINUTE * (actor.time - 2.0), abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("actor", "words"),
    [
        ({"drift": {"LeftForeArm": 6 * MINUTE}}, r"LeftForeArm: its heading drifts by \+[56]\.\d deg/min .* 2 are"),
        ({"scatter": 0.08}, r": the stands differ too much to tell. Take the same pose more exactly"),
        ({"frozen": ("Hips",), "turns": False, "scatter": 0.0}, r"Hips: they haven't turned at all"),
        ({"tilted": {(3, "RightHand"): 0.5}}, r"RightHand: in stand 3 it is tilted by 2\d degrees unlike at first"),
    ],
)  # fmt: skip
def test_what_cant_work_is_refused_with_its_reason(
    actor: dict[str, Any], words: str, command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = sorted(folder.iterdir())
    assert command("--sim", "-o", "new.json", actor=Suited(**actor)) == 2
    output = capsys.readouterr().err
    assert "Traceback" not in output
    assert re.search(words, output), output
    assert sorted(folder.iterdir()) == before


def test_a_segment_without_a_sensor_is_told_and_not_judged(command: Command, folder: Path) -> None:
    frozen = ("LeftHand", "Spine1")
    assert command("--sim", actor=Suited(frozen=frozen, drift={"LeftForeArm": MINUTE}, scatter=0.002)) == 0
    made = read(folder / "p07.json")
    assert [name for name, each in made.drifts.items() if not each.measured] == ["Spine1", "LeftHand"]


@pytest.mark.parametrize(
    ("actor", "lack"),
    [
        ({"pose": "t"}, "Arm is off the pose by"),
        ({"frozen": ("all",)}, "Arm is off the pose by"),
        ({"faces": {2: 1.5}}, "you face 86 degrees left of the first stand"),
        ({"tilted": {(1, "Hips"): 0.6}}, "Hips leans by 34 degrees"),
    ],
)
def test_a_stand_begins_only_in_the_pose(actor: dict[str, Any], lack: str) -> None:
    wearer = Suited(**actor)
    procedure = procedure_of(wearer)
    feed(wearer, procedure, 60.0)
    assert procedure.step.kind is Kind.GO
    assert lack in procedure.view().lack


def test_a_suit_that_is_lost_holds_the_stand_up() -> None:
    wearer = Suited(gone=(1,))
    procedure = procedure_of(wearer)
    feed(wearer, procedure, 10.0)
    assert (procedure.step.kind, procedure.view().missing) == (Kind.GO, "the suit isn't measured")
    wearer.gone = ()
    feed(wearer, procedure, 200.0)
    assert procedure.done


def test_keys_and_the_screen() -> None:
    wearer = Suited()
    procedure = procedure_of(wearer)
    assert procedure.go_on().startswith("it begins by itself")
    while procedure.step.kind is not Kind.PAUSE:
        feed(wearer, procedure, 0.4)
    assert procedure.skip() == "every stand is needed"
    assert procedure.redo(5) == "the stands are 1 to 4"
    console = Console(file=io.StringIO(), width=110, force_terminal=False)
    console.print(picture("calibrate", procedure.view()))
    shown = console.file.getvalue()  # type: ignore[attr-defined]
    for words in ("Walk about and turn", "walk", "stands ", "q quit"):
        assert words in shown
    assert procedure.go_on() == ""
    assert (procedure.step.kind, procedure.step.number) == (Kind.GO, 2)
    assert procedure.redo(1) == ""
    feed(wearer, procedure, 200.0)
    assert procedure.done


@pytest.mark.slow
def test_the_old_file_is_kept_and_a_recording_gives_the_same(
    command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    actor = Suited(scatter=0.002)
    assert command("--sim", actor=actor) == 0
    first = (folder / "p07.json").read_bytes()
    file = RowFile(actor.graph.layout, folder / "p07.rrd")
    for rows in actor.rows:
        file.add(rows)
    file.close()
    assert command("--recording", "p07.rrd", "--yes", person=False) == 0
    assert (folder / "p07.json").read_bytes() == first == (folder / "p07.json.old").read_bytes()
    assert command("--recording", "p07.rrd", "-o", "x.json", "--person", "P08", person=False) == 2
    assert command("--recording", "p07.rrd", "p07.rrd", "-o", "x.json", person=False) == 2
    assert command("--sim", "--redo", "2", "--from", "p07.rrd", "-o", "x.json") == 2
    assert "a drift is seen within one session" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--option", "stands=2"], "--option stands"),
        (["--option", "pose=t"], "the simulated person lets the arms hang"),
        (["--option", "device=hand"], "'hand' is no device that is calibrated by 'suit'"),
        (["--person", "Anna"], "isn't anonymous"),
        (["--set", "devices.suit.calibration=null"], "the profile names no calibration file"),
        (["--set", "sim.parts.body.part=person"], "0 parts 'body'"),
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
        (lambda made: made.update(heading=90.0), "heading"),
        (lambda made: made.update(format="srl-glove-1"), "format"),
        (lambda made: made.pop("drifts"), "drifts: the key 'drifts' is missing"),
    ],
)
def test_a_file_that_doesnt_fit_is_refused(
    change: Callable[[dict[str, Any]], None], words: str, command: Command, folder: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    assert command("--sim", actor=Suited(scatter=0.002)) == 0
    text = (folder / "p07.json").read_text()
    (folder / "p07.json").write_text(text.replace('"heading": 0.', '"heading": 0.1'))
    assert main(["check", "worn.yaml"]) == 2
    assert "it was changed after it was written" in capsys.readouterr().err
    (folder / "p07.json").write_text(text)
    edited(folder / "p07.json", change)
    assert main(["check", "worn.yaml"]) == 2
    output = capsys.readouterr().err
    assert words in output
    assert "Traceback" not in output


def test_the_driver_turns_the_body_back_by_the_heading(command: Command, folder: Path) -> None:
    """A person who faced along z in the room, and walks along it, does so in what the driver gives."""
    assert command("--sim", actor=Suited(heading=0.6, scatter=0.0)) == 0
    file = KeptFile.read(folder / "p07.json")
    heading = read(folder / "p07.json").heading
    half = 0.5 * heading
    rotation = np.tile([1.0, 0.0, 0.0, 0.0], (59, 1))
    rotation[0] = np.cos(half), 0.0, np.sin(half), 0.0
    place = BODY.offsets.copy()
    place[0] = 2.0 * np.sin(heading), 0.9, 2.0 * np.cos(heading)  # two metres ahead, as the suit has it
    values = np.hstack([100.0 * place, np.degrees(euler_angles(matrices(rotation), "YXZ"))]).ravel()
    states = {"rotation": np.zeros((59, 4)), "translation": np.zeros((59, 3))}
    config = NoitomConfig(port="tcp://127.0.0.1:7001", calibration=file)
    Pose(config, BODY).fill(Frame(values, True, False, 0, "", 1), states)
    np.testing.assert_allclose(np.abs(states["rotation"][0]), [1.0, 0.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(states["translation"][0], [0.0, 0.9, 2.0], atol=1e-9)
    np.testing.assert_allclose(states["translation"][1:], BODY.offsets[1:], atol=1e-9)


@pytest.mark.slow
def test_the_simulated_suit_of_the_shipped_profile_is_calibrated(tmp_path: Path) -> None:
    hidden = {"LeftForeArm": 0.01, "RightLeg": -0.008}
    drift = ", ".join(f"{name}: {rate}" for name, rate in hidden.items())
    settings = ("sim.devices.suit.heading=0.5", f"sim.devices.suit.drift={{{drift}}}")
    reported: dict[str, Any] = summary(
        call(
            tmp_path, "calibrate", "suit-station", "suit", "--sim", "--person", "P07", "-o", "p07.json", "--json",
            *(word for each in settings for word in ("--set", each)),
            *(word for each in ("stands=3", "walk=2", "hold=4", "drift=60", "sure=10") for word in ("--option", each)),
        )
    )  # fmt: skip
    assert reported["refusals"] == []
    assert reported["heading"] == pytest.approx(0.5, abs=0.03)
    for name, each in reported["segments"].items():
        assert each["rate"] == pytest.approx(hidden.get(name, 0.0), abs=0.0015)


def procedure_of(wearer: Suited) -> Procedure:
    made: Procedure = wearer.method.procedure([])
    return made
