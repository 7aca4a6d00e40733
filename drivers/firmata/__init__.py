"""Arduino boards with StandardFirmata: hobby servos and push buttons."""

from srl.drivers.firmata.driver import Firmata

__all__ = ["Firmata"]
