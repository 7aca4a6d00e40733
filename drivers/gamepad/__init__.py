"""Logitech F310 and other pads that Linux's xpad driver serves."""

from srl.drivers.gamepad.driver import Gamepad, GamepadConfig

__all__ = ["Gamepad", "GamepadConfig"]
