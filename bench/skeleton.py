"""The human-SRL skeleton: from a frame or a line of text to 90 node positions, and beside an independent reader.

The peers compute the joints' positions of a BVH file, here of a real walk in $SRL_SHARED/data. bvhio reads bones that
stretch, pymotion doesn't; it computes many frames at once, too. Neither knows arms. Without a peer or the file there
is nothing to compare with.
"""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np

from bench.noitom import Software
from bench.pairs import Row, measure
from srl.control.skeleton.human import human
from srl.control.skeleton.human_srl import HumanSrl
from srl.control.skeleton.kinematics import Kinematics
from srl.control.skeleton.paper import PaperVector
from srl.drivers.noitom import NoitomConfig
from srl.drivers.noitom.pose import Pose
from srl.drivers.noitom.protocol import BinaryParser, TextParser, encode_binary, encode_text
from srl.drivers.noitom.skeleton import Skeleton
from srl.runtime.contracts.rotation import euler_angles, matrices
from srl.runtime.models.models import ArmsModel
from srl.runtime.models.skeleton import bvh
from srl.runtime.models.skeleton.arms import SIDES
from srl.sim.parts.body.motion import Scripted

_FRAMES: Final = 200
_SHARED: Final = Path(__file__).resolve().parents[2] / "shared"
_AIMS: Final = {"frame": 20.0, "text": 45.0}  # us
_WHAT: Final = {
    "frame": "quaternions to 90 positions",
    "vector": "quaternions to the 540 numbers",
    "text": "a text line to 90 positions",
    "binary": "a binary frame to 90 positions",
    "parse": "of which the text's parser",
    "pose": "of which quaternions from angles",
}


def run() -> list[Row]:
    """Our own times against their aims, then the peers frame by frame."""
    aims = {name: _AIMS.get(name, _AIMS["text"]) for name in _WHAT}
    pairs = measure(_ours, {"the aim": lambda: aims})
    rows = [pairs.row("skeleton", what, name, "the aim", "us") for name, what in _WHAT.items()]
    judged = [
        replace(row, aim=f"at most {_AIMS[name]:g} us", holds=row.ours <= _AIMS[name]) if name in _AIMS else row
        for name, row in zip(_WHAT, rows, strict=True)
    ]
    return judged + _latency() + _peers()


def _latency() -> list[Row]:
    """From when a text frame has been sent to the driver's socket until its nodes are there, by TCP on this machine."""

    def numbers(k: int) -> bytes:
        return encode_text(np.random.default_rng(k).uniform(-90.0, 90.0, 354))

    kinematics, right = Kinematics(HumanSrl(human(), ArmsModel().arms)), {SIDES[0]: np.zeros(7)}
    with Software(numbers) as software:
        driver = software.driver
        states = driver.state_arrays

        def ours() -> dict[str, float]:
            took = []
            for _ in range(_FRAMES):
                before = driver.health.frames
                software.send()
                start = time.perf_counter_ns()
                while driver.health.frames == before:
                    driver.read(software.now())
                kinematics.nodes(states["rotation"], states["translation"], right)
                took.append((time.perf_counter_ns() - start) / 1e3)
            return {name: float(np.percentile(took, share)) for name, share in (("p50", 50), ("p99", 99))}

        pairs = measure(ours, {"the kernel alone": software.kernel_frames}, 10)
    return [
        pairs.row("skeleton", f"from the last byte on the socket to 90 positions, {what}", what, name, "us")
        for what in ("p50", "p99")
        for name in pairs.others
    ]


class _Clock:
    """The median time of each step, us."""

    def __init__(self) -> None:
        self._took: dict[str, list[int]] = {}

    def time(self, name: str, once: Callable[..., Any], *arguments: Any) -> Any:
        start = time.perf_counter_ns()
        found = once(*arguments)
        self._took.setdefault(name, []).append(time.perf_counter_ns() - start)
        return found

    def metrics(self) -> dict[str, float]:
        return {name: statistics.median(took) / 1e3 for name, took in self._took.items()}


