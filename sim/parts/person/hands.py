"""The cell's part `hands`: a person's hands that hold a thing, turn it as told, and hold it still."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final
from xml.etree.ElementTree import Element

import numpy as np
from pydantic import Field
from scipy.spatial.transform import Rotation

from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import QUATERNION
from srl.runtime.contracts.wearer import Instruction, Rest, Turn
from srl.sim.wearer.motion import quintic
from srl.sim.world.mjcf import CONTACT, add
from srl.sim.world.part import Mjcf, Part, PartConfig

_UPDATE: Final = 0.002  # s between two targets
_FREQUENCIES: Final = (0.7, 1.1, 1.9)  # Hz, of hands that don't hold quite still; ours


class HandsConfig(PartConfig):
    """Options of the part."""

    seconds: float = Field(2.0, gt=0.2, description="s that a turn takes; ours")
    askew: float = Field(0.12, ge=0, le=0.5, description="rad, standard deviation of how it is turned; ours")
    sway: float = Field(0.01, ge=0, le=0.1, description="rad, amplitude by which what is held sways; ours")
    stiffness: float = Field(0.02, gt=0.002, le=1.0, description="s, in which it returns to where it is held")


class HandsPart(Part):
    """Body `NAME/held`, free but for the hands: mount on it what they hold.

    Truth: `NAME_turn` (4,), w x y z, of what is held, in the world.
    """

    Config = HandsConfig
    summary = "a person's hands that hold a thing and turn it as told"

    def __init__(self, name: str, config: HandsConfig, seed: int) -> None:
        super().__init__(name, config, seed)
        self._config = config
        self.wearer = self
        self.truth = (Signal(name=f"{name}_turn", shape=(4,), unit="1", labels=QUATERNION),)
        self.every = 1
        self._from, self._to, self._since, self._instructed = Rotation.identity(), Rotation.identity(), 0.0, 0

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        self.moves_freely(mjcf, parent)
        body = mjcf.body(mjcf.worldbody, f"{self.name}/held", gravcomp=1, **self.at())
        add(body, "freejoint", name=f"{self.name}/free")
        add(body, "geom", name=f"{self.name}/grip", type="sphere", size=(0.03,), mass=1.0, **CONTACT["none"])
        mjcf.lead(self.name, f"{self.name}/held", self._config.stiffness, **self.at())

    def bind(self, model: Any, data: Any) -> None:
        self._data, self._dt = data, float(model.opt.timestep)
        self._body = int(model.body(f"{self.name}/held").id)
        self._mocap = int(model.body(f"{self.name}/target").mocapid[0])
        self.every = max(1, round(_UPDATE / self._dt))

    # -- the wearer, as who instructs it knows it

    @property
    def done(self) -> bool:
        """Whether the last turn is over."""
        return bool(self._data.time >= self._since + self._config.seconds)

    def instruct(self, instruction: Instruction) -> None:
        """From now on turns what is held; else holds it still. Raises ValueError: hands alone can't do it."""
        if isinstance(instruction, Rest):
            return
        if not isinstance(instruction, Turn):
            raise ValueError(f"hands that hold a thing aren't told to {type(instruction).__name__}: Turn or Rest")
        self._from, self._since = self._target(float(self._data.time)), float(self._data.time)
        self._instructed += 1
        random = np.random.default_rng((self.seed, self._instructed))
        up, _ = Rotation.align_vectors([[0.0, 0.0, 1.0]], [instruction.up])
        about = Rotation.from_rotvec([0.0, 0.0, random.uniform(-np.pi, np.pi)])
        more = (1.0 + 3.0 * min(instruction.again, 1)) * self._config.askew
        self._to = Rotation.from_rotvec(more * random.normal(size=3)) * about * up

    def see(self, pointers: Any) -> None:
        """Hands see nothing."""

    def _target(self, t: float) -> Rotation:
        share = quintic(min(max((t - self._since) / self._config.seconds, 0.0), 1.0))
        way = (self._from.inv() * self._to).as_rotvec()
        return self._from * Rotation.from_rotvec(share * way)

    def drive(self, step: int) -> None:
        t = (step + self.every) * self._dt
        sway = self._config.sway * np.sin([2.0 * np.pi * f * t for f in _FREQUENCIES])
        turn = self._target(t) * Rotation.from_rotvec(sway)
        self._data.mocap_quat[self._mocap] = turn.as_quat(scalar_first=True)

    def fill(self, truth: Mapping[str, Array]) -> None:
        truth[self.truth[0].name][:] = self._data.xquat[self._body]

    def save(self) -> Array:
        return np.array([*self._from.as_quat(), *self._to.as_quat(), self._since, self._instructed])

    def restore(self, state: Array) -> None:
        self._from, self._to = Rotation.from_quat(state[:4]), Rotation.from_quat(state[4:8])
        self._since, self._instructed = float(state[8]), int(state[9])
