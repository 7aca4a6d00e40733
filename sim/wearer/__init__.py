"""The simulated wearer: intended joint angles of the hand as a function of time."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from srl.runtime.contracts.files import ProfilePath
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.signals import Array
from srl.runtime.models.human_hand import RANGES
from srl.sim.wearer.instructed import InstructedWearer
from srl.sim.wearer.motion import Wearer
from srl.sim.wearer.recording import load_wearer
from srl.sim.wearer.scripted import ScriptedWearer

__all__ = ["InstructedWearer", "ScriptedWearer", "Wearer", "WearerConfig", "load_wearer", "make_wearer"]


class WearerConfig(Options):
    """Who wears the hand: a recording, or a script that closes and opens it."""

    renamed: ClassVar[dict[str, str]] = {"told": "instructed"}

    recording: ProfilePath | None = Field(
        default=None, description="file or folder (docs/simulation.md); null: the script"
    )
    episode: int | None = Field(default=None, ge=0, description="one episode of a recording that has several")
    speed: float = Field(default=1.0, gt=0, le=10, description="1 is the person's own pace")
    loop: bool = Field(default=False, description="start again at the end instead of standing still")
    instructed: bool = Field(
        default=False, description="does what a calibration says, instead of a script or a recording"
    )
    miss: float = Field(
        default=0.0, ge=0, le=0.5, description="rad, standard deviation by which a joint misses what it is to do; ours"
    )
    period: float = Field(default=4.0, ge=1.0, description="s, the script's time from one grasp to the next")


def make_wearer(config: WearerConfig, seed: int, ranges: Array = RANGES) -> Wearer:
    """Creates the wearer that a profile sets; `ranges` (20, 2), rad, are its joints'.

    Raises:
        RecordingError: the recording can't be read, or doesn't fit into the ranges.
    """
    if config.instructed:
        return InstructedWearer(seed, ranges=ranges, miss=config.miss)
    if config.recording is None:
        return ScriptedWearer(seed, ranges=ranges, period=config.period, speed=config.speed)
    return load_wearer(config.recording, ranges=ranges, episode=config.episode, speed=config.speed, loop=config.loop)
