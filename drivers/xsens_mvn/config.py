"""An MVN suit's options in the profile, and its states."""

from __future__ import annotations

import re
from typing import Final, Literal, Self

from pydantic import Field, model_validator

from srl.drivers.capture.config import CaptureConfig
from srl.drivers.capture.view import signals as seen
from srl.drivers.xsens_mvn.protocol import JOINT_ENDS, SEGMENTS
from srl.runtime.contracts.errors import nearest
from srl.runtime.contracts.signals import Signal
from srl.runtime.contracts.terms import POINT

_WORD: Final = re.compile(r"(?<=[a-z])(?=[A-Z])")


def slug(name: str) -> str:
    """MVN's name as a profile has it: RightUpperArm is right_upper_arm."""
    return _WORD.sub("_", name).lower()


ALL: Final = {slug(name): name for name in SEGMENTS}


class MvnConfig(CaptureConfig):
    """Options of an Xsens suit, streamed by MVN."""

    port: str = Field(description="udp://ADDRESS:9763: this host's address to which MVN sends; udp://:9763 for any")
    segments: dict[str, str] = Field(
        default_factory=ALL.copy, description="name: MVN's segment, such as RightUpperArm; all 23 if not given"
    )
    markers: dict[str, str] = Field(default_factory=dict, max_length=0, description="a suit has none")
    unlabelled: int = Field(default=0, ge=0, le=0, description="a suit has none")
    joints: tuple[str, ...] = Field((), description="MVN's joints whose angles are given, such as RightElbow")
    centre_of_mass: bool = Field(False, description="the body's centre of mass is given, too")
    character: int = Field(0, ge=0, le=255, description="which person of MVN's")
    sender: str | None = Field(
        None, description="MVN's computer: datagrams of others are left out; null: the first's count"
    )
    up: Literal["z", "y"] = Field(
        "z", description="the axis that points up, in MVN's streamer; the stream doesn't say it"
    )
    forward: Literal["x", "z"] | None = Field(
        None, description="with `up: y`: the axis along which the person looked in MVN's calibration"
    )
    delay: float = Field(
        0.0, ge=0, lt=1, description="s from a pose to its datagram, in MVN; the stream doesn't say it"
    )

    @model_validator(mode="after")
    def _known(self) -> Self:
        if self.up == "y" and self.forward is None:
            raise ValueError(
                "`up: y` needs 'forward': no source says where that axis system of MVN looks. Stand as in MVN's "
                "calibration and walk ahead: 'forward: z' if z grows, 'forward: x' if x does. Or choose Z up in MVN"
            )
        if self.up == "z" and self.forward is not None:
            raise ValueError("'forward' is for `up: y`; with z up x is forward")
        for name in self.segments.values():
            if name not in SEGMENTS:
                raise ValueError(f"MVN has no segment '{name}'. {nearest(name, SEGMENTS)}")
        for name in self.joints:
            if name not in JOINT_ENDS:
                raise ValueError(f"MVN has no joint '{name}'. {nearest(name, JOINT_ENDS)}")
        for wanted in ([*self.segments.values()], [*self.joints]):
            if twice := [name for name in wanted if wanted.count(name) > 1]:
                raise ValueError(f"'{twice[0]}' is named twice; name it once")
        return self


def signals(config: MvnConfig) -> tuple[Signal, ...]:
    """Returns `pose` (k, 7), `visible` (k,), each segment's own pose, and what else the profile requests."""
    made = list(seen(config))
    if config.joints:
        labels = tuple(slug(name) for name in config.joints)
        made.append(
            Signal(
                name="joint_angles", shape=(len(labels), 3), unit="rad", labels=labels, components=(("x", "y", "z"),)
            )
        )
    if config.centre_of_mass:
        made.append(Signal(name="centre_of_mass", shape=(3,), unit="m", frame=config.frame, labels=POINT))
    return tuple(made)
