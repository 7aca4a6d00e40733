"""Franka Emika Panda (FER) and FR3 (sheet panda): modified DH after Craig, link parameters of Gaz et al. 2019.

The inertias reproduce joint torques, not the true distribution of mass: use them for the dynamics of the whole arm,
not for a single link's momentum. The FR3 has the same kinematics. Its own inertias are not known, so it has the
Panda's.
"""

from __future__ import annotations

from dataclasses import replace
from math import pi
from typing import Final

from srl.runtime.models.robots.description import (
    Capsule,
    Joint,
    RobotDescription,
    SlidingFriction,
    array,
    everywhere,
    inertial,
    rot_x,
    rot_z,
    trans,
)

# (a of the row, alpha of the row, d)
_ROWS: Final = (
    (0.0, 0.0, 0.333),
    (0.0, -pi / 2, 0.0),
    (0.0, pi / 2, 0.316),
    (0.0825, pi / 2, 0.0),
    (-0.0825, -pi / 2, 0.384),
    (0.0, pi / 2, 0.0),
    (0.088, pi / 2, 0.0),
)
_LINKS: Final = (
    inertial(4.970684, (0.003875, 0.002081, -0.04762), (0.70337, 0.70661, 0.009117, -0.000139, 0.006772, 0.019169)),
    inertial(0.646926, (-0.003141, -0.02872, 0.003495), (0.007962, 0.02811, 0.025995, -0.003925, 0.010254, 0.000704)),
    inertial(3.228604, (0.027518, 0.039252, -0.066502), (0.037242, 0.036155, 0.01083, -0.004761, -0.011396, -0.012805)),
    inertial(3.587895, (-0.05317, 0.104419, 0.027454), (0.025853, 0.019552, 0.028323, 0.007796, -0.001332, 0.008641)),
    inertial(
        1.225946, (-0.011953, 0.041065, -0.038437), (0.035549, 0.029474, 0.008627, -0.002117, -0.004037, 0.000229)
    ),
    inertial(1.666555, (0.060149, -0.014117, -0.010517), (0.001964, 0.004354, 0.005433, 0.000109, -0.001158, 0.000341)),
    inertial(
        0.735522, (0.010517, -0.004252, 0.061597), (0.012516, 0.010027, 0.004815, -0.000428, -0.001196, -0.000741)
    ),
)
# Our own rough hulls, for contact only.
_SHAPES: Final = (
    (Capsule((0.0, 0.0, -0.19), (0.0, 0.0, -0.05), 0.06),),
    (Capsule((0.0, 0.0, -0.06), (0.0, 0.0, 0.06), 0.06),),
    (Capsule((0.0, 0.0, -0.17), (0.0, 0.0, -0.05), 0.06),),
    (Capsule((0.0, 0.0, -0.06), (0.0, 0.0, 0.06), 0.055),),
    (Capsule((0.0, 0.0, -0.26), (0.0, 0.07, -0.13), 0.055), Capsule((0.0, 0.07, -0.13), (0.0, 0.05, 0.0), 0.04)),
    (Capsule((0.0, 0.0, -0.03), (0.0, 0.0, 0.01), 0.05),),
    (Capsule((0.0, 0.0, -0.03), (0.0, 0.0, 0.062), 0.045),),
)

PANDA: Final = RobotDescription(
    name="panda",
    base=inertial(
        0.629769, (-0.041018, -0.00014, 0.049974), (0.00315, 0.00388, 0.004285, 8.2904e-07, 0.00015, 8.2299e-06)
    ),
    base_shape=(Capsule((-0.06, 0.0, 0.06), (0.0, 0.0, 0.06), 0.06),),
    joints=tuple(
        Joint(f"joint{i + 1}", rot_x(alpha) @ trans(a, 0.0, d), link, shape)
        for i, ((a, alpha, d), link, shape) in enumerate(zip(_ROWS, _LINKS, _SHAPES, strict=True))
    ),
    flange=trans(0.0, 0.0, 0.107),
    q_lower=array(-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973),
    q_upper=array(2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973),
    dq_max=array(2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61),
    ddq_max=array(15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0),
    dddq_max=array(7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0),
    tau_max=array(87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0),
    dtau_max=everywhere(1000.0, 7),
    # The maker's reflected inertias of the FR3's joints, as the README of Drake's franka_description gives them (MuJoCo
    # Menagerie has 0.1 kg m2 for each joint of a Panda). Nobody has published the Panda's own.
    rotor_inertia=array(0.605721456, 0.605721456, 0.462474144, 0.462474144, 0.205544064, 0.205544064, 0.205544064),
    dry_friction=everywhere(0.0, 7),
    # Gaz et al. 2019, supplement, table I: identified from the torque sensors, so the motors' friction isn't in it.
    sliding_friction=SlidingFriction(
        array(0.54615, 0.87224, 0.64068, 1.2794, 0.83904, 0.30301, 0.56489),
        array(5.1181, 9.0657, 10.136, 5.5903, 8.3469, 17.133, 10.336),
        array(0.039533, 0.025882, -0.04607, 0.036194, 0.026226, -0.021047, 0.0035526),
    ),
    stiffness=array(3000.0, 3000.0, 3000.0, 2500.0, 2500.0, 2000.0, 2000.0),
    inertia=array(2.6, 3.1, 1.7, 1.3, 0.26, 0.26, 0.23),
    home=array(0.0, -pi / 4, 0.0, -3 * pi / 4, 0.0, pi / 2, pi / 4),
    payload=3.0,
)

FR3: Final = replace(
    PANDA,
    name="fr3",
    # The maker's table of the FR3. The greatest velocity also depends on the distance to the joint's limit.
    q_lower=array(-2.9007, -1.8361, -2.9007, -3.0770, -2.8763, 0.4398, -3.0508),
    q_upper=array(2.9007, 1.8361, 2.9007, -0.1169, 2.8763, 4.6216, 3.0508),
    dq_max=array(2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26),
    ddq_max=everywhere(10.0, 7),
    dddq_max=everywhere(5000.0, 7),
)

FLANGE_TO_HAND: Final = rot_z(-pi / 4)
"""(4, 4), Franka's own hand in the flange frame; its tool point is 0.1034 m further along z."""
HAND_TO_TCP: Final = trans(0.0, 0.0, 0.1034)
HAND: Final = inertial(0.73, (-0.01, 0.0, 0.03), (0.001, 0.0025, 0.0017, 0.0, 0.0, 0.0))
"""Franka's hand without its two fingers of 0.015 kg, in its own frame."""
