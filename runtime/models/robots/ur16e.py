"""Universal Robots UR16e (sheet ur16e): standard DH, nominal values without an individual arm's calibration.

The base frame is the controller's `base` (ROS `base_link` rotated by pi about z). The flange is its `tool0`.
"""

from __future__ import annotations

from math import inf, pi, radians
from typing import Final

import numpy as np

from srl.runtime.models.robots.description import (
    Capsule,
    Joint,
    RobotDescription,
    array,
    everywhere,
    inertial,
    rot_x,
    trans,
)

_NAMES: Final = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
# (a, alpha, d): the transforms after the rotation about z
_ROWS: Final = (
    (0.0, pi / 2, 0.1807),
    (-0.4784, 0.0, 0.0),
    (-0.36, 0.0, 0.0),
    (0.0, pi / 2, 0.17415),
    (0.0, -pi / 2, 0.11985),
    (0.0, 0.0, 0.11655),
)
# In the DH frame at the link's far end.
_LINKS: Final = (
    inertial(7.369, (0.0, -0.016, 0.03), (0.03351, 0.03374, 0.021, 2e-05, -1e-05, 0.00374)),
    inertial(10.45, (0.302, 0.0, 0.16), (0.02796, 0.47558, 0.47635, -0.0001, -0.0072, 3e-05)),
    inertial(4.321, (0.194, 0.0, 0.065), (0.01091, 0.1206, 0.11714, 6e-05, 0.01012, 1e-05)),
    inertial(2.18, (0.0, -0.009, 0.011), (0.00609, 0.00245, 0.00579, -1e-05, 0.0, 0.00083)),
    inertial(2.033, (0.0, 0.018, 0.012), (0.00389, 0.00219, 0.00363, -1e-05, 0.0, -0.00045)),
    inertial(0.907, (0.0, 0.0, -0.044), (0.00117, 0.00118, 0.00084, 0.0, 0.0, 0.0)),
)
# Our own rough hulls, for contact only; in the link's frame, at its near end.
_SHAPES: Final = (
    (Capsule((0.0, 0.0, 0.09), (0.0, 0.0, 0.19), 0.075),),
    (Capsule((0.0, 0.0, 0.1), (0.0, 0.0, 0.18), 0.07), Capsule((0.0, 0.0, 0.16), (-0.4784, 0.0, 0.16), 0.06)),
    (Capsule((0.0, 0.0, 0.04), (0.0, 0.0, 0.1), 0.06), Capsule((0.0, 0.0, 0.05), (-0.36, 0.0, 0.05), 0.05)),
    (Capsule((0.0, 0.0, 0.08), (0.0, 0.0, 0.17), 0.045),),
    (Capsule((0.0, 0.0, 0.05), (0.0, 0.0, 0.12), 0.045),),
    (Capsule((0.0, 0.0, 0.04), (0.0, 0.0, 0.071), 0.045),),
)
_ENDS: Final = tuple(trans(a, 0.0, d) @ rot_x(alpha) for a, alpha, d in _ROWS)

UR16E: Final = RobotDescription(
    name="ur16e",
    base=inertial(4.0, (0.0, 0.0, 0.05), (0.0109, 0.0109, 0.0113, 0.0, 0.0, 0.0)),
    base_shape=(Capsule((0.0, 0.0, 0.02), (0.0, 0.0, 0.05), 0.08),),
    joints=tuple(
        Joint(name, placement, link.moved(end), shape)
        for name, placement, end, link, shape in zip(
            _NAMES, (np.eye(4), *_ENDS[:-1]), _ENDS, _LINKS, _SHAPES, strict=True
        )
    ),
    flange=_ENDS[-1],
    # The elbow could rotate further, but there the arm hits itself.
    q_lower=array(-2 * pi, -2 * pi, -pi, -2 * pi, -2 * pi, -2 * pi),
    q_upper=array(2 * pi, 2 * pi, pi, 2 * pi, 2 * pi, 2 * pi),
    dq_max=np.radians([120.0, 120.0, 180.0, 180.0, 180.0, 180.0]),
    ddq_max=everywhere(inf, 6),
    dddq_max=everywhere(inf, 6),
    tau_max=array(330.0, 330.0, 150.0, 54.0, 54.0, 54.0),
    dtau_max=everywhere(inf, 6),
    # Rotors behind harmonic drives: only an order of magnitude, as nobody publishes them.
    rotor_inertia=array(3.0, 3.0, 1.5, 0.5, 0.5, 0.5),
    dry_friction=array(8.0, 8.0, 5.0, 2.0, 2.0, 2.0),
    stiffness=array(40000.0, 40000.0, 25000.0, 6000.0, 6000.0, 6000.0),
    inertia=array(8.0, 10.0, 3.0, 0.6, 0.6, 0.6),
    home=np.array([0.0, -radians(90), radians(90), -radians(90), -radians(90), 0.0]),
    payload=16.0,
)
