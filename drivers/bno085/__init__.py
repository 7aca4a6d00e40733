"""Bosch BNO085 (CEVA BNO08X) inertial sensors in their UART-RVC mode: orientation and acceleration, 100 a second."""

from srl.drivers.bno085.driver import Bno085, Bno085Config

__all__ = ["Bno085", "Bno085Config"]
