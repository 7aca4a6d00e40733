"""Vicon motion capture: the DataStream server's TCP stream and Tracker's UDP object stream."""

from srl.drivers.vicon.driver import Vicon

__all__ = ["Vicon"]
