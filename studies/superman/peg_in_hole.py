"""Constrained interaction: a person leads a peg into a hole and out again, with MOCA and with Kairos (Fig. 11).

The paper shows curves and payload lines; the payloads are the only figures it prints. "As published" is the paper's
law without the runtime's additions (leash, tank, slowing down).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from runtime.contracts.gravity import GRAVITY
from runtime.contracts.signals import Array
from runtime.ipc.words import Cause
from sim.parts.person.plans import peg_in_hole
from studies.result import Claim, Result
from studies.runs import Run, Task, controller, largest, run_all
from studies.superman.assumptions import assumed

STUDY: Final = "peg-in-hole"
_BUTTONS: Final = {"admittance": "A"}
# Hand, sensor and handle of the profiles: kg, and m in the flange's frame.
_FLANGE: Final = (0.88, (0.05, 0.003, 0.065))


@dataclass(frozen=True)
class Condition:
    """A robot and its law. `bare`: without leash and tank, and for Kairos without slowing down."""

    label: str
    profile: str
    bare: bool
    compliant: bool = False

    @property
    def robot(self) -> str:
        return "moca" if self.profile == "moca-man" else "kairos"


MOCA: Final = Condition("MOCA", "moca-man", bare=False)
MOCA_BARE: Final = Condition("MOCA as published", "moca-man", bare=True)
KAIROS_BARE: Final = Condition("Kairos as published", "kairos-man", bare=True)
KAIROS: Final = Condition("Kairos", "kairos-man", bare=False)
COMPLIANT: Final = Condition("Kairos, force feedback", "kairos-man", bare=False, compliant=True)
CONDITIONS: Final = (MOCA, MOCA_BARE, KAIROS_BARE, COMPLIANT)
_ONCE: Final = (MOCA_BARE,)  # run with the first seed only, for time


@dataclass(frozen=True)
class Outcome:
    """The outcome of a run. Forces in N, lengths in m; `cause` is the stop's, "" if none came before the end.

    `force` is the largest of single physics steps. The simulated contact chatters from step to step, so a sensor would
    show less; `mean_force` is the largest mean over the stated window. The claims use `force`.
    """

    condition: Condition
    seed: int
    force: float
    mean_force: float
    depth: float
    inserted: bool
    withdrew: bool
    missed: int
    cause: str
    stopped_at: float | None


def task(condition: Condition, seed: int, a: dict[str, Any], name: str = "") -> Task:
    """Returns a run of one condition, with the assumptions `a`."""
    mass, at = _with_peg(a)
    arm: dict[str, Any] = {"load": {"mass": mass, "centre": at}}
    if condition.robot == "kairos":
        arm = {"payload": mass, "payload_cog": at}
    changes: dict[str, Any] = {
        "devices": {"arm": arm},
        "controllers": _controllers(condition, a),
        "sim": {
            "parts": {
                "peg": {
                    "part": "peg", "at": {"parent": "arm/flange", "position": a["peg_position"]},
                    "mass": a["peg_mass"], "length": a["peg_length"],
                },
                "hole": {
                    "part": "hole", "at": {"position": a[f"hole_{condition.robot}"]}, "peg": "peg/tip",
                    "diameter": a["diameter"], "chamfer": a["chamfer"],
                    "stiffness": a["contact"], "friction": a["friction"],
                },
                "person": {
                    "tool": "peg/tip", "plan": _plan(a), "stiffness": a["stiffness"], "damping": a["hand_damping"],
                    "learned_mass": a["mass"][0], "learned_damping": a["damping"][0],
                },
            }
        },
    }  # fmt: skip
    if condition.robot == "kairos":
        changes["sim"]["devices"] = {"arm": {"force_limit": a["force_limit"]}}
        changes["sim"]["parts"]["arm"] = {"drives": a["drives"]}
    label = name or condition.label
    slug = "-".join(label.lower().replace(",", "").split())
    return Task(f"{slug}-{seed}", condition.profile, changes, a["duration"], seed)


def _with_peg(a: dict[str, Any]) -> tuple[float, list[float]]:
    """Returns the kg at the flange with the peg, and its centre of mass, as configured in the robot."""
    mass, centre = _FLANGE
    x, y, z = a["peg_position"]
    peg = (x, y, z + a["peg_length"] / 2)
    total = mass + a["peg_mass"]
    return total, [(mass * c + a["peg_mass"] * p) / total for c, p in zip(centre, peg, strict=True)]


def _plan(a: dict[str, Any]) -> list[dict[str, Any]]:
    steps = peg_in_hole(depth=a["depth"], force=a["push"], above=a["above"])
    plan = [step.model_dump(mode="json", exclude_none=True) for step in steps]
    for step in plan:
        if "button" in step:
            step["button"] = _BUTTONS[step["button"]]
        if "patience" in step:
            step["patience"] = a["patience"]
    return plan


def _controllers(condition: Condition, a: dict[str, Any]) -> list[dict[str, Any]]:
    options: dict[str, Any] = {"mass": a["mass"], "damping": a["damping"]}
    if condition.bare:
        options |= {"leash": None, "tank": None}
    entries = controller(condition.profile, "guide", **options)
    body = next(entry for entry in entries if entry.get("name") == "body")
    if condition.robot == "moca" and condition.bare:
        body["unit_mass"] = True
    if condition.robot == "kairos" and condition.bare:
        body["speed"] = None
        body.pop("base_speed", None)
    if condition.robot == "kairos" and not condition.compliant:
        del body["force_feedback"]
        body["in"] = {k: v for k, v in body["in"].items() if k not in ("flange_wrench", "hand")}
    return entries


def outcome(condition: Condition, seed: int, run: Run, a: dict[str, Any]) -> Outcome:
    """Computes the outcome from a run's ground truth."""
    force, depth = run.value("world.hole_force"), run.value("world.hole_depth")[:, 0]
    progress = run.value("world.person_progress")
    # After the insertion and the rest comes the withdrawal: step 4 of the plan. The peg is out after it.
    steps = progress[:, 0]
    tip = run.value("world.person_tool")
    above = tip[:, 2] - a[f"hole_{condition.robot}"][2]
    inserted = bool(depth.max(initial=0.0) >= a["inserted"])
    out = steps >= 5
    stops = np.flatnonzero(run.word("cause") > 0)
    cause = ""
    stopped_at = None
    if len(stops) and Cause(int(run.word("cause")[stops[0]])) is not Cause.END:
        cause = Cause(int(run.word("cause")[stops[0]])).name.lower().replace("_", " ")
        stopped_at = float(run.t[stops[0]])
    withdrew = inserted and not cause and bool(out.any()) and bool(above[out][0] > 0.0)
    means = smoothed(force, run.t, a["window"])
    return Outcome(
        condition,
        seed,
        largest(force),
        largest(means),
        float(depth.max()),
        inserted,
        withdrew,
        int(progress[-1, 1]),
        cause,
        stopped_at,
    )


