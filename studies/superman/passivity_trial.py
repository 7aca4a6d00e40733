"""One trial of the passivity study: MOCA or Kairos in lockstep, and a hand that holds, knocks, leans or lets go.

The profile itself runs, from the handle's sensor and the buttons through law and guard to the simulated arm and base.
The hand is a force at the handle: a push, and a spring and damper about where the handle was when it was grasped,
computed once a cycle. It neither sees nor reacts.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, cast

import numpy as np
from ruamel.yaml import YAML

from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.header import CYCLE, Cause, State
from srl.sim.parts.things.ft_sensor import HandlePart
from srl.studies.simulated import cell, lockstep, merged
from srl.studies.superman.lag import lag
from srl.studies.tasks.task import Value

PRESS: Final = 0.3  # s, when A is pressed
BEGIN: Final = 1.2  # s, when a knock or a push begins: the hand has held the handle since it was pressed
_TOUCH: Final = {"touches": "hand/palm", "point": [0.0, 0.0, 0.05], "normal": [0.0, 1.0, 0.0]}
_REST: Final = 0.01  # of the speed at a release, below which the motion counts as stopped

Push = tuple[float, float, tuple[float, float, float]]  # begin and end, s; N


@dataclass(frozen=True)
class Scene:
    """What the hand does, and on what.

    Attributes:
        seconds: of world time.
        stiffness: (t, N/m) of the hand, linear between them; N s/m: `damping`.
        pushes: (begin, end, (3,) N).
        presses: s of presses, by button.
        wall: options of the part `wall`.
        loss: s from which the handle's sensor is gone.
    """

    seconds: float
    stiffness: tuple[tuple[float, float], ...] = ((0.0, 0.0),)
    damping: float = 0.0
    pushes: tuple[Push, ...] = ()
    presses: Mapping[str, tuple[float, ...]] | None = None
    wall: Mapping[str, Any] | None = None
    loss: float | None = None


def scene(p: Mapping[str, Any]) -> Scene:
    """The scene that a trial's parameters name."""
    k, d, push = p.get("stiffness", 0.0), p.get("hand_damping", 0.0), p.get("push", 0.0)
    knocked = ((BEGIN, BEGIN + 0.05, (p.get("knock", 0.0), 0.0, 0.0)),)
    match p["scene"]:
        case "hold":
            return Scene(4.25, ((0.0, k),), d, knocked)
        case "stiffen":
            soft = p["soft"]
            return Scene(4.25, ((BEGIN, soft), (BEGIN + p["stiffens_in"], k)), d, knocked)
        case "lean":
            # Gently up to the wall, and against it; then away from it.
            touched, until = BEGIN + 1.2, BEGIN + 1.2 + p["lean"]
            leaned: tuple[Push, ...] = (
                (BEGIN, touched, (0.0, -p["approach"], 0.0)), (touched, until, (0.0, -push, 0.0)),
                (until, until + 1.2, (0.0, push, 0.0)),
            )  # fmt: skip
            return Scene(until + 1.2, pushes=leaned, wall={**_TOUCH, "gap": 0.04, "stiffness": p["wall"]})
        case "leave":
            # Up to the wall, and against it; then A is switched off and the hand is gone.
            touched, until = BEGIN + 1.2, BEGIN + 3.2
            leaned = ((BEGIN, touched, (0.0, -p["approach"], 0.0)), (touched, until, (0.0, -push, 0.0)))
            wall = {**_TOUCH, "gap": 0.04, "stiffness": p["wall"]}
            return Scene(until + 1.2, pushes=leaned, presses={"A": (until,)}, wall=wall)
        case "cart":
            # Pushed away, then the hand holds the handle where it is, then it leads it back.
            stop, back = BEGIN + 2.0, BEGIN + 3.5
            pushes = ((BEGIN, stop, (0.0, -push, 0.0)), (back, back + 1.2, (0.0, push, 0.0)))
            cart = {**_TOUCH, "gap": 0.02, "stiffness": 2e4, "mass": p["cart"], "resistance": p["resistance"]}
            held = ((stop, 0.0), (stop + 0.05, k), (back - 0.05, k), (back, 0.0))
            return Scene(back + 1.2, held, d, pushes, {"P": (0.6,)}, cart)
        case "let go":
            until = BEGIN + 0.8
            return Scene(until + 1.0, pushes=((BEGIN, until, (0.0, push, 0.0)),), presses={"A": (until,)})
        case "lose":
            until = BEGIN + 0.8
            return Scene(until + 1.0, pushes=((BEGIN, until, (0.0, push, 0.0)),), loss=until)
    raise ValueError(f"no scene '{p['scene']}'")


