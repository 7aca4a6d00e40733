"""CyberGlove II and III data gloves, 18 or 22 sensors, 8-bit records over a serial line."""

from srl.drivers.cyberglove.driver import CyberGlove

__all__ = ["CyberGlove"]
