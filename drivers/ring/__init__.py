"""A ring with one push button."""

from srl.drivers.ring.driver import Ring, RingConfig

__all__ = ["Ring", "RingConfig"]
