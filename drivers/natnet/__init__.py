"""OptiTrack motion capture: Motive's NatNet stream, 3.0 to 4.x."""

from drivers.natnet.config import NatNetConfig
from drivers.natnet.driver import NatNet

__all__ = ["NatNet", "NatNetConfig"]
