"""The law `intention` on a simulated person whom its recogniser has never seen.

The recogniser is made of all other people. The law then runs online, 20 times a second, on a session of this person's,
in which the suit sits in its own way, and on motion that has nothing to do with the actions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from math import nan
from pathlib import Path
from typing import Any, Final

import numpy as np

from srl.control.intention.features import FRAMES
from srl.control.intention.law import Intention
from srl.control.intention.training import BACKGROUND, Held, Recogniser, Thresholds, Trial, train
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.wearer import Rest, Walk
from srl.sim.parts.body.motion import Recorded
from srl.sim.wearer.people import MISFIT, subject
from srl.sim.wearer.performer import Performer, measured
from srl.studies.intention import people
from srl.studies.intention.accuracy import law_of
from srl.studies.intention.people import ACTIONS, DT, JOINTS, SKELETON, Session, onsets, unrelated
from srl.studies.tasks.task import Value

UNRELATED: Final = ("stand", "walk", "stop-and-go", "reach")
_STOP_AND_GO: Final = 4.0  # s, of standing and of walking, in turn
_EVERYDAY: Final = 185.0  # s, as a calibration asks for
_NOISE: Final = 0.002  # rad, of the suit, as in its fake
_AFTER: Final = 0.6  # s after an action's end in which it may still hold


@dataclass(frozen=True)
class Played:
    """The law's outputs over a motion, by sample: k actions.

    Attributes:
        action: (T, k) the one that holds.
        posterior: (T, k). confidence, rejected: (T,).
    """

    action: Array
    posterior: Array
    confidence: Array
    rejected: Array


def play(law: Intention, rotation: Array, translation: Array) -> Played:
    """Runs the law over samples (T, n, 4) and (T, n, 3) m at the recogniser's rate, from a reset at the beginning."""
    law.reset()
    rows: dict[str, list[Array]] = {name: [] for name in ("action", "posterior", "confidence", "rejected")}
    for q, p in zip(rotation, translation, strict=True):
        law.input["rotation"][:], law.input["translation"][:] = q, p
        law.update(DT)
        for name, own in rows.items():
            own.append(law.output[name].copy())
    made = {name: np.array(own) for name, own in rows.items()}
    return Played(made["action"], made["posterior"], made["confidence"][:, 0], made["rejected"][:, 0])


def made_of(
    numbers: Sequence[int], repetitions: int, thresholds: Thresholds, without: str = "",
    everyday: tuple[Trial, ...] = (),
) -> tuple[Recogniser, Held]:  # fmt: skip
    """A recogniser of these people, each of whom is held out in turn for its limits.

    Args:
        numbers: of the people.
        repetitions: of each action.
        thresholds: of the recogniser.
        without: an action that is left out.
        everyday: the wearer's own everyday motion, which must trigger nothing.
    """
    every = [t for n in numbers for t in _trials(n, repetitions) if t.label != without]
    return train([*every, *everyday], thresholds)


@cache
def _trials(number: int, repetitions: int) -> tuple[Trial, ...]:
    return tuple(people.session(number, repetitions).trials(group=number))


def scores(made: Session, played: Played, names: Sequence[str], confidence: float, lead: float) -> dict[str, Value]:
    """What the law made of a session, as shares, by label.

    A window is judged if all of it lies within one label, `lead` s after the word for an action. It is `right` if it
    isn't rejected, its action is the most likely class, and the posterior is at least `confidence`: what counts for the
    dwell. For standing and walking: if it isn't rejected and counts for no action. An action is `found` if it held
    between its word and a little after its end; `another`, if another one held then, too. `delay`: s, from the word
    until it held, median.
    """
    found: dict[str, Value] = {}
    best = np.where(played.posterior.max(axis=1) >= played.confidence, played.posterior.argmax(axis=1), len(names))
    counts = (played.rejected == 0.0) & (played.confidence >= confidence) & (best < len(names))
    for label in (*ACTIONS, *BACKGROUND):
        own = [(begin, end) for begin, end, name, _ in made.labels if name == label]
        at = np.zeros(len(made.times), bool)
        for begin, end in own:
            since = begin + (lead if label in ACTIONS else 0.0) + (FRAMES - 1) * DT - 1e-9
            at |= (made.times >= since) & (made.times < end)
        number = names.index(label) if label in names else -1
        right = counts & (best == number) if label in ACTIONS else (played.rejected == 0.0) & ~counts
        found[f"{label}_right"] = float(right[at].mean())
        found[f"{label}_rejected"] = float(played.rejected[at].mean())
        if label in ACTIONS:
            found |= {f"{label}_{name}": v for name, v in _holds(made, played, own, number).items()}
    return found


