"""Robotous RFT force/torque sensors on a CAN bus."""

from drivers.can_ft.driver import CanFt

__all__ = ["CanFt"]
