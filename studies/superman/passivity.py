"""The admittance held by a stiff hand: does it oscillate, with the energy tank and as the bare law?

    M v' + D v = f,     f = K_h (x_h - x) - D_h x',     x behind the desired position by the loop's delay

Without delay it is passive for any stiffness K_h. With delay, the bare law rings beyond a margin that `margin` gives.
Person: a spring and damper about a fixed point, without corrections by sight; the handle receives one knock.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan, pi, sqrt
from pathlib import Path
from typing import Any, Final

import numpy as np

from runtime.contracts.signals import Array
from runtime.ipc.words import Cause
from studies.result import Claim, Result
from studies.runs import Run, Task, controller, run_all
from studies.superman.assumptions import assumed

STUDY: Final = "passivity"
ROBOTS: Final = {"moca": "moca-man", "kairos": "kairos-man"}
_LONGEST: Final = 0.3  # s, greatest delay that is searched


@dataclass(frozen=True)
class Case:
    """A robot, a hand's stiffness (N/m), delay added to the sensor (s), with or without the tank.

    `told`: whether the tank's configuration includes the added delay (`force_age`).
    """

    robot: str
    stiffness: float
    late: float
    tank: bool
    told: bool = False

    @property
    def name(self) -> str:
        return f"{self.robot} {self.stiffness:g} Npm {1e3 * self.late:g} ms {self.law}"

    @property
    def law(self) -> str:
        return ("told" if self.told else "tank") if self.tank else "bare"


@dataclass(frozen=True)
class Outcome:
    """The outcome of a run.

    Attributes:
        first, last: m/s, RMS speed of the handle in the first and the last third of the time after the knock.
        growth: last / first.
        verdict: still, dies, persists, grows.
        given: J, the greatest energy that the robot had given to the hand since the knock's end.
        delay: s, from the handle's force to the tool's motion, in addition to the law's own.
        knocked: J, energy that the knock put in.
        damped: share of cycles in which the tank was too empty.
        cause: of a stop before the end.
    """

    case: Case
    first: float
    last: float
    growth: float
    verdict: str
    given: float
    knocked: float
    delay: float
    damped: float
    cause: str


def margin(stiffness: float, mass: float, damping: float, hand: float = 0.0) -> float:
    """Returns the delay, s, at which the bare law with a hand of `stiffness` and damping `hand` begins to ring."""
    # |L| = 1 for L = (K + D_h s) / (s (M s + D)): M^2 w^4 + (D^2 - D_h^2) w^2 - K^2 = 0.
    b = damping * damping - hand * hand
    w = sqrt((-b + sqrt(b * b + 4 * mass * mass * stiffness * stiffness)) / (2 * mass * mass))
    return (pi / 2 + atan(hand * w / stiffness) - atan(mass * w / damping)) / w


def task(case: Case, a: dict[str, Any]) -> Task:
    """Returns a run of one case, with the assumptions `a`."""
    options: dict[str, Any] = {"mass": a["mass"], "damping": a["damping"]}
    if not case.tank:
        options |= {"tank": None, "leash": None}
    if case.told:
        options["force_age"] = case.late
    plan = [{"do": "press", "button": "A"}, {"do": "hold", "seconds": 60.0}]
    start, end = a["knock_at"]
    knock = {"start": start, "end": end, "wrench": [a["knock"], 0.0, 0.0, 0.0, 0.0, 0.0]}
    person = {
        "plan": plan, "stiffness": case.stiffness, "damping": a["hand_damping"], "stiffening": 0.0,
        "correction": [0.0, 0.0],
    }  # fmt: skip
    changes = {
        "controllers": controller(ROBOTS[case.robot], "guide", **options),
        "sim": {"parts": {"person": person, "grip": {"pushes": [knock]}}, "devices": {"sensor": {"delay": case.late}}},
    }
    return Task(case.name.replace(" ", "-"), ROBOTS[case.robot], changes, a["trial"], a["seed"])


def motion(run: Run) -> tuple[Array, Array, Array]:
    """Returns times (k,) s, forces of the hand (k, 3) N and velocities of the handle (k, 3) m/s, all ground truth."""
    t, place = run.t, run.value("world.person_tool")
    return t, run.value("world.person_wrench")[:, :3], np.gradient(place, t, axis=0)


def outcome(case: Case, run: Run, a: dict[str, Any]) -> Outcome:
    """Computes the outcome from a run's ground truth."""
    t, force, velocity = motion(run)
    active = run.word("state") == 2
    held = (t > a["knock_at"][1]) & active
    which = np.flatnonzero(held)
    third = len(which) // 3
    speed: Array = np.linalg.norm(velocity, axis=1)
    first, last = (float(np.sqrt(np.mean(speed[part] ** 2))) for part in (which[:third], which[-third:]))
    growth = last / first
    if last < a["still"]:
        verdict = "still"
    elif growth < a["dies"]:
        verdict = "dies"
    else:
        verdict = "grows" if growth > a["grows"] else "persists"
    given = _given(t, force, velocity)
    causes = run.word("cause")
    stops = {Cause(int(c)) for c in np.unique(causes) if c} - {Cause.END}
    cause = ", ".join(sorted(c.name.lower().replace("_", " ") for c in stops))
    damped = float(np.mean(run.value("guide.tank")[held, 0] <= 0.1 * a["stored"])) if case.tank else 0.0
    on = (run.value("keys.modes")[:, 0] > 0.5) & active
    pushed = force + run.value("world.grip_push")[:, :3]
    delay = lag(t[on], pushed[on], velocity[on], a)
    most = float((given[held] - given[which[0]]).max())
    before = t <= a["knock_at"][1]
    knocked = -float(_given(t, pushed - force, velocity)[before][-1])
    return Outcome(case, first, last, growth, verdict, most, knocked, delay, damped, cause)


