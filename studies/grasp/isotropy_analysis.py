"""What the grasps of `grasp-isotropy` say: the claims by unit and condition, and the table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import isfinite, nan
from typing import Any, Final

import numpy as np

from srl.runtime.contracts.signals import Array
from srl.studies.grasp.closing import CLOSINGS, Closing
from srl.studies.grasp.isotropy_trial import SEEN, UNITS
from srl.studies.grasp.things import SHAPES
from srl.studies.result import Claim
from srl.studies.tasks.task import Row
from srl.studies.toolkit.statistics import interval, proportion

Record = Mapping[str, Any]
HEADLINE: Final[tuple[Closing, str]] = ("converge", "measured")
"""The condition of the claims: tips go to the object, and the mapping sees the hand as a glove does. See the table."""
_UNIT: Final = {"l": "torques by the object's length", "mm": "torques in N mm", "m": "torques in N m"}
_SUFFIX: Final = {"l": "", "mm": "-mm", "m": "-m"}
_LARGE: Final = 0.09  # m: larger ones are the larger half of the study's sizes
_SAME: Final = 1e-9  # of an isotropy: less isn't a difference
_NONE: Final = (nan, nan, nan)


def records(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """One entry for each usable placement and closing law: `shape`, `size`, `seed`, `closing`, and its measures."""
    found = []
    for row in rows:
        if row.done and row.values["usable"]:
            given = row.task.parameters
            for closing in given["closings"]:
                start = f"{closing}_"
                own = {name.removeprefix(start): v for name, v in row.values.items() if name.startswith(start)}
                head = {"shape": given["shape"], "size": given["size"], "seed": row.task.seed, "closing": closing}
                found.append(head | own)
    return found


def as_radius(found: Sequence[Record], sizes: Sequence[float]) -> list[dict[str, Any]]:
    """The entries with spheres and pipes of these sizes (m) as radii, and cubes of them as edges."""
    sized = [{**one, "size": one["size"] / (1 if one["shape"] == "cube" else 2)} for one in found]
    return [one for one in sized if any(abs(one["size"] - size) < 1e-9 for size in sizes)]


def claims(found: Sequence[Record], start: str = "") -> list[Claim]:
    """The paper's claims in the headline's condition, by unit, and ours about chance. The others: `statistics`.

    `start`: of the claims' names.
    """
    closing, seen = HEADLINE
    return [
        Claim(
            id=f"{start}{name}", text=f"{text} (95 %: {low:.3g} to {high:.3g})", paper=paper,
            measured=value if isfinite(value) else None, unit=unit, holds=low > bound,
        )
        for name, text, paper, unit, bound, (value, low, high) in _findings(_of(found, closing), seen)
        if paper or name.startswith("finger-beats-chance")
    ]  # fmt: skip


def statistics(found: Sequence[Record]) -> dict[str, Any]:
    """Every claim's figure with its interval in every condition: by closing law, and by what the mapping sees."""
    out: dict[str, Any] = {}
    for closing in CLOSINGS:
        for seen in SEEN:
            out[f"{closing}, {seen}"] = {
                name: {"value": _plain(value), "low": _plain(low), "high": _plain(high), "holds": low > bound}
                for name, _, _, _, bound, (value, low, high) in _findings(_of(found, closing), seen)
            }
    return out


