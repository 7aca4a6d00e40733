"""Replays a recorded device in place of the real one."""

from srl.drivers.replay.driver import Replay, ReplayConfig

__all__ = ["Replay", "ReplayConfig"]
