"""The control law `retreat`: leads a worn arm out of the way of its wearer, and else to where another law wants it."""

from __future__ import annotations

from math import isinf

import numpy as np
from pydantic import Field

from srl.control.skeleton.body_motion import BodyMotion
from srl.control.skeleton.capsules import nearest
from srl.control.skeleton.envelope import link_nodes, reaches
from srl.control.skeleton.options import EnvelopeOptions
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import POINT, QUATERNION

SPAN = 0.05  # s over which velocities are means
STEP = 1e-4  # rad or m, of the finite differences


class RetreatConfig(EnvelopeOptions, ControllerConfig):
    """Options of `retreat`."""

    begin: float = Field(0.08, gt=0, lt=1, description="m, distance below which the arm gives way")
    horizon: float = Field(0.8, ge=0, lt=2, description="s by which an approach counts before it has come")
    speed: float = Field(0.2, gt=0, lt=2, description="m/s, at most, of the arm's fastest point on its way out")
    ahead: float = Field(
        0.2, gt=0, lt=2, description="s by which the goal is ahead of the arm on that way, and of getting there"
    )


class Retreat(Controller):
    """A goal that mixes the one that is wanted and a step along the distances' gradient.

    With d_k the distance of pair k and w_k >= 0 the speed at which its segment approaches, alpha_k = clip(1 - (d_k -
    w_k horizon) / begin, 0, 1). The arm goes along g = sum_k alpha_k^2 grad_q d_k, at `speed` at most, for the share
    max_k alpha_k, and to `target` for the rest; the difference to `target` changes with the time constant `ahead`, so
    nothing jumps. It is a wish like any other: the guard checks its motion as that of any law (docs/guard.md, "Keeping
    clear"). A retreat that nobody checks runs into the other side of the body.

    Inputs: `target` (n,) rad or m; `rotation` (59, 4), `translation` (59, 3) m of the suit. Output: `q` (n,), wired to
    the arm's position command: it begins at what was applied. `share` (1,): max alpha.

    A pose that is none (`BodyMotion.trouble`) is left out, and the body counts as where it was. While `target` isn't
    there (NaN), its last value stands, or where the arm was at the reset.
    """

    Config = RetreatConfig
    summary = "a worn arm gives way to its wearer, else goes where it is wanted"

    def __init__(self, name: str, config: RetreatConfig) -> None:
        super().__init__(name, config)
        self.options = config
        self._arms, self._side, self._envelope = config.arms.arms, config.arm, config.envelope
        joints, n, labels = config.figure.labels, self._arms.n, self._arms.labels
        self.inputs = (
            Signal(name="target", shape=(n,), unit="rad", labels=labels, slides=self._arms.slides),
            Signal(name="rotation", shape=(len(joints), 4), unit="1", labels=joints, components=(QUATERNION,)),
            Signal(name="translation", shape=(len(joints), 3), unit="m", labels=joints, components=(POINT,)),
        )
        self.outputs = (
            Signal(name="q", shape=(n,), unit="rad", labels=labels, slides=self._arms.slides),
            Signal(name="share", shape=(1,), unit="1"),
        )
        self._links = np.array([pair.link for pair in self._envelope.pairs])
        self._segments = np.array([pair.segment for pair in self._envelope.pairs])
        self._radii = self._envelope.radii[self._segments] + self._envelope.link_radius
        stroke = np.full(n, config.stroke)
        self._reach = reaches(self._arms, self._side, -stroke, stroke).max(axis=1)
        self._motion = BodyMotion(config.figure, self._envelope.ends, SPAN)
        self._tries = np.vstack([np.zeros(n), STEP * np.eye(n)])
        self._now, self._last = 0, b""
        self._offset = np.zeros(n)  # of the output from the target
        self._target = np.zeros(n)  # the newest that was there, or where the arm was at the reset

    def reset(self) -> None:
        self._motion.forget()
        self._last = b""
        start = self.applied.get("q", self.input["target"])
        self._target[:] = start
        self._wanted()
        self.output["q"][:] = start
        self._offset[:] = start - self._target
        self.output["share"][0] = 0.0

    def update(self, dt: float) -> None:
        self._now += round(dt * 1e9)
        rotation, translation, body = self.input["rotation"], self.input["translation"], self._motion
        values = rotation.tobytes() + translation.tobytes()
        if values != self._last and not body.trouble(rotation, translation):
            self._last = values
            body.take(self._now, rotation, translation)
        target, here = self._wanted(), self.applied.get("q", self.output["q"])
        share, way = self._way(here)
        wanted = share * (here + way - target)
        if np.isfinite(wanted).all():  # what isn't finite would stay in the sum for good
            self._offset += min(dt / self.options.ahead, 1.0) * (wanted - self._offset)
        self.output["q"][:] = target + self._offset
        self.output["share"][0] = share

    def _wanted(self) -> Array:
        if np.isfinite(self.input["target"]).all():
            self._target[:] = self.input["target"]
        return self._target

    def _way(self, here: Array) -> tuple[float, Array]:
        """max alpha, and the step out of the way, (n,) rad or m."""
        options, body = self.options, self._motion
        nodes = link_nodes(self._arms, self._side, here + self._tries)
        found = nearest(body.ends, self._segments, nodes, self._links)
        distance = found.distance - self._radii
        ahead = distance[0]
        if not isinf(body.window):
            speed = np.einsum("kei,ik->ke", body.velocity[self._segments], found.normal[:, 0]).max(axis=1)
            ahead = ahead - options.horizon * np.maximum(speed, 0.0)
        alpha = np.clip(1.0 - ahead / options.begin, 0.0, 1.0)
        g = (distance[1:] - distance[0]) @ (alpha * alpha) / STEP
        size = float(np.abs(g) @ self._reach)
        return float(alpha.max()), g * (options.speed * options.ahead / size) if size > 1e-9 else np.zeros_like(g)
