"""A worn arm at random goals and a wearer who reaches about without looking: who runs into whom.

Contacts are those of MuJoCo's own collision between capsules that are thinner than the envelope's. A contact is to be
blamed on the arm if the arm's motion alone closes the gap at over 0.02 m/s when it begins.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np

from helpers.guard import guard_of
from runtime.contracts.rotation import Quaternion, from_euler_xyz, product
from runtime.contracts.signals import Array, Command, Kind
from runtime.control.skeleton.body_clearance import BodyClearance, BodyClearanceConfig
from runtime.control.skeleton.body_motion import BodyMotion
from runtime.control.skeleton.capsules import nearest
from runtime.control.skeleton.envelope import CLOTHING, PARTS, link_nodes
from runtime.control.skeleton.kinematics import Kinematics
from runtime.control.skeleton.options import EnvelopeOptions
from runtime.control.skeleton.retreat import Retreat, RetreatConfig
from srl.testing import bound

DT = 0.01
BLAME = 0.02  # m/s
GOAL = 0.06  # m, of a goal from trunk and legs
THIN = 0.8  # of the envelope's radii: the person under the clothes
LOW = np.array([-1.6, -1.4, -1.6, -1.9, 0.0, -1.6, -2.6])
HIGH = np.array([1.0, 0.3, 1.6, 1.9, 0.1, 1.6, 2.6])
V = np.array([0.8, 0.8, 0.8, 0.8, 0.08, 0.8, 0.8])
A = 5 * V
LAG = 0.03  # s, of the servo


@dataclass
class Attack:
    """What is different from what the guard is told.

    Attributes:
        guarded: the arm has a clearance at all.
        delay: s, from a pose to its frame.
        drop: share of the frames that are lost.
        freeze: (from, to) s in which the suit repeats its frame with new stamps.
        quick: factor on the wearer's speed.
        thin: factor on the envelope's radii.
        servo: s, its lag.
        retreat: the law `retreat` bends the goals.
    """

    guarded: bool = True
    delay: float = 0.03
    drop: float = 0.0
    freeze: tuple[float, float] = (0.0, 0.0)
    quick: float = 1.0
    thin: float = 1.0
    servo: float = LAG
    retreat: bool = False
    options: dict[str, Any] = field(default_factory=dict)


@dataclass
class Outcome:
    """What became of one trial.

    Attributes:
        contacts: m/s, by which the arm closed the gap when each contact began.
        goals: reached.
        held: share of the cycles.
        acceleration: m/s^2, the highest of any end of the wearer's limbs, in the carrier's frame.
    """

    contacts: list[float] = field(default_factory=list)
    goals: int = 0
    held: float = 0.0
    acceleration: float = 0.0

    @property
    def blamed(self) -> int:
        return sum(speed > BLAME for speed in self.contacts)


class Wearer:
    """Both arms go from one random posture in front of the body to the next, by minimum jerk."""

    def __init__(self, config: BodyClearanceConfig, rng: np.random.Generator, quick: float) -> None:
        figure = config.figure
        self.names, self.rng, self.quick = figure.labels, rng, quick
        joints = list(figure.human.joints)
        self.translation = figure.human.offsets[joints].copy()
        self.hang = {"Right": (0.2, 1.3, 0.3), "Left": (0.2, 1.3, 0.3)}
        self.posture = {side: np.array(at) for side, at in self.hang.items()}
        self.moves = {side: (0.0, 1e-6, self.posture[side], self.posture[side]) for side in self.posture}

    def rotation(self, t: float) -> Array:
        """(59, 4) at t s; t must not fall."""
        made = np.tile([1.0, 0.0, 0.0, 0.0], (len(self.names), 1))
        for side, sign in (("Right", 1.0), ("Left", -1.0)):
            begin, lasts, start, end = self.moves[side]
            if t >= begin + lasts:
                goal = self.rng.uniform((-0.2, 0.2, 0.0), (1.4, 1.3, 1.9))
                lasts = (0.7 + np.abs(goal - end).max() * 0.6) / self.quick
                begin, start, end = t, end, goal
                self.moves[side] = begin, lasts, start, end
            s = min((t - begin) / lasts, 1.0)
            a, b, c = start + (end - start) * s**3 * (10 - 15 * s + 6 * s * s)
            upper = product(from_euler_xyz(0.0, sign * a, 0.0), from_euler_xyz(0.0, 0.0, sign * b))
            self._set(made, f"{side}Arm", upper)
            self._set(made, f"{side}ForeArm", from_euler_xyz(0.0, sign * c, 0.0))
        return made

    def aside(self) -> Array:
        """(59, 4): both arms stretched out sideways."""
        return np.tile([1.0, 0.0, 0.0, 0.0], (len(self.names), 1))

    def _set(self, made: Array, joint: str, q: Quaternion) -> None:
        made[self.names.index(joint)] = q


def truth(
    config: EnvelopeOptions, share: float = 1.0, without: float = 0.0, link_radius: float | None = None
) -> tuple[Kinematics, dict[tuple[int, int], str]]:
    """MuJoCo's model with capsules, which fit the T-pose, and the geoms that belong to a pair.

    The body's radii are `share` of the envelope's, less what is `without`, m; the arm's its own.
    """
    envelope, figure = config.envelope, config.figure
    nodes = figure.arms.names(config.arm)

    def shape(spec: Any) -> None:
        where = {part.start: [] for part in PARTS.values()}  # type: ignore[var-annotated]
        for name, part, radius in zip(PARTS, PARTS.values(), envelope.radii, strict=True):
            where[part.start].append((name, part, radius))
        tree = figure.tree
        at = {node.name: np.zeros(3) for node in tree.nodes}
        for i, node in enumerate(tree.nodes):
            at[node.name] = np.array(node.offset) + (at[tree.names[tree.parents[i]]] if tree.parents[i] >= 0 else 0)
        for body in spec.bodies:
            for name, part, radius in where.get(body.name, ()):
                _capsule(body, f"body/{name}", at[part.end] - at[part.start], share * (radius - without))
            if body.name in nodes[:-1]:
                after = nodes[nodes.index(body.name) + 1]
                _capsule(body, f"arm/{body.name}", at[after] - at[body.name], link_radius or envelope.link_radius)

    kinematics = Kinematics(figure, shape)
    model, pairs = kinematics.model, {}
    for pair in envelope.pairs:
        a = model.geom(f"arm/{nodes[pair.link]}").id
        pairs[a, model.geom(f"body/{envelope.segments[pair.segment]}").id] = pair.name
    return kinematics, pairs


def _capsule(body: Any, name: str, way: Array, radius: float) -> None:
    body.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=[0, 0, 0, *way], size=[radius, 0, 0])


def trial(seed: int, attack: Attack, seconds: float = 8.0) -> Outcome:
    """One wearer, one arm, from rest with hanging arms."""
    rng = np.random.default_rng(seed)
    options = {"least": 0.02, "uncertainty": 0.0, "latency": 0.03} | attack.options
    believed = BodyClearanceConfig(**options, **_thinned(attack.thin))
    wearer = Wearer(believed, rng, attack.quick)
    kinematics, pairs = truth(BodyClearanceConfig(least=0.02, uncertainty=0.0), THIN, CLOTHING, 0.03)
    command = Command(name="command", shape=(7,), unit="rad", kind=Kind.POSITION, labels=believed.arms.arms.labels)
    clearance = BodyClearance("arm.clear", believed, command)
    rotation, translation = wearer.rotation(0.0), wearer.translation
    clearance.bind({"rotation": rotation.copy(), "translation": translation})
    guard = guard_of(
        Kind.POSITION, 7, DT, lower=LOW.tolist(), upper=HIGH.tolist(), velocity=V.tolist(), acceleration=A.tolist()
    )
    applied, measured = np.zeros(7), np.zeros(7)
    guard.bind(applied, measured)
    if attack.guarded:
        guard.keep_clear(clearance, LAG, np.full(7, 0.001))
    guard.reset(measured)
    law = bound(Retreat("retreat", RetreatConfig())) if attack.retreat else None
    if law is not None:
        law.input["translation"][:], law.input["rotation"][:] = translation, rotation
        law.reset()
    queue = [np.zeros(7)] * round(attack.servo / DT)
    distance = Gap(BodyClearanceConfig(least=0.02, uncertainty=0.0))
    distance.pose(wearer.aside(), translation)
    made, goal, since, stamp = Outcome(), np.zeros(7), 0.0, -1
    frames: list[tuple[float, Array]] = []
    next_frame, touching, ends = 0.0, dict.fromkeys(pairs, False), []
    for k in range(round(seconds / DT)):
        t = k * DT
        pose = wearer.rotation(t)
        if t >= next_frame:
            frames.append((t + attack.delay, pose))
            next_frame += 1 / 60
        while frames and frames[0][0] <= t + 1e-9:
            _, seen = frames.pop(0)
            stamp = round((t + 1.0) * 1e9)
            if attack.freeze[0] <= t < attack.freeze[1]:
                continue  # a new stamp on old values
            if rng.random() >= attack.drop:
                clearance.input["rotation"][:] = seen
            else:
                stamp = clearance._stamp
        if np.abs(measured - goal).max() < 0.02 or t - since > 4.0:
            made.goals += k > 0 and bool(np.abs(measured - goal).max() < 0.02)
            goal, since = next(q for q in rng.uniform(LOW, HIGH, (500, 7)) if distance(q) > GOAL), t
        if guard.verified is not None:
            now = round((t + 1.0) * 1e9)
            guard.verified.begin(now, {"rotation": stamp, "translation": stamp}, 0.0)
        if law is not None:
            law.input["target"][:], law.input["rotation"][:] = goal, clearance.input["rotation"]
            law.applied["q"][:] = applied
            law.update(DT)
        guard.step(goal if law is None else law.output["q"], None, DT)
        made.held += (guard.verified is not None and guard.verified.held) * DT / seconds
        before = measured.copy()
        queue.append(applied.copy())
        measured[:] = queue.pop(0)
        _contacts(
            kinematics,
            pairs,
            touching,
            made,
            lambda q, pose=pose: kinematics.nodes(pose, translation, {"right": q}),
            before,
            measured,
        )  # type: ignore[misc]
        ends.append(clearance_ends(kinematics, believed))
    rate = np.diff(np.array(ends), 2, axis=0) / DT**2
    made.acceleration = float(np.linalg.norm(rate, axis=-1).max())
    return made


class Gap:
    """The arm's distance, m, from the body: the envelope's own."""

    def __init__(self, config: EnvelopeOptions) -> None:
        envelope = config.envelope
        self._config, self._motion = config, BodyMotion(config.figure, envelope.ends, 0.01)
        self._links = np.array([pair.link for pair in envelope.pairs])
        self._segments = np.array([pair.segment for pair in envelope.pairs])
        self._radii = envelope.radii[self._segments] + envelope.link_radius

    def pose(self, rotation: Array, translation: Array) -> None:
        """The body's posture from now on."""
        self._motion.take(0, rotation, translation)

    def __call__(self, q: Array) -> float:
        nodes = link_nodes(self._config.arms.arms, self._config.arm, q[None])
        axes = nearest(self._motion.ends, self._segments, nodes, self._links).distance
        return float((axes - self._radii).min())


