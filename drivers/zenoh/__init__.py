"""A device on another machine: signals of another runtime, or of any ROS 2 node behind zenoh."""

from srl.drivers.zenoh.config import SignalEntry, ZenohConfig
from srl.drivers.zenoh.driver import Zenoh

__all__ = ["SignalEntry", "Zenoh", "ZenohConfig"]
