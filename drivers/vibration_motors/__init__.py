"""Vibration motors on the wearer, behind an Arduino board with StandardFirmata."""

from srl.drivers.vibration_motors.config import VibrationMotorsConfig
from srl.drivers.vibration_motors.driver import VibrationMotors

__all__ = ["VibrationMotors", "VibrationMotorsConfig"]
