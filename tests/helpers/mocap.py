"""Recorded and made-up markers for joint angles."""

from __future__ import annotations

from collections.abc import Mapping

import c3d
import numpy as np

from helpers.shared import shared
from srl.control.ikns.identify import ArmLandmarks, Landmarks, Measures, identify, plug_in_gait
from srl.runtime.contracts.rotation import euler_angles
from srl.runtime.models.body import Body, Side, average

SERVE = "data/optitrack_upper_body/kinematics_tennis_serve"
STATURE = 1.679  # m, of the person in vicon_plug_in_gait
MEASURES: dict[Side, Measures] = {  # m, the file's own subject parameters
    "left": Measures(0.050, 0.096, 0.061, 0.030),
    "right": Measures(0.050, 0.092, 0.065, 0.030),
}


def recorded(relative: str, unit: float = 1e-3) -> dict[str, np.ndarray]:
    """Points (frames, 3) of a C3D file by name without the subject; m, NaN where hidden; angles keep their degrees.

    unit: m, of the file.
    """
    with shared(relative).open("rb") as file:
        reader = c3d.Reader(file)
        names = [label.strip().rpartition(":")[2] for label in reader.point_labels]
        rows = np.array([points[:, :4] for _, points, _ in reader.read_frames()], float)
    rows[rows[..., 3] < 0] = np.nan
    return {n: rows[:, i, :3] * (1.0 if n.endswith("Angles") else unit) for i, n in enumerate(names)}


def gait(trial: str) -> dict[str, np.ndarray]:
    """`Static` or `Movement` of vicon_plug_in_gait."""
    return recorded(f"data/vicon_plug_in_gait/{trial}_trial.c3d")


def gait_body(static: Mapping[str, np.ndarray], *sides: Side) -> tuple[Body, np.ndarray]:
    """The person's body and its angles in the static trial."""
    body = average(STATURE, sides or ("left", "right"))
    return identify(body, static, plug_in_gait({side: MEASURES[side] for side in body.sides}))


def frames(markers: Mapping[str, np.ndarray], names: tuple[str, ...]) -> np.ndarray:
    """(frames, k, 3) in the order of names."""
    return np.stack([markers[name] for name in names], axis=1)


def made(body: Body, q: np.ndarray) -> np.ndarray:
    """(k, 3) m: where the body's markers are at q."""
    poses = body.forward(q)
    return np.array([poses[m.segment][:3, :3] @ m.at + poses[m.segment][:3, 3] for m in body.markers.values()])


def off(ours: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """(frames, n - 3) degrees between angles (frames, n), without the torso's places."""
    return np.rad2deg(np.abs(ours - truth))[:, 3:]


def reaching(body: Body, count: int, rate: float = 100.0, seed: int = 3) -> np.ndarray:
    """(count, n): smooth motion of every joint, some rad/s at most, from elbows bent by 60 degrees."""
    rng, t = np.random.default_rng(seed), np.arange(count) / rate
    n = len(body.joints)
    phases = rng.uniform(0.0, 2 * np.pi, (2, n))
    q = 0.2 * sum(np.sin(2 * np.pi * f * t[:, None] + p) for f, p in zip((0.5, 1.3), phases, strict=True))
    for side in body.sides:
        q[:, body.names.index(f"{side}_elbow_flexion")] += np.deg2rad(70.0)
        q[:, body.names.index(f"{side}_shoulder_abduction")] += np.deg2rad(30.0)
    return q


# Vicon's angles, from poses


def axes(points: Mapping[str, np.ndarray], segment: str) -> np.ndarray:
    """(frames, 3, 3): the axes of a segment that the file gives."""
    ends = [points[segment + end] - points[segment + "O"] for end in "ALP"]
    return np.stack([e / np.linalg.norm(e, axis=1, keepdims=True) for e in ends], axis=2)


def vicon_angles(
    thorax: np.ndarray, humerus: np.ndarray, radius: np.ndarray, hand: np.ndarray
) -> dict[str, np.ndarray]:
    """Degrees (frames, 3) in Vicon's orders, of poses with Vicon's axes: the shoulder XYZ, elbow and wrist YXZ."""
    pairs = {"shoulder": (thorax, humerus, "XYZ"), "elbow": (humerus, radius, "YXZ"), "wrist": (radius, hand, "YXZ")}
    return {n: np.rad2deg(euler_angles(a.transpose(0, 2, 1) @ b, o)) for n, (a, b, o) in pairs.items()}


def as_vicon(body: Body, q: np.ndarray, side: str) -> list[np.ndarray]:
    """Our thorax, humerus, radius (before it turns) and hand, (frames, 3, 3), with Vicon's axes."""
    m = 1.0 if side == "left" else -1.0
    turned = q.copy()
    turned[:, body.names.index(f"{side}_forearm_pronation")] = 0.0
    poses, straight = ([body.forward(row) for row in rows] for rows in (q, turned))
    hand = np.array([[0.0, -m, 0.0], [m, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return [
        np.array([p["torso"][:3, :3] for p in poses]) @ np.diag([1.0, -1.0, -1.0]),
        np.array([p[f"{side}_upper_arm"][:3, :3] for p in poses]) @ np.diag([-1.0, -1.0, 1.0]),
        np.array([p[f"{side}_forearm"][:3, :3] for p in straight]) @ np.diag([-1.0, -1.0, 1.0]),
        np.array([p[f"{side}_hand"][:3, :3] for p in poses]) @ hand,
    ]


def difference(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Degrees, the shorter way round."""
    return (a - b + 180.0) % 360.0 - 180.0


# vicon_upper_limb_emg: one arm that lifts a box

LIFTING = "data/vicon_upper_limb_emg/markers_analogs.c3d"
LIFTER = Landmarks(
    ("STER", "T1", "XIPH", "T10"),
    {
        "right": ArmLandmarks(
            "ACRO_tip", "EPICl", "STYLr", "STYLu", ("INDEX", "LASTC"), Measures(wrist_width=None), "EPICm"
        )
    },
)
"""The rules' landmarks among the names of the person who lifts a box with the right arm."""
LIFTER_MARKERS = {
    "torso": ("STER", "T1", "XIPH", "T10", "STERl"),
    "right_clavicle": ("ACRO_tip", "CLAV_AC"),
    "right_upper_arm": ("DELT", "ARMl", "EPICl", "EPICm"),
    "right_forearm": ("LARMm", "LARMl", "STYLr", "STYLu"),
    "right_hand": ("INDEX", "LASTC", "MEDH", "LATH"),
}

# Our joints that Vicon's columns mean
CHAIN = ("shoulder_flexion", "shoulder_abduction", "shoulder_rotation", "elbow_flexion")


def printed(angles: np.ndarray, joint: str, side: str) -> np.ndarray:
    """Vicon's Euler angles (frames, 3) with the signs and offsets with which its files give them."""
    x, y, z = angles.T
    if joint == "shoulder":
        return np.stack([-y, 180.0 - x, z + 180.0] if side == "right" else [-y, 180.0 + x, 180.0 - z], axis=1)
    return angles if side == "right" else angles * (1.0, -1.0, -1.0)