def _ours() -> dict[str, float]:
    """A simulated reach, frame by frame, as the suit's program would send it."""
    suit, clock = Skeleton("axis-neuron"), _Clock()
    motion = Scripted("reach", suit, 1.0, 1, "wearer")
    figure = HumanSrl(human(), ArmsModel(sides=("right", "left")).arms)
    kinematics, paper, out = Kinematics(figure), PaperVector(figure), np.empty((90, 6))
    pose, text, binary = Pose(NoitomConfig(port="tcp://127.0.0.1:1"), suit), TextParser(), BinaryParser()
    states = {"rotation": np.zeros((59, 4)), "translation": np.zeros((59, 3))}
    places = suit.offsets * 100.0

    def whole(parser: TextParser | BinaryParser, data: bytes, arms: Any) -> None:
        frame = parser.feed(data)
        assert frame is not None
        pose.fill(frame, states)
        kinematics.nodes(states["rotation"], states["translation"], arms)

    for k in range(_FRAMES):
        hips, turns = motion.at(k / 60.0)
        places[0] = hips * 100.0
        values = np.hstack([places, np.degrees(euler_angles(matrices(turns), "YXZ"))]).ravel()
        arms = {side: np.full(7, 0.001 * k) for side in figure.arms.sides}
        line, packet = encode_text(values), encode_binary(values, k)
        clock.time("text", whole, text, line, arms)
        clock.time("binary", whole, binary, packet, arms)
        frame = clock.time("parse", text.feed, line)
        clock.time("pose", pose.fill, frame, states)
        clock.time("frame", kinematics.nodes, states["rotation"], states["translation"], arms)
        clock.time("vector", paper.write, states["rotation"], states["translation"], arms, out)
    return clock.metrics()


def _peers() -> list[Row]:
    file = Path(os.environ.get("SRL_SHARED", _SHARED)) / "data" / "axis_neuron_bvh" / "fullbody_walk_yxz.bvh"
    if not file.is_file() or find_spec("bvhio") is None:
        return []
    figure = HumanSrl(bvh.read_tree(file), ArmsModel().arms)
    turns, places = bvh.read(file).pose(figure.labels)
    kinematics, nothing = Kinematics(figure), dict[Any, Any]()
    # It reads files alone, and every line at once: a short one.
    with tempfile.TemporaryDirectory(prefix="srl-") as folder:
        short = Path(folder) / "short.bvh"
        bvh.write(short, figure.human, *_human(figure, turns[:_FRAMES], places[:_FRAMES]), 1 / 60)
        other = import_module("bvhio").readAsHierarchy(str(short))

    def ours() -> dict[str, float]:
        clock = _Clock()
        for k in range(_FRAMES):
            clock.time("p50", kinematics.nodes, turns[k], places[k], nothing)
        return clock.metrics()

    def theirs() -> dict[str, float]:
        def once(k: int) -> None:
            other.loadPose(k, recursive=True)
            for joint, _, _ in joints:
                _ = joint.PositionWorld

        joints, clock = other.layout(), _Clock()
        for k in range(0, _FRAMES, 10):
            clock.time("p50", once, k)
        return clock.metrics()

    pairs = measure(ours, {"bvhio": theirs} | _pymotion(figure, turns, places), 5)
    return [
        pairs.row("skeleton", "a real frame to its positions", "p50", name, "us", "faster", lambda r: r < 1.0)
        for name in pairs.others
    ]


def _pymotion(figure: HumanSrl, turns: Any, places: Any) -> dict[str, Callable[[], dict[str, float]]]:
    """Its kinematics of the human's 59 joints, frame by frame and all frames at once, per frame."""
    if find_spec("pymotion") is None or find_spec("pymotion.ops") is None:
        return {}
    fk = import_module("pymotion.ops.skeleton_np").fk  # the faster of its two frame by frame
    tree = figure.human
    joints = list(tree.joints)
    parents = np.array([max(joints.index(tree.parents[i]), 0) if tree.parents[i] >= 0 else 0 for i in joints])
    offsets = tree.offsets[joints].copy()
    offsets[0] = 0.0

    def single() -> dict[str, float]:
        clock = _Clock()
        for k in range(_FRAMES):
            clock.time("p50", fk, turns[k], places[k, 0], offsets, parents)
        return clock.metrics()

    def batch() -> dict[str, float]:
        clock = _Clock()
        clock.time("p50", fk, turns[:_FRAMES], places[:_FRAMES, 0], offsets, parents)
        return {name: value / _FRAMES for name, value in clock.metrics().items()}

    return {"pymotion": single, f"pymotion, {_FRAMES} frames at once": batch}


def _human(figure: HumanSrl, turns: Any, places: Any) -> tuple[Any, Any]:
    """The human's nodes alone, of the whole skeleton's."""
    keep = [figure.tree.index(name) for name in figure.human.names]
    rotation, translation = figure.whole(turns, places, {})
    return rotation[:, keep], translation[:, keep]


if __name__ == "__main__":
    for row in run():
        print(f"{row.what}: {row.ours:g} us, {row.other_name} {row.other:g}, ratio {row.ratio:g}, A/A {row.control:g}")
