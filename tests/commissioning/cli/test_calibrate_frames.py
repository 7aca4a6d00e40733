"""`srl calibrate PROFILE frames`: a hidden base and tracker are found, or what can't work is refused."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from helpers.acted_calibration import calibrate, recorded
from helpers.edited import edited
from helpers.frame_calibration import BASE, POINTS, PROFILE, TRACKER, Leader
from helpers.run import call, summary
from scipy.spatial.transform import Rotation

from srl.commissioning.calibration.frames import method as frame_method
from srl.commissioning.calibration.frames import report as frame_report
from srl.commissioning.calibration.profile_subset import build
from srl.commissioning.calibration.request import CalibrationRequest
from srl.drivers.ur import Ur, UrConfig
from srl.runtime.cli import main
from srl.runtime.contracts.files import Files, decoded
from srl.runtime.models import record_file
from srl.runtime.models.mount_record import FrameRecord, Pose
from srl.runtime.profile import profile, wiring

Command = Callable[..., int]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "cell.yaml").write_text(PROFILE)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def command(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Command:
    return calibrate(monkeypatch, frame_report, "cell.yaml", "frames", Leader, personal=False)


def options(given: tuple[str, ...]) -> list[str]:
    return [word for each in given for word in ("--option", each)]


def read(path: Path) -> FrameRecord:
    return record_file.read(FrameRecord, path)


def apart(found: Pose, true: tuple[float, ...]) -> tuple[float, float]:
    """m, rad."""
    turns = [Rotation.from_quat(q, scalar_first=True) for q in (found.quaternion, true[3:])]
    away = np.linalg.norm(np.subtract(found.position, true[:3]))
    return float(away), float((turns[0].inv() * turns[1]).magnitude())


@pytest.mark.slow
def test_a_hidden_base_and_tracker_are_found_and_the_profile_reads_them(
    command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", "cell.yaml"]) == 2
    assert "Make it with `srl calibrate PROFILE frames`" in capsys.readouterr().err
    actor = Leader()
    assert command("--sim", actor=actor, picture=True) == 0
    assert actor.closed
    made = read(folder / "arm.json")
    assert apart(made.pose, BASE) < (0.0005, 0.0005)
    assert made.body is not None
    assert apart(made.body, TRACKER) < (0.0005, 0.001)
    assert (made.frame, made.parent, made.what, made.count) == ("arm", "room", "poses", 8)
    assert (made.drivers, made.simulated) == ({"mocap": "vicon", "arm": "panda"}, True)
    output = capsys.readouterr()
    assert "Bring both bodies to another pose" in output.err
    assert [Path(line).name for line in output.out.splitlines()[-2:]] == ["arm.json", "arm.json.report.png"]
    assert (folder / "arm.json.report.png").read_bytes()[:4] == b"\x89PNG"
    assert main(["check", "cell.yaml"]) == 0
    reported = capsys.readouterr().out
    assert "file frames.arm.calibration: " in reported
    assert "frames.arm.calibration: it was made in simulation, and 'mocap' is real" in reported
    graph = wiring.build(*profile.load("cell.yaml"), None)
    assert graph.frames.entries["arm"].placed() == pytest.approx((*made.pose.position, *made.pose.quaternion), abs=1e-9)
    assert graph.layout.meta["frames"]["arm"]["position"] == pytest.approx(made.pose.position)


def test_points_that_a_tip_touches_find_it_too(command: Command, folder: Path) -> None:
    assert command("--sim", *options(POINTS), actor=Leader(POINTS)) == 0
    made = read(folder / "arm.json")
    assert apart(made.pose, BASE) < (0.0005, 0.001)
    assert (made.what, made.body) == ("points", None)


@pytest.mark.slow
def test_points_that_are_known_need_no_robot(command: Command, folder: Path) -> None:
    actor = Leader(POINTS)
    assert command("--sim", *options(POINTS), actor=actor) == 0
    # What the arm measured is now given as known.
    rows = np.concatenate(actor.rows)
    seen = actor.channel_map.samples(rows)
    known = []
    for number in range(1, 9):
        pose = seen.frame[np.flatnonzero(seen.marks == number)[-1]]
        known.append(pose[:3] + Rotation.from_quat(pose[3:], scalar_first=True).apply([0.03, 0.02, 0.05]))
    text = ";".join(",".join(f"{v:.9f}" for v in p) for p in known)
    given = ("what=points", f"known={text}")
    again = Leader(given)  # it goes to the same places
    assert [device.name for device in again.graph.devices] == ["mocap"]
    assert command("--sim", "-o", "known.json", *options(given), actor=again) == 0
    made = read(folder / "known.json")
    assert apart(made.pose, BASE) < (0.0005, 0.001)
    assert (made.signals, made.drivers) == (("mocap.tool.pose",), {"mocap": "vicon"})


@pytest.mark.parametrize(
    ("actor", "option", "words"),
    [
        ({"pushed": {3: 0.03}}, (), r"pose 3: it is \d+ mm off where the other 7 say, which fit each other"),
        ({"flat": True}, ("turned=0.01",), r"poses: they turn about one axis: about others by 0\.0\d rad"),
        ({"line": True}, (*POINTS, "apart=0.001", "frame_tip=0,0,0", "parent_tip=0,0,0"), r"they lie near a line"),
        ({"scale": 1.05}, POINTS, r"\+5\.0 % larger than in the frame"),
        ({"scale": 1000.0, "noise": 1e-6}, (*POINTS, "steady=0.01"), r"looks like millimetres"),
        ({"pushed": {2: 0.05}}, POINTS, r"point 2: it is \d+ mm off"),
    ],
)  # fmt: skip
def test_what_cant_work_is_refused_with_its_reason(
    actor: dict[str, Any], option: tuple[str, ...], words: str, command: Command, folder: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    before = sorted(folder.iterdir())
    assert command("--sim", *options(option), actor=Leader(option, **actor)) == 2
    assert re.search(words, capsys.readouterr().err)
    assert sorted(folder.iterdir()) == before


@pytest.mark.slow
def test_the_old_file_is_kept(command: Command, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command("--sim") == 0
    first = (folder / "arm.json").read_bytes()
    assert command("--sim") == 2
    assert "a calibration is there already" in capsys.readouterr().err
    moved = (0.0, *BASE[1:])
    assert command("--sim", "--yes", actor=Leader(base=moved)) == 0
    assert (folder / "arm.json.old").read_bytes() == first
    assert read(folder / "arm.json").pose.position[0] == pytest.approx(0.0, abs=5e-4)


@pytest.mark.slow
def test_a_recording_gives_the_same_file_and_a_pose_is_done_again(command: Command, folder: Path) -> None:
    bad = Leader(pushed={3: 0.03})
    assert command("--sim", actor=bad) == 2
    recorded(bad, folder / "bad.rrd")
    assert command("--recording", "bad.rrd") == 2
    again = Leader()
    assert command("--sim", "--redo", "3", "--from", "bad.rrd", actor=again) == 0
    assert again.led == 1
    recorded(again, folder / "again.rrd")
    assert command("--recording", "bad.rrd", "again.rrd", "-o", "both.json") == 0
    assert (folder / "both.json").read_bytes() == (folder / "arm.json").read_bytes()
    assert apart(read(folder / "both.json").pose, BASE) < (0.001, 0.001)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--person", "P07"], "--person: 'frames' is no person's"),
        (["--option", "count=4"], "4 poses don't find a frame: 6 are needed"),
        (["--option", "counts=4"], "there is no such option. Did you mean 'count'"),
        (["--option", "parent_tip=0,0,0.1"], "a tip goes with what=points"),
        (["--option", "what=points", "--option", "parent_tip=0,nan,0.1"], "a tip needs finite numbers"),
        (["--option", "known=0,0,0;1,0,0;0,1,0;0,0,1"], "known points go with what=points"),
        (
            ["--option", "what=points", "--option", "known=0,0,0;1,0;0,1,0;0,0,1"],
            "--option known.1: the list is too short",
        ),
        (["--option", "what=points", "--option", "known=0,0,0;1,0,0;0,1,0;0,0,1"], "there are 4 known points"),
        (
            ["--option", "what=points", "--option", "count=4", "--option", "known=0,0,0;.2,0,0;.2,.2,0;0,.2,0"],
            "touched in the order ",
        ),
        (["--option", "frame=arn"], "no frame 'arn'. Did you mean 'arm'"),
        (["--option", "frame=room"], "frames.room has no `calibration:`"),
        (["--option", "parent_signal=arm.pose"], "'arm.pose': it is in arm, not in 'room'"),
        (["--option", "frame_signal=arm.position"], "'arm.position': no pose of a device"),
        (["--set", "frames.arm={parent: room}"], "no frame has `calibration:`"),
        (["--set", "frames.tool={parent: arm/flange, calibration: tool.json}"], "Name one: --option frame=arm"),
        (["--set", "devices.mocap.frame=null"], "Give the device that sees it `frame: room`"),
        (["--set", "frames.arm.position=[1,0,0]"], "`calibration` says where it is: leave `position` out"),
        (["--set", "frames.arm.pose=mocap.tool.pose"], "`calibration` says where it is: leave `pose` out"),
        (["--set", "frames.arm.calibration=3"], "must be the path of a file"),
        (["--set", "frames.arm.calibration="], "must be the path of a file"),
        (["--set", "frames.arm={calibration: arm.json}"], "name it, `parent: FRAME`"),
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
        ({"frame": "base"}, "it says where 'base' is in 'room', not 'arm' in 'room'"),
        ({"parent": "cell"}, "it says where 'arm' is in 'cell', not 'arm' in 'room'"),
        (
            {"drivers": {"arm": "ur", "mocap": "vicon"}},
            "it was measured with 'arm' by the driver 'ur', now it is 'panda'",
        ),
        ({"drivers": {}}, "drivers: it has 0 entries, not at least 1"),
        ({"body": None}, "poses have a body, and points have none"),
        ({"signals": ["mocap.tool.pose"]}, "the signals aren't those of the devices that measured"),
        (
            {"drivers": {"cameras": "vicon"}, "signals": ["cameras.tool.pose"]},
            "the device 'cameras', which the profile doesn't have",
        ),
        ({"pose": {"position": [0, 0, 0], "quaternion": [0, 0, 0, 0]}}, "the quaternion's length isn't 1"),
        ({"format": "srl-ft-1"}, "srl-frame-1"),
    ],
)
def test_a_calibration_of_something_else_is_refused(
    change: dict[str, Any], words: str, command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command("--sim") == 0
    edited(folder / "arm.json", lambda made: made.update(change))
    capsys.readouterr()
    assert main(["check", "cell.yaml"]) == 2
    assert words in capsys.readouterr().err


def test_a_pose_that_is_given_in_another_frame_now_and_a_place_in_millimetres(
    command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command("--sim") == 0
    capsys.readouterr()
    moved = ["--set", "frames.lab={}", "--set", "frames.room={parent: lab, position: [1, 0, 0]}"]
    assert main(["check", "cell.yaml", *moved]) == 0
    assert "it says that" not in capsys.readouterr().out
    assert main(["check", "cell.yaml", *moved, "--set", "devices.mocap.frame=lab"]) == 2
    output = capsys.readouterr().err
    assert "measured with 'mocap.tool.pose' when that was given in 'room'; now it is in 'lab'" in output
    edited(folder / "arm.json", lambda made: made["pose"].update(position=[1200.0, -400.0, 800.0]))
    assert main(["check", "cell.yaml"]) == 0
    assert "it says that 'arm' is 1200 m off. Are these millimetres?" in capsys.readouterr().out


def test_a_recording_of_another_device_is_refused_and_its_signals_are_told(
    command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    actor = Leader()
    assert command("--sim", actor=actor) == 0
    recorded(actor, folder / "run.rrd")
    other = "devices.arm={driver: ur, port: tcp://10.0.0.1}"
    assert command("--recording", "run.rrd", "-o", "two.json", "--set", other) == 2
    output = capsys.readouterr().err
    assert "it was measured with 'arm' by the driver 'panda'; now it is ur" in output
    two = ["devices.mocap.segments={tool: tool/tool, wand: wand/wand}"]
    one = [*options(("parent_signal=mocap.wand.pose",)), "--set", *two]
    assert command("--recording", "run.rrd", "-o", "two.json", *one) == 0
    assert read(folder / "two.json").signals == ("mocap.tool.pose", "arm.pose")


def test_another_arm_of_the_same_driver_and_name_is_noticed_by_its_serial_number(
    command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`serials` in the file is what the profile demanded of the device, which refuses any other one itself."""
    arm = "devices.arm={driver: ur, port: tcp://10.0.0.1, interface: none, serial: %s}"
    checked, source = profile.load("cell.yaml", [arm % "'42'"])
    method = frame_method.FrameMethod(
        CalibrationRequest("cell.yaml", "frames"), checked, source, folder / "a.json", print
    )
    graph = build(*method.subset(""), sim=False)
    assert method.channel_map(graph.layout, "").options.serials == {"arm": "42"}
    assert [device.commands for device in graph.devices] == [(), ()]
    assert command("--sim") == 0
    whole = (folder / "arm.json").read_text()
    edited(folder / "arm.json", lambda made: made["drivers"].update(arm="ur"))
    bare = ["--set", "controllers=[]", "--set", "guard={}", "--set", "stop={}", "--set", "setpoints={}", "--set", arm]

    def output(serial: str, code: int) -> str:
        capsys.readouterr()
        assert main(["check", "cell.yaml", *bare[:-1], arm % serial]) == code
        reported = capsys.readouterr()
        return " ".join(f"{reported.out} {reported.err}".split())

    assert "it doesn't say of which ur it is, and 'arm' is 42" in output("'42'", 0)
    (folder / "arm.json").write_text(whole)
    edited(folder / "arm.json", lambda made: (made["drivers"].update(arm="ur"), made.update(serials={"arm": "42"})))
    assert "serial" not in output("'42'", 0)
    assert "it was measured with the ur of serial 42, now 'arm' is 43" in output("'43'", 2)
    assert "it is of the ur 42. Write `serial`, so that another one is refused" in output("null", 0)


