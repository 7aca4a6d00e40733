"""Arduino boards with StandardFirmata: hobby servos and push buttons."""

from drivers.firmata.driver import Firmata

__all__ = ["Firmata"]
