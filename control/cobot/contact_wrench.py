"""What the surroundings do to the tool: a flange sensor's wrench without the tool's weight and the person's hand."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from operator import sub
from typing import Any, ClassVar, Literal

from pydantic import Field, field_validator

from srl.control.cobot.axes import Point
from srl.control.cobot.whole_body import mount_of_the_arm
from srl.runtime.contracts import rotation
from srl.runtime.contracts.errors import OptionError
from srl.runtime.contracts.gravity import GRAVITY
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.transforms import Transform, coordinates, device, measured
from srl.runtime.models.robots.pinocchio_model import FLANGE


class WeightConfig(Options):
    """An object whose weight the sensor measures."""

    mass: float = Field(ge=0, le=50, description="kg")
    com: Point = Field((0.0, 0.0, 0.0), description="m, its centre of mass in the control point's frame")


class FlangeWrenchOptions(Options):
    """How the flange's wrench is read: whose axes it has, and what else it measures."""

    gone: ClassVar[Mapping[str, str]] = {
        "position": "where the wrench is measured follows from `frames:`",
        "quaternion": "write `axes: sensor`, and the sensor's frame under `frames:`",
        "mount_quaternion": "where the arm stands follows from `frames:`",
    }

    @field_validator("axes", mode="before", check_fields=False)
    @classmethod
    def _not_tool(cls, value: Any) -> Any:
        if value == "tool":
            raise OptionError("`axes: tool` is gone", "Write `axes: sensor`, and the sensor's frame under `frames:`")
        return value

    axes: Literal["arm", "sensor", "world"] = Field(
        "arm",
        description="whose axes the wrench has: the arm's base (UR, Panda) or the world's, measured at the flange; or "
        "those of the frame that its device names, measured at that frame's origin",
    )
    tool: WeightConfig | None = Field(None, description="what hangs on the sensor, if it doesn't take it off itself")
    hand: bool = Field(True, description="the hand's force goes through the sensor too: take it off (input `hand`)")
    hand_lead: float = Field(
        0.02,
        ge=0,
        le=0.2,
        description="s by which `hand` may be newer than `flange_wrench`: a push mustn't look like contact",
    )


class ContactWrench:
    """Computes the surroundings' wrench on the tool from that of a sensor at the flange."""

    def __init__(self, options: FlangeWrenchOptions) -> None:
        self._options = options
        self._turn: rotation.Quaternion = (1.0, 0.0, 0.0, 0.0)
        self._at: rotation.Vector = (0.0, 0.0, 0.0)
        self._hands: deque[list[float]] = deque()  # the hand's wrenches of the last `hand_lead`

    def transforms(self) -> tuple[Transform, ...]:
        """What it needs of the tree of frames, with the inputs `q`, `base_pose`, `pose` and `flange_wrench`."""
        place = coordinates("flange_wrench") if self._options.axes == "sensor" else device("q", FLANGE)
        found = (Transform("sensor", place, measured("pose"), "where the contact is measured, from the control point"),)
        return (*found, mount_of_the_arm()) if self._options.axes == "arm" else found

    def place(self, transform: Mapping[str, Array]) -> None:
        """Takes the transforms."""
        x, y, z, *turn = transform["sensor"].tolist()
        self._at = (x, y, z)
        if self._options.axes == "arm":
            turn = transform["mount"].tolist()[3:]
        self._turn = (1.0, 0.0, 0.0, 0.0) if self._options.axes == "world" else (turn[0], turn[1], turn[2], turn[3])

    def reset(self) -> None:
        """Forgets the hand's past wrenches."""
        self._hands.clear()

    def take(
        self,
        wrench: list[float],
        hand: list[float],
        orientation: rotation.Quaternion,
        yaw: float,
        dt: float,
        expected: list[float] | None = None,
    ) -> list[float]:
        """Returns the surroundings' wrench (6,) N, N m on the tool, at the control point, world axes.

        Args:
            wrench: (6,) N, N m, the measured wrench on the tool.
            hand: (6,) N, N m, the hand's wrench at the control point, world axes.
            orientation: orientation of the control point, world.
            yaw: yaw of the mobile base, rad.
            dt: s since the last call.
            expected: (6,) N, N m, what is known to pull besides the hand, a load's weight; None: nothing.
        """
        o = self._options
        turn = self._turn
        if o.axes == "sensor":
            turn = rotation.product(orientation, turn)
        elif o.axes == "arm":
            turn = rotation.product(rotation.exp(0.0, 0.0, yaw), turn)
        force = rotation.turned(turn, (wrench[0], wrench[1], wrench[2]))
        torque = rotation.turned(turn, (wrench[3], wrench[4], wrench[5]))
        at = rotation.turned(orientation, self._at)
        f = [*force, *(t + r for t, r in zip(torque, cross(at, force), strict=True))]
        if o.tool is not None:
            weight = (0.0, 0.0, -o.tool.mass * GRAVITY)
            lever = cross(rotation.turned(orientation, o.tool.com), weight)
            f = list(map(sub, f, (*weight, *lever)))
        return self._without_hand(f, hand, dt, expected) if o.hand else f

    def _without_hand(self, f: list[float], hand: list[float], dt: float, expected: list[float] | None) -> list[float]:
        """Takes off the hand's wrench of the instant that leaves the smallest rest.

        It isn't known which of the hand's forces the flange measures now. What one of them explains is no contact.
        """
        hands = self._hands
        hands.append(hand)
        while dt > 0.0 and len(hands) > round(self._options.hand_lead / dt) + 1:
            hands.popleft()
        known = expected or [0.0] * 6
        left = [list(map(sub, map(sub, f, known), hands[k])) for k in {0, len(hands) // 2, len(hands) - 1}]
        rest = [*min((v[:3] for v in left), key=square), *min((v[3:] for v in left), key=square)]
        return [a + b for a, b in zip(rest, known, strict=True)]


def square(v: list[float] | rotation.Vector) -> float:
    """The square of a vector's length."""
    return v[0] * v[0] + v[1] * v[1] + v[2] * v[2]


def cross(a: rotation.Vector, b: rotation.Vector) -> rotation.Vector:
    """The vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