def smoothed(values: Array, t: Array, window: float) -> Array:
    """Returns running means (k, 3) of values (k, 3) over the last `window` s."""
    n = max(1, round(window / float(np.median(np.diff(t)))))
    total = np.cumsum(np.vstack([np.zeros((n, values.shape[1])), values]), axis=0)
    return np.asarray((total[n:] - total[:-n]) / n)


def run(folder: Path, quick: bool) -> Result:
    """Runs every condition with every seed, MOCA as published with the first only; quick: Kairos and one seed."""
    a = assumed(STUDY)
    seeds = a["seeds"][:1] if quick else a["seeds"]
    pairs = [(c, seed) for c in CONDITIONS for seed in (seeds[:1] if c in _ONCE else seeds)]
    if quick:
        pairs = [(c, seed) for c, seed in pairs if c.robot == "kairos"]
    runs = run_all([task(condition, seed, a) for condition, seed in pairs], folder)
    found = [outcome(c, seed, r, a) for (c, seed), r in zip(pairs, runs, strict=True)]
    result = Result(STUDY, simulated=True, seeds=list(seeds))
    result.table = [row(o, a) for o in found]
    result.claims = claims(found, a)
    picture = folder / "peg-in-hole.png"
    _draw(picture, list(zip(found, runs, strict=True)), a)
    result.files = [str(picture), *(str(r.file) for r in runs)]
    return result


