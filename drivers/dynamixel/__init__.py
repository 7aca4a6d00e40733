"""Robotis Dynamixel MX and X on one half-duplex bus, firmware of protocol 1.0 or 2.0."""

from srl.drivers.dynamixel.driver import Dynamixel

__all__ = ["Dynamixel"]