def _holds(made: Session, played: Played, own: Sequence[tuple[float, float]], number: int) -> dict[str, float]:
    """Shares of the repetitions in which the action held, and in which another did; s until it held."""
    hits, others, delays = 0, 0, []
    for begin, end in own:
        at = (made.times >= begin) & (made.times < end + _AFTER)
        here: Array = played.action[at]
        held: Array = np.atleast_1d(here.any(axis=0))
        others += bool(np.delete(held, number).any()) if number >= 0 else bool(held.any())
        if number >= 0 and held[number]:
            hits += 1
            delays.append(float(made.times[at][here[:, number].argmax()]) - begin)
    return {
        "found": hits / len(own), "another": others / len(own), "delay": float(np.median(delays)) if delays else nan,
    }  # fmt: skip


def other_motion(kind: str, number: int, seconds: float, misfit: float) -> tuple[Array, Array]:
    """What a suit measures of a person who does none of the actions, or means none: rotation, translation.

    Standing, walking, and both in turn are this person's own, in a suit that is off. Reaching about with one arm after
    the other is the scripted person's of the cell, in an ideal suit.
    """
    if kind == "reach":
        return unrelated("reach", seconds, number)
    person = Performer(subject(number, SKELETON.names), SKELETON)
    if kind == "walk":
        person.instruct(0.0, Walk())
    elif kind == "stop-and-go":
        for k, t in enumerate(np.arange(0.0, seconds, _STOP_AND_GO).tolist()):
            person.instruct(t, Rest() if k % 2 else Walk())
    times = np.arange(0.0, seconds, DT)
    seed = 1000 * number + UNRELATED.index(kind)
    rotation, translation = measured(person, times, misfit, _NOISE, seed=seed)
    return rotation[:, JOINTS], translation[:, JOINTS]


def recorded(file: Path) -> tuple[Array, Array]:
    """A real suit's recording at the recogniser's rate: rotation (T, n, 4), translation (T, n, 3) m.

    Raises RecordingError.
    """
    motion = Recorded(file, SKELETON, 1.0, False)
    poses = [motion.at(t) for t in np.arange(0.0, motion.duration, DT).tolist()]
    translation = np.tile(motion.offsets, (len(poses), 1, 1))
    translation[:, 0] = [hips for hips, _ in poses]
    return np.array([q for _, q in poses])[:, JOINTS], translation[:, JOINTS]


def trial(text: str, parameters: dict[str, Any], seed: int) -> Mapping[str, Value]:
    """One person, held out, as a task.

    Args:
        text: unused.
        parameters: `person`, the number; `others`, of whom the recogniser is made; `repetitions` of each of them, and
            `tried` of the person; `left_out`, an action that the second recogniser has never seen; `unrelated`, s of
            each kind; `thresholds`, that differ; `misfit`, degrees rms; `everyday`, s of the person's own everyday
            motion, in another session, that sets the triggers.
        seed: of how the suit sits.
    Returns:
        Columns of `scores`; KIND_activations: how often an action began in `unrelated` s; ..._held: of the law that
        lets holding still confirm; dwell, s, and trigger, the widest limit, as chosen; unseen_rejected: share of the
        windows of the action that was left out; unseen_taken: share of its repetitions in which another one held.
    """
    number, repetitions, misfit = parameters["person"], parameters["repetitions"], parameters.get("misfit", MISFIT)
    thresholds = Thresholds.model_validate(parameters.get("thresholds", {}))
    seconds = parameters.get("everyday", _EVERYDAY)
    daily = (people.everyday(number, seconds, 0, misfit),) if seconds > 0.0 else ()
    made = made_of(parameters["others"], repetitions, thresholds, everyday=daily)
    law, holding = law_of(made, thresholds), law_of(made, thresholds, "hold")
    names = law.outputs[0].labels
    own = people.session(number, parameters["tried"], seed, misfit)
    found = scores(own, play(law, own.rotation, own.translation), names, thresholds.confidence, thresholds.lead)
    for kind in UNRELATED:
        motion = other_motion(kind, number, parameters["unrelated"], misfit)
        found[f"{kind}_activations"] = len(onsets(play(law, *motion).action))
        found[f"{kind}_activations_held"] = len(onsets(play(holding, *motion).action))
    played = play(holding, own.rotation, own.translation)
    held = scores(own, played, names, thresholds.confidence, thresholds.lead)
    found |= {f"{label}_{name}_held": held[f"{label}_{name}"] for label in ACTIONS for name in ("found", "delay")}
    found |= {"dwell": made[0].triggers.dwell, "trigger": float(made[0].triggers.limits.max())}
    out = parameters["left_out"]
    blind = law_of(made_of(parameters["others"], repetitions, thresholds, out, daily), thresholds)
    names, played = blind.outputs[0].labels, play(blind, own.rotation, own.translation)
    again = scores(own, played, names, thresholds.confidence, thresholds.lead)
    return found | {"unseen_rejected": again[f"{out}_rejected"], "unseen_taken": again[f"{out}_another"]}
