"""How Dynamixel MX servos move a limb of a URDF: one supply feeds them all."""

from __future__ import annotations

from srl.runtime.contracts.limb_drives import LimbDrives


class DynamixelLimb(LimbDrives):
    """A bus of servos with an angle at their shafts."""

    driver, words, part, port = "dynamixel", "Dynamixel MX servos", "dynamixel-chain", "/dev/ttyUSB0"
    prefix = "MX-"
