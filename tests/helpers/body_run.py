"""A made-up run of a person with one supernumerary arm: nodes, capsules and gaps as laws give them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from srl.control.skeleton.human import human
from srl.control.skeleton.human_srl import HumanSrl
from srl.control.skeleton.kinematics import Kinematics
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.terms import CAPSULE, GAP, POINT
from srl.runtime.ipc.header import LINK_ACTIVE, LINK_CONNECTED, State
from srl.runtime.ipc.layout import Layout
from srl.runtime.models.skeleton.arms import BASE, END, STANDARD, Arms
from srl.runtime.recorder.stream import Stream

FIGURE = HumanSrl(human(), Arms("Spine", BASE, STANDARD, END, ("right",)))
TREE = FIGURE.tree
GROUPS = FIGURE.groups
# From node to node, with a radius, m; the last two are the arm's.
CAPSULES = (
    ("Hips", "Spine3", 0.15), ("RightForeArm", "RightHand", 0.05), ("LeftForeArm", "LeftHand", 0.05),
    ("RightUpLeg", "RightLeg", 0.09), ("LeftUpLeg", "LeftLeg", 0.09), ("RJ4", "RJ6", 0.03), ("RJ6", "REnd", 0.03),
)  # fmt: skip
RATE = 100
Y_UP = {"parent": None, "position": [0, 0, 0], "quaternion": [0.5, 0.5, 0.5, 0.5], "pose": None}


def body_layout() -> Layout:
    """Nodes, capsules and gaps in the suit's frame, which has y up."""
    layout = Layout(devices=["suit"])
    layout.add(
        "skeleton.nodes", "internal", (len(TREE), 3), "m", frame="suit", labels=TREE.names, components=(POINT,),
        visual="skeleton", links=TREE.polylines, groups=GROUPS,
    )  # fmt: skip
    layout.add(
        "collision.envelope", "internal", (len(CAPSULES), 8), "m", frame="suit",
        labels=tuple(f"{a} to {b}" for a, b, _ in CAPSULES), components=(CAPSULE,), visual="capsules",
    )  # fmt: skip
    layout.add(
        "collision.closest", "internal", (2, 7), "m", frame="suit", labels=("first", "second"), components=(GAP,),
        visual="gaps",
    )  # fmt: skip
    layout.add("arm.position_command", "command", (7,), "rad", labels=FIGURE.arms.labels)
    layout.add("arm.position_command.applied", "applied", (7,), "rad", labels=FIGURE.arms.labels)
    layout.add("arm.position", "state", (7,), "rad", labels=FIGURE.arms.labels)
    plot = {"title": "Distance", "unit": "m", "lines": {"arm": "collision.closest[first,distance]"}}
    layout.meta = {
        "name": "made-up body", "profile": "name: made-up\n", "sha256": "0" * 64, "rate": [RATE, 1],
        "wall": 1_700_000_000_000_000_000, "frames": {"suit": Y_UP}, "record": {"plots": [plot]}, "simulated": ["suit"],
    }  # fmt: skip
    return layout


def body_rows(layout: Layout, count: int, first: int = 1) -> NDArray[np.int64]:
    """Rows first .. first + count - 1: the arm moves between two postures, and the right forearm towards it."""
    kinematics = Kinematics(FIGURE)
    rows = np.zeros((count, layout.width), np.int64)
    offsets = FIGURE.human.offsets[list(FIGURE.human.joints)]
    names = FIGURE.labels
    period = 1_000_000_000 // RATE
    for i, row in enumerate(rows):
        n = first + i
        phase = 0.5 - 0.5 * np.cos(2 * np.pi * n / 400)
        q = phase * np.array([-0.9, -0.9, -0.5, 0.4, 0.03, 0.0, 0.9])
        turn = np.tile([1.0, 0.0, 0.0, 0.0], (len(names), 1))
        for side, sign in (("Right", 1.0), ("Left", -1.0)):
            turn[names.index(f"{side}Arm")] = np.cos(0.65), 0.0, 0.0, sign * np.sin(0.65)
        turn[names.index("RightForeArm")] = np.cos(phase * 0.7), 0.0, np.sin(phase * 0.7), 0.0
        nodes = kinematics.nodes(turn, offsets, {"right": q})
        solids = np.array([[*nodes[TREE.index(a)], *nodes[TREE.index(b)], r, np.nan] for a, b, r in CAPSULES])
        solids[:, 7] = [_distance(s, solids[-1]) for s in solids]
        solids[-2:, 7] = solids[:-2, 7].min()
        near = int(np.argmin(solids[:-2, 7]))
        gaps = np.full((2, 7), np.nan)
        gaps[0] = *solids[near, :3], *solids[-1, 3:6], solids[near, 7]
        now = 5_000_000_000_000 + n * period
        _word(layout, row, "cycle", n)
        for name in ("now", "deadline", "wake"):
            _word(layout, row, name, now)
        for k, name in enumerate(("read", "control", "guard", "write")):
            _word(layout, row, name, now + (k + 1) * 50_000)
        _word(layout, row, "dt", period)
        _word(layout, row, "state", State.ACTIVE)
        _word(layout, row, "suit.stamp", now - 8_000_000)
        _word(layout, row, "suit.link", LINK_CONNECTED | LINK_ACTIVE)
        for name, values in (
            ("skeleton.nodes", nodes), ("collision.envelope", solids), ("collision.closest", gaps),
            ("arm.position_command", q), ("arm.position_command.applied", q), ("arm.position", q - 0.02),
        ):  # fmt: skip
            field = layout.fields[name]
            start = layout.ints + field.offset
            row[start : start + field.size] = np.ascontiguousarray(values).view(np.int64).ravel()
    return rows


def body_file(folder: Path) -> Path:
    """A recording of 4 s of it at 100 Hz."""
    layout = body_layout()
    layout.save(folder / "layout.json")
    stream = Stream((folder / "layout.json").read_text())
    stream.recording.save(folder / "run.rrd")
    stream.prologue(None)
    stream.rows(np.arange(1, 401), body_rows(layout, 400))
    stream.recording.disconnect()
    return folder / "run.rrd"


def upright(points: Array) -> Array:
    """Points (n, 3) of the suit's frame in the root frame: x forward, y to the left, z up."""
    return points[:, [2, 0, 1]]


def _distance(one: Array, other: Array) -> float:
    """m between two capsules (8,), on a grid: good enough for colours."""
    a, b = ((1 - t) * s[:3] + t * s[3:6] for s in (one, other) for t in [np.linspace(0, 1, 21)[:, None]])
    return float(np.linalg.norm(a[:, None] - b[None], axis=2).min() - one[6] - other[6])


def _word(layout: Layout, row: NDArray[np.int64], name: str, value: int) -> None:
    row[layout.int_names.index(name)] = value
