"""`strap-base`: keeps the tip of a worn arm where a rigid base would have it, as far as gravity can tell."""

from __future__ import annotations

from math import degrees, inf, isinf
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from srl.control.shared.turns import measured_turn
from srl.control.strap.axes import Axis
from srl.control.strap.correction import Correction
from srl.control.strap.tilt import UP_Y, UP_Z, tilt, up_in
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.errors import OptionError
from srl.runtime.contracts.rotation import Quaternion, Vector, exp, product
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import POINT, QUATERNION
from srl.runtime.contracts.transforms import Place, Transform, device, frame, measured
from srl.runtime.models.models import ArmsOption
from srl.runtime.models.skeleton.arms import Side

Seconds = Annotated[float, Field(ge=0, le=60)]


class StrapBaseConfig(ControllerConfig):
    """Options of `strap-base`."""

    axes: dict[str, Axis] = Field(min_length=1, description="the arm's, by joint, from the base to the tip")
    arms: ArmsOption | None = Field(
        None, description="supernumerary arms under `models:`: the arm is one of them, its base has the suit's axes"
    )
    side: Side | None = Field(None, description="which of the arms; needed where there are two")
    reference: Literal["imu", "suit"] = Field(
        "imu", description="what measures the body that wears the arm: a second inertial sensor, or a capture suit"
    )
    joints: tuple[str, ...] = Field(
        ("Hips", "Spine"),
        min_length=1,
        description="with a suit: its joints, from the root to the wearer of the arm",
    )
    body: str = Field("spine", description="with a suit: the frame of the last of these joints")
    most: float = Field(0.35, gt=0, le=1.5, description="rad, greatest tilt that is compensated")
    damping: float = Field(0.02, gt=0, le=1, description="m/rad, of the least squares")
    smooth: Seconds = Field(0.02, description="s, time constant of the low-pass on the tilt")
    fade: Annotated[float, Field(gt=0, le=60)] = Field(
        0.5, description="s, in which the compensation comes and goes, and a difference at the reset melts away"
    )

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if len(set(self.joints)) < len(self.joints):
            raise ValueError("joints: each once")
        if self.arms is None:
            return self
        arms = self.arms.arms
        assert arms.side(self.side)
        if arms.n != len(self.axes):
            raise OptionError(f"the arms have {arms.n} joints, and these are {len(self.axes)} axes", "Give each one")
        for name, axis in self.axes.items():
            if given := {"axis", "link", "slides"} & axis.model_fields_set:
                raise OptionError(f"{name}: '{min(given)}' is described under `models:`", "Leave it out here")
        return self

    def arm(self) -> tuple[tuple[Axis, ...], Vector]:
        """The axes with their places, and m from the base to the first."""
        own = tuple(self.axes.values())
        if self.arms is None:
            return own, (0.0, 0.0, 0.0)
        arms = self.arms.arms
        side = arms.side(self.side)
        turns, (_, first, *links) = arms.axes(side).tolist(), arms.offsets(side).tolist()
        made = tuple(
            axis.model_copy(update={"axis": tuple(turn), "link": tuple(link), "slides": joint.slides})
            for axis, turn, link, joint in zip(own, turns, links, arms.joints, strict=True)
        )
        x, y, z = first
        return made, (x, y, z)


