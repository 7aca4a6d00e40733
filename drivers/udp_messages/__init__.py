"""Anything that sends numbers by UDP: JSON or Open Sound Control."""

from srl.drivers.udp_messages.config import UdpMessagesConfig
from srl.drivers.udp_messages.driver import UdpMessages

__all__ = ["UdpMessages", "UdpMessagesConfig"]