def line(condition: Condition, a: dict[str, Any]) -> float:
    """Returns the robot's payload, N."""
    return float(a[f"payload_{condition.robot}"] * GRAVITY)


def row(o: Outcome, a: dict[str, Any]) -> dict[str, Any]:
    """Returns a row of the table."""
    fails = o.condition is KAIROS_BARE
    paper = {"moca": "inserted, below the line", "kairos": "above the line, stopped" if fails else ""}
    return {
        "robot": o.condition.label, "seed": o.seed, "inserted": "yes" if o.inserted else "no",
        "withdrew": "yes" if o.withdrew else "no", "depth mm": 1e3 * o.depth, "largest force N": o.force,
        "mean force N": o.mean_force,
        "payload N": line(o.condition, a), "stop": o.cause or "none",
        "stop s": o.stopped_at, "missed": o.missed, "paper": paper[o.condition.robot],
    }  # fmt: skip


def claims(found: list[Outcome], a: dict[str, Any]) -> list[Claim]:
    """Returns the claims. Every seed must confirm a claim; the figure is that of the worst seed."""

    def of(condition: Condition) -> list[Outcome]:
        return [o for o in found if o.condition is condition]

    moca, bare, kairos, soft = of(MOCA), of(MOCA_BARE), of(KAIROS_BARE), of(COMPLIANT)
    light, heavy = line(MOCA, a), line(COMPLIANT, a)
    return [
        Claim(
            id="moca-inserts", text="MOCA inserts the peg and withdraws it", paper="yes (Fig. 11a)",
            measured=float(sum(o.withdrew for o in moca)), unit=f"of {len(moca)} runs",
            holds=bool(moca) and all(o.withdrew for o in moca),
        ),
        Claim(
            id="moca-force-below-payload", text=f"MOCA's largest external force is below {light:.1f} N",
            paper="below the line (Fig. 11a)", measured=_extreme(max, moca), unit="N",
            holds=bool(moca) and all(o.force < light for o in moca),
        ),
        Claim(
            id="moca-as-published", text=f"MOCA without leash and tank does both, below {light:.1f} N",
            paper="yes (Fig. 11a)", measured=_extreme(max, bare), unit="N",
            holds=bool(bare) and all(o.withdrew and o.force < light for o in bare),
        ),
        Claim(
            id="kairos-exceeds-payload", text=f"Kairos as published exceeds {heavy:.0f} N and is stopped",
            paper="yes (Fig. 11b)", measured=_extreme(min, kairos), unit="N",
            holds=bool(kairos) and all(o.force > heavy and o.cause == "device fault" for o in kairos),
        ),
        Claim(
            id="kairos-compliant-inserts", text=f"Kairos with force feedback inserts and withdraws below {heavy:.0f} N",
            paper="", measured=_extreme(max, soft), unit="N",
            holds=bool(soft) and all(o.withdrew and o.force < heavy for o in soft),
        ),
    ]  # fmt: skip


# The changes of `sweep`: one assumption at a time, and those that together make the contact hard.
_HARD: Final = {"contact": 1e6, "diameter": 0.0304}
SWEEP: Final[tuple[dict[str, float], ...]] = (
    {"contact": 1e4}, {"contact": 2e5}, {"contact": 1e6},
    {"diameter": 0.0304}, {"diameter": 0.032},
    {"friction": 0.1}, {"friction": 0.4},
    {"push": 8.0}, {"push": 30.0},
    {"stiffness": 100.0}, {"stiffness": 400.0},
    {"drives": 0.25}, {"drives": 4.0},
    {"force_limit": 157.0}, {"force_limit": 400.0},
    _HARD, _HARD | {"friction": 0.4, "stiffness": 400.0},
)  # fmt: skip
_KAIROS_ONLY: Final = {"drives", "force_limit"}