def trial(text: str, parameters: dict[str, Any], seed: int) -> Mapping[str, Value]:
    """One scene as a task.

    Args:
        text: the profile's, moca-man or kairos-man.
        parameters: `scene` and its numbers (see `scene`); `law`; `options` of `admittance`; `late`, s, added to the
            handle's sensor; `still`, `dies`, `grows`, as in assumptions.yaml.
        seed: of the world's noise.
    Returns:
        first, last, growth, verdict, delay (s), given (J, to the hand at most since the knock's end, beyond what it
        put in): of a hand that holds; wall (N, the largest force), bounce (m/s, RMS in the last half of a lean),
        away (m/s, 1 s after it was led back); left (N, 1 s after A was switched off in a lean); coasted (m), stopped
        (s), harsh (m/s2, over 20 ms): after letting go; cause of a stop; with a tank also least (J, of it) and damped
        (share of cycles with nothing or a debt in it).
    """
    what = scene(parameters)
    made = _Handling(text, parameters, seed, what)
    made.run()
    row: dict[str, Value] = {"cause": made.cause()}
    if parameters["law"] != "bare":
        tank = made.column("tank")[made.active() & (made.column("t") > PRESS)]
        row |= {"least": float(tank.min()), "damped": float(np.mean(tank <= 0.0))}
    match parameters["scene"]:
        case "hold" | "stiffen":
            row |= _held(made, parameters)
        case "lean" | "cart":
            row |= _pressed(made, what)
        case "leave":
            row |= _left(made, what)
        case _:
            row |= _released(made, what)
    return row


class _Handling:
    """A profile in lockstep with the hand, and what is measured in each cycle."""

    def __init__(self, text: str, parameters: Mapping[str, Any], seed: int, what: Scene) -> None:
        content = YAML(typ="safe", pure=True).load(text)
        (guide,) = (entry for entry in content["controllers"] if entry["use"] == "admittance")
        guide |= parameters.get("options", {})
        presses = {"A": (PRESS, *((what.presses or {}).get("A", ())))} | {
            name: times for name, times in (what.presses or {}).items() if name != "A"
        }
        sensor: dict[str, Any] = {"delay": parameters.get("late", 0.0)}
        if what.loss is not None:
            sensor["loss"] = [[what.loss, what.seconds]]
        changes: dict[str, Any] = {
            "seed": seed,
            "sim": {
                "parts": {"person": None, "wall": None if what.wall is None else {"part": "wall", **what.wall}},
                "devices": {
                    "panel": {"person": None, "presses": {n: [[t, t + 0.1] for t in ts] for n, ts in presses.items()}},
                    "sensor": sensor,
                },
            },
        }
        # JSON is YAML, and keeps the order of a mapping's keys.
        self.lockstep = lockstep(json.dumps(merged(content, changes)), {})
        graph = self.lockstep.graph
        self._what, self._dt = what, self.lockstep.period * 1e-9
        self._cell = cell(self.lockstep)
        self._grip = cast(HandlePart, self._cell.parts["grip"])
        self._views, self._ints = graph.row.views, graph.row.ints
        self._body = int(self._cell.model.body("grip/grip").id)
        self._started: Array | None = None
        self._rows: list[list[float]] = []

    NAMES: Final = ("t", "x", "y", "z", "fx", "fy", "fz", "px", "py", "pz", "tank", "wall", "tx", "ty", "tz", "state",
                    "cause", "speed")  # fmt: skip

    def run(self) -> None:
        """The whole scene."""
        views, what, dt = self._views, self._what, self._dt
        before = None
        for _ in range(round(what.seconds / dt)):
            self.lockstep.step()
            t = self.lockstep.count * dt
            place = np.array(self._cell.data.xpos[self._body])
            velocity = np.zeros(3) if before is None else (place - before) / dt
            before = place
            if self._started is None and t >= PRESS:
                self._started = place
            stiffness = float(np.interp(t, [k[0] for k in what.stiffness], [k[1] for k in what.stiffness]))
            hold, push = np.zeros(3), np.zeros(3)
            if self._started is not None and stiffness > 0.0:
                hold = stiffness * (self._started - place) - what.damping * velocity
            elif stiffness == 0.0:
                self._started = place  # it will be held where it is then
            for begin, end, force in what.pushes:
                if begin <= t < end:
                    push += force
            self._grip.push(np.array([*(hold + push), 0.0, 0.0, 0.0]))
            wall = float(np.linalg.norm(views["world.wall_force"])) if what.wall is not None else 0.0
            self._rows.append(
                [
                    t, *place, *hold, *push, views["guide.tank"].item(0), wall, *views["tool.pose"][:3].tolist(),
                    int(self._ints[CYCLE.state]), int(self._ints[CYCLE.cause]),
                    float(np.linalg.norm(views["guide.twist"][:3])),
                ]
            )  # fmt: skip
        self._table = np.array(self._rows)

    def column(self, *names: str) -> Array:
        """(k,) or (k, n) of every cycle."""
        found: Array = self._table[:, [self.NAMES.index(name) for name in names]]
        return found[:, 0] if len(names) == 1 else found

    def cause(self) -> str:
        """Of a stop; "" for none."""
        causes = {Cause(int(c)) for c in np.unique(self.column("cause")) if c}
        return ", ".join(sorted(c.name.lower().replace("_", " ") for c in causes))

    def speeds(self) -> Array:
        """(k, 3) m/s of the handle."""
        return np.gradient(self.column("x", "y", "z"), self._dt, axis=0)

    def active(self) -> Any:
        """(k,) whether commands went out."""
        return self.column("state") == int(State.ACTIVE)


