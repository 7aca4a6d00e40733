"""A step of the object mapping with 1, 2 and 4 extra fingers, beside other ways to the joints for the same frames.

Ours is a whole cycle of the law `object-mapping`: damped, within joint limits, with the sphere for the viewer. The
first peer is the paper's equations (1) to (5) as they stand, with numpy.linalg.pinv: two pseudo-inverses, no damping,
angles clipped. dex-retargeting has no virtual object: it is given the vectors from the wrist to where our fingers'
tips went at each frame, and finds the joints by optimisation (its `vector` form), so it does a part of the work. Each
row says how far a peer's tips are from ours. Times are of the processor. It is measured if it is installed:
`pip install dex-retargeting==0.5.0 torch`.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from time import process_time_ns
from typing import Any, Final
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np

from bench.pairs import Row, measure, there_and_back
from srl.control.hand.extra_finger import ExtraFinger
from srl.control.hand.object_mapping import ObjectMapping, ObjectMappingConfig
from srl.control.shared.kinematics import Chain
from srl.runtime.contracts.rotation import euler_angles, homogeneous
from srl.runtime.contracts.signals import Array
from srl.runtime.models.human_hand import hand_geometry
from srl.runtime.models.models import FingerModel
from srl.runtime.models.point_series import PointSeries
from srl.sim.wearer import ScriptedWearer

FRAMES: Final = 60
DT: Final = 0.01  # s from frame to frame
_BEGIN: Final = 0.6  # s; the scripted hand is closing
_PLACES: Final = {1: (0.0,), 2: (-0.02, 0.02), 4: (-0.045, -0.015, 0.015, 0.045)}  # m along x, at the wrist
_HOME: Final = (0.0, 0.70, 0.52, 0.52)  # rad
_MODEL: Final = FingerModel()

Solve = Callable[[int], Array]
"""From the number of a frame to the joints (n,), rad, of all extra fingers, from those of the call before."""


def run() -> list[Row]:
    """Compares them with one, two and four fingers."""
    return [row for fingers in _PLACES for row in _rows(fingers)]


def _rows(count: int) -> list[Row]:
    frames, places = closing(), worn(count)
    bases = np.array([homogeneous(place) for place in places])
    law = ours(frames, places)
    targets = np.array([tips(law(i), bases) for i in range(FRAMES)])
    peers = {"numpy.linalg.pinv": plain(frames, bases)}
    retargeting = dex(targets, bases)
    if retargeting is not None:
        peers["dex-retargeting"] = retargeting
    elif count == min(_PLACES):
        print("  dex-retargeting: not installed", file=sys.stderr)
    apart = {name: _apart(peer, targets, bases) for name, peer in peers.items()}
    pairs = measure(
        lambda: there_and_back(law, FRAMES, process_time_ns),
        {name: lambda peer=peer: there_and_back(peer, FRAMES, process_time_ns) for name, peer in peers.items()},  # type: ignore[misc]
    )
    plural = "s" if count > 1 else ""
    return [
        pairs.row("object-mapping", f"{count} finger{plural}, a step; tips {mm:.1f} mm apart", "p50", name, "us")
        for name, mm in apart.items()
    ]


def closing() -> Array:
    """The human fingertips (FRAMES, 5, 3), m, of a hand that closes."""
    wearer, hand = ScriptedWearer(0), PointSeries(*hand_geometry())
    return np.array([hand.at(wearer.target(_BEGIN + DT * i))[3::4] for i in range(FRAMES)])


def worn(count: int) -> Array:
    """The poses (count, 7) of the extra fingers in the hand's frame: side by side at the wrist, out of the palm."""
    return np.array([[x, -0.02, -0.03, 0.5, -0.5, 0.5, 0.5] for x in _PLACES[count]])


def tips(q: Array, bases: Array) -> Array:
    """The robotic tips (count, 3), m, for all joints (n,), rad."""
    chains = [Chain(base, np.array(_MODEL.rows)) for base in bases]
    return np.array([c.forward(each.tolist()) for c, each in zip(chains, q.reshape(len(bases), -1), strict=True)])


def _apart(peer: Solve, targets: Array, bases: Array) -> float:
    """Largest distance of a peer's tips from ours, mm, over the frames in their order."""
    found = np.array([tips(peer(i), bases) for i in range(FRAMES)])
    return 1e3 * float(np.linalg.norm(found - targets, axis=2).max())


def ours(frames: Array, places: Array) -> Solve:
    """The law, which begins at home with the first frame."""
    fingers = tuple(ExtraFinger(name=f"finger_{i}") for i in range(len(places)))
    law = ObjectMapping("mapping", ObjectMappingConfig(fingers=fingers))
    joints = np.tile(_HOME, len(places))
    arrays = {signal.name: np.zeros(signal.shape) for signal in law.outputs}
    poses = {finger.name: pose for finger, pose in zip(fingers, places, strict=True)}
    applied, given = {"q": joints.copy()}, {"tips": frames[0].copy()}
    law.bind(given, arrays, applied, {p.name: np.array(p.default) for p in law.parameters}, poses)
    law.reset()

    def solve(i: int) -> Array:
        given["tips"][...] = frames[i]
        law.update(DT)
        applied["q"][:] = arrays["q"]
        return arrays["q"]

    return solve


