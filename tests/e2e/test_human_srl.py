"""The profiles human-srl whole: wearer, suit and arm simulated; recordings replayed and exported."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from helpers.run import call, summary
from helpers.shared import shared
from helpers.skeleton import FOLDER, human_srl

from srl.control.skeleton.kinematics import Kinematics
from srl.control.skeleton.paper import PaperVector
from srl.runtime.ipc.header import State
from srl.runtime.models.skeleton import bvh
from srl.runtime.profile import profile
from srl.runtime.recording.reader import Recording, read

pytestmark = pytest.mark.slow
POSTURES = np.array(
    [[0.0] * 7, [-0.8727, -0.8727, -0.5236, 0.0, 0.0, 0.0, 0.8727], [-0.6, -0.3, 0.4, -0.9, 0.08, -0.5, 0.2]]
)
NEAR = np.array([0.08, 0.08, 0.08, 0.08, 0.005, 0.08, 0.08])


def run(folder: Path, name: str, *options: str, code: int = 0) -> tuple[dict[str, object], Recording]:
    """A run that is recorded in x.rrd, and its summary."""
    done = call(folder, "run", name, "--sim", "--fast", "--record", "x.rrd", "--json", *options, code=code, timeout=400)
    return summary(done), read(folder / "x.rrd")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("human-srl")


@pytest.fixture(scope="module")
def whole(folder: Path) -> tuple[dict[str, object], Recording]:
    return run(folder, "human-srl", "--duration", "14", "--set", "sim.devices.suit.noise=0")


def nodes(recording: Recording, *names: str) -> np.ndarray:
    """(k, names, 3) m, in the cell: y, z, x of it are the suit's x, y, z."""
    labels = recording.layout.fields["skeleton.nodes"].labels
    return recording.value("skeleton.nodes")[:, [labels.index(name) for name in names]][:, :, [2, 0, 1]]


def arrivals(recording: Recording, device: str = "arm") -> list[int]:
    """The postures that the arm came to, in their order."""
    position = recording.value(f"{device}.position")
    found = [np.flatnonzero((np.abs(POSTURES - q) <= NEAR).all(axis=1)) for q in position]
    visited = [int(each[0]) for each in found if len(each)]
    return [k for i, k in enumerate(visited) if i == 0 or visited[i - 1] != k]


@pytest.mark.exhaustive
def test_the_arm_goes_round_its_postures(tmp_path: Path) -> None:
    done, recording = run(tmp_path, "human-srl", "--duration", "26", "--set", "sim.devices.suit.noise=0")
    assert (done["state"], done["cause"]) == ("ended", "end")
    assert arrivals(recording)[:4] == [0, 1, 2, 0]


def test_the_nodes_are_where_the_wearers_joints_were(whole: tuple[dict[str, object], Recording]) -> None:
    _, recording = whole
    names = recording.layout.fields["world.wearer_position"].labels
    truth, now = recording.value("world.wearer_position"), recording.int("now")
    stamps, active = recording.int("suit.stamp"), recording.int("state") == State.ACTIVE
    found = nodes(recording, *names)
    seen = np.flatnonzero(active & (stamps > now[0]))[20:]
    for joint in range(len(names)):
        for axis in range(3):
            then = np.interp(stamps[seen], now, truth[:, joint, axis])
            np.testing.assert_allclose(found[seen, joint, axis], then, atol=2e-3, err_msg=names[joint])


def test_the_arms_end_is_the_simulated_arms(whole: tuple[dict[str, object], Recording]) -> None:
    _, recording = whole
    off = np.linalg.norm(nodes(recording, "REnd")[:, 0] - recording.value("world.arm_tip")[:, 0], axis=1)
    active = recording.int("state") == State.ACTIVE
    # The suit is 30 ms late, and the servos a cycle.
    assert np.median(off[active][50:]) < 0.01
    assert off[active][50:].max() < 0.05


def test_a_replay_computes_the_same_bits(folder: Path, whole: object) -> None:
    assert json.loads(call(folder, "replay", "x.rrd", "--json").stdout)["identical"] is True


