"""zenoh for drivers: its threads live in a process of their own, behind a socket that never blocks."""

from drivers.zenoh_link.config import PeerConfig
from drivers.zenoh_link.link import Link, Outlet

__all__ = ["Link", "Outlet", "PeerConfig"]