def plain(frames: Array, bases: Array) -> Solve:
    """The paper's equations with numpy.linalg.pinv, all Jacobians at once; forward kinematics are the law's own."""
    limits, count = (np.array(_MODEL.lower), np.array(_MODEL.upper)), len(bases)
    chains = [Chain(base, np.array(_MODEL.rows)) for base in bases]
    q, before = np.tile(_HOME, (count, 1)), frames[0]

    def grasp(points: Array, centre: Array) -> Array:
        """A (3 k, 7): the points' velocities from those of the object and its scale."""
        r = points - centre
        A = np.zeros((len(points), 3, 7))
        A[:, :, :3] = np.eye(3)
        x, y, z = r.T
        A[:, 0, 4], A[:, 0, 5], A[:, 1, 3], A[:, 1, 5], A[:, 2, 3], A[:, 2, 4] = z, -y, -z, x, y, -x
        A[:, :, 6] = r
        return A.reshape(-1, 7)

    def solve(i: int) -> Array:
        nonlocal before
        centre = before.mean(axis=0)
        motion = np.linalg.pinv(grasp(before, centre)) @ (frames[i] - before).ravel()
        tip = np.array([chain.forward(each) for chain, each in zip(chains, q.tolist(), strict=True)])
        J = np.array([chain.jacobian() for chain in chains]).transpose(0, 2, 1)
        dp = (grasp(tip, centre) @ motion).reshape(count, 3, 1)
        q[:] = np.clip(q + (np.linalg.pinv(J) @ dp)[:, :, 0], *limits)
        before = frames[i]
        return q.ravel()

    return solve


def dex(targets: Array, bases: Array) -> Solve | None:
    """dex-retargeting's vector optimiser for the vectors from the wrist to the robotic tips; None: not installed."""
    try:
        optimizer: Any = import_module("dex_retargeting.optimizer")
        sequence: Any = import_module("dex_retargeting.seq_retarget")
        wrapper: Any = import_module("dex_retargeting.robot_wrapper")
    except ImportError:
        return None
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "fingers.urdf")
        path.write_text(urdf(bases))
        robot = wrapper.RobotWrapper(str(path))
    count, n = len(bases), len(_MODEL.rows)
    names = [f"finger_{i}_joint_{j}" for i in range(count) for j in range(n)]
    ends = [f"finger_{i}_tip" for i in range(count)]
    vectors = optimizer.VectorOptimizer(robot, names, ["hand"] * count, ends, np.zeros((2, count), int))
    retargeting = sequence.SeqRetargeting(vectors, has_joint_limits=True)
    order = [robot.dof_joint_names.index(name) for name in names]
    home = np.zeros(robot.dof)
    home[order] = np.tile(_HOME, count)
    retargeting.set_qpos(home)

    def solve(i: int) -> Array:
        q: Array = retargeting.retarget(targets[i])[order]
        return q

    return solve


def urdf(bases: Array) -> str:
    """The extra fingers on a body `hand`, as URDF: a Denavit-Hartenberg row is a turn, then a fixed offset."""
    robot = Element("robot", name="fingers")
    SubElement(robot, "link", name="hand")
    for i, base in enumerate(bases):
        parent, xyz, rpy = "hand", base[:3, 3], euler_angles(base[None, :3, :3], "ZYX")[0, ::-1]
        for j, (alpha, a) in enumerate(_MODEL.rows):
            limit = {"lower": f"{_MODEL.lower[j]}", "upper": f"{_MODEL.upper[j]}", "effort": "1", "velocity": "10"}
            joint = _joint(robot, f"finger_{i}_joint_{j}", "revolute", parent, f"finger_{i}_{j}", xyz, rpy)
            SubElement(joint, "axis", xyz="0 0 1")
            SubElement(joint, "limit", limit)
            parent, xyz, rpy = f"finger_{i}_{j}", np.array([a, 0.0, 0.0]), np.array([alpha, 0.0, 0.0])
        _joint(robot, f"finger_{i}_end", "fixed", parent, f"finger_{i}_tip", xyz, rpy)
    return tostring(robot, encoding="unicode")


def _joint(robot: Element, name: str, kind: str, parent: str, child: str, xyz: Array, rpy: Array) -> Element:
    SubElement(robot, "link", name=child)
    joint = SubElement(robot, "joint", {"name": name, "type": kind})
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
    SubElement(joint, "origin", xyz=" ".join(map(repr, xyz.tolist())), rpy=" ".join(map(repr, rpy.tolist())))
    return joint


if __name__ == "__main__":
    for row in run():
        print(row.what, row.metrics())
