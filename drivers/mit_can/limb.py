"""How actuators in MIT mode move a limb of a URDF: stiffness and damping come from what the joint carries and moves."""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil, floor, isfinite, log10, sqrt
from typing import Any, Final

from pydantic import ValidationError

from srl.drivers.can_limb import HALF, CanLimb, number_of, plain
from srl.drivers.mit_can.config import MitCanConfig
from srl.runtime.contracts.limb_drives import LEAD, LimbJoint, LimbMotor, Question

_SAG: Final = 0.05  # rad, by which the weight may pull a spring
_STIFFEST, _MOST_DAMPING = 400.0, 5.0  # N m/rad; N m s/rad, the most that MIT mode can say
_SOFTEST: Final = 5.0  # N m/rad
_DAMPED, _RINGING = 0.7, 0.3  # damping ratio that is aimed at, and the least


class MitCanLimb(CanLimb):
    """MIT mode: stiffness and damping come from what the joint carries and moves."""

    driver, words = "mit-can", "Damiao and CubeMars AK actuators on CAN, in MIT mode"
    guessed = "'kp' and 'kd'"

    def asks(self, answers: Mapping[str, Any]) -> Question | None:
        if "maker" not in answers:
            return Question("maker", "who made the actuators", ("damiao", "cubemars"), "damiao")
        if answers["maker"] == "damiao":
            return None
        if "firmware" not in answers:  # never guessed: an older command is a gain to a V3
            return Question("firmware", "which generation their firmware is of", ("v1", "v2", "v3"), "v2")
        if "enable_at_open" not in answers:
            what = "whether they may be switched on at open, with damping alone: most don't say before where they are"
            to_do = "Nothing can be opened without: say yes, or choose another driver"
            return Question("enable_at_open", what, (), "true", to_do, "yes")
        return None

    def takes(self, model: str, answers: Mapping[str, Any]) -> bool:
        entry = {"id": 1, "model": model, "lower": -1.0, "upper": 1.0, "kp": 1.0, "kd": 1.0}
        try:
            MitCanConfig.model_validate({"port": self.port, **answers, "motors": {"joint": entry}})
        except ValidationError:
            return False
        return True

    def lead(self, joint: LimbJoint) -> float:
        if not joint.slides:
            return 1.0
        reach = max((abs(end) for end in (joint.lower, joint.upper) if isfinite(end)), default=0.0)
        return max(LEAD, _up(reach / HALF))

    def entry(self, joint: LimbJoint, motor: LimbMotor, number: int, answers: Mapping[str, Any]) -> dict[str, Any]:
        kp, kd = self.gains(joint, motor)
        gains = {"kp": float(f"{kp:.2g}"), "kd": float(f"{kd:.2g}")}
        # A rotor's encoder tells the angle within a turn of the rotor alone.
        park = {"park": plain(joint.home)} if answers["maker"] == "cubemars" else {}
        return {**super().entry(joint, motor, number, answers), **gains, **park}

    def gains(self, joint: LimbJoint, motor: LimbMotor) -> tuple[float, float]:
        """N m/rad and N m s/rad at the shaft: the weight pulls it by 3 degrees, unless that can't be damped."""
        lead = self.lead(joint)
        moved = joint.inertia * lead**2 + number_of(motor, "inertia")
        kp = min(max(joint.torque * lead / _SAG, _SOFTEST), _STIFFEST, (_MOST_DAMPING / 2 / _RINGING) ** 2 / moved)
        return kp, min(2 * _DAMPED * sqrt(kp * moved), _MOST_DAMPING)

    def strained(self, joint: LimbJoint, motor: LimbMotor) -> str:
        sag = joint.torque * self.lead(joint) / self.gains(joint, motor)[0]
        return f"{joint.name}: a stiffness that can be damped lets the weight pull it by {sag:.2g} rad" \
            if sag > 3 * _SAG else ""  # fmt: skip


def _up(value: float) -> float:
    """Rounded up to two digits."""
    if value <= 0.0:
        return 0.0
    step = 10.0 ** (floor(log10(value)) - 1)
    return float(f"{ceil(value / step - 1e-9) * step:.2g}")
