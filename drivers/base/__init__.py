"""A mobile base behind ROS 2 and zenoh."""

from srl.drivers.base.config import BaseConfig
from srl.drivers.base.driver import MobileBase

__all__ = ["BaseConfig", "MobileBase"]