def _thinned(factor: float) -> dict[str, Any]:
    if factor == 1.0:
        return {}
    full = BodyClearanceConfig(least=0.02, uncertainty=0.0).envelope
    return {"radii": {n: factor * r for n, r in zip(full.segments, full.radii.tolist(), strict=True)}}


def clearance_ends(kinematics: Kinematics, config: BodyClearanceConfig) -> Array:
    """(s, 2, 3) m, the ends of the segments in the carrier's frame."""
    nodes = kinematics.data.xpos[1:]
    body = kinematics.body(config.figure.arms.parent)
    return (nodes[config.envelope.ends] - kinematics.data.xpos[body]) @ kinematics.data.xmat[body].reshape(3, 3)


def _contacts(
    kinematics: Kinematics, pairs: dict[tuple[int, int], str], touching: dict[tuple[int, int], bool], made: Outcome,
    place: Callable[[Array], Array], before: Array, after: Array,
) -> None:  # fmt: skip
    """Notes what begins to touch; by how much the arm's step alone, the body held, has closed the gap."""
    gaps = []
    for q in (before, after):
        place(q)
        gaps.append({two: mujoco.mj_geomDistance(kinematics.model, kinematics.data, *two, 0.06, None) for two in pairs})
    for two in pairs:
        touches = gaps[1][two] <= 0.0
        if touches and not touching[two]:
            made.contacts.append((gaps[0][two] - gaps[1][two]) / DT)
        touching[two] = touches
