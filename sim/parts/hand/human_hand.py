"""The cell's part `human-hand`: a person's hand of 20 joints, moved by a script or a recording."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Final, cast
from xml.etree.ElementTree import Element

import numpy as np
from pydantic import Field

from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import POINT, POSE
from srl.runtime.models.human_hand import FINGERS
from srl.runtime.models.models import HandModel, HandOption, named
from srl.sim.parts.hand.hand import add_hand
from srl.sim.wearer import InstructedWearer, Wearer, WearerConfig, make_wearer
from srl.sim.world.part import Mjcf, Part, PartConfig

_TICK: Final = 10_000_000  # ns; period at which the wearer's intention is read and the hand's motion is stored
_MEMORY: Final = 64  # ticks of the hand's past motion that are stored for slow sensors


class HumanHandConfig(PartConfig):
    """Options of a hand; its origin is the wrist's centre."""

    model: HandOption = named("hand")
    strength: float = Field(default=1.0, gt=0, description="multiplies the greatest torque of every joint of the hand")
    wearer: WearerConfig = WearerConfig()


class HumanHandPart(Part):
    """A hand whose joints follow the wearer's intention with limited torque, so that contacts can stop them.

    The targets change every 10 ms and are interpolated linearly in between. The body `<name>/base` is the hand's
    frame: what is worn at the wrist is mounted there.

    Truth: `<name>_position` (20,) rad; `<name>_tips` (5, 3), m, of the fingertips in the hand's own frame, which has
    the part's name; `<name>_pose` (7,), m and w x y z, of that frame in the world.

    Attributes:
        wearer: the intention.
    """

    Config: ClassVar[type[PartConfig]] = HumanHandConfig
    summary = "a 20-joint human hand, moved by a script or by a recording"

    def __init__(self, name: str, config: PartConfig, seed: int) -> None:
        super().__init__(name, config, seed)
        self._config = config = cast(HumanHandConfig, config)
        self.wearer: Wearer = make_wearer(config.wearer, seed, config.model.ranges)
        if (fitted := self.wearer.fitted) is not None:
            warned = self.warnings if fitted.doubtful else self.remarks
            warned += [("wearer.recording", line) for line in fitted.lines()]
            if fitted.constant:
                still = f"these don't move, so they were probably not measured: {', '.join(fitted.constant)}"
                self.remarks.append(("wearer.recording", still))
            if fitted.unused:
                self.remarks.append(("wearer.recording", f"nothing is taken of {', '.join(fitted.unused)}"))
        self.ends = self.wearer.duration if np.isfinite(self.wearer.duration) else None
        tips = Signal(
            name=f"{name}_tips", shape=(5, 3), unit="m", frame=name, labels=FINGERS, components=(POINT,),
            visual="points",
        )  # fmt: skip
        self.truth = (
            Signal(name=f"{name}_position", shape=(20,), unit="rad", labels=config.model.names),
            tips,
            Signal(name=f"{name}_pose", shape=(7,), unit="m", of=name, labels=POSE),
        )

    @property
    def model(self) -> HandModel:
        """The hand's geometry and ranges."""
        return self._config.model

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        base = f"{self.name}/base"
        body = mjcf.body(parent, base, **self.at())
        add_hand(mjcf, body, self.name, self._config.model, self._config.strength)

    def bind(self, model: Any, data: Any) -> None:
        self._data = data
        self._timestep: float = model.opt.timestep
        step_ns = round(self._timestep * 1e9)
        self.every = max(1, _TICK // step_ns)
        self._span, self._step_ns = self.every * step_ns, step_ns
        joints = [model.joint(f"{self.name}/{joint}") for joint in self._config.model.names]
        drives = [model.actuator(joint.name).id for joint in joints]
        # Views of MuJoCo's own arrays; a hand's joints and drives lie side by side.
        first, drive = int(joints[0].qposadr[0]), drives[0]
        self._qpos, self._rate = data.qpos[first : first + 20], data.ctrl[drive : drive + 20]
        state = int(model.actuator_actadr[drive])
        self._set_points = data.act[state : state + 20]
        site = int(model.site(f"{self.name}/{FINGERS[0]}").id)
        self._sites = data.site_xpos[site : site + 5]
        base = int(model.body(f"{self.name}/base").id)
        self._origin, self._axes, self._turn = data.xpos[base], data.xmat[base].reshape(3, 3), data.xquat[base]
        self._qpos[:] = self._set_points[:] = self.wearer.target(0.0)
        self._past = np.tile(self._qpos, (_MEMORY, 1))  # (64, 20); row k % 64 holds tick k

    def worn_by(self, wearer: Wearer) -> None:
        """Another wearer from now on; the hand is in that one's posture at once. For studies, before the first step."""
        self.wearer = wearer
        self._qpos[:] = self._set_points[:] = wearer.target(0.0)
        self._past[:] = self._qpos

    def drive(self, step: int) -> None:
        """Stores the posture, and starts moving the set-points to the wearer's target one tick from now."""
        self._past[step // self.every % _MEMORY] = self._qpos
        span = self.every * self._timestep
        goal = self.wearer.target(step * self._timestep + span)
        goal -= self._set_points
        np.divide(goal, span, out=self._rate)

    def fill(self, truth: Mapping[str, Array]) -> None:
        truth[f"{self.name}_position"][:] = self._qpos
        truth[f"{self.name}_tips"][:] = (self._sites - self._origin).dot(self._axes)
        truth[f"{self.name}_pose"][:3], truth[f"{self.name}_pose"][3:] = self._origin, self._turn

    def save(self) -> Array:
        warned = self.wearer.save() if isinstance(self.wearer, InstructedWearer) else np.empty(0)
        return np.concatenate([self._past.ravel(), warned])

    def restore(self, state: Array) -> None:
        self._past[...] = state[: self._past.size].reshape(self._past.shape)
        if isinstance(self.wearer, InstructedWearer):
            self.wearer.restore(state[self._past.size :])

    def position(self, at: int | None = None) -> Array:
        """Joint angles of the hand (20,), rad.

        Args:
            at: world time, ns, at most 0.6 s ago; default: now. The motion is stored every 10 ms and
                interpolated in between.
        """
        step = round(self._data.time / self._timestep)
        now, span = step * self._step_ns, self._span
        if at is None or at >= now:
            return self._qpos.copy()
        newest = max(step - 1, 0) // self.every  # the last tick that is stored
        tick, rest = divmod(max(at, (newest - _MEMORY + 1) * span, 0), span)
        before = self._past[tick % _MEMORY]
        if rest == 0:
            return before.copy()
        if tick < newest:
            after = self._past[(tick + 1) % _MEMORY]
        else:
            after, span = self._qpos, now - newest * span
        between = after - before
        between *= rest / span
        between += before
        return between
