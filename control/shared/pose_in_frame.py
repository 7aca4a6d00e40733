"""A pose in another frame of the profile's tree: a hand that motion capture sees, as the chest sees it."""

from __future__ import annotations

from pydantic import Field

from srl.runtime.contracts import rotation
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.frames import as_pose
from srl.runtime.contracts.signals import Signal
from srl.runtime.contracts.terms import POSE
from srl.runtime.contracts.transforms import Transform, coordinates, frame


class PoseInFrameConfig(ControllerConfig):
    """Options of `pose-in-frame`."""

    frame: str = Field(description="frame of the profile's tree in which the pose is given")


class PoseInFrame(Controller):
    """Gives a pose in another frame, which may move: T_frame_of = T_frame_in T_in_of.

    Input `pose` (7,) m and w x y z, in the frame that its device names; output `pose` (7,), in the frame of the option.
    NaN while the pose isn't measured, and before all frames on the way were. What isn't seen is a loss of intent.
    """

    Config = PoseInFrameConfig
    summary = "a pose in another frame of the profile's tree, fixed or measured"

    def __init__(self, name: str, config: PoseInFrameConfig) -> None:
        super().__init__(name, config)
        self.inputs = (Signal(name="pose", shape=(7,), unit="m", labels=POSE),)
        self.outputs = (
            Signal(name="pose", shape=(7,), unit="m", frame=config.frame, of="=pose", labels=POSE, visual="path"),
        )
        need = f"the frame of the pose in '{config.frame}'"
        self.transforms = (Transform("frame", coordinates("pose"), frame(config.frame), need, moves=True),)

    def reset(self) -> None:
        self.update(0.0)

    def update(self, dt: float) -> None:
        self.output["pose"][:] = rotation.composed(as_pose(self.transform["frame"]), as_pose(self.input["pose"]))
