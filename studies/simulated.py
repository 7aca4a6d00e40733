"""A profile run for a trial: whole, simulated, in lockstep in this process, with the signals that the trial reads."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, cast

import numpy as np
from ruamel.yaml import YAML

from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.header import CYCLE, Cause
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.profile import profile, wiring
from srl.sim.world.cell import Cell
from srl.studies.toolkit.errors import StudyError

AFTER: Final = 0.5  # s, for which a run goes on after the robot stopped: what a stopped robot does is seen
_BLOCK: Final = 4096  # rows


@dataclass(frozen=True)
class Setup:
    """What a trial simulates.

    Attributes:
        profile: a name under profiles/.
        changes: merged into the profile, key by key; lists and scalars replace, None removes.
        duration: greatest world time, s.
    """

    profile: str
    changes: dict[str, Any]
    duration: float


class Run:
    """A finished run.

    Attributes:
        t: (k,) s, of each cycle.
        cause: of the first stop other than the end, in words; "" if there was none.
        stopped_at: s, of that stop.
        ended: whether the run ended by itself, because its plan was over.
    """

    def __init__(self, t: Array, values: Mapping[str, Array], causes: Any, ended: bool) -> None:
        """
        Args:
            t: (k,) s.
            values: (k, ...) of each signal.
            causes: (k,) numbers of the causes.
            ended: see above.
        """
        self.t, self._values, self.ended = t, values, ended
        self.cause, self.stopped_at = "", None
        stops = np.flatnonzero((causes > 0) & (causes != Cause.END))
        if len(stops):
            self.cause = Cause(int(causes[stops[0]])).name.lower().replace("_", " ")
            self.stopped_at = float(t[stops[0]])

    def value(self, signal: str) -> Array:
        """Returns a signal's values, (k, ...)."""
        return self._values[signal]


def parsed(text: str, changes: Mapping[str, Any], seed: int) -> dict[str, Any]:
    """Returns a profile with its choices made, changes merged in, and without what needs files."""
    given = YAML(typ="safe", pure=True).load(text)
    words = [f"{name}={changes[name]}" for name in given.get("choices", {}) if name in changes]
    plain, _ = profile.tree("study.yaml", text, words)
    rest = {key: value for key, value in changes.items() if key not in given.get("choices", {})}
    content: dict[str, Any] = merged(plain, {**rest, "seed": seed, "record": None})
    return content


def simulate(text: str, setup: Setup, seed: int, signals: Sequence[str]) -> Run:
    """Runs a profile until its world has finished, the robot stopped, or the time is over.

    Args:
        text: the profile's.
        setup: what is changed, and how long it lasts at most.
        seed: of the world.
        signals: their names; they are kept of every cycle.

    Raises:
        StudyError: there is no such signal.
        SrlError: the profile isn't valid.
    """
    # JSON is YAML, and keeps the order of a mapping's keys: `guide-buttons` identifies buttons by their places.
    run = lockstep(json.dumps(parsed(text, setup.changes, seed)), {})
    graph = run.graph
    views, ints = graph.row.views, graph.row.ints
    if missing := [name for name in signals if name not in views]:
        raise StudyError("trial: signals", f"the profile has no {', '.join(missing)}", "Name signals of its layout")
    cycles, after = round(setup.duration * graph.profile.rate), round(AFTER * graph.profile.rate)
    kept = {name: _Growing(views[name].shape) for name in signals}
    causes, world = _Growing(()), graph.world
    assert world is not None
    left = cycles
    while left > 0 and not world.finished:
        run.step()
        left -= 1
        for name, rows in kept.items():
            rows.add(views[name])
        causes.add(ints[CYCLE.cause])
        if ints[CYCLE.cause] and ints[CYCLE.cause] != Cause.END:
            left, after = min(left, after), after - 1
    t: Array = np.arange(len(causes.rows)) / float(graph.profile.rate)
    return Run(t, {name: rows.rows for name, rows in kept.items()}, causes.rows, bool(world.finished))


class _Growing:
    """Rows of one shape, added one by one."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._rows, self._count = np.empty((_BLOCK, *shape)), 0

    def add(self, row: Any) -> None:
        """One more."""
        if self._count == len(self._rows):
            self._rows = np.concatenate([self._rows, np.empty_like(self._rows)])
        self._rows[self._count] = row
        self._count += 1

    @property
    def rows(self) -> Array:
        """(k, ...) all of them."""
        return self._rows[: self._count]


def merged(base: Any, changes: Any) -> Any:
    """Returns `base` with `changes` merged in, mapping by mapping; None removes a key."""
    if not isinstance(base, dict) or not isinstance(changes, Mapping):
        return changes
    found = dict(base)
    for key, value in changes.items():
        if value is None:
            found.pop(key, None)
        else:
            found[key] = merged(found.get(key), value)
    return found


def controllers(text: str, use: str, **options: Any) -> list[dict[str, Any]]:
    """Returns a profile's controllers with options of one of them changed, because a list replaces a list."""
    entries = [dict(entry) for entry in YAML(typ="safe", pure=True).load(text)["controllers"]]
    chosen = [entry for entry in entries if use in (entry["use"], entry.get("name"))]
    if len(chosen) != 1:
        raise StudyError("controllers", f"the profile has {len(chosen)} called '{use}'", "Name one of them")
    chosen[0] |= options
    return entries


def without_hand(entries: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Returns controllers without the gripper's: for trials that never close the hand, whose device is left out."""
    return [entry for entry in entries if entry["use"] != "gripper"]


def lockstep(text: str, overrides: Mapping[str, Any]) -> Lockstep:
    """Returns a profile in lockstep, with other values by key path."""
    words = [f"{key}={json.dumps(value)}" for key, value in overrides.items()]
    return Lockstep(wiring.build(*profile.parse("study.yaml", text, words), []))


def cell(lockstep: Lockstep) -> Cell:
    """Returns the simulated world of a profile that has a cell."""
    return cast(Cell, lockstep.graph.world)


def largest(values: Array) -> float:
    """Returns the greatest length of vectors (k, 3); 0 if there are none."""
    return float(np.linalg.norm(values, axis=-1).max(initial=0.0))
