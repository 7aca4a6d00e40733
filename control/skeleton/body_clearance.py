"""The clearance `body-clearance`: keeps a worn arm clear of its wearer, whose motion a suit measures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import isinf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from srl.control.shared.approach import Separation, is_clear, margins, reserve
from srl.control.skeleton.body_motion import BodyMotion
from srl.control.skeleton.capsules import Nearest, nearest
from srl.control.skeleton.envelope import reaches
from srl.control.skeleton.joint_age import JointAge
from srl.control.skeleton.levers import Way
from srl.control.skeleton.options import EnvelopeOptions
from srl.control.skeleton.other_arm import Limb, OtherArm
from srl.runtime.contracts.clearance import NEVER, Braking, Clearance, ClearanceConfig
from srl.runtime.contracts.errors import WiringError
from srl.runtime.contracts.signals import Array, Command, Signal
from srl.runtime.contracts.terms import POINT, QUATERNION

_FASTER = 0.05  # m/s of an undeclared noise, from which it is remarked


class Seen(NamedTuple):
    """What is seen of k pairs in m samples.

    Attributes:
        found: the nearest points of their axes.
        distance: (m, k) m, of the capsules.
        height, speed: (m, k, 2), H_je and w_je of `srl.control.shared.approach`.
    """

    found: Nearest
    distance: Array
    height: Array
    speed: Array


class BodyClearanceConfig(EnvelopeOptions, ClearanceConfig):
    """Options of `body-clearance`."""

    least: float = Field(ge=0.005, lt=1, description="m, C, that is always kept: 0.02 in simulation, more on a person")
    uncertainty: float = Field(
        ge=0, lt=1, description="m, Z_d, by which a segment may be beside where the suit has it; 0.05 for 5 degrees"
    )
    noise: float | None = Field(
        None, ge=0, lt=1, description="m, by which the error of a segment's place may change within `span`; "
        "null: 2 * uncertainty",
    )  # fmt: skip
    latency: float = Field(0.04, ge=0, lt=1, description="s, from a pose to its sample's stamp")
    acceleration: float = Field(1.0, ge=0.5, le=10, description="factor on the segments' a_e")
    span: float = Field(0.05, ge=0.01, lt=0.5, description="s, over which a segment's velocity is a mean")
    repeat: float = Field(
        0.0, ge=0, le=0.5, description="s for which a sample that repeats the last in every bit is taken for new"
    )
    max_age: float = Field(
        0.25, gt=0, le=0.5, description="s, of the body's pose, latency included; an older one is none"
    )
    creep: float = Field(0.02, ge=0, le=0.1, description="m/s, at which an arm that is too near may leave")


class BodyClearance(Clearance):
    """Compares all relevant pairs of links and segments along the braking motion (`srl.control.shared.approach`).

    Inputs: `rotation` (59, 4), `translation` (59, 3) m: the suit's joints in their parents. All is computed in the
    frame of the node that carries the arms, on which their base is rigid but for what straps give: `base_shift`,
    `base_turn`. The age of the pose is the time since its stamp, or since it last changed where a suit repeats
    itself, and `latency`. A segment that a hanging joint moves stays where it was seen last, and gets older by itself
    (`JointAge`). The other arms that hang on the same node and have such a clearance are compared, too (`OtherArm`).
    """

    Config = BodyClearanceConfig
    summary = "a worn arm keeps clear of its wearer's body, which a suit measures"

    def __init__(self, place: str, config: BodyClearanceConfig, command: Command) -> None:
        super().__init__(place, config, command)
        self.options = options = config
        arms, envelope, labels = config.arms.arms, config.envelope, command.labels
        if sorted(labels) != sorted(arms.labels):
            problem = f"the command has {', '.join(labels)}, the arms {', '.join(arms.labels)}"
            raise WiringError(place, problem, "Give the device's joints the names of the arms'")
        if command.slides is not None and set(command.slides) != set(arms.slides):
            odd = min(set(command.slides) ^ set(arms.slides))
            here, there = ("slides", "turns") if odd in arms.slides else ("turns", "slides")
            problem = f"{odd} {here} in the arms and {there} in the device: one would be in m, the other in rad"
            remedy = "Say it at the device (`m_per_rad` of a Dynamixel motor that slides), or in the arms' `slides`"
            raise WiringError(place, problem, remedy)
        joints = config.figure.labels
        k = len(joints)
        self.inputs = (
            Signal(name="rotation", shape=(k, 4), unit="1", labels=joints, components=(QUATERNION,)),
            Signal(name="translation", shape=(k, 3), unit="m", labels=joints, components=(POINT,)),
        )
        self._arms, self._envelope = arms, envelope
        self.limb = (arms, options.arm)
        self._order = np.array([labels.index(name) for name in arms.labels])  # from the command's order to the arm's
        stroke = np.full(arms.n, options.stroke)
        self._by_link = by_link = reaches(arms, options.arm, -stroke, stroke)
        self._links = np.array([pair.link for pair in envelope.pairs])
        self._segments = np.array([pair.segment for pair in envelope.pairs])
        self._all = np.arange(len(envelope.pairs))
        self.reach = np.empty(arms.n)
        self.reach[self._order] = by_link.max(axis=1)
        self.stroke[self._order] = [options.stroke if joint.slides else np.inf for joint in arms.joints]
        self.creep = options.creep
        self._radii = envelope.radii[self._segments] + envelope.link_radius
        self._a_e = options.acceleration * envelope.acceleration[self._segments]
        self._noise = 2.0 * options.uncertainty if options.noise is None else options.noise
        self._needed = Separation(self._a_e, options.least, options.uncertainty + options.beside[self._links])
        self._motion = BodyMotion(config.figure, envelope.ends, options.span)
        self._joints = JointAge(config.figure, envelope.ends, options.repeat)
        # As each segment was seen last with all its joints: ends (m), their velocity (m/s), the window (s), when (ns).
        s = len(envelope.segments)
        self._ends, self._velocity, self._window = np.zeros((s, 2, 3)), np.zeros((s, 2, 3)), np.full(s, np.inf)
        self._pace = np.zeros((s, 2))  # m/s, of the ends
        self._seen_at = np.full(s, NEVER, np.int64)
        self._moved_at = np.full(s, NEVER, np.int64)  # ns, of the velocity
        self._compared = np.unique(self._segments)
        self._last = b""
        self._changed = self._stamp = NEVER
        self._age, self._problem = 0.0, "no pose of the body yet"
        self._ages: Array = np.zeros(len(envelope.pairs))  # s, of the segments
        self._swing = np.full((2, len(envelope.pairs)), np.inf)  # m/s
        self._worst = ""
        self._distance = float("nan")
        self._first: tuple[bytes, Seen] | None = None  # the arm's nodes, and what is seen there in this cycle
        self.body = Limb(
            arms,
            options.arm,
            self._order,
            by_link,
            envelope.links,
            envelope.link_radius,
            options.uncertainty + float(options.beside.max()),
        )
        self._others: list[OtherArm] = []

    def meet(self, others: Iterable[Clearance]) -> None:
        unmet, unseen = [], {*self._arms.sides} - {self.options.arm}
        for other in others:
            if not isinstance(other, BodyClearance) or other.limb == self.limb:
                continue
            unseen.discard(other.options.arm)
            if other.body.arms.parent != self._arms.parent:
                unmet.append(f"the arm of {other.place} hangs on another node of the body: the two aren't compared")
                continue
            self._others.append(OtherArm(self.body, other.body, other, self.options.least))
            other.watched = True
        unmet += [f"the {side} arm has no clearance of its own: it isn't compared" for side in sorted(unseen)]
        self.unmet = tuple(unmet)

    def begin(self, now: int, stamps: Mapping[str, int]) -> bool:
        self._first = None
        stamp = min(stamps.values())
        rotation, translation = self.input["rotation"], self.input["translation"]
        if stamp == NEVER:
            return self._unusable("the body isn't seen")
        if problem := self._motion.trouble(rotation, translation):
            return self._unusable(problem)
        options, motion = self.options, self._motion
        if stamp != self._stamp:
            values = rotation.tobytes() + translation.tobytes()
            if values != self._last:
                self._last, self._changed = values, stamp
                self._take(stamp, rotation, translation)
            elif stamp - self._changed <= options.repeat * 1e9:
                self._take(stamp, rotation, translation)
            self._stamp = stamp
        since = self._changed if stamp - self._changed > options.repeat * 1e9 else stamp
        self._age = max(now - since, 0) * 1e-9 + options.latency
        if self._age > options.max_age:
            return self._unusable(f"the body's pose is {self._age:.2f} s old")
        if isinf(motion.window):
            self._problem = "the body's pose has only just come"
            return False
        ages = np.maximum(self._age, np.maximum(now - self._seen_at, 0) * 1e-9 + options.latency)
        oldest = int(self._compared[ages[self._compared].argmax()])
        if ages[oldest] > options.max_age:
            self._problem = f"{self._joints.name(oldest)} of the body's pose hangs"
            return False
        self._ages = ages[self._segments]
        self._problem = ""
        return True

    def _take(self, stamp: int, rotation: Array, translation: Array) -> None:
        motion, joints = self._motion, self._joints
        motion.take(stamp, rotation, translation)
        known = not isinf(motion.window)
        joints.take(stamp, rotation, stamp - round(motion.window * 1e9) if known else stamp)
        if known:
            fresh = joints.fresh
            self._ends[fresh] = motion.ends[fresh]
            # While a joint repeats itself its segment goes on as before: nobody knows that it stands still.
            moved = fresh & (joints.moved | np.isinf(self._window))
            self._velocity[moved], self._window[moved] = motion.velocity[moved], motion.window
            self._pace[moved] = np.linalg.norm(motion.velocity[moved], axis=-1)
            self._moved_at[moved] = stamp
            self._seen_at = np.where(fresh, stamp, np.minimum(self._seen_at, joints.oldest))
            # A point's velocity is within this of its mean as it was seen last, and the errors' change is in it.
            since = self._window / 2 + np.maximum(self._seen_at - self._moved_at, 0) * 1e-9
            self._swing[:] = self._a_e.T * since[self._segments] + self._noise / self.options.span

    def clear(self, motion: Braking) -> bool:
        self._problem = ""
        way = self.way(motion)
        clear = self._clear_of_body(way)
        for other in self._others:
            clear &= self._clear_of(other, way)
        return clear

    def way(self, motion: Braking) -> Way:
        """The motion of this arm, link by link."""
        return Way(self._arms, self.options.arm, self._order, self._by_link, motion)

    def _clear_of_body(self, way: Way) -> bool:
        # Most pairs are so far apart that the whole way wouldn't do, judged from where the limb is now.
        first, needed, links = self._started(way.nodes[:1]), self._needed, self._links
        travel, slack = way.travel.take(links, axis=1), way.slack.take(links)
        bound = reserve(first.height[0], first.speed[0], travel, float(way.until[-1]), self._ages, slack, needed)
        near = np.flatnonzero(~(bound >= 0.0))  # what isn't a number isn't clear
        clear = True
        if near.size:
            seen = self._seen(way.nodes, near)
            needed = self._needed_of(near)
            age, travel, slack = self._ages.take(near), travel.take(near, axis=1), slack.take(near)
            margin = margins(seen.height, seen.speed, travel, way.until, age, slack, needed)
            close = np.flatnonzero(~(margin >= 0.0).all(axis=0))  # a closer look costs more
            limit = np.zeros(near.size)
            if close.size:
                margin[:, close], limit[close] = self._close(way, seen, near, close, margin[:, close])
            bound[near] = margin.min(axis=0)  # of the others it stays a bound
            clear = is_clear(margin, seen.distance, limit, self.creep)
        worst = int(bound.argmin())
        self.margin, self._distance = float(bound[worst]), float(first.distance[0, worst])
        self._worst = self._envelope.pairs[worst].name
        return clear

    def _close(
        self, way: Way, seen: Seen, near: NDArray[np.intp], close: NDArray[np.intp], margin: Array
    ) -> tuple[Array, Array]:
        """Margins by the posture's own levers, (m - 1, k), and by how much the motion may close, (k,) m/s.

        Args:
            way: the motion.
            seen: of the pairs `near`, in all samples.
            close: which of these are meant.
            margin: theirs, by the farthest reach.
        """
        pairs = near.take(close)
        found = Nearest(*(each.take(close, axis=-1) for each in seen.found))
        height, speed = seen.height.take(close, axis=1), seen.speed.take(close, axis=1)
        links, age, needed = self._links.take(pairs), self._ages.take(pairs), self._needed_of(pairs)
        levers = way.levers(found, links)
        by_levers, gap = way.close(levers, height, speed, links, age, needed)
        margin = np.maximum(margin, by_levers)
        limit = np.zeros(len(pairs))
        left = np.flatnonzero(~(margin >= 0.0).all(axis=0))
        if left.size:
            pairs = pairs.take(left)
            t = way.until[1:, None] + age.take(left)
            ends = self._pace.take(self._segments.take(pairs), axis=0) + self._swing.take(pairs, axis=1).T
            moved = ends * t[..., None] + 0.5 * self._a_e.take(pairs, axis=0) * (t * t)[..., None]
            radii = self._radii.take(pairs)
            limit[left] = way.closing(
                levers.take(left), links.take(left), gap.take(left, axis=1) + radii, found.distance.take(left, axis=1),
                moved.max(axis=-1) + np.take(self._needed.uncertainty, pairs), radii + self.options.least,
            )  # fmt: skip
            # A base that is turned turns the arm's velocities, too.
            limit[left] += self.options.base_turn * way.speed.take(links.take(left))
        return margin, limit

    def _needed_of(self, pairs: NDArray[np.intp]) -> Separation:
        needed = self._needed
        return Separation(self._a_e.take(pairs, axis=0), needed.least, np.take(needed.uncertainty, pairs))

    def _clear_of(self, other: OtherArm, way: Way) -> bool:
        judged = other.judge(way)
        if judged is None:
            self.margin, self._problem = float("nan"), "nobody knows where the other arm is"
            return False
        least = judged.margin.min(axis=0)
        worst = int(least.argmin())
        if not least[worst] >= self.margin:
            self.margin, self._distance = float(least[worst]), float(judged.distance[0, worst])
            self._worst = other.name(worst)
        return is_clear(judged.margin, judged.distance, judged.closing, self.creep)

    def _started(self, nodes: Array) -> Seen:
        """All pairs where the limb is now. What the guard tries within a cycle all begins there."""
        place = nodes.tobytes()
        if self._first is None or self._first[0] != place:
            self._first = place, self._seen(nodes, self._all)
        return self._first[1]

    def _seen(self, nodes: Array, pairs: NDArray[np.intp]) -> Seen:
        """These pairs, with the arm's nodes (m, n + 2, 3) in m samples."""
        segments = self._segments.take(pairs)
        found = nearest(self._ends, segments, nodes, self._links.take(pairs))
        distance = found.distance - self._radii.take(pairs)
        height = np.empty((2, *distance.shape))
        # Over its axis' nearest point the limb is as high as it is distant; along the axis the height is linear.
        np.add(distance, found.on_segment * found.along, out=height[0])
        np.subtract(height[0], found.along, out=height[1])
        velocity = self._velocity.transpose(1, 2, 0).take(segments, axis=2)[:, :, None]
        speed = np.maximum(np.add.reduce(velocity * found.normal, axis=1), 0.0)
        speed += self._swing.take(pairs, axis=1)[:, None]
        return Seen(found, distance, height.transpose(1, 2, 0), speed.transpose(1, 2, 0))

    def why(self) -> str:
        if self._problem:
            return self._problem
        return f"{self._worst} is {self._distance:.3f} m apart, {-self.margin:.3f} m less than needed"

    def remarks(self) -> list[str]:
        faster = self._noise / self.options.span
        unknown = faster > _FASTER and self.options.noise is None
        return (
            self._envelope.remarks()
            + [f"`noise` isn't declared: each segment may come {faster:.2g} m/s faster than it is seen"] * unknown
        ) + [f"compared with the arm of {other.place}: {len(other)} pairs of links" for other in self._others]

    def _unusable(self, problem: str) -> bool:
        self._problem = problem
        self._motion.forget()  # but not what it was: a suit that repeats it is as old as before
        return False
