"""Robotous RFT force/torque sensors on a CAN bus."""

from srl.drivers.can_ft.driver import CanFt

__all__ = ["CanFt"]
