"""Independent operation behind the verified stop beside a wearer who reaches about without looking."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from helpers import blame
from helpers.blame import DT, HIGH, LAG, LOW, THIN, A, Outcome, V, Wearer, truth
from helpers.guard import guard_of
from runtime.contracts.signals import Array, Command, Kind
from runtime.control.models import ArmsModel
from runtime.control.operation.demonstration import PERIOD, TaskPath
from runtime.control.operation.replay import JointRanges, Replay, ReplayOptions
from runtime.control.operation.worn import Worn
from runtime.control.skeleton.body_clearance import BodyClearance, BodyClearanceConfig
from runtime.control.skeleton.envelope import CLOTHING

BASE = (-0.10, 0.05, 0.30)  # m, as in human-srl-task
REST = np.array([-1.0, -0.3, 0.0, -0.9, 0.0, -0.3, 0.0])
POSTURE = np.array([-1.2, -0.4, 0.0, -0.6, 0.03, -0.3, 0.0])
SUIT = 1 / 60  # s
DELAY = 0.03  # s


@dataclass
class Trial:
    """What became of one path: contacts as in `helpers.blame`, mm of the tip from the path's place, s, done."""

    contacts: Outcome = field(default_factory=Outcome)
    errors: list[float] = field(default_factory=list)
    seconds: float = 0.0
    done: bool = False
    nearest: float = np.inf

    def figures(self) -> tuple[float, float, float]:
        """Mean, 95th percentile and greatest of the errors, mm; from where the task begins."""
        e = 1e3 * np.array(self.errors)
        return float(e.mean()), float(np.quantile(e, 0.95)), float(e.max())


def path(seed: int) -> TaskPath:
    """A closed curve of 5 s in front of the wearer's right side, within the arm's reach."""
    rng = np.random.default_rng([seed, 7])
    u = np.linspace(0.0, 1.0, round(5.0 / PERIOD) + 1)
    s = 2.0 * np.pi * u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
    centre = np.array([-0.36, 0.08, 0.62]) + rng.uniform(-0.06, 0.06, 3)
    a, b = rng.uniform(-0.09, 0.09, (2, 3))
    return TaskPath(centre + np.outer(np.cos(s) - 1.0, a) + np.outer(np.sin(s), b))


def run(
    seed: int, around: str, *, guarded: bool = True, still: bool = False, most: float = 40.0, **options: float
) -> Trial:
    """One path by an arm with a servo's lag; the wearer moves both arms all the time, or not at all (`still`)."""
    rng = np.random.default_rng(seed)
    arms: dict[str, Any] = {"arms": _arms()}
    config = BodyClearanceConfig(least=0.02, uncertainty=0.0, latency=DELAY, **arms)
    wearer = Wearer(config, rng, 1.0)
    kinematics, pairs = truth(config, THIN, CLOTHING, 0.03)
    labels = config.arms.arms.labels
    command = Command(name="command", shape=(7,), unit="rad", kind=Kind.POSITION, labels=labels)
    clearance = BodyClearance("arm.clear", config, command)
    pose = wearer.rotation(0.0)
    clearance.bind({"rotation": pose.copy(), "translation": wearer.translation})
    guard = guard_of(
        Kind.POSITION, 7, DT, lower=LOW.tolist(), upper=HIGH.tolist(), velocity=V.tolist(), acceleration=A.tolist()
    )
    applied, measured = REST.copy(), REST.copy()
    guard.bind(applied, measured)
    if guarded:
        guard.keep_clear(clearance, LAG, np.full(7, 0.001))
    guard.reset(measured)
    worn = Worn(config.figure, "right", config.envelope)
    worn.see(pose, wearer.translation, 0.0)
    kept = ReplayOptions.model_validate({"around": around, **options})
    replay = Replay(path(seed), JointRanges(LOW, HIGH, V, 0.75 * A, POSTURE), kept)
    made, queue, frames = Trial(), [REST.copy()] * round(LAG / DT), list[tuple[float, Array]]()
    stamp, next_frame, last, began = -1, 0.0, applied.copy(), False
    touching, height = dict.fromkeys(pairs, False), wearer.translation[0, 1]
    for k in range(round(most / DT)):
        t = k * DT
        pose = wearer.rotation(0.0 if still else t)
        wearer.translation[0, 1] = height + 1e-4 * np.sin(t)  # a suit that repeats itself in every bit is frozen
        if t >= next_frame:
            frames.append((t + DELAY, pose))
            next_frame += SUIT
        while frames and frames[0][0] <= t + 1e-9:
            clearance.input["rotation"][:] = frames.pop(0)[1]
            stamp = round((t + 1.0) * 1e9)
        worn.see(clearance.input["rotation"], wearer.translation, DT)
        seen = worn.tip(measured)[0].copy()
        tip, J = worn.tip(applied)
        near = worn.pairs(replay.options.look, replay.options.pairs)
        v = replay.step(applied.copy(), (applied - last) / DT, tip, J, seen, near, DT)
        last = applied.copy()
        if guard.verified is not None:
            guard.verified.begin(round((t + 1.0) * 1e9), {"rotation": stamp, "translation": stamp}, 0.0)
        guard.step(applied + v * DT, v, DT)
        before = measured.copy()
        queue.append(applied.copy())
        measured[:] = queue.pop(0)
        began = began or replay.s > 0.0
        if began:
            made.errors.append(float(np.linalg.norm(replay.path.at(replay.s)[0] - worn.tip(measured)[0])))
            made.seconds += DT
        blame._contacts(
            kinematics, pairs, touching, made.contacts,
            lambda q, pose=pose: kinematics.nodes(pose, wearer.translation, {"right": q}), before, measured,
        )  # type: ignore[misc]  # fmt: skip
        if replay.done:
            made.done = True
            break
    return made


def _arms() -> ArmsModel:
    return ArmsModel(sides=("right",), base=BASE)
