"""zenoh for drivers: its threads run in their own process, behind a socket that never blocks."""

from srl.drivers.zenoh_link.config import PeerConfig
from srl.drivers.zenoh_link.link import Link, Outlet

__all__ = ["Link", "Outlet", "PeerConfig"]