class StrapBase(Controller):
    """Turns the joints so that the tip stays where a rigid base would put it.

    The base's roll and pitch follow from gravity: where up is by the sensor on the base, against where it would be if
    the base were fixed to the body, by what measures the body. Neither sensor's yaw enters. The base's yaw and its
    translation aren't seen, and so aren't compensated; the base is taken to turn about its own origin.

    Inputs: `q` (n,) rad or m, the arm's measured joints, whose device's frame is the base; `wanted` (n,), the joints
    for a rigid base; `orientation` (4,) w x y z of the sensor on the base. The body's: `body` (4,) w x y z of a second
    sensor (`reference: imu`), or `rotation` (k, 4) w x y z of the suit's joints in their parents (`suit`).

    Outputs: `command` (n,) rad or m; `tilt` (3,) rad, the rotation vector that is compensated, in the base's axes;
    `active` (1,), 0 to 1: how much of it. What isn't measured, NaN or no unit quaternion, makes the compensation fade
    out from its last value; `active` says so. So does a tilt beyond `most` for longer than `fade`. A tilt that is
    beyond it from the reset on is never compensated, and after `fade` it stops the limb: a mount is wrong. It fades in
    at a reset and when the measurement is back. While `wanted` isn't there (NaN), its last value stands, or where the
    limb was at the reset.
    """

    Config = StrapBaseConfig
    summary = "compensates roll and pitch of a worn arm's base at its tip"

    def __init__(self, name: str, config: StrapBaseConfig) -> None:
        super().__init__(name, config)
        axes, first = config.arm()
        n = len(axes)
        unit = "m" if all(axis.slides for axis in axes) else "rad"
        joints = {"shape": (n,), "unit": unit, "labels": tuple(config.axes)}
        joints["slides"] = tuple(name for name, axis in zip(config.axes, axes, strict=True) if axis.slides)
        self.inputs = (
            Signal(name="q", **joints),  # type: ignore[arg-type]
            Signal(name="wanted", **joints),  # type: ignore[arg-type]
            Signal(name="orientation", shape=(4,), unit="1", labels=QUATERNION),
            self._body_signal(config),
        )
        self.outputs = (
            Signal(name="command", **joints),  # type: ignore[arg-type]
            Signal(name="tilt", shape=(3,), unit="rad", labels=POINT),
            Signal(name="active", shape=(1,), unit="1"),
        )
        worn: Place = measured("body") if config.reference == "imu" else frame(config.body)
        self.transforms = (
            Transform("mount", measured("orientation"), device("q"), "the sensor on the base, in the arm's base"),
            Transform("body", worn, device("q"), "what measures the body, in the arm's base where it is unloaded"),
        )
        self._config = config
        self._correction = Correction(axes, config.damping, first)
        self._up = UP_Z if config.reference == "imu" else UP_Y
        self._tilt: Vector = (0.0, 0.0, 0.0)
        self._share = 0.0
        self._wanted = np.zeros(n)  # the newest that was there, or where the limb was at the reset
        self._rest = np.zeros(n)  # what is left of the difference at the reset
        self._left = 0.0  # s
        self._seen = False
        self._beyond = inf  # s, for which the tilt has been beyond `most`
        self._lying = 0.0  # s, for which it has been so since the reset
        self._losses = self._bounded = self._cycles = 0
        self._worst = 0.0

    @staticmethod
    def _body_signal(config: StrapBaseConfig) -> Signal:
        if config.reference == "imu":
            return Signal(name="body", shape=(4,), unit="1", labels=QUATERNION)
        return Signal(
            name="rotation", shape=(len(config.joints), 4), unit="1", labels=config.joints, components=(QUATERNION,)
        )

    def bind(self, *arrays: Any) -> None:
        super().bind(*arrays)
        self._mount, self._worn = (_rotation(self.transform[name]) for name in ("mount", "body"))

    def reset(self) -> None:
        wanted = self.input["wanted"]
        start = self.applied.get("command", self.input["q"])
        self._correction.reset()
        # Until the tilt has been within `most` once, there is no reason to believe the mounts.
        self._share, self._seen, self._beyond, self._lying = 0.0, False, inf, 0.0
        self.lost, self.why = False, ""
        self._wanted[:] = wanted if np.isfinite(wanted).all() else start
        self._rest[:] = start - self._wanted
        self._left = self._config.fade
        self._tilt = self._measured() or (0.0, 0.0, 0.0)
        self.output["command"][:] = start
        self._tell()

    def update(self, dt: float) -> None:
        self._cycles += 1
        self._follow(dt)
        self._left = max(0.0, self._left - dt)
        wanted = self.input["wanted"]
        if np.isfinite(wanted).all():
            self._wanted[:] = wanted
        x, y, z = self._tilt
        s = self._share
        d = self._correction.solve(self._wanted, exp(s * x, s * y, s * z))
        self._worst = max(self._worst, self._correction.error)
        left = self._left / self._config.fade
        self.output["command"][:] = self._wanted + d + left * left * (3.0 - 2.0 * left) * self._rest
        self._tell()

    def metrics(self) -> dict[str, object]:
        """How often the measurement was lost, share of cycles with a tilt beyond `most`, tip error left, mm."""
        return {
            "losses": self._losses,
            "beyond_most": self._bounded / max(self._cycles, 1),
            "error_left_mm": round(1000 * self._worst, 2),
        }

    # -- the tilt

    def _follow(self, dt: float) -> None:
        """Takes the newest tilt, or lets the last one fade out."""
        new = self._measured()
        size = 0.0 if new is None else sum(v * v for v in new) ** 0.5
        if new is not None:
            self._beyond = self._beyond + dt if size > self._config.most else 0.0
            self._bounded += size > self._config.most
            self._lying = self._lying + dt if isinf(self._beyond) else 0.0
            self.lost = self._lying > self._config.fade
            self.why = self._why(size) if self.lost else ""
        if self._beyond > self._config.fade:
            new = None  # no strap gives way so far for so long: a sensor has come off, or its mount is wrong
        self._losses += self._seen and new is None
        self._seen = new is not None
        step = dt / self._config.fade
        if new is None:
            self._share = max(0.0, self._share - step)
            return
        if size > self._config.most:
            x, y, z = new
            by = self._config.most / size
            new = (by * x, by * y, by * z)
        # What has faded out is nowhere in the command, so the old value needn't be left slowly.
        a = 1.0 if self._share == 0.0 else dt / (dt + self._config.smooth)
        x, y, z = (old + a * (value - old) for old, value in zip(self._tilt, new, strict=True))
        self._tilt = x, y, z
        self._share = min(1.0, self._share + step)

    def _measured(self) -> Vector | None:
        """The present tilt, rad; None if it isn't measured."""
        base = measured_turn(self.input["orientation"].tolist())
        body: Quaternion | None = (1.0, 0.0, 0.0, 0.0)
        if self._config.reference == "imu":
            body = measured_turn(self.input["body"].tolist())
        else:
            for row in self.input["rotation"]:
                joint = measured_turn(row.tolist())
                body = None if joint is None or body is None else product(body, joint)
        if base is None or body is None:
            return None
        return tilt(up_in(self._mount, base, UP_Z), up_in(self._worn, body, self._up))

    def _why(self, size: float) -> str:
        """Why the limb stops. `size`: rad, of the tilt."""
        body = "'body'" if self._config.reference == "imu" else "the suit"
        return (
            f"'orientation' says since the reset that the base is tilted by {degrees(size):.0f} degrees against "
            f"{body}, and straps give way by {degrees(self._config.most):.0f} at most ('most'). Mount both as "
            "`frames:` says, or correct them there"
        )

    def _tell(self) -> None:
        s = self._share
        self.output["tilt"][:] = [s * v for v in self._tilt]
        self.output["active"][0] = s


def _rotation(pose: Array) -> Quaternion:
    w, x, y, z = pose[3:].tolist()
    return (w, x, y, z)
