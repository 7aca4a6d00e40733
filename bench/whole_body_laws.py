"""The whole-body laws, closed form and QP, against pinocchio's bare kinematics of the same model on the same postures.

A law's cycle is the tool's pose and Jacobian and the law itself, as in a run. Bare are forward kinematics and the
flange's Jacobian, and for MOCA the mass matrix, of base and arm: what no law of this robot can do without.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from bench.differential_ik import PLACE, Ours, Solve, timed
from bench.pairs import PAIRS, Row, measure
from srl.control.cobot.kairos_clik import KairosClik, KairosClikConfig
from srl.control.cobot.kairos_qp import KairosQp, KairosQpConfig
from srl.control.cobot.moca_impedance import MocaImpedance, MocaImpedanceConfig
from srl.control.cobot.moca_qp import MocaQp, MocaQpConfig
from srl.runtime.contracts.controller import Controller
from srl.runtime.contracts.signals import Array
from srl.runtime.models.robots import PANDA, SUMMIT_XL, UR16E, RobotDescription
from srl.runtime.models.robots.pinocchio_model import FLANGE, mobile_model
from srl.studies.superman.as_published import OFF

_DISTANCES: Any = {"distances": {"tool": {"end": (0.0, 0.0, 0.15), "radius": 0.06}}}
_PEER = "bare kinematics"


def laws() -> dict[str, tuple[RobotDescription, Controller]]:
    """By name: the robot and its law."""

    def kairos(limits: Any) -> Controller:
        return KairosQp("law", KairosQpConfig(limits=limits))

    def moca(limits: Any) -> Controller:
        return MocaQp("law", MocaQpConfig(limits=limits))

    clik, impedance = (OFF[use] for use in ("kairos-clik", "moca-impedance"))
    return {
        "kairos-clik, as published": (UR16E, KairosClik("law", KairosClikConfig.model_validate(clik))),
        "kairos-clik": (UR16E, KairosClik("law", KairosClikConfig())),
        "kairos-qp": (UR16E, kairos({})),
        "kairos-qp, distances": (UR16E, kairos(_DISTANCES)),
        "moca-impedance, as published": (PANDA, MocaImpedance("law", MocaImpedanceConfig.model_validate(impedance))),
        "moca-impedance": (PANDA, MocaImpedance("law", MocaImpedanceConfig())),
        "moca-qp": (PANDA, moca({})),
        "moca-qp, distances": (PANDA, moca(_DISTANCES)),
    }


def run() -> list[Row]:
    """A row for each law."""
    rows = []
    for name, (robot, law) in laws().items():
        pairs = measure(timed(Ours(robot, law), robot), {_PEER: timed(bare(robot), robot)}, PAIRS)
        rows.append(pairs.row("superman-laws", f"{name}, a cycle's kinematics and law", "solve", _PEER, "us"))
    return rows


def bare(robot: RobotDescription) -> Solve:
    """pinocchio alone."""
    mount = np.eye(4)
    mount[:3, 3] = PLACE
    model: Any = mobile_model(SUMMIT_XL, robot, mount)
    data, frame = model.createData(), model.getFrameId(FLANGE)
    masses = robot is PANDA

    def solve(q: Array, *_: Any) -> Array:
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacement(model, data, frame)
        J: Array = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        if masses:
            pin.crba(model, data, q)
        return J

    return solve
