"""qbrobotics / NMMI SoftHand: one motor, one synergy, on RS485."""

from srl.drivers.softhand.driver import SoftHand

__all__ = ["SoftHand"]
