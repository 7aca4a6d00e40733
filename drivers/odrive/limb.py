"""How ODrives move a limb of a URDF."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from srl.drivers.can_limb import MARGIN, CanLimb, number_of, plain
from srl.runtime.contracts.limb_drives import LimbJoint, LimbMotor, Question


class OdriveLimb(CanLimb):
    """ODrive: motor and gear are the lab's own."""

    driver, words = "odrive", "ODrives on CAN, each with a geared motor"
    slides, entries, prefix = False, "axes", "ODrive"
    guessed = "'parked', 'gear', 'current' and 'torque_constant' (a motor of 100 rpm/V with a gear of 8)"

    def asks(self, answers: Mapping[str, Any]) -> Question | None:
        if "firmware" not in answers:
            what = "which firmware they have (0.5: v3.x boards; 0.6: S1, Pro, Micro)"
            return Question("firmware", what, ("0.5", "0.6"), "0.6")
        if answers["firmware"] == "0.6":
            what = "where the maker's flat_endpoints.json of exactly their firmware and hardware is, for the watchdog"
            done = "endpoints" in answers
            return None if done else Question("endpoints", what, example="flat_endpoints.json", kind="file")
        what = "whether each axis' watchdog was set with odrivetool (0.5 s), as nothing on CAN can"
        to_do = "Set axisN.config.watchdog_timeout = 0.5 and enable_watchdog = True, and save"
        return None if "watchdog_set" in answers else Question("watchdog_set", what, (), "true", to_do, "yes")

    def travel(self, joint: LimbJoint) -> tuple[float, float]:
        return joint.lower, joint.upper  # it counts turns from where it is switched on

    def entry(self, joint: LimbJoint, motor: LimbMotor, number: int, answers: Mapping[str, Any]) -> dict[str, Any]:
        gear, current = number_of(motor, "gear"), motor.stall_current
        return {
            "node": number, "gear": gear, "parked": plain(joint.home), **self.bounds(joint),
            "velocity": MARGIN * joint.speed, "current": float(f"{current:.2g}"),
            "torque_constant": motor.torque_constant / gear,
        }  # fmt: skip
