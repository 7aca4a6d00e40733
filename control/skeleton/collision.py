"""The control law `collision`: distances, nearest points and approach speeds of body and arm, in each cycle."""

from __future__ import annotations

from math import isinf

import numpy as np
from pydantic import Field

from srl.control.skeleton.body_motion import BodyMotion
from srl.control.skeleton.capsules import between, nearest
from srl.control.skeleton.envelope import link_nodes
from srl.control.skeleton.envelope_picture import EnvelopePicture
from srl.control.skeleton.options import EnvelopeOptions
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import POINT, QUATERNION

SPAN = 0.05  # s over which velocities are means
SIDES = ("body", "arm")


class CollisionConfig(EnvelopeOptions, ControllerConfig):
    """Options of `collision`."""

    frame: str | None = Field(None, description="frame of the profile's tree that the suit's world is")
    picture: bool = Field(True, description="give the capsules and the closest gaps for pictures, too")


class Collision(Controller):
    """Measures and decides nothing: what keeps the arm clear is the guard (docs/guard.md, "Keeping clear").

    Inputs: `rotation` (59, 4), `translation` (59, 3) m of the suit's joints in their parents; `arm` (n,) rad or m, the
    positions of one arm.

    Outputs, by pair "link/segment": `distance` (k,) m, negative inside; `approach` (k,) m/s, positive while the gap
    closes, by the motion of both; `points` (k, 2, 3) m, the nearest points of the capsules' surfaces on the body and on
    the arm, in the suit's world; `least` (1,) m. Until the body has been seen for 0.05 s its speed counts as 0. For
    pictures, in the suit's world: `envelope` (s + n + 1, 8), the capsules of the body's segments and the arm's links,
    each with its distance to the nearest one of the other side with which it is compared, NaN if there is none;
    `closest` (3, 7), the gaps of the three nearest segments.
    """

    Config = CollisionConfig
    summary = "distances, nearest points and approach speeds of a worn arm and its wearer"

    def __init__(self, name: str, config: CollisionConfig) -> None:
        super().__init__(name, config)
        self._arms, self._side, self._envelope = config.arms.arms, config.arm, config.envelope
        pairs = self._envelope.pairs
        joints, n, k = config.figure.labels, self._arms.n, len(pairs)
        names = tuple(pair.name for pair in pairs)
        self.inputs = (
            Signal(name="rotation", shape=(len(joints), 4), unit="1", labels=joints, components=(QUATERNION,)),
            Signal(name="translation", shape=(len(joints), 3), unit="m", labels=joints, components=(POINT,)),
            Signal(name="arm", shape=(n,), unit="rad", labels=self._arms.labels, slides=self._arms.slides),
        )
        self.outputs = (
            Signal(name="distance", shape=(k,), unit="m", labels=names),
            Signal(name="approach", shape=(k,), unit="m/s", labels=names),
            Signal(
                name="points", shape=(k, 2, 3), unit="m", frame=config.frame, labels=names, components=(SIDES, POINT)
            ),
            Signal(name="least", shape=(1,), unit="m"),
        )
        self._picture = EnvelopePicture(self._envelope) if config.picture else None
        if self._picture is not None:
            self.outputs += self._picture.signals(config.frame)
        self._links = np.array([pair.link for pair in pairs])
        self._segments = np.array([pair.segment for pair in pairs])
        self._body_radii = self._envelope.radii[self._segments]
        self._motion = BodyMotion(config.figure, self._envelope.ends, SPAN)
        self._carrier = self._motion.kinematics.body(self._arms.parent)
        self._now, self._last = 0, b""
        self._nodes: Array | None = None
        self._closest = np.full(k, np.inf)

    def reset(self) -> None:
        self._motion.forget()
        self._last, self._nodes = b"", None
        self.update(0.0)

    def update(self, dt: float) -> None:
        self._now += round(dt * 1e9)
        rotation, translation, body = self.input["rotation"], self.input["translation"], self._motion
        values = rotation.tobytes() + translation.tobytes()
        if values != self._last:
            self._last = values
            if not np.isfinite(body.ends).all():
                body.forget()  # the pose before wasn't known, so nothing tells a speed
            body.take(self._now, rotation, translation)
        nodes = link_nodes(self._arms, self._side, self.input["arm"][None])[0]
        before, self._nodes = self._nodes, nodes
        speed = (nodes - before) / dt if before is not None and dt > 0 else np.zeros_like(nodes)
        segments, links = self._segments, self._links
        found = nearest(body.ends, segments, nodes, links)
        out = self.output
        out["distance"][:] = found.distance - self._body_radii - self._envelope.link_radius
        out["least"][0] = out["distance"].min()
        arm, arm_speed = (np.stack([each[:-1], each[1:]], axis=1) for each in (nodes, speed))
        closing = -between(arm_speed, links, found.on_link)
        if not isinf(body.window):
            closing += between(body.velocity, segments, found.on_segment)
        np.add.reduce(closing * found.normal, axis=0, out=out["approach"])
        data = body.kinematics.data
        R, p = data.xmat[self._carrier].reshape(3, 3), data.xpos[self._carrier]
        on_body = between(body.ends, segments, found.on_segment) + self._body_radii * found.normal
        on_arm = between(arm, links, found.on_link) - self._envelope.link_radius * found.normal
        np.add((R @ on_body).T, p, out=out["points"][:, 0])
        np.add((R @ on_arm).T, p, out=out["points"][:, 1])
        np.fmin(self._closest, out["distance"], out=self._closest)
        if self._picture is not None:
            self._picture.fill(out, body.ends @ R.T + p, nodes @ R.T + p)

    def metrics(self) -> dict[str, object]:
        """The least distance of the run with its pair, and what isn't compared."""
        worst = int(self._closest.argmin())
        return {
            "least_m": float(self._closest[worst]),
            "pair": self._envelope.pairs[worst].name,
            "pairs": len(self._envelope.pairs),
            "left_out": self._envelope.left_out,
        }
