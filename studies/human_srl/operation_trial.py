"""One task done by a worn arm by itself, beside a wearer who reaches about without looking, or stands still.

Profile `human-srl-task`: its law's replay commands the arm through its guard, with or without the verified stop. The
suit is late and noisy, and the servos are late and otherwise obey exactly; the arm's masses aren't simulated.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from ruamel.yaml import YAML

from srl.control.operation.demonstration import PERIOD, TaskPath
from srl.control.operation.detour import Detour
from srl.control.operation.replay import Replay, ReplayOptions
from srl.control.operation.worn import Worn
from srl.control.reach.options import MarginOptions
from srl.control.skeleton.human import human
from srl.control.skeleton.human_srl import HumanSrl
from srl.control.skeleton.options import EnvelopeOptions
from srl.control.skeleton.ranges import JointRanges
from srl.runtime.contracts.clearance import NEVER
from srl.studies.human_srl.contacts import Contact, Contacts
from srl.studies.human_srl.reaching import Reaching
from srl.studies.human_srl.setting import Setting
from srl.studies.human_srl.suit import Suit
from srl.studies.human_srl.wearers import Wearer
from srl.studies.tasks.task import Value

PROFILE: Final = "human-srl-task"
SECONDS: Final = 5.0  # s, that a path was shown in
REST: Final = np.array([-1.0, -0.3, 0.0, -0.9, 0.0, -0.3, 0.0])  # rad, m: where the profile's arm starts
_AHEAD: Final = np.array([-0.26, 0.03, 0.32])  # m, from the base to where paths are: within the arm's reach
_BEGIN: Final = 1.0  # s, of the clock at the first cycle


@dataclass
class Trial:
    """What became of one path.

    Attributes:
        contacts: of arm and body.
        errors: m, of the measured tip from the path's place, by cycle since the task began.
        progress: s, of the phase in the same cycles.
        seconds: that it took.
        done: within the time.
        blocked: share of the cycles in which a distance let the arm go neither along the path nor around.
    """

    contacts: list[Contact] = field(default_factory=list)
    errors: list[float] = field(default_factory=list)
    progress: list[float] = field(default_factory=list)
    seconds: float = 0.0
    done: bool = False
    blocked: float = 0.0

    @property
    def blamed(self) -> int:
        """Contacts that the arm made."""
        return sum(contact.blamed for contact in self.contacts)

    def metrics(self) -> tuple[float, float, float]:
        """Mean, 95th percentile and greatest of the errors, mm; NaN if the task never began.

        Each part of the path counts alike in the first two, however long the arm waits there.
        """
        e, weight = 1e3 * np.array(self.errors), np.array(self.progress)
        if not weight.sum() > 0.0:
            return float("nan"), float("nan"), float("nan")
        order = np.argsort(e)
        share = np.cumsum(weight[order]) / weight.sum()
        p95 = e[order][min(int(np.searchsorted(share, 0.95)), len(e) - 1)]
        return float(np.average(e, weights=weight)), float(p95), float(e.max())


def path(seed: int, base: Sequence[float]) -> TaskPath:
    """A closed curve in front of the wearer's right side; `base`: m, of the arm."""
    rng = np.random.default_rng([seed, 7])
    u = np.linspace(0.0, 1.0, round(SECONDS / PERIOD) + 1)
    s = 2.0 * np.pi * u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
    centre = np.array(base) + _AHEAD + rng.uniform(-0.06, 0.06, 3)
    a, b = rng.uniform(-0.09, 0.09, (2, 3))
    return TaskPath(centre + np.outer(np.cos(s) - 1.0, a) + np.outer(np.sin(s), b))


@dataclass(frozen=True)
class Case:
    """What is done, and what differs from the profile.

    Attributes:
        guarded: by the verified stop.
        still: the wearer doesn't move.
        most: s, after which the task is given up.
        pace: factor on the wearer's pace.
        base: m, of the arm.
        lag: s, of the servos; the guard is told.
        clear: options of `body-clearance`.
        replay: options of the law's replay.
    """

    guarded: bool = True
    still: bool = False
    most: float = 60.0
    pace: float = 1.0
    base: Sequence[float] | None = None
    lag: float | None = None
    clear: Mapping[str, Any] = field(default_factory=dict)
    replay: Mapping[str, Any] = field(default_factory=dict)


