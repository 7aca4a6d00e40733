"""How CubeMars actuators in servo mode move a limb of a URDF."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from srl.drivers.can_limb import MARGIN, CanLimb, plain
from srl.runtime.contracts.limb_drives import LimbJoint, LimbMotor, Question

_RAMP: Final = 20.0  # 1/s, of a drive's own acceleration over its speed


class CubemarsServoLimb(CanLimb):
    """CubeMars in servo mode: the drive's own ramp and speed, parked where it is switched on."""

    driver, words = "cubemars-servo", "CubeMars AK actuators on CAN, in servo mode"
    slides, entries, prefix, guessed = False, "axes", "AK", "'parked' and 'current'"

    def asks(self, answers: Mapping[str, Any]) -> Question | None:
        what = "s of silence after which the drives let go, as set with the maker's program"
        return None if "timeout" in answers else Question("timeout", what, example="1.0", kind="number")

    def entry(self, joint: LimbJoint, motor: LimbMotor, number: int, answers: Mapping[str, Any]) -> dict[str, Any]:
        speed = MARGIN * joint.speed
        return {
            "id": number, "model": motor.name, "parked": plain(joint.home), **self.bounds(joint),
            "velocity": speed, "acceleration": _RAMP * speed, "current": float(f"{motor.stall_current:.2g}"),
            "torque_constant": float(f"{motor.torque_constant:.3g}"),
        }  # fmt: skip
