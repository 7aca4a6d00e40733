"""Feetech STS bus servos, such as the STS3215 of the SO-100 and SO-101 arms, on one half-duplex bus."""

from srl.drivers.feetech.driver import Feetech

__all__ = ["Feetech"]
