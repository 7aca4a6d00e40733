"""Replays a recorded device in place of the real one."""

from srl.drivers.replay.config import ReplayConfig
from srl.drivers.replay.driver import Replay

__all__ = ["Replay", "ReplayConfig"]
