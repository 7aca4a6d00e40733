"""qbrobotics / NMMI SoftHand: one motor, one synergy, on RS485."""

from drivers.softhand.driver import SoftHand

__all__ = ["SoftHand"]
