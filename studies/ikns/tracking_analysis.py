"""What the rows of the tracking experiment say: claims, the table beside the paper's, tests, and the figure."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure

from srl.runtime.contracts.signals import Array
from srl.studies.ikns.curves import KINDS, SECONDS, curve
from srl.studies.ikns.published import PAIRED_T, RMSE, SHAPIRO_WILK
from srl.studies.result import Claim
from srl.studies.toolkit.statistics import interval, paired_t, shapiro_wilk, summary, tost

Rows = Sequence[Mapping[str, Any]]
MARGIN: Final = 1.0  # % of the greatest value: two conditions that differ by less are taken as equivalent
STILL: Final = 0.020  # m
_SUBJECTS: Final = 10  # of the paper
_STUDENT: Final = 2.262  # 97.5th percentile with 9 degrees of freedom: of the paper's ten subjects
_COLORS: Final = {"ikns": "#D55E00", "gamepad": "#0072B2"}


def analysed(rows: Mapping[str, Rows], *, simulated: bool) -> tuple[list[Claim], list[dict[str, Any]], dict[str, Any]]:
    """Judges the claims by the first model's rows, and tabulates all.

    Args:
        rows: of each model of the wearer, the headline first; for people one entry alone.
        simulated: where they come from, for the claims' words.
    """
    left_out = {model: incomplete(own) for model, own in rows.items()}
    rows = {model: [row for row in own if row["wearer"] not in left_out[model]] for model, own in rows.items()}
    table = [line for model, own in rows.items() for line in _table(model, own)]
    headline = next(iter(rows.values()))
    subjects = sorted({str(row["wearer"]) for row in headline})
    if len(subjects) < 3:  # nothing can be tested
        return [], table, {"subjects": subjects, "left_out": left_out}
    words = f"{len(subjects)} {'simulated wearers' if simulated else 'people'}"
    if lacking := left_out[next(iter(rows))]:
        words += f" ({len(lacking)} left out, who lack trials)"
    statistics: dict[str, Any] = {"subjects": subjects, "left_out": left_out, "margin": MARGIN}
    for model, own in rows.items():
        statistics[model] = _tests(own)
    claims = [*_levels(headline, words), _order(headline, words), _same(statistics[next(iter(rows))], words),
              _still(headline, words)]  # fmt: skip
    return claims, table, statistics


def incomplete(rows: Rows) -> list[str]:
    """The subjects who lack a trial that others have: who is compared with whom must not depend on what is missing."""
    counts = Counter((str(row["wearer"]), str(row["condition"]), str(row["curve"])) for row in rows)
    kinds = {kind[1:] for kind in counts}
    subjects = sorted({kind[0] for kind in counts})
    most = max(counts.values(), default=0)
    return [who for who in subjects if any(counts[who, *kind] < most for kind in kinds)]


def means(rows: Rows, condition: str, name: str | None = None, what: str = "rmse") -> Array:
    """(n,) each subject's mean of a column, subjects in the order of their names; `name`: of one curve."""
    own: dict[str, list[float]] = {}
    for row in rows:
        if row["condition"] == condition and name in (None, row["curve"]):
            own.setdefault(str(row["wearer"]), []).append(float(row[what]))
    return np.array([np.mean(own[subject]) for subject in sorted(own)])


def _table(model: str, rows: Rows) -> list[dict[str, Any]]:
    found = []
    for condition in sorted({str(row["condition"]) for row in rows}, reverse=True):
        for name in KINDS:
            chosen = [row for row in rows if (row["condition"], row["curve"]) == (condition, name)]
            if not chosen:
                continue
            values = means(rows, condition, name)
            own, paper = summary(values), RMSE[condition, name]
            low, high = interval(values) if len(values) > 1 else (math.nan, math.nan)
            hand = {k: 1e3 * np.array([row[f"hand_{k}"] for row in chosen]) for k in ("rms", "p95", "max")}
            found.append({
                "model": model, "condition": condition, "curve": name, "n": own.n, "rmse": own.mean,
                "deviation": own.deviation, "low": low, "high": high, "paper": paper[0], "paper_deviation": paper[1],
                "mean_error": float(means(rows, condition, name, "mean_error").mean()),
                "hand_rms_mm": float(hand["rms"].mean()), "hand_p95_mm": float(hand["p95"].mean()),
                "hand_max_mm": float(hand["max"].max()),
                "worst_step": max(float(row["worst_step"]) for row in chosen),
                "outside": float(np.mean([row["outside"] for row in chosen])),
                "held": float(np.mean([row["held"] for row in chosen])),
            })  # fmt: skip
    return found


def _tests(rows: Rows) -> dict[str, Any]:
    """IKNS against gamepad: on subjects' means of all their trials, and as the paper did, curve by curve."""
    arm, pad = means(rows, "ikns"), means(rows, "gamepad")
    each = [np.concatenate([means(rows, condition, name) for name in KINDS]) for condition in ("ikns", "gamepad")]
    same = tost(arm, pad, MARGIN)
    found: dict[str, Any] = {
        "tost": vars(same), "paired_t": vars(paired_t(arm, pad)), "shapiro_wilk": vars(shapiro_wilk(arm - pad)),
        "interval": interval(arm - pad), "paired_t_as_published": vars(paired_t(each[0], each[1])),
        "shapiro_wilk_as_published": vars(shapiro_wilk(each[0] - each[1])),
    }  # fmt: skip
    found["by_curve"] = {
        name: {"difference": float((means(rows, "ikns", name) - means(rows, "gamepad", name)).mean()),
               "interval": interval(means(rows, "ikns", name) - means(rows, "gamepad", name))}
        for name in KINDS
    }  # fmt: skip
    return found