def run(text: str, who: Wearer, case: Case, seed: int) -> Trial:
    """Does one path. `text`: the profile's; `seed`: of the path, of how the wearer moves, and of the suit's noise."""
    setting = Setting(text, base=case.base, lag=case.lag)
    dt, options = setting.dt, EnvelopeOptions(arms=setting.arms)
    figure = HumanSrl(human(who.scale), setting.arms.arms)
    wearer = Reaching(figure.human, np.random.default_rng([seed, 0]), replace(who, pace=case.pace * who.pace))
    contacts = Contacts(figure, options.arm, options.envelope, who)
    pose, translation = wearer.rotation(0.0), wearer.translation
    clearance = setting.clearance(**case.clear)
    clearance.bind({"rotation": pose.copy(), "translation": translation.copy()})
    applied, measured = REST.copy(), REST.copy()
    guard = setting.guard(applied, measured, clearance if case.guarded else None)
    suit = Suit(setting.frame, setting.delay, np.random.default_rng([seed, 2]))
    worn = Worn(options.figure, options.arm, options.envelope)
    law, detour = _law(text, setting, seed, case, worn)
    worn.see(pose, translation, 0.0)
    servos, stamp, last, frame, blocked = deque([REST.copy()] * round(setting.lag / dt)), NEVER, REST.copy(), pose, 0
    made = Trial()
    for k in range(round(case.most / dt)):
        t = k * dt
        now = round((_BEGIN + t) * 1e9)
        pose = wearer.rotation(0.0 if case.still else t)
        if (newest := suit.frame(t, pose)) is not None:
            stamp, frame = now, newest
            clearance.input["rotation"][:] = frame
        worn.see(frame, translation, dt)
        if detour is not None:
            detour.see(frame, translation, dt)
        seen = worn.tip(measured)[0].copy()
        tip, J = worn.tip(applied)
        phase, near = law.s, worn.pairs(law.options.look, law.options.pairs)
        before = (applied - last) / dt
        v = None if detour is None else detour.step(applied.copy(), before, law, dt)
        if v is None:
            v = law.step(applied.copy(), before, tip, J, seen, near, dt)
        else:
            law.hold(tip)
        last = applied.copy()
        blocked += law.blocked
        if guard.verified is not None:
            guard.verified.begin(now, {"rotation": stamp, "translation": stamp}, 0.0)
        guard.step(applied + v * dt, v, dt)
        old = measured.copy()
        servos.append(applied.copy())
        measured[:] = servos.popleft()
        if made.errors or law.s > 0.0:
            made.errors.append(float(np.linalg.norm(law.path.at(law.s)[0] - worn.tip(measured)[0])))
            made.progress.append(law.s - phase)
            made.seconds += dt
        contacts.step(pose, translation, old, measured, dt)
        if law.done:
            made.done = True
            break
    made.contacts, made.blocked = contacts.found, blocked / (k + 1)
    return made


def _law(text: str, setting: Setting, seed: int, case: Case, worn: Worn) -> tuple[Replay, Detour | None]:
    """The replay with the profile's options and those of the case, and its planned ways."""
    entries = YAML(typ="safe", pure=True).load(text)["controllers"]
    (entry,) = (one for one in entries if one["use"] == "independent-operation")
    names = ("lower", "upper", "velocity", "acceleration", "posture")
    limits = [np.array([entry[name][label] for label in setting.labels]) for name in names]
    options = ReplayOptions.model_validate({**entry.get("replay", {}), **case.replay})
    replay = Replay(path(seed, setting.arms.base), JointRanges(*limits), options)
    if options.around != "plan":
        return replay, None
    given = {name: entry[name] for name in MarginOptions.model_fields if name in entry}
    return replay, Detour(MarginOptions(**{**given, "arms": setting.arms}), worn, options.keep, options.plan_after)


def trial(text: str, parameters: dict[str, Any], seed: int) -> Mapping[str, Value]:
    """One path as a task.

    Args:
        text: the profile's.
        parameters: `wearer`, of `Wearer` by name; `case`, of `Case` by name.
        seed: as in `run`. Trials of one seed and wearer have the same path and motion.
    Returns:
        mean, p95, most: mm, as in `Trial.metrics`; taken: s; done; contacts, blamed: how many; fastest: m/s, at
        which the arm closed a gap; blocked: share.
    """
    made = run(text, Wearer(**parameters["wearer"]), Case(**parameters["case"]), seed)
    mean, p95, most = made.metrics()
    return {
        "mean": mean, "p95": p95, "most": most, "taken": made.seconds, "done": made.done,
        "contacts": len(made.contacts), "blamed": made.blamed, "blocked": made.blocked,
        "fastest": max((contact.speed for contact in made.contacts), default=0.0),
    }  # fmt: skip