def _held(made: _Handling, p: Mapping[str, Any]) -> dict[str, Value]:
    t, force, velocity = made.column("t"), made.column("fx", "fy", "fz"), made.speeds()
    after = np.flatnonzero((t > BEGIN + 0.05) & made.active())
    third = len(after) // 3
    speed = np.linalg.norm(velocity, axis=1)
    first, last = (float(np.sqrt(np.mean(speed[part] ** 2))) for part in (after[:third], after[-third:]))
    growth = last / first
    verdict = "persists"
    if last < p["still"]:
        verdict = "still"
    elif growth < p["dies"]:
        verdict = "dies"
    elif growth > p["grows"]:
        verdict = "grows"
    given = _work(t, -force, velocity)
    pushed = made.column("px", "py", "pz")
    knocked = float(_work(t, pushed, velocity)[-1])
    on = t > PRESS + 0.1
    options = p["options"]
    delay = lag(t[on], (force + pushed)[on], velocity[on], options["mass"], options["damping"], p["dead_band"])
    return {
        "first": first, "last": last, "growth": growth, "verdict": verdict, "delay": delay,
        "given": float((given[after] - given[after[0]]).max()), "knocked": knocked,
    }  # fmt: skip


def _work(t: Array, force: Array, velocity: Array) -> Array:
    """The work (k,) J of a force so far."""
    power = np.sum(force * velocity, axis=1)
    return np.concatenate([[0.0], np.cumsum(power[:-1] * np.diff(t))])


def _pressed(made: _Handling, what: Scene) -> dict[str, Value]:
    t, wall, speed = made.column("t"), made.column("wall"), made.speeds()[:, 1]
    *_, (begin, until, _), (away, _, _) = what.pushes
    half = (t > 0.5 * (begin + until)) & (t < until)
    return {
        "wall": float(wall.max()), "leaned": float(np.mean(wall[half])),
        "bounce": float(np.sqrt(np.mean((speed[half] - np.mean(speed[half])) ** 2))),
        "away": float(speed[np.searchsorted(t, away + 1.0)]),
    }  # fmt: skip


def _left(made: _Handling, what: Scene) -> dict[str, Value]:
    """The wall's force before and 1 s after A is switched off."""
    t, wall = made.column("t"), made.column("wall")
    *_, (_, until, _) = what.pushes
    before, after = (t > until - 0.5) & (t < until), (t > until + 0.9) & (t < until + 1.1)
    return {"leaned": float(np.mean(wall[before])), "left": float(np.mean(wall[after]))}


def _released(made: _Handling, what: Scene) -> dict[str, Value]:
    """Of the true handle: the way and the time until it moves at a hundredth of its speed at the release, for good."""
    t, place, speed = made.column("t"), made.column("x", "y", "z"), np.linalg.norm(made.speeds(), axis=1)
    (_, until, _), *_ = what.pushes
    # The button is pressed, or the sensor is silent, from then on; the system must see it, too.
    start = int(np.searchsorted(t, until))
    moving = np.flatnonzero(speed[start:] > max(_REST * speed[start], 0.005))
    slowing = np.gradient(made.speeds(), float(t[1] - t[0]), axis=0)[start:]
    window = np.ones(round(0.02 / (t[1] - t[0])))
    mean = np.stack([np.convolve(a, window / len(window), "valid") for a in slowing.T], axis=1)
    return {
        "released": float(speed[start]), "coasted": float(np.linalg.norm(place[start:] - place[start], axis=1).max()),
        "stopped": float(t[start + moving[-1]] - t[start]) if len(moving) else 0.0,
        "harsh": float(np.linalg.norm(mean, axis=1).max()),
    }  # fmt: skip