def _levels(rows: Rows, words: str) -> list[Claim]:
    claims = []
    for name in KINDS:
        mean, deviation = RMSE["ikns", name]
        reach = _STUDENT * deviation / math.sqrt(_SUBJECTS)
        own = float(means(rows, "ikns", name).mean())
        claims.append(Claim(
            id=f"rmse-{name.lower()}",
            text=f"IKNS, {name}: the mean of {words} lies within the 95 % interval of the paper's mean, "
            f"{mean - reach:.2f} to {mean + reach:.2f}",
            paper=f"{mean} +- {deviation}", measured=own, unit="%", holds=abs(own - mean) <= reach,
        ))  # fmt: skip
    return claims


def _order(rows: Rows, words: str) -> Claim:
    order = ("T2", "T3", "T1")
    two, three, one = (means(rows, "ikns", name) for name in order)
    lows = (interval(two - three)[0], interval(three - one)[0])
    return Claim(
        id="order-t2-t3-t1",
        text=f"IKNS: T2 is harder than T3, and T3 than T1: both differences' 95 % intervals are above 0; {words}; "
        "measured: the share of them with this order",
        paper=", ".join(f"{RMSE['ikns', name][0]:.2f}" for name in order),
        measured=100.0 * float(np.mean((two > three) & (three > one))), unit="%", holds=min(lows) > 0.0,
    )  # fmt: skip


def _same(tests: Mapping[str, Any], words: str) -> Claim:
    same, paired, normal = tests["tost"], tests["paired_t"], tests["shapiro_wilk"]
    return Claim(
        id="no-difference-from-gamepad",
        text=f"the means of IKNS and gamepad differ by less than {MARGIN:g}: TOST on the means of {words}, p = "
        f"{same['p']:.2g}, 90 % interval {same['low']:.2f} to {same['high']:.2f} (paired t({paired['freedom']}) = "
        f"{paired['t']:.2f}, p = {paired['p']:.2g}; Shapiro-Wilk p = {normal['p']:.2g})",
        paper=f"paired t({PAIRED_T['freedom']}) = {PAIRED_T['t']}, p = {PAIRED_T['p']}; Shapiro-Wilk p = "
        f"{SHAPIRO_WILK}",
        measured=same["difference"], unit="%", holds=bool(same["equivalent"]),
    )  # fmt: skip


def _still(rows: Rows, words: str) -> Claim:
    arm = [row for row in rows if row["condition"] == "ikns"]
    rms, p95, most = (1e3 * np.array([row[f"hand_{k}"] for row in arm]) for k in ("rms", "p95", "max"))
    return Claim(
        id="hand-still",
        text=f"IKNS: in every trial of {words} the hand's distance from its mean place has a 95th percentile below "
        f"{1e3 * STILL:.0f} mm; measured: the largest (mean rms {rms.mean():.1f}, mean 95th percentile "
        f"{p95.mean():.1f}, largest of all {most.max():.1f} mm)",
        paper="the hand doesn't move; no figure", measured=float(p95.max()), unit="mm",
        holds=bool(p95.max() < 1e3 * STILL),
    )  # fmt: skip


def figure(rows: Rows, file: Path, title: str) -> None:
    """Draws as the paper's Fig. 3: above, the curve and the trial with the median RMSE; below, the mean absolute error
    of all trials over time, IKNS and gamepad."""
    picture = Figure(figsize=(12, 6), layout="constrained")
    axes = picture.subplots(2, len(KINDS), sharex=True, sharey="row")
    picture.suptitle(f"Tracking ({title})")
    for column, name in enumerate(KINDS):
        above, below = axes[:, column]
        fine = np.linspace(0.0, SECONDS, 501)
        above.plot(fine, 100.0 * curve(name, fine), color=_COLORS["gamepad"], label="displayed")
        for condition, color in _COLORS.items():
            chosen = sorted(
                (row for row in rows if (row["condition"], row["curve"]) == (condition, name)), key=lambda r: r["rmse"]
            )
            if not chosen:
                continue
            paths = [100.0 * np.array(json.loads(row["path"])) for row in chosen]
            t = np.linspace(0.0, SECONDS, len(paths[0]) + 1)[1:]
            if condition == "ikns":
                label = f"pointer, IKNS ({chosen[len(chosen) // 2]['wearer']})"
                above.plot(t, paths[len(chosen) // 2], color=color, label=label)
            error = np.abs(np.array(paths) - 100.0 * curve(name, t))
            below.plot(t, error.mean(axis=0), color=color, label="IKNS" if condition == "ikns" else condition)
        above.set_title(name)
        above.set_ylim(0.0, 100.0)
        below.set_xlabel("s")
        for axis in (above, below):
            axis.grid(alpha=0.3)
            axis.legend(loc="upper right", fontsize=8)
    axes[1, 0].set_ylim(bottom=0.0)
    axes[0, 0].set_ylabel("control value, %")
    axes[1, 0].set_ylabel("mean absolute error, %")
    picture.savefig(file, dpi=110)
