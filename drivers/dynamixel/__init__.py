"""Robotis Dynamixel MX-28, MX-64 and MX-106 on one half-duplex bus, firmware of protocol 1.0 or 2.0."""

from srl.drivers.dynamixel.driver import Dynamixel

__all__ = ["Dynamixel"]
