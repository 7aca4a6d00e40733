"""OptiTrack motion capture: Motive's NatNet stream, 3.0 to 4.x."""

from srl.drivers.natnet.config import NatNetConfig
from srl.drivers.natnet.driver import NatNet

__all__ = ["NatNet", "NatNetConfig"]
