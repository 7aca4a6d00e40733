"""Universal Robots e-Series arms: RTDE for data and commands, our own control script, the dashboard."""

from drivers.ur.config import UrConfig
from drivers.ur.driver import Ur

__all__ = ["Ur", "UrConfig"]
