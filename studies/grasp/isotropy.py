"""Does a sixth finger make a better grasp? The numerical study of Prattichizzo et al. 2014 (III), and its limits.

A hand closes around spheres, cubes and pipes, alone and with the extra finger that the mapping moves. Everything is
geometry: the profile's hand, finger and law, moved without time until they touch.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any, Final

import numpy as np

from srl.studies.grasp.closing import CLOSINGS
from srl.studies.grasp.isotropy_analysis import as_radius, claims, records, statistics, table
from srl.studies.grasp.isotropy_figure import figure
from srl.studies.grasp.isotropy_trial import AUGMENTED, PROFILE, TRIAL
from srl.studies.grasp.scenes import write
from srl.studies.grasp.things import SHAPES, SIZES, Shape
from srl.studies.result import Result
from srl.studies.tasks.runner import Runner
from srl.studies.tasks.task import TrialTask

STUDY: Final = "grasp-isotropy"
PLACEMENTS: Final = 12  # of each object
_ROUND: Final[tuple[Shape, ...]] = ("sphere", "cylinder")
_SHOWN: Final = (0.06, 0.08, 0.10, 0.12)  # m, sizes of the recording
_QUICK: Final = ((0.06, 0.10), 1)  # sizes and placements
_SWEPT: Final = ((0.06, 0.08, 0.10, 0.12), 4)
_MOUNTED: Final = (0.0, -0.020, -0.030)  # m, as in the profile
_TURNED: Final = (0.5, -0.5, 0.5, 0.5)  # w x y z, as in the profile
_BESIDE: Final = 0.020  # m, of each of two fingers from where one would be; a module is 33 mm wide
_LINKS: Final = (0.035, 0.042, 0.050)  # m; the profile's is the second


def run(folder: Path, quick: bool, runner: Runner) -> Result:
    """The whole study, with sizes as diameters and as radii; `quick`: two sizes, one placement of each."""
    sizes, placements = _QUICK if quick else (SIZES, PLACEMENTS)
    tasks = [*trials(sizes, placements)]
    doubled = [2 * size for size in sizes if 2 * size not in sizes]
    tasks += trials(doubled, placements, shapes=_ROUND)
    rows = runner.rows(tasks, folder)
    found = records([row for row in rows if row.task.parameters["size"] in sizes])
    by_radius = as_radius(records(rows), sizes)
    words: dict[str, Any] = {"unusable": sum(row.done and not row.values["usable"] for row in rows)}
    words |= {**statistics(found), "sizes are radii": statistics(by_radius)}
    (folder / "statistics.json").write_text(json.dumps(words, indent=1) + "\n", encoding="utf-8")
    pictures = []
    for closing, (end, chosen) in product(CLOSINGS, {"": found, "-radius": by_radius}.items()):
        pictures.append(f"isotropy-{closing}{end}.png")
        figure([one for one in chosen if one["closing"] == closing], folder / pictures[-1], closing, bool(end))
    write(folder / "grasps.rrd", tasks[0].text, _SHOWN[:1] if quick else _SHOWN, quick)
    files = [*pictures, "grasps.rrd", "statistics.json", "rows.parquet"]
    said = claims(found) + claims(by_radius, "radius-")
    return Result(STUDY, True, list(range(placements)), said, table(found) + table(by_radius, "radius"), files)


def trials(
    sizes: Iterable[float],
    placements: int,
    changes: Mapping[str, Any] | None = None,
    grasps: Sequence[str] = AUGMENTED,
    shapes: Iterable[Shape] = SHAPES,
) -> Iterator[TrialTask]:
    """The trials of these sizes, m, with the same placements for each. `changes`: of the profile, by key path."""
    for shape in shapes:
        for size in sizes:
            for seed in range(placements):
                given = {
                    "shape": shape, "size": size, "set": dict(changes or {}), "grasps": list(grasps),
                    "closings": list(CLOSINGS),
                }  # fmt: skip
                yield TrialTask.of(STUDY, TRIAL, seed, given, profile=PROFILE)


def sweep(folder: Path, runner: Runner) -> list[dict[str, Any]]:
    """Changes fingers, hand and law one at a time; means over all shapes, four sizes, four placements."""
    asked = {label: [*trials(*_SWEPT, changes=changed, grasps=["whole"])] for label, changed in _changes()}
    found = []
    for label, rows in runner.by_label(asked, folder / "sweep").items():
        kept = records(rows)
        entry: dict[str, Any] = {"changed": label, "usable": len({(r["shape"], r["size"], r["seed"]) for r in kept})}
        for closing in CLOSINGS:
            chosen = [one for one in kept if one["closing"] == closing]
            for seen in ("measured", "intended"):
                entry[f"touch {closing} {seen}"] = float(np.mean([r[f"whole_{seen}_touch"] > 0 for r in chosen]))
            gain = [r["whole_measured_gii_l"] - r["human_gii_l"] for r in chosen]
            entry[f"gain {closing} measured"] = float(np.mean(gain))
            for measure in ("closed", "epsilon"):
                entry[f"{measure} {closing} measured"] = float(
                    np.mean([r[f"whole_measured_{measure}"] for r in chosen])
                )
        found.append(entry)
    return found


def _changes() -> Iterator[tuple[str, dict[str, Any]]]:
    """What is changed: in words, and by key path."""
    yield "nothing", {}
    for axis, name in enumerate(("to the little finger", "distal", "dorsal")):
        for shift in (-0.020, 0.020):
            position = [*_MOUNTED]
            position[axis] += shift
            yield f"worn {1e3 * shift:+.0f} mm {name}", {"frames.finger.position": position}
    for link in (_LINKS[0], _LINKS[2]):
        rows = [[np.pi / 2, 0.015], *([0.0, link] for _ in range(3))]
        yield f"links of {1e3 * link:.0f} mm", {"models.finger.rows": rows}
    for home in ((0.0, 0.0, 0.0), (20.0, 20.0, 20.0), (60.0, 30.0, 30.0)):
        servos = {f"devices.finger.servos.flexion_{i}.home": float(np.deg2rad(d)) for i, d in enumerate(home, 1)}
        yield "home of " + "/".join(f"{d:.0f}" for d in home) + " degrees", servos
    for length in (0.17, 0.21):
        yield f"a hand of {1e3 * length:.0f} mm", {"models.hand.length": length}
    for deformation in ("non-isotropic", "shear"):
        yield f"a {deformation} object", {"controllers.1.deformation": deformation}
    yield f"two fingers {2e3 * _BESIDE:.0f} mm apart", _two()


def _two() -> dict[str, Any]:
    """A second finger like the first. The board turns the first's joints; the cell moves both."""
    servos = ("abduction", "flexion_1", "flexion_2", "flexion_3")
    return {
        "frames.finger.position": [-_BESIDE, *_MOUNTED[1:]],
        "frames.second": {"parent": "hand", "position": [_BESIDE, *_MOUNTED[1:]], "quaternion": [*_TURNED]},
        "sim.parts.second": {"part": "robotic-finger"},
        "sim.devices.finger.joints": {servo: f"finger_{servo}" for servo in servos},
    }
