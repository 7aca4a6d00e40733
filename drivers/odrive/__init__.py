"""ODrive motor controllers on CAN (CANSimple), firmware 0.5 and 0.6."""

from srl.drivers.odrive.driver import Odrive

__all__ = ["Odrive"]