def sweep(folder: Path, conditions: tuple[Condition, ...] = (MOCA, KAIROS_BARE, COMPLIANT)) -> list[dict[str, Any]]:
    """Shows how the largest force depends on the assumptions, with the first seed.

    Returns rows: the change, robot, whether it inserted and withdrew, N, the stop.
    """
    base = assumed(STUDY)
    seed = base["seeds"][0]
    cases: list[tuple[str, Condition, dict[str, Any]]] = [("no force feedback", KAIROS, base)]
    for changed in SWEEP:
        label = " ".join(f"{name} {value:g}" for name, value in changed.items())
        for condition in conditions:
            if condition.robot == "kairos" or not _KAIROS_ONLY & changed.keys():
                cases.append((label, condition, base | changed))
    tasks = [task(c, seed, a, f"sweep {label} {c.label}") for label, c, a in cases]
    rows = []
    for (label, condition, a), done in zip(cases, run_all(tasks, folder), strict=True):
        rows.append({"changed": label} | row(outcome(condition, seed, done, a), a))
    return rows


def _draw(path: Path, pairs: list[tuple[Outcome, Run]], a: dict[str, Any]) -> None:
    """Draws the force over time and the height of the peg's tip, for the first seed, as in Fig. 11."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    seed = pairs[0][0].seed
    shown = [(o, r) for o, r in pairs if o.seed == seed and o.condition in (MOCA, KAIROS_BARE, COMPLIANT)]
    figure, axes = plt.subplots(2, len(shown), figsize=(4.4 * len(shown), 6), sharex="col", squeeze=False)
    for column, (o, r) in enumerate(shown):
        t, top, low = r.t, axes[0, column], axes[1, column]
        force: Array = np.linalg.norm(r.value("world.hole_force"), axis=1)
        means = np.linalg.norm(smoothed(r.value("world.hole_force"), t, a["window"]), axis=1)
        top.plot(t, force, color="lightsteelblue", linewidth=0.5, label="each step")
        top.plot(t, means, color="tab:blue", linewidth=0.8, label=f"mean over {1e3 * a['window']:g} ms")
        top.axhline(line(o.condition, a), color="tab:red", linestyle="--", label="payload")
        top.set_title(f"{o.condition.label}\n{o.force:.0f} N, " + (f"stopped: {o.cause}" if o.cause else "no stop"))
        top.set_ylabel("external force, N")
        top.legend(loc="upper left")
        hole = np.array(a[f"hole_{o.condition.robot}"])
        desired, actual = r.value("guide.pose")[:, :3], r.value("tool.pose")[:, :3]
        tip = r.value("world.person_tool")
        lever = tip - actual
        for k, (axis, colour) in enumerate(zip("xyz", ("tab:orange", "tab:green", "tab:purple"), strict=True)):
            on = r.word("state") > 1
            low.plot(t[on], (tip[on, k] - hole[k]) * 1e3, color=colour, linewidth=1.0, label=axis)
            low.plot(
                t[on], (desired[on, k] + lever[on, k] - hole[k]) * 1e3, color=colour, linestyle="--", linewidth=0.7
            )
        low.axhline(0.0, color="black", linestyle=":", linewidth=0.8)
        if o.stopped_at is not None:
            for each in (top, low):
                each.axvline(o.stopped_at, color="grey", linewidth=0.8)
        low.set_ylim(-120, 120)
        low.set_xlabel("time, s")
        low.set_ylabel("peg's tip from the hole's mouth, mm\n(dashed: desired)")
        low.legend(loc="upper right", ncols=3)
    figure.suptitle(f"Peg in hole, simulated (seed {seed})")
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _extreme(which: Callable[..., float], outcomes: list[Outcome]) -> float | None:
    """Returns the greatest or least force, N; None if there was no such run."""
    return which(o.force for o in outcomes) if outcomes else None