def test_the_export_opens_in_an_independent_reader(folder: Path, whole: tuple[dict[str, object], Recording]) -> None:
    bvhio = pytest.importorskip("bvhio")
    _, recording = whole
    done = json.loads(call(folder, "export", "x.rrd", "--bvh", "x.bvh", "--rate", "25", "--json").stdout)
    other = bvhio.readAsHierarchy(str(folder / "x.bvh"))
    frames = len(bvh.read(folder / "x.bvh").frames)
    assert done["frames"] == frames
    assert done["period"] == pytest.approx(0.04)
    last = int(recording.int("cycle")[-1])
    # Frames go back from the last row in steps of four; where the laws ran, the rows have the nodes.
    first = (last // 4 * 4) - 4 * (frames - 1)
    labels = recording.layout.fields["skeleton.nodes"].labels
    values, state = recording.value("skeleton.nodes"), recording.int("state")
    compared = 0
    for frame in range(5, frames, 30):
        k = first + 4 * frame
        if state[k] != State.ACTIVE:
            continue
        other.loadPose(frame)
        for joint, _, _ in other.layout():
            expected = np.array(joint.PositionWorld.to_tuple()) / 100.0
            np.testing.assert_allclose(values[k, labels.index(joint.Name)], expected, atol=2e-5)
        compared += 1
    assert compared > 5


@pytest.mark.exhaustive
def test_no_bvh_without_a_skeleton(folder: Path) -> None:
    call(folder, "run", "servo-jog", "--sim", "--fast", "--duration", "0.5", "--record", "jog.rrd")
    done = call(folder, "export", "jog.rrd", "--bvh", "jog.bvh", code=2)
    assert "no law of this recording writes bvh" in done.stderr
    done = call(folder, "export", "x.rrd", "--bvh", "x.bvh", "--rate", "0", code=2)
    assert "'0' is no rate" in done.stderr


def test_a_suit_that_is_gone_holds_the_arm(tmp_path: Path) -> None:
    done, recording = run(
        tmp_path, "human-srl", "--duration", "9", "--set", "sim.devices.suit.loss=[[5.2,15.0]]", code=1
    )
    assert (done["state"], done["cause"], done["fault_source"]) == ("ended", "intent_loss", "suit")
    now = (recording.int("now") - recording.int("now")[0]) / 1e9
    first = float(now[recording.int("state") == State.STOPPING][0])
    assert first == pytest.approx(5.2, abs=0.03)
    position, held = recording.value("arm.position"), now > first + 1.0
    assert np.ptp(position[held], axis=0).max() < 0.02
    values = recording.value("skeleton.nodes")[held & (now < 8.9)]
    assert np.ptp(values, axis=0).max() == 0.0  # the skeleton keeps its last pose


@pytest.mark.exhaustive
def test_both_arms_mirror_each_other(tmp_path: Path) -> None:
    _, recording = run(tmp_path, "human-srl-two", "--duration", "20", "--set", "sim.parts.wearer.script=t-pose")
    assert arrivals(recording, "right")[:3] == arrivals(recording, "left")[:3] == [0, 1, 2]
    right, left, spine = (nodes(recording, name)[:, 0] for name in ("REnd", "LEnd", "Spine"))
    active = np.flatnonzero(recording.int("state") == State.ACTIVE)[50:]
    mirrored = (left - spine) * [1.0, -1.0, 1.0]
    assert np.abs(right - spine - mirrored)[active].max() < 0.03  # both sag a little, and the body sways
    assert np.ptp(right[active], axis=0).max() > 0.2


def test_a_real_recording_may_be_the_wearer(tmp_path: Path) -> None:
    path = shared(f"{FOLDER}/fullbody_walk_yxz.bvh")
    done, recording = run(tmp_path, "human-srl", "--set", f"sim.parts.wearer.recording={path}", "--duration", "3")
    assert done["cause"] == "end"
    hips = nodes(recording, "Hips")[:, 0][recording.int("state") == State.ACTIVE]
    assert np.linalg.norm(np.ptp(hips[20:], axis=0)) > 0.5  # the person walks
    high = nodes(recording, "Head")[-20, 0, 2]
    assert 1.4 < high < 1.8


@pytest.mark.exhaustive
@pytest.mark.parametrize(("rate", "seconds", "extra"), [(20, 50, 0.2), (1000, 6, 0.1)])
def test_the_papers_test(tmp_path: Path, rate: int, seconds: int, extra: float) -> None:
    """1000 steps at 20 Hz, and at 1000 Hz: every step's 540 numbers are saved, and give its nodes again offline."""
    done, recording = run(
        tmp_path,
        "human-srl",
        *("--duration", str(seconds), "--set", f"rate={rate}", "--set", f"devices.suit.max_age={extra}"),
        *("--set", "guard.arm.position_command.clear=null"),  # the test is of the skeleton, at the paper's pace
    )
    assert (done["cause"], done["recording_complete"]) == ("end", True)
    active = np.flatnonzero(recording.int("state") == State.ACTIVE)[1:]  # the laws run from the second one on
    assert len(active) >= 1000 - 5
    assert set(arrivals(recording)) == {0, 1, 2}
    figure = human_srl(base=profile.load("human-srl")[0].models["srl-arms"].base)
    paper, kinematics = PaperVector(figure), Kinematics(figure)
    vectors, expected = recording.value("skeleton.vector")[active], recording.value("skeleton.nodes")[active]
    assert vectors[0].size == 540
    for k in range(0, len(vectors), max(1, len(vectors) // 1000)):
        rotation, translation, arms = paper.read(vectors[k])
        np.testing.assert_allclose(kinematics.nodes(rotation, translation, arms), expected[k], atol=1e-6)
