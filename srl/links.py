"""Links to devices by URL: serial ports, TCP, UDP, CAN, and `loop://NAME` for tests."""

from srl.drivers.canbus import CanLink, open_can
from srl.drivers.datagram import Datagrams, open_datagrams
from srl.drivers.transport import Transport, open_transport

__all__ = ["CanLink", "Datagrams", "Transport", "open_can", "open_datagrams", "open_transport"]
