"""A mobile base behind ROS 2 and zenoh."""

from drivers.base.config import BaseConfig
from drivers.base.driver import MobileBase

__all__ = ["BaseConfig", "MobileBase"]