def _given(t: Array, force: Array, velocity: Array) -> Array:
    """Returns the energy, (k,) J, that the robot has given to the hand so far."""
    power = -np.sum(force * velocity, axis=1)
    return np.concatenate([[0.0], np.cumsum(power[:-1] * np.diff(t))])


def lag(t: Array, force: Array, velocity: Array, a: dict[str, Any]) -> float:
    """Returns the s by which the handle's motion is behind the motion that the bare law makes of the force at once.

    It is the shift with the greatest correlation of the two over the whole recording, interpolated between samples by a
    parabola.
    """
    dt = float(np.median(np.diff(t)))
    M, D, band = np.array(a["mass"][:3]), np.array(a["damping"][:3]), a["dead_band"]
    ideal, v = np.zeros_like(force), np.zeros(3)
    for k, f in enumerate(force):
        size = float(np.linalg.norm(f))
        beyond = f * max(0.0, 1.0 - band / size) if size > 0 else f
        v = v + dt * (beyond - D * v) / M
        ideal[k] = v
    most = min(round(_LONGEST / dt), len(t) // 2)
    n = len(t) - most
    match = []
    for k in range(most):
        x, y = ideal[:n].ravel(), velocity[k : k + n].ravel()
        size = float(np.linalg.norm(x)) * float(np.linalg.norm(y))
        match.append(float(x @ y) / max(size, 1e-12))
    best = int(np.argmax(match))
    if 0 < best < most - 1:
        low, top, high = match[best - 1 : best + 2]
        if (bend := low - 2 * top + high) < 0:
            return dt * (best + 0.5 * (low - high) / bend)
    return dt * best


def cases(a: dict[str, Any], quick: bool) -> list[Case]:
    """Returns the runs; quick: Kairos, a relaxed hand with the bare law and the stiffest hand with the tank."""
    stiffest = max(a["stiffness"])
    if quick:
        return [Case("kairos", min(a["stiffness"]), 0.0, tank=False), Case("kairos", stiffest, 0.0, tank=True)]
    hands = {"kairos": a["stiffness"], "moca": a["stiffness_moca"]}
    plain = [Case(r, k, 0.0, tank) for r, stiffness in hands.items() for k in stiffness for tank in (True, False)]
    late = [Case("kairos", stiffest, late, tank) for late in a["late"] for tank in (True, False)]
    return late + plain + [Case("kairos", stiffest, late, tank=True, told=True) for late in a["late"]]


def run(folder: Path, quick: bool) -> Result:
    """Runs the study; see the module's docstring."""
    a = assumed(STUDY)
    chosen = cases(a, quick)
    runs = run_all([task(case, a) for case in chosen], folder)
    found = [outcome(case, r, a) for case, r in zip(chosen, runs, strict=True)]
    result = Result(STUDY, simulated=True, seeds=[a["seed"]])
    result.table = [row(o, a) for o in found]
    result.claims = claims(found, a)
    picture = folder / "passivity.png"
    _draw(picture, list(zip(found, runs, strict=True)))
    result.files = [str(picture), *(str(r.file) for r in runs)]
    return result


def row(o: Outcome, a: dict[str, Any]) -> dict[str, Any]:
    """Returns a row of the table."""
    case = o.case
    return {
        "robot": case.robot, "hand N/m": case.stiffness, "added ms": 1e3 * case.late,
        "law": case.law,
        "margin ms": 1e3 * margin(case.stiffness, a["mass"][0], a["damping"][0], a["hand_damping"]),
        "delay ms": 1e3 * o.delay, "first mm/s": 1e3 * o.first, "last mm/s": 1e3 * o.last,
        "growth": o.growth, "verdict": o.verdict, "given J": o.given, "knock J": o.knocked, "damped": o.damped,
        "stop": o.cause or "none",
    }  # fmt: skip


def claims(found: list[Outcome], a: dict[str, Any]) -> list[Claim]:
    """Returns our claims; the paper says only that its parameters keep the behaviour stable."""
    stiffest = max(a["stiffness"])
    M, D = a["mass"][0], a["damping"][0]
    pure = margin(stiffest, M, D)
    bare = [o for o in found if not o.case.tank]
    # The claims about the tank are for runs in which its configuration includes the sensor's delay.
    tank = [o for o in found if o.case.tank and (o.case.told or o.case.late == 0.0)]
    # Measured with the most relaxed hand: large oscillations run into the guard's limits, which adds delay.
    loops = {o.case.robot: o.delay for o in bare if o.case.late == 0.0 and o.case.stiffness == min(a["stiffness"])}
    loop = loops["kairos"]
    beyond = [
        o for o in bare
        if loops[o.case.robot] + o.case.late > margin(o.case.stiffness, M, D, a["hand_damping"])
    ]  # fmt: skip
    return [
        Claim(
            id="analytic-margin", paper="", measured=1e3 * pure, unit="ms", holds=0.009 < pure < 0.011,
            text=f"the bare law holds {stiffest:g} N/m up to about 10 ms of delay (M = {M:g}, D = {D:g})",
        ),
        Claim(
            id="loop-delay", text="Kairos' own delay, handle's force to tool's motion, is within that margin",
            paper="", measured=1e3 * loop, unit="ms", holds=loop < pure,
        ),
        Claim(
            id="tank-no-growth", paper="", measured=max(o.growth for o in tank), unit="last / first third",
            text="with the tank no oscillation grows, whatever the stiffness, with the sensor's delay stated",
            holds=all(o.growth < 1.0 or o.verdict == "still" for o in tank),
        ),
        Claim(
            id="tank-dies-out", paper="", measured=1e3 * max(o.last for o in tank), unit="mm/s",
            text="and each falls to less than half within 3 s",
            holds=all(o.verdict in ("dies", "still") for o in tank),
        ),
        Claim(
            id="tank-energy", paper="", measured=max(o.given - o.knocked for o in tank), unit="J",
            text=f"with the tank the hand is given at most {a['stored']:g} J more than the knock put in",
            holds=all(o.given - o.knocked <= a["stored"] for o in tank),
        ),
        Claim(
            id="bare-rings", text="the bare law keeps on oscillating or grows wherever the delay is beyond its margin",
            paper="", measured=float(sum(o.verdict in ("grows", "persists") for o in beyond)),
            unit=f"of {len(beyond)} runs",
            holds=bool(beyond) and all(o.verdict in ("grows", "persists") for o in beyond),
        ),
    ]  # fmt: skip


def sweep(folder: Path) -> list[dict[str, Any]]:
    """Shows how far the verdicts depend on the hand's own damping (N s/m) and on the user studies' heavier admittance.

    Returns rows: the change, and the table's columns; Kairos, the stiffest hand.
    """
    base = assumed(STUDY)
    stiffest = max(base["stiffness"])
    heavy = {"mass": [6.0, 6.0, 6.0, 1.0, 1.0, 1.0], "damping": [40.0, 40.0, 40.0, 1.8, 1.8, 1.8]}
    changed: dict[str, dict[str, Any]] = {
        "hand_damping 0": {"hand_damping": 0.0},
        "hand_damping 20": {"hand_damping": 20.0},
        "M 6, D 40": heavy,
    }
    rows = []
    for label, change in changed.items():
        a = base | change
        chosen = [Case("kairos", stiffest, 0.0, tank) for tank in (True, False)]
        place = folder / label.replace(" ", "-").replace(",", "")
        place.mkdir(parents=True, exist_ok=True)
        runs = run_all([task(case, a) for case in chosen], place)
        rows += [
            {"changed": label} | row(outcome(case, r, a), a) for case, r in zip(chosen, runs, strict=True)
        ]  # fmt: skip
    return rows


def _draw(path: Path, pairs: list[tuple[Outcome, Run]]) -> None:
    """Draws the handle's speed and energy given to the hand, tank and bare law, a column per stiffness and delay."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    groups: dict[tuple[str, float, float], list[tuple[Outcome, Run]]] = {}
    for o, r in pairs:
        groups.setdefault((o.case.robot, o.case.stiffness, o.case.late), []).append((o, r))
    columns = min(len(groups), 4)
    lines = -(-len(groups) // columns)
    figure, axes = plt.subplots(2 * lines, columns, figsize=(4 * columns, 4 * lines), squeeze=False, sharex=True)
    for number, ((robot, stiffness, late), members) in enumerate(groups.items()):
        line, column = divmod(number, columns)
        top, low = axes[2 * line, column], axes[2 * line + 1, column]
        for o, r in members:
            t, force, velocity = motion(r)
            colour = {"tank": "tab:blue", "bare": "tab:red", "told": "tab:green"}[o.case.law]
            label = f"{o.case.law}: {o.verdict}"
            top.plot(t, velocity[:, 0], color=colour, linewidth=0.7, label=label)
            low.plot(t, _given(t, force, velocity), color=colour, linewidth=0.9)
        added = f" + {1e3 * late:g} ms" if late else ""
        top.set_title(f"{robot}, {stiffness:g} N/m{added}", fontsize=10)
        top.set_ylabel("handle's vx, m/s")
        low.set_ylabel("given to hand, J")
        top.legend(loc="upper right", fontsize=7)
    for unused in range(len(groups), lines * columns):
        line, column = divmod(unused, columns)
        axes[2 * line, column].axis("off")
        axes[2 * line + 1, column].axis("off")
    for each in axes[-1]:
        each.set_xlabel("time, s")
    figure.suptitle("Admittance held by a stiff hand, simulated")
    figure.tight_layout()
    figure.savefig(path, dpi=90)
    plt.close(figure)
