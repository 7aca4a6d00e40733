"""zenoh for drivers: its threads run in their own process, behind a socket that never blocks."""

from drivers.zenoh_link.config import PeerConfig
from drivers.zenoh_link.link import Link, Outlet

__all__ = ["Link", "Outlet", "PeerConfig"]
