"""Universal Robots e-Series arms: RTDE for data and commands, our own control script, the dashboard."""

from srl.drivers.ur.config import UrConfig
from srl.drivers.ur.driver import Ur

__all__ = ["Ur", "UrConfig"]
