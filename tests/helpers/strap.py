"""A worn arm of seven axes: three that meet in a shoulder, an elbow, a slide, two of the wrist."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from srl.control.strap.axes import Axis

ARM: dict[str, dict[str, Any]] = {
    "j1": {"axis": [0, 1, 0]},
    "j2": {"axis": [0, 0, 1]},
    "j3": {"axis": [1, 0, 0], "link": [0.22, 0, 0]},
    "j4": {"axis": [0, 1, 0], "link": [0.1, 0, 0]},
    "j5": {"axis": [1, 0, 0], "link": [0.1, 0, 0], "slides": True, "lower": -0.04, "upper": 0.04},
    "j6": {"axis": [0, 0, 1], "link": [0.06, 0, 0]},
    "j7": {"axis": [0, 1, 0], "link": [0.1, 0, 0]},
}
"""For the law `strap-base`. At zero it is stretched along x, 0.58 m."""

HOME = [0.4, 0.3, 0.0, -0.9, 0.0, 0.2, 0.3]
"""A posture away from limits and singularities; rad, and m for j5."""

AXES = tuple(Axis.model_validate(axis) for axis in ARM.values())
LOWER, UPPER = np.array([a.lower for a in AXES]), np.array([a.upper for a in AXES])
UNIT = [1.0, 0.0, 0.0, 0.0]

share = st.lists(st.floats(0, 1), min_size=7, max_size=7)
vectors = st.tuples(*[st.floats(-1, 1)] * 3).map(np.array)
turns = vectors.map(lambda v: Rotation.from_rotvec(3 * v))
small = vectors.map(lambda v: 0.15 * v / max(1.0, float(np.linalg.norm(v))))


def q_of(shares: list[float]) -> np.ndarray:
    return LOWER + np.array(shares) * (UPPER - LOWER)


def wxyz(turn: Rotation) -> tuple[float, float, float, float]:
    x, y, z, w = turn.as_quat()
    return (w, x, y, z)
