"""One trial of a worn arm beside a person who reaches about without looking: contacts, and goals that it reached.

The profile's clearance and guard run in simulated time, with a suit that is late and noisy and servos that are late.
The arm's masses aren't simulated: without the clearance it passes through the body, so its goals are a free arm's.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import radians
from typing import Any, Final

import numpy as np

from srl.control.reach.law import Reach, ReachConfig
from srl.control.skeleton.human import human
from srl.control.skeleton.human_srl import HumanSrl
from srl.control.skeleton.kinematics import Kinematics
from srl.control.skeleton.options import EnvelopeOptions
from srl.runtime.contracts.clearance import NEVER
from srl.runtime.contracts.signals import Array
from srl.studies.human_srl.comfort import Comfort
from srl.studies.human_srl.contacts import Contacts
from srl.studies.human_srl.gap import Gap, carried
from srl.studies.human_srl.reaching import Reaching
from srl.studies.human_srl.setting import Setting
from srl.studies.human_srl.suit import Suit, bias
from srl.studies.human_srl.wearers import Wearer
from srl.studies.tasks.task import Value

SECONDS: Final = 12.0
TIMEOUT: Final = 6.0  # s, then a goal is given up
NEAR: Final = 0.02  # rad or m, of every joint from a goal that is reached
FREE: Final = 0.06  # m, of a goal from the person with the arms stretched out sideways
_BEGIN: Final = 1.0  # s, of the clock at the first cycle
_TRIES: Final = 500


@dataclass(frozen=True)
class Attack:
    """What is done, and what is different from what the guard is told.

    Attributes:
        guarded: the arm has its clearance.
        planned: the law `reach` leads to the goals.
        delay: s, from a pose to its frame; None: as the profile's suit.
        drop: share of the frames that are lost.
        freeze: (from, to) s in which the suit repeats its frame with new stamps.
        pace: factor on the person's pace.
        lag: s, of the servos, as the guard is told; None: as the profile's.
        tracking: rad or m, by which joints may be beside their commands, as the guard is told; None: as the profile's.
        servo: factor on the lag, which the guard isn't told.
        assumed: factor on the envelope's radii.
        clear: options of the clearance that differ from the profile's.
        base: m, the arm's, in the frame of the node that carries it; None: as the profile's.
        bias: degrees rms, by which the suit has each joint off all the time.
        sway, march: degrees, of the person's trunk and thighs, as in `Reaching`.
        away: the arm starts at a random free posture, not at zero.
        timeout: s, after which a goal is given up.
    """

    guarded: bool = True
    planned: bool = False
    delay: float | None = None
    drop: float = 0.0
    freeze: tuple[float, float] = (0.0, 0.0)
    pace: float = 1.0
    lag: float | None = None
    tracking: float | None = None
    servo: float = 1.0
    assumed: float = 1.0
    clear: Mapping[str, float] | None = None
    base: tuple[float, float, float] | None = None
    bias: float = 0.0
    sway: float = 0.0
    march: float = 0.0
    away: bool = False
    timeout: float = TIMEOUT


def trial(text: str, parameters: dict[str, Any], seed: int) -> Mapping[str, Value]:
    """One motion of one wearer.

    Args:
        text: the profile's.
        parameters: `wearer`, of `Wearer` by name; `attack`, of `Attack` by name; `seconds`, how long.
        seed: of the motion, the goals and the suit's noise. Trials of one seed and wearer have the same motion.

    Returns:
        contacts, rest, blamed: of the pairs that the clearance compares: all, at an arm at rest, by the arm.
        left_out, blamed_left_out: of the others. pushed: contacts, of both and those that were there at the beginning,
        into which the arm went at over `BLAME` in any step. fastest: m/s, of all blamed. tried, reached: goals that
        were reached or given up; times: JSON, s of each, null if given up. held: share of the cycles. acceleration:
        m/s^2, the person's highest, and beyond: the highest over what the clearance takes for possible.
    """
    who = Wearer(**parameters["wearer"])
    attack = Attack(**parameters["attack"])
    setting = Setting(text, base=attack.base, lag=attack.lag, tracking=attack.tracking)
    return Run(setting, replace(who, pace=who.pace * attack.pace), attack, seed).run(parameters["seconds"])


class Run:
    """A trial that is taken apart: `run` it once, then look at `contacts` and `goals`."""

    def __init__(self, setting: Setting, who: Wearer, attack: Attack, seed: int) -> None:
        motion, goals, suit, start = (np.random.default_rng([seed, k]) for k in range(4))
        self.setting, self.attack, n = setting, attack, len(setting.labels)
        options = EnvelopeOptions(arms=setting.arms)
        figure = HumanSrl(human(who.scale), setting.arms.arms)
        self.reaching = Reaching(figure.human, motion, who, radians(attack.sway), radians(attack.march))
        self.contacts = Contacts(figure, options.arm, options.envelope, who)
        self.goals = _Goals(setting, options, self.reaching, goals, attack.timeout)
        delay = setting.delay if attack.delay is None else attack.delay
        off = bias(len(self.reaching.names), attack.bias, start) if attack.bias else None
        self.suit = Suit(setting.frame, delay, suit, attack.drop, attack.freeze, off)
        self.ends = _Ends(options, self.contacts.kinematics)
        pose, translation = self.reaching.rotation(0.0), self.reaching.translation
        self.clearance = setting.clearance(**{**_assumed(options, attack.assumed), **(attack.clear or {})})
        self.clearance.bind({"rotation": pose.copy(), "translation": translation.copy()})
        posture = _Goals(setting, options, self.reaching, start).free() if attack.away else np.zeros(n)
        self.applied, self.measured = posture.copy(), posture.copy()
        self.guard = setting.guard(self.applied, self.measured, self.clearance if attack.guarded else None)
        self.law = self._law(pose, translation) if attack.planned else None
        self.comfort = Comfort(self.clearance, self.guard, setting)

    def run(self, seconds: float) -> Mapping[str, Value]:
        dt, measured, translation = self.setting.dt, self.measured, self.reaching.translation
        servos = deque([measured.copy()] * round(self.attack.servo * self.setting.lag / dt))
        held, cycles, stamp = 0, round(seconds / dt), NEVER
        for k in range(cycles):
            t = k * dt
            now = round((_BEGIN + t) * 1e9)
            pose = self.reaching.rotation(t)
            if (frame := self.suit.frame(t, pose)) is not None:
                stamp, self.clearance.input["rotation"][:] = now, frame
            if self.guard.verified is not None:
                self.guard.verified.begin(now, {"rotation": stamp, "translation": stamp}, 0.0)
            goal = self.goals.at(t, measured)
            self.guard.step(*self._wanted(goal), dt)
            self.comfort.take(k, goal, len(self.goals.times), measured)
            held += self.guard.verified is not None and self.guard.verified.held
            before = measured.copy()
            servos.append(self.applied.copy())
            measured[:] = servos.popleft()
            self.contacts.step(pose, translation, before, measured, dt)
            self.ends.take()
        return self._row(held / cycles)

    def _row(self, held: float) -> Mapping[str, Value]:
        found = [contact for contact in self.contacts.found if contact.compared]
        others = [contact for contact in self.contacts.found if not contact.compared]
        highest, beyond = self.ends.accelerations(self.setting.dt)
        times = self.goals.times
        return {
            "contacts": len(found),
            "rest": sum(contact.rest for contact in found),
            "blamed": sum(contact.blamed for contact in found),
            "left_out": len(others),
            "blamed_left_out": sum(contact.blamed for contact in others),
            "pushed": self.contacts.pushed,
            "fastest": max((contact.speed for contact in self.contacts.blamed), default=0.0),
            "who": json.dumps([contact.pair for contact in self.contacts.blamed]),
            "tried": len(times),
            "reached": sum(time is not None for time in times),
            "times": json.dumps(times),
            "held": held,
            "acceleration": highest,
            "beyond": beyond,
            "open": json.dumps(self.comfort.open(len(times))),
            "stands": self.comfort.stands,
            "jerk": self.comfort.jerk(),
        }

    def _law(self, pose: Array, translation: Array) -> Reach:
        setting = self.setting
        limits = {
            key: dict(zip(setting.labels, getattr(setting, key).tolist(), strict=True))
            for key in ("lower", "upper", "velocity", "acceleration")
        }
        law = Reach("reach", ReachConfig(arms=setting.arms, **limits))
        inputs = {signal.name: np.zeros(signal.shape) for signal in law.inputs}
        outputs = {signal.name: np.zeros(signal.shape) for signal in law.outputs}
        law.bind(inputs, outputs, {"q": self.applied}, {}, {})
        law.input["target"][:] = np.nan
        law.input["rotation"][:], law.input["translation"][:] = pose, translation
        law.reset()
        return law

    def _wanted(self, goal: Array) -> tuple[Array, Array | None]:
        """Where the arm shall go, and how fast."""
        law = self.law
        if law is None:
            return goal, None
        law.input["target"][:], law.input["rotation"][:] = goal, self.clearance.input["rotation"]
        law.update(self.setting.dt)
        return law.output["q"], law.output["q_velocity"]


class _Goals:
    """Random goals that are free while the person's arms are out of the way.

    Attributes:
        times: s from a goal to its being reached; None: it was given up.
    """

    def __init__(
        self, setting: Setting, options: EnvelopeOptions, reaching: Reaching, rng: np.random.Generator,
        timeout: float = TIMEOUT,
    ) -> None:  # fmt: skip
        self._setting, self._rng, self._timeout = setting, rng, timeout
        self._gap = Gap(options)
        self._gap.pose(reaching.aside(), reaching.translation)
        self._goal: Array = np.zeros(len(setting.labels))
        self._since: float | None = None
        self.times: list[float | None] = []

    def at(self, t: float, measured: Array) -> Array:
        """(n,) the goal at t s, with the arm where it is measured."""
        if self._since is not None:
            there, waited = bool(np.abs(measured - self._goal).max() < NEAR), t - self._since
            if not there and waited < self._timeout:
                return self._goal
            self.times.append(round(waited, 6) if there else None)
        self._goal, self._since = self.free(), t
        return self._goal

    def free(self) -> Array:
        """(n,) the next one. Raises ValueError."""
        for q in self._rng.uniform(self._setting.lower, self._setting.upper, (_TRIES, len(self._goal))):
            if self._gap(q) > FREE:
                return np.asarray(q)
        raise ValueError(f"no free goal in {_TRIES}")


class _Ends:
    """The ends of the person's segments, in the frame of the node that carries the arm, cycle by cycle."""

    def __init__(self, options: EnvelopeOptions, kinematics: Kinematics) -> None:
        self._options, self._kinematics = options, kinematics
        self._found: list[Array] = []

    def take(self) -> None:
        """The next cycle."""
        self._found.append(carried(self._kinematics, self._options))

    def accelerations(self, dt: float) -> tuple[float, float]:
        """m/s^2, the highest of all ends; and the highest as a share of what the envelope says of each end."""
        size = np.linalg.norm(np.diff(np.array(self._found), 2, axis=0), axis=-1) / dt**2
        return float(size.max()), float((size / self._options.envelope.acceleration).max())


def _assumed(options: EnvelopeOptions, factor: float) -> dict[str, Any]:
    if factor == 1.0:
        return {}
    envelope = options.envelope
    return {"radii": {n: factor * r for n, r in zip(envelope.segments, envelope.radii.tolist(), strict=True)}}
