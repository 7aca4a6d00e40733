"""How Feetech STS servos move a limb of a URDF."""

from __future__ import annotations

from srl.runtime.contracts.limb_drives import LimbDrives


class FeetechLimb(LimbDrives):
    """A bus of servos with an angle at their shafts."""

    driver, words, part, port = "feetech", "Feetech STS servos", "feetech-chain", "/dev/ttyACM0"