def test_a_file_that_was_changed_by_hand_is_refused(
    command: Command, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command("--sim") == 0
    plain = json.loads((folder / "arm.json").read_text())
    plain["pose"]["position"][0] += 0.1
    (folder / "arm.json").write_text(json.dumps(plain))
    assert main(["check", "cell.yaml"]) == 2
    assert "it was changed after it was written" in capsys.readouterr().err


def test_nothing_is_commanded_and_an_arm_that_takes_the_command_over_is_refused(
    command: Command, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    graph = Leader().graph
    assert graph.actuators == []
    assert [device.commands for device in graph.devices] == [(), ()]

    class TakesOver(UrConfig):
        interface: Literal["velocity", "position"] = "velocity"  # type: ignore[assignment]

    monkeypatch.setattr(Ur, "Config", TakesOver)
    assert main(["calibrate", "cell.yaml", "frames", "--set", "devices.arm={driver: ur, port: tcp://10.0.0.1}"]) == 2
    output = capsys.readouterr().err
    assert "its driver 'ur' can't be opened without taking the command over" in output
    assert "--option known=x,y,z" in output


def test_a_replay_has_the_file_and_a_typed_one_is_looked_for_here(command: Command, folder: Path) -> None:
    assert command("--sim") == 0
    (folder / "elsewhere").mkdir()
    (folder / "arm.json").rename(folder / "elsewhere" / "typed.json")
    checked, source = profile.load("cell.yaml", ["frames.arm.calibration=elsewhere/typed.json"])
    graph = wiring.build(checked, source, None)
    (folder / "elsewhere" / "typed.json").unlink()
    meta = graph.layout.meta
    assert list(meta["files"]) == ["--set elsewhere/typed.json"]
    again = wiring.build(
        *profile.parse(meta["label"], meta["profile"], meta["overrides"], Files(recorded=decoded(meta["files"], "run")))
    )
    assert again.frames.entries["arm"] == graph.frames.entries["arm"]


@pytest.mark.exhaustive
@pytest.mark.slow
def test_the_simulated_arm_is_found_where_it_stands(folder: Path) -> None:
    reported: dict[str, Any] = summary(call(folder, "calibrate", "cell.yaml", "frames", "--sim", "--json"))
    assert reported["refusals"] == []
    assert apart(read(folder / "arm.json").pose, BASE) < (0.0002, 0.0005)
    assert [each["number"] for each in reported["each"]] == list(range(1, 9))
