"""The cell's part `ur16e`."""

from __future__ import annotations

from runtime.control.robots import UR16E
from sim.parts.robots.arm import ArmPart


class Ur16ePart(ArmPart):
    """Universal Robots' arm; its base frame is the controller's `base`."""

    summary = "Universal Robots UR16e, six joints, 16 kg"
    robot = UR16E
