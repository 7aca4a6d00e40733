"""`srl calibrate PROFILE ft`: hidden bias and load of a sensor are found, or what can't work is refused."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.acted_calibration import calibrate, feed, recorded
from helpers.admittance import admittance
from helpers.edited import edited
from helpers.ft_calibration import BIAS, COM, MASS, PROFILE, Turner
from helpers.run import call, summary
from rich.console import Console
from scipy.spatial.transform import Rotation

from srl.commissioning.calibration.ft import method as ft_method
from srl.commissioning.calibration.ft import report as ft_report
from srl.commissioning.calibration.ft.fit import Thresholds
from srl.commissioning.calibration.ft.procedure import Kind, Procedure
from srl.commissioning.calibration.ft.samples import Plan
from srl.commissioning.calibration.screen import picture
from srl.control.cobot.ft_record import FtRecord
from srl.runtime.cli import main
from srl.runtime.contracts.files import KeptFile
from srl.runtime.contracts.gravity import GRAVITY
from srl.runtime.models import record_file

Command = Callable[..., int]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "led.yaml").write_text(PROFILE)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def command(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Command:
    return calibrate(monkeypatch, ft_report, "led.yaml", "ft", Turner, personal=False)


def read(path: Path) -> FtRecord:
    return record_file.read(FtRecord, path)


@pytest.mark.slow
def test_hidden_bias_and_load_are_found_and_the_profile_reads_them(
    command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", "led.yaml"]) == 2
    assert "Make it with `srl calibrate PROFILE ft`" in capsys.readouterr().err
    actor = Turner()
    assert command("--sim", actor=actor, picture=True) == 0
    assert actor.closed
    made = read(folder / "handle.json")
    # Means of 100 samples with 0.05 N of noise.
    np.testing.assert_allclose(made.bias[:3], BIAS[:3], atol=0.01)
    np.testing.assert_allclose(made.bias[3:], BIAS[3:], atol=5e-4)
    assert made.tool_mass == pytest.approx(MASS, abs=1e-3)
    np.testing.assert_allclose(made.tool_com, COM, atol=1e-4)
    assert (made.signal, made.frame, made.simulated, made.poses) == ("sensor.wrench", "handle", True, 8)
    said = capsys.readouterr()
    assert "Turn the sensor: its z axis down" in said.err
    assert [Path(line).name for line in said.out.splitlines()[-2:]] == ["handle.json", "handle.json.report.png"]
    assert (folder / "handle.json.report.png").read_bytes()[:4] == b"\x89PNG"
    assert main(["check", "led.yaml"]) == 0
    assert "controllers.2.calibration: it was made in simulation, and 'sensor' is real" in capsys.readouterr().out


@pytest.mark.slow
def test_the_law_takes_the_file_and_feels_no_hand_where_there_is_none(command: Command, folder: Path) -> None:
    assert command("--sim") == 0
    file = KeptFile.read(folder / "handle.json")
    for seed in range(5):
        turn = Rotation.random(rng=seed)
        weight = turn.inv().apply([0.0, 0.0, -GRAVITY * MASS])
        law = admittance((0.0, 0.0, 0.0, *turn.as_quat(scalar_first=True)), calibration=file)
        law.input["wrench"][:] = np.concatenate([weight, np.cross(COM, weight)]) + BIAS
        law.update(0.002)
        assert np.linalg.norm(law.output["hand"][:3]) < 0.02
        assert np.linalg.norm(law.output["hand"][3:]) < 2e-3
    bare = admittance()
    bare.input["wrench"][:] = BIAS
    bare.update(0.002)
    assert np.linalg.norm(bare.output["hand"][:3]) > 3.0


def test_one_pose_finds_the_bias_alone(command: Command, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    actor = Turner(("poses=1",))
    assert command("--sim", "--option", "poses=1", actor=actor) == 0
    made = read(folder / "handle.json")
    assert (made.poses, made.tool_mass, actor.turned) == (1, 0.0, 0)
    shown = BIAS + np.array([0.0, 0.0, -GRAVITY * MASS, *np.cross(COM, [0.0, 0.0, -GRAVITY * MASS])])
    np.testing.assert_allclose(made.bias, shown, atol=0.02)
    assert "the tool's weight in this pose is part of the bias" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("actor", "words"),
    [
        ({"touched": {3: 2.0}}, r"pose 3: \d\.\d+ N and \d\.\d+ N m are left of its wrench"),
        ({"flat": True}, r"poses: they lie too near one plane: spread 0\.\d\d, 0.25 are needed"),
    ],
)
def test_what_cant_work_is_refused_with_its_reason(
    actor: dict[str, Any], words: str, command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "handle.json").write_text("{}")
    before = sorted(folder.iterdir())
    assert command("--sim", "-o", "new.json", actor=Turner(**actor)) == 2
    assert re.search(words, capsys.readouterr().err)
    assert sorted(folder.iterdir()) == before


@pytest.mark.slow
def test_the_old_file_is_kept(command: Command, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command("--sim") == 0
    first = (folder / "handle.json").read_bytes()
    assert command("--sim") == 2
    assert "a calibration is there already" in capsys.readouterr().err
    assert command("--sim", "--yes", actor=Turner(mass=0.6)) == 0
    assert (folder / "handle.json.old").read_bytes() == first
    assert read(folder / "handle.json").tool_mass == pytest.approx(0.6, abs=1e-3)


@pytest.mark.slow
def test_a_recording_gives_the_same_file_and_a_pose_is_done_again(command: Command, folder: Path) -> None:
    bad = Turner(touched={3: 2.0})
    assert command("--sim", actor=bad) == 2
    recorded(bad, folder / "bad.rrd")
    assert command("--recording", "bad.rrd") == 2
    again = Turner()
    assert command("--sim", "--redo", "3", "--from", "bad.rrd", actor=again) == 0
    assert again.turned == 1
    recorded(again, folder / "again.rrd")
    assert command("--recording", "bad.rrd", "again.rrd", "-o", "both.json") == 0
    assert (folder / "both.json").read_bytes() == (folder / "handle.json").read_bytes()
    assert read(folder / "both.json").tool_mass == pytest.approx(MASS, abs=1e-3)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--person", "P07"], "--person: 'ft' is no person's"),
        (["--option", "poses=4"], "4 poses don't find the load: 6 are needed"),
        (["--option", "pose=4"], "there is no such option. Did you mean 'poses'"),
        (["--dofs", "swivel"], "--dofs: it is of 'ikns', not of 'ft'"),
        (["--set", "devices.sensor.bias=true"], "Leave `bias: true` out"),
        (["--set", "controllers.2.calibration={tool_mass: 0.2}"], "the profile names no calibration file"),
    ],
)
def test_wrong_arguments_are_named(
    arguments: list[str], words: str, command: Command, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command("--sim", *arguments) == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("{tool_mas: 0.2}", "calibration.tool_mas"),
        ("{tool_mass: -1}", "calibration.tool_mass"),
        ("3", "calibration"),
        ("led.yaml", "led.yaml: it is no JSON"),
    ],
)
def test_a_wrong_value_or_file_is_named_at_its_place(
    given: str, words: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", "led.yaml", "--set", f"controllers.2.calibration={given}"]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert "Traceback" not in said


def test_values_and_the_old_options(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "led.yaml", "--set", "controllers.2.calibration={tool_mass: 0.2}"]) == 0
    assert main(["check", "led.yaml", "--set", "controllers.2.tool_mass=0.2"]) == 2
    assert "the key 'tool_mass' is gone" in capsys.readouterr().err


def test_a_calibration_of_another_frame_is_refused(
    command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command("--sim") == 0
    edited(folder / "handle.json", lambda made: made.update(frame="tool"))
    capsys.readouterr()
    assert main(["check", "led.yaml"]) == 2
    assert "sensor.wrench is in 'handle', guide.wrench expects 'tool'" in capsys.readouterr().err


def test_a_pose_like_another_or_that_moves_isnt_taken() -> None:
    actor = Turner(stays=(2,))
    procedure = Procedure(Plan(), Thresholds())
    feed(actor, procedure, 20.0)
    assert (procedure.step.kind, procedure.step.number) == (Kind.GO, 2)
    assert "it reads as in pose 1" in procedure.view().lack
    actor.stays = ()
    actor.begin(procedure)
    while procedure.step.kind is not Kind.HOLD:
        feed(actor, procedure, 0.1)
    feed(actor, procedure, 0.5)
    actor.touched = {2: 3.0}
    feed(actor, procedure, 1.5)
    assert (procedure.step.kind, procedure.step.number) == (Kind.GO, 2)


def test_the_screen_shows_what_to_do_and_what_the_sensor_reads() -> None:
    actor, procedure = Turner(), Procedure(Plan(), Thresholds())
    feed(actor, procedure, 1.0)
    console = Console(file=io.StringIO(), width=110, force_terminal=False)
    console.print(picture("calibrate", procedure.view()))
    shown = console.file.getvalue()  # type: ignore[attr-defined]
    for words in ("Turn the sensor: its z axis up", "force", "torque", "poses ", "q quit"):
        assert words in shown


@pytest.mark.slow
def test_the_last_wrench_of_a_lost_sensor_counts_for_nothing() -> None:
    actor = Turner(lost=(2,))
    procedure = Procedure(Plan(), Thresholds())
    feed(actor, procedure, 20.0)
    assert (procedure.step.kind, procedure.step.number) == (Kind.GO, 2)
    assert procedure.view().missing == "the wrench isn't measured"
    actor.lost = ()
    feed(actor, procedure, 60.0)
    assert procedure.done


def test_a_pose_left_out_counts_for_nothing() -> None:
    procedure = Procedure(Plan(poses=7), Thresholds())
    actor = Turner(("poses=7",))
    while procedure.step.number != 3:
        feed(actor, procedure, 0.1)
    assert procedure.skip() == ""
    feed(actor, procedure, 60.0)
    assert procedure.done
    assert procedure.view().states[2] == "left out"
    found = ft_method.FtMethod.compute(
        object.__new__(ft_method.FtMethod), actor.channel_map, [actor.channel_map.samples(np.concatenate(actor.rows))],
        actor.channel_map.date(actor.rows[0]),
    )  # fmt: skip
    assert found.found.numbers == (1, 2, 4, 5, 6, 7)
    assert procedure.redo(1) == ""
    assert procedure.skip() == "6 poses must remain"


@pytest.mark.exhaustive
@pytest.mark.slow
def test_the_simulated_handle_of_a_shipped_profile_is_found(tmp_path: Path) -> None:
    """The robot isn't there: the person has the sensor in the hands, and nobody holds the handle."""
    hidden = ["sim.devices.sensor.offset=[3,-2,1,0.1,0.2,-0.3]", "sim.parts.grip.mass=0.4", "rate=100"]
    arguments = [word for each in hidden for word in ("--set", each)]
    reported: dict[str, Any] = summary(
        call(tmp_path, "calibrate", "kairos-man", "ft", "--sim", "-o", "handle.json", "--json", *arguments)
    )
    assert reported["refusals"] == []
    np.testing.assert_allclose(reported["bias"][:3], [3.0, -2.0, 1.0], atol=0.02)
    np.testing.assert_allclose(reported["bias"][3:], [0.1, 0.2, -0.3], atol=1e-3)
    assert reported["tool_mass"] == pytest.approx(0.4 + 0.05, abs=2e-3)
    np.testing.assert_allclose(reported["tool_com"], [0.0, 0.0, 0.4 * 0.06 / 0.45], atol=5e-4)
    assert [p["number"] for p in reported["poses"]] == list(range(1, 9))
