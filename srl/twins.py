"""What twins are made of: a device's wire protocol behind a pty or behind sockets, for the real driver to talk to."""

from srl.runtime.contracts.world import Twin
from srl.sim.devices.shared.can import CanTwin
from srl.sim.devices.shared.serial import SerialTwin
from srl.sim.devices.shared.sockets import SocketTwin, TcpDoor, UdpDoor

__all__ = ["CanTwin", "SerialTwin", "SocketTwin", "TcpDoor", "Twin", "UdpDoor"]
