"""A suit's options in the profile, and its states."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from srl.drivers.noitom.skeleton import JOINTS, Kind, Skeleton
from srl.runtime.contracts.driver import DeviceConfig
from srl.runtime.contracts.files import FileOption, KeptFile
from srl.runtime.contracts.rotation import Order
from srl.runtime.contracts.signals import Signal
from srl.runtime.contracts.terms import POINT, QUATERNION


class NoitomConfig(DeviceConfig):
    """Options of a suit."""

    port: str = Field(description="tcp://HOST:7001 (Axis Neuron), udp://:7012 (Axis Studio sends there)")
    skeleton: Kind = Field("axis-neuron", description="the tree; it can't be told from the stream")
    order: Order = Field("YXZ", description="rotation order set in the software; it can't be told from the stream")
    avatar: int = Field(0, ge=0, description="index of the person")
    scale: float = Field(1.0, gt=0.3, lt=3, description="of the default body, where displacements aren't sent")
    calibration: (
        Annotated[KeptFile, FileOption("Make it with `srl calibrate PROFILE suit`, or name another")] | None
    ) = Field(None, description="file of `srl calibrate`: the suit's heading is taken back by it; None: as it is sent")


def signals(skeleton: Skeleton) -> tuple[Signal, Signal]:
    """Returns the states `rotation` (59, 4) and `translation` (59, 3)."""
    return (
        Signal(name="rotation", shape=(JOINTS, 4), unit="1", labels=skeleton.names, components=(QUATERNION,)),
        Signal(name="translation", shape=(JOINTS, 3), unit="m", labels=skeleton.names, components=(POINT,)),
    )
