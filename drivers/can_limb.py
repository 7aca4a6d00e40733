"""How the drivers of actuators on CAN move a limb of a URDF."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import Any, Final

from srl.runtime.contracts.limb_drives import LimbDrives, LimbJoint, LimbMotor

HALF: Final = 3.0  # rad: an encoder at the shaft tells its angle in any travel of twice this
MARGIN: Final = 2.0  # of a drive's own limit of speed over the guard's


class CanLimb(LimbDrives):
    """A driver of actuators on CAN, which turn easily and need each joint's travel."""

    part, port, parked = "actuator-chain", "can://socketcan/can0", True

    def device(self, joints: list[LimbJoint], answers: Mapping[str, Any]) -> dict[str, Any]:
        return dict(answers)

    def travel(self, joint: LimbJoint) -> tuple[float, float]:
        half = HALF * self.lead(joint)
        ends = [end for end in (joint.lower, joint.upper) if isfinite(end)]
        middle = sum(ends) / 2 if len(ends) == 2 else joint.home
        middle = min(max(middle, joint.home - half / 2), joint.home + half / 2)
        return max(joint.lower, middle - half), min(joint.upper, middle + half)

    def chain(self, motors: list[LimbMotor]) -> dict[str, Any]:
        return {"voltage": min(number_of(motor, "nominal_voltage") for motor in motors)}


def number_of(motor: LimbMotor, name: str) -> float:
    """A number that only actuators have: gear, inertia (kg m^2 at the shaft), nominal_voltage (V)."""
    return float(getattr(motor, name))


def plain(value: float) -> float:
    return float(f"{value:.6g}")
