"""An arm on a body for tests of independent operation: plain shapes, paths, and the law without a loop."""

from __future__ import annotations

from math import cos, sin
from typing import Any

import numpy as np

from helpers.control import bound
from helpers.skeleton import human_srl
from srl.control.operation.demonstration import PERIOD, TaskPath
from srl.control.operation.law import IndependentOperation, Mode
from srl.control.operation.options import IndependentOperationConfig
from srl.control.operation.replay import Replay, ReplayOptions
from srl.control.operation.worn import Worn
from srl.control.skeleton.envelope import Envelope
from srl.control.skeleton.kinematics import Kinematics
from srl.control.skeleton.ranges import JointRanges
from srl.runtime.contracts.rotation import product
from srl.runtime.contracts.signals import Array

LOWER = np.array([-1.6, -1.4, -1.6, -1.9, 0.0, -1.6, -2.6])
UPPER = np.array([1.0, 0.3, 1.6, 1.9, 0.1, 1.6, 2.6])
SPEED = np.array([0.8, 0.8, 0.8, 0.8, 0.08, 0.8, 0.8])
ACCELERATION = 5.0 * SPEED
START = np.array([-0.9, -0.5, 0.0, -0.9, 0.05, -0.3, 0.0])
DT = 0.01


def ranges() -> JointRanges:
    return JointRanges(LOWER, UPPER, SPEED, ACCELERATION)


def envelope(**radii: float) -> Envelope:
    """The standard envelope of the standard body, in thin clothes; radii, m, by segment."""
    figure = human_srl()
    return Envelope(figure.tree, figure.arms, "right", radii, 0.0, 0.03, ())


def posture() -> tuple[Array, Array]:
    """Rotation (k, 4) and translation (k, 3) m of the T-pose."""
    human = human_srl().human
    joints = list(human.joints)
    return np.tile([1.0, 0.0, 0.0, 0.0], (len(joints), 1)), human.offsets[joints].copy()


def circle(centre: Array, radius: float = 0.06, seconds: float = 6.0) -> TaskPath:
    """A circle in the plane across the view, begun and ended at rest."""
    u = np.linspace(0.0, 1.0, round(seconds / PERIOD) + 1)
    angle = 2.0 * np.pi * u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
    return TaskPath(centre + radius * np.stack([np.cos(angle) - 1.0, np.sin(angle), 0.0 * angle], axis=1))


class Hand:
    """The right arm of a person in the T-pose, which goes where it is told by turning shoulder and elbow."""

    def __init__(self) -> None:
        self.rotation, self.translation = posture()
        self._kinematics = Kinematics(human_srl())
        labels = human_srl().labels
        self._rows = [labels.index(name) for name in ("RightArm", "RightForeArm")]
        self._angles = np.array([1.0, 0.5, 0.8])  # rad: shoulder about y and z, elbow about y

    def bend(self, angles: Array) -> Array:
        """Takes the arm to angles (3,) rad: shoulder about y and z, elbow about y; returns the wrist's place, m."""
        y, z, elbow = angles.tolist()
        self.rotation[self._rows[0]] = product((cos(y / 2), 0.0, sin(y / 2), 0.0), (cos(z / 2), 0.0, 0.0, sin(z / 2)))
        self.rotation[self._rows[1]] = cos(elbow / 2), 0.0, sin(elbow / 2), 0.0
        nodes, tree = self._kinematics.nodes(self.rotation, self.translation, {}), human_srl().tree
        found: Array = nodes[tree.index("RightHand")] - nodes[tree.index("Spine")]
        return found

    def go(self, place: Array) -> Array:
        """Takes the wrist to a place, m in the spine's frame, as near as the arm can; returns where it is."""
        for _ in range(30):
            here = self.bend(self._angles)
            away = place - here
            if np.linalg.norm(away) < 1e-6:
                break
            J = np.stack([(self.bend(self._angles + 1e-5 * e) - here) / 1e-5 for e in np.eye(3)], axis=1)
            self._angles += J.T @ np.linalg.solve(J @ J.T + 1e-4 * np.eye(3), away)
        return self.bend(self._angles)


class Bench:
    """The replay on an arm that obeys at once."""

    def __init__(
        self, person: Hand | None = None, start: Array = START, path: TaskPath | None = None, **options: Any
    ) -> None:
        self.worn = Worn(human_srl(), "right", envelope())
        self.person = person or Hand()
        self.worn.see(self.person.rotation, self.person.translation, 0.0)
        self.q, self.v = start.copy(), np.zeros(7)
        self.tip = self.worn.tip(self.q)[0].copy()
        self.path = path or circle(self.tip)
        self.replay = Replay(self.path, ranges(), ReplayOptions(**options))
        self.errors: list[float] = []
        self.least = np.inf
        self.seconds = 0.0

    def step(self, look: float = 0.25) -> None:
        self.worn.see(self.person.rotation, self.person.translation, DT)
        tip, J = self.worn.tip(self.q)
        self.tip = tip
        pairs = self.worn.pairs(look, 12)
        self.least = min(self.least, float(pairs.distance.min(initial=np.inf)))
        self.v = self.replay.step(self.q, self.v, tip, J, tip, pairs, DT)
        self.errors.append(self.replay.error)
        self.q = self.q + DT * self.v
        self.seconds += DT

    def run(self, seconds: float) -> None:
        while self.seconds < seconds and not self.replay.done:
            self.step()


def law(**options: Any) -> IndependentOperation:
    """The law, bound, with the arm at START and the person's arm out of its way."""
    named = {
        key: dict(zip(human_srl().arms.labels, values.tolist(), strict=True))
        for key, values in (("lower", LOWER), ("upper", UPPER), ("velocity", SPEED), ("acceleration", ACCELERATION))
    }
    config = IndependentOperationConfig.model_validate({**named, "teach": True, "replay": {"keep": 0.02}, **options})
    made = bound(IndependentOperation("task", config))
    person = Hand()
    made.input["rotation"][:], made.input["translation"][:] = person.rotation, person.translation
    made.applied["q"][:] = made.input["position"][:] = START
    made.reset()
    return made


def cycle(made: IndependentOperation, person: Hand | None = None) -> Array:
    """One cycle of a guard and an arm that obey at once; the command."""
    if person is not None:
        made.input["rotation"][:] = person.rotation
    made.update(DT)
    made.applied["q"][:] = made.input["position"][:] = made.output["q"]
    return made.output["q"].copy()


def teach(made: IndependentOperation, seconds: float = 4.0) -> Array:
    """The hand shows an arc within the arm's reach (with the option `shift`); returns its places."""
    person, places = Hand(), []
    made.input["teach"][0] = 1.0
    for t in np.arange(0.0, seconds, DT):
        u = t / seconds
        s = u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
        places.append(person.bend(np.array([1.0 + 0.3 * s, 0.3 + 0.2 * np.sin(6.0 * s), 0.6])))
        cycle(made, person)
    made.input["teach"][0] = 0.0
    made.input["rotation"][:] = Hand().rotation
    while Mode(int(made.output["state"][0])) in (Mode.TEACHING, Mode.CHECKING):
        cycle(made)
    return np.array(places)


def press(made: IndependentOperation) -> None:
    made.input["press"][0] += 1.0
    cycle(made)