def _findings(
    chosen: Sequence[Record], seen: str
) -> Iterator[tuple[str, str, str, str, float, tuple[float, float, float]]]:
    """Claims' id, text, the paper's words, unit, the value that the interval must be above; value, low, high."""
    size = np.array([one["size"] for one in chosen])
    touch, part = (_touch(chosen, grasp, seen) for grasp in ("whole", "partial"))

    def gii(grasp: str, unit: str) -> Array:
        name = f"human_gii_{unit}" if grasp == "human" else f"{grasp}_{seen}_gii_{unit}"
        return np.array([one[name] for one in chosen], dtype=float)

    for unit in UNITS:
        human, whole, partial, every = (gii(g, unit) for g in ("human", "whole", "partial", "partial_all"))
        gain, end, words = whole - human, _SUFFIX[unit], _UNIT[unit]
        yield (
            f"finger-improves-gii{end}", f"the finger raises GII, {words}: mean gain", "improves it",
            "1", 0.0, _mean(gain),
        )  # fmt: skip
        yield (
            f"finger-improves-gii-touching{end}", f"the same where the finger touches, {words}", "",
            "1", 0.0, _mean(gain[touch]),
        )  # fmt: skip
        yield (
            f"more-for-large-objects{end}", f"the gain grows with the object, {words}", "in particular for large ones",
            "1 per 100 mm", 0.0, _slope(size, gain),
        )  # fmt: skip
        yield (
            f"more-for-large-objects-touching{end}", f"the same where the finger touches, {words}", "",
            "1 per 100 mm", 0.0, _slope(size[touch], gain[touch]),
        )  # fmt: skip
        some = touch & (human > _SAME)
        yield (
            f"more-for-large-objects-ratio{end}",
            f"the ratio of GII with and without the finger grows with the object, where it touches, {words}", "",
            "log10 per 100 mm", 0.0, _slope(size[some], np.log10(whole[some] / human[some])),
        )  # fmt: skip
        yield (
            f"partial-below-whole{end}", f"with thumb and index inactive GII is below the whole hand's, {words}",
            "slightly lower", "1", 0.0, _mean(whole - partial),
        )  # fmt: skip
        yield (
            f"partial-below-whole-all-close{end}", f"the same if thumb and index close as well, {words}", "",
            "1", 0.0, _mean(whole - every),
        )  # fmt: skip
        yield (
            f"partial-above-human{end}", f"GII with thumb and index inactive is above the bare hand's, {words}",
            "generally higher", "of placements", 0.5, _share(partial > human + _SAME),
        )  # fmt: skip
        yield (
            f"partial-above-human-touching{end}", f"the same where the finger touches, {words}", "",
            "of placements", 0.5, _share((partial > human + _SAME)[part]),
        )  # fmt: skip
        for label, kept in (("small", size <= _LARGE), ("large", size > _LARGE)):
            yield (
                f"partial-above-human-touching-{label}{end}",
                f"the same on objects {'of more than' if label == 'large' else 'up to'} {1e3 * _LARGE:.0f} mm, {words}",
                "", "of placements", 0.5, _share((partial > human + _SAME)[part & kept]),
            )  # fmt: skip
        yield (
            f"partial-above-human-all-close{end}", f"the same if thumb and index close as well, {words}", "",
            "of placements", 0.5, _share(every > human + _SAME),
        )  # fmt: skip
        if seen == "measured":
            better = np.array([one[f"human_better_{unit}"] for one in chosen], dtype=float)
            yield (
                f"finger-beats-chance{end}",
                f"where it touches, share in which it raises GII more than most contacts at random places, {words}", "",
                "of grasps", 0.5, _share(better[touch] > 0.5),
            )  # fmt: skip


def table(found: Sequence[Record], counted: str = "diameter") -> list[dict[str, Any]]:
    """Each condition as a whole; then the headline's shapes and sizes. GII by the object's length.

    `counted`: what the size of spheres and pipes is.
    """
    lines = [_line(_of(found, closing), closing, seen, "all", "all") for closing in CLOSINGS for seen in SEEN]
    closing, seen = HEADLINE
    sizes = sorted({one["size"] for one in found})
    for shape in SHAPES:
        for size in sizes:
            own = [one for one in _of(found, closing) if (one["shape"], one["size"]) == (shape, size)]
            lines.append(_line(own, closing, seen, shape, f"{1e3 * size:.0f}"))
    return [{"counted": counted, **line} for line in lines]


def _line(own: Sequence[Record], closing: str, seen: str, shape: str, size: str) -> dict[str, Any]:
    def mean(name: str) -> float | None:
        return float(np.mean([one[name] for one in own])) if own else None

    gain, low, high = _mean(np.array([one[f"whole_{seen}_gii_l"] - one["human_gii_l"] for one in own], dtype=float))
    return {
        "closing": closing, "seen": seen, "shape": shape, "size": size, "grasps": len(own),
        **{f"touch {g}": float(np.mean(_touch(own, g, seen))) if own else None for g in ("whole", "partial")},
        "human": mean("human_gii_l"), "whole": mean(f"whole_{seen}_gii_l"), "partial": mean(f"partial_{seen}_gii_l"),
        "all close": mean(f"partial_all_{seen}_gii_l"), "gain": _plain(gain), "low": _plain(low), "high": _plain(high),
        "random": mean("human_null_l"), "raised": mean("human_raised_l"),
        "closed": mean("human_closed"), "closed whole": mean(f"whole_{seen}_closed"),
        "epsilon": mean("human_epsilon"), "epsilon whole": mean(f"whole_{seen}_epsilon"),
        "contacts": mean("human_n"),
    }  # fmt: skip


def _of(found: Sequence[Record], closing: str) -> list[Record]:
    return [one for one in found if one["closing"] == closing]


def _touch(chosen: Sequence[Record], grasp: str, seen: str) -> Any:
    return np.array([one[f"{grasp}_{seen}_touch"] > 0 for one in chosen], dtype=bool)


def _mean(values: Array) -> tuple[float, float, float]:
    """A mean with Student's interval."""
    return _NONE if len(values) < 2 else (float(np.mean(values)), *interval(values))


def _share(values: Any) -> tuple[float, float, float]:
    """A share with its exact interval."""
    return (float(np.mean(values)), *proportion(int(np.sum(values)), len(values))) if len(values) else _NONE


def _slope(size: Array, values: Array) -> tuple[float, float, float]:
    """The slope of the line through values over sizes (m), per 100 mm, with Student's interval."""
    if len(set(size.tolist())) < 2 or len(size) < 3:
        return _NONE
    from scipy import stats

    line = stats.linregress(10.0 * size, values)
    reach = float(stats.t.ppf(0.975, len(size) - 2)) * float(line.stderr)
    return float(line.slope), float(line.slope) - reach, float(line.slope) + reach


def _plain(value: float) -> float | None:
    return value if isfinite(value) else None
