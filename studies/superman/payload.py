"""The identified payload, beyond the paper: how fast contact stops, at what force, and how often without a cause.

Trials are tasks (`payload_trial`): guiding without contact, contact from above, beside and below at two
speeds and stiffnesses, and a load that falls. The law is the one of the profile `kairos-man`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.stats import chi2

from srl.studies.result import Claim, Result
from srl.studies.superman.assumptions import assumed
from srl.studies.tasks.runner import Runner
from srl.studies.tasks.task import Row, TrialTask

STUDY: Final = "payload"
PROFILE: Final = "kairos-man"
WHERE: Final = ("above", "beside", "below")
_QUICK: Final = (2, 5.0)  # seeds, s of guiding
# ISO/TS 15066:2016, table A.2: quasi-static force on a hand, N. It isn't known what will be hit.
HAND: Final = 140.0
_GONE: Final = 0.05  # s
_RARE: Final = 1.0  # false stops an hour, upper bound, that would be acceptable; ours
_LEVEL: Final = 0.95


def run(folder: Path, quick: bool, runner: Runner) -> Result:
    """Runs all trials; `quick`: two loads, five seconds of guiding."""
    setup = assumed(STUDY)
    seeds, seconds = _QUICK if quick else (setup["seeds"], setup["seconds"])
    rows = runner.done(list(tasks(setup, range(1, seeds + 1), seconds)), folder / "trials")
    result = Result(STUDY, simulated=True, seeds=list(range(1, seeds + 1)))
    result.claims, result.table = claims(rows), table(rows)
    return result


def tasks(setup: Mapping[str, Any], seeds: Iterable[int], seconds: float) -> Iterable[TrialTask]:
    """The trials of all loads."""
    for seed in seeds:
        yield _task("guide", seed, {"setup": setup, "seconds": seconds})
        yield _task("drop", seed, {"setup": setup})
        for where in WHERE:
            for speed in setup["speeds"]:
                for stiffness in setup["stiffness"]:
                    hit = {"where": where, "speed": speed, "stiffness": stiffness}
                    yield _task("contact", seed, {"setup": setup, **hit})


def _task(kind: str, seed: int, parameters: Mapping[str, Any]) -> TrialTask:
    return TrialTask.of(STUDY, f"{STUDY}-{kind}", seed, parameters, profile=PROFILE)


def of(rows: Sequence[Row], kind: str, **parameters: Any) -> list[Mapping[str, Any]]:
    """The values of the trials of one kind."""
    return [
        row.values
        for row in rows
        if row.task.trial == f"{STUDY}-{kind}" and all(row.task.parameters[k] == v for k, v in parameters.items())
    ]


def claims(rows: Sequence[Row]) -> list[Claim]:
    """Ours: the paper has no such law."""
    guided, hits, drops = of(rows, "guide"), of(rows, "contact"), of(rows, "drop")
    slow = of(
        rows, "contact", speed=min(row.task.parameters["speed"] for row in rows if "speed" in row.task.parameters)
    )
    often = upper(sum(g["stops"] for g in guided), sum(g["hours"] for g in guided))
    missed = sum(hit["stopped"] is None for hit in hits)
    hardest = max((float(hit["peak"]) for hit in slow), default=float("nan"))
    longest = max((np.inf if d["gone"] is None else float(d["gone"]) for d in drops), default=float("nan"))
    within = float(np.mean([abs(g["mass_error"]) <= 2 * g["deviation"] for g in guided])) if guided else float("nan")
    return [
        Claim(
            id="false-stops", text=f"guiding stops falsely at most {_RARE:g} times an hour (95 %)", paper="",
            measured=often, unit="1/h", holds=often <= _RARE,
        ),
        Claim(
            id="contact-stops", text="every contact beyond the load stops the limb", paper="",
            measured=float(missed), unit="missed", holds=bool(hits) and missed == 0,
        ),
        Claim(
            id="slow-contact-below-hand", text=f"at the lower speed no contact presses with more than {HAND:g} N",
            paper="", measured=hardest, unit="N", holds=hardest <= HAND,
        ),
        Claim(
            id="drop-seen", text=f"of a dropped load less than a tenth is left after {1e3 * _GONE:g} ms", paper="",
            measured=longest, unit="s", holds=longest <= _GONE,
        ),
        Claim(
            id="mass-as-stated", text="the mass is within two stated deviations in 95 % of the loads", paper="",
            measured=within, unit="share", holds=within >= _LEVEL,
        ),
    ]  # fmt: skip


def table(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """A line for guiding, one for each kind of contact, one for drops."""
    guided, drops = of(rows, "guide"), of(rows, "drop")
    lines: list[dict[str, Any]] = []
    if guided:
        hours = sum(g["hours"] for g in guided)
        lines.append(
            {
                "trial": "guided", "n": len(guided), "hours": hours, "false stops": sum(g["stops"] for g in guided),
                "false contacts": sum(g["contacts"] for g in guided),
                "stops an hour, at most": upper(sum(g["stops"] for g in guided), hours),
                "largest rest (N)": max(g["force"] for g in guided),
                "largest rest (N m)": max(g["torque"] for g in guided),
                "mass error, RMS (kg)": float(np.sqrt(np.mean([g["mass_error"] ** 2 for g in guided]))),
                "centre error, median (m)": float(np.median([g["com_error"] for g in guided])),
            }
        )  # fmt: skip
    kinds = sorted(
        {
            (row.task.parameters["speed"], row.task.parameters["stiffness"], row.task.parameters["where"])
            for row in rows
            if row.task.trial == f"{STUDY}-contact"
        }
    )
    for speed, stiffness, where in kinds:
        found = of(rows, "contact", where=where, speed=speed, stiffness=stiffness)
        stopped = [hit for hit in found if hit["stopped"] is not None]
        lines.append(
            {
                "trial": f"{where}, {speed:g} m/s, {stiffness:g} N/m", "n": len(found), "stopped": len(stopped),
                **spread("stops after (ms)", [1e3 * hit["stopped"] for hit in stopped]),
                **spread("force then (N)", [hit["force"] for hit in stopped]),
                **spread("largest force (N)", [hit["peak"] for hit in found]),
            }
        )  # fmt: skip
    if drops:
        seen = [1e3 * d["gone"] for d in drops if d["gone"] is not None]
        lines.append({"trial": "dropped", "n": len(drops), "seen": len(seen), **spread("gone after (ms)", seen)})
    return lines


def spread(name: str, values: Sequence[float]) -> dict[str, float | None]:
    """Median and largest of some values, None without any."""
    return {
        f"{name}, median": float(np.median(values)) if values else None,
        f"{name}, most": max(values) if values else None,
    }


def upper(events: int, hours: float) -> float:
    """The exact upper bound, at 95 %, of a Poisson rate (one-sided), 1/h."""
    return float(chi2.ppf(_LEVEL, 2 * (events + 1)) / (2 * hours)) if hours > 0 else float("inf")
