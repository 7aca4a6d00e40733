"""Joint angles of a recorded frame: our fit of both arms beside pycgm's whole Plug-in Gait.

They do different work: pycgm computes every joint of the body directly from the markers, ours fits 24 degrees of
freedom of the upper body and finds lost and swapped markers. Needs pycgm, c3d and the recording `vicon_plug_in_gait` in
$SRL_SHARED/data; without them there is nothing to measure.
"""

from __future__ import annotations

import os
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np

from bench.pairs import Row, measure, there_and_back
from srl.control.ikns.identify import Measures, identify, plug_in_gait
from srl.control.ikns.markers import MarkerFit
from srl.runtime.contracts.signals import Array
from srl.runtime.models.body import Side, average

_FRAMES: Final = 40
_STATURE: Final = 1.679  # m, of the recording's person
_MEASURES: Final[dict[Side, Measures]] = {  # m, the recording's own
    "left": Measures(0.050, 0.096, 0.061, 0.030),
    "right": Measures(0.050, 0.092, 0.065, 0.030),
}
_SHARED: Final = Path(__file__).resolve().parents[2] / "shared"


def run() -> list[Row]:
    """Compares them, or returns nothing where a part is missing."""
    folder = Path(os.environ.get("SRL_SHARED", _SHARED)) / "data" / "vicon_plug_in_gait"
    if not folder.is_dir() or find_spec("pyCGM_Single") is None or find_spec("c3d") is None:
        return []
    static, moving = _points(folder / "Static_trial.c3d"), _points(folder / "Movement_trial.c3d")
    io, static_of, cgm = (import_module(f"pyCGM_Single.{name}") for name in ("pycgmIO", "pycgmStatic", "pyCGM"))
    subject = static_of.getStatic(_rows(static), io.loadVSK(str(folder / "Test.vsk"), dict=False), flat_foot=False)
    rows = _rows(moving)[:_FRAMES]
    body, _ = identify(average(_STATURE), {n: 1e-3 * p for n, p in static.items()}, plug_in_gait(_MEASURES))
    fit, everything = MarkerFit(body), np.ones(len(body.markers), bool)
    points = 1e-3 * np.array([[row[name] for name in fit.names] for row in rows])
    if not all(fit.solve(points[0], everything, starts=6) for _ in range(20)):  # until its labels are sure
        raise RuntimeError("the recording's first frame doesn't fit its person")

    def ours() -> dict[str, float]:
        return there_and_back(lambda i: fit.solve(points[i], everything), _FRAMES)

    def theirs() -> dict[str, float]:
        return there_and_back(lambda i: cgm.JointAngleCalc(rows[i], subject), _FRAMES)

    pairs = measure(ours, {"pycgm": theirs})
    return [pairs.row("pycgm", "a recorded frame's angles, both arms", "p50", "pycgm", "us")]


def _points(file: Path) -> dict[str, Array]:
    """Points (frames, 3) mm of the named markers."""
    reader: Any = import_module("c3d")
    with file.open("rb") as opened:
        found = reader.Reader(opened)
        names = [label.strip().rpartition(":")[2] for label in found.point_labels]
        frames = np.array([points[:, :3] for _, points, _ in found.read_frames()], float)
    return {n: frames[:, i] for i, n in enumerate(names) if not n.startswith("*")}


def _rows(points: dict[str, Array]) -> list[dict[str, Array]]:
    return [{name: values[i] for name, values in points.items()} for i in range(len(points["CLAV"]))]
