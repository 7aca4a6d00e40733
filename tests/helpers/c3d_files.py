"""C3D files written by the package `c3d`, which shares no code with ours or ezc3d; with plates, by ezc3d."""

from __future__ import annotations

import io
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import c3d
import numpy as np

from srl.runtime.contracts.signals import Array

LABELS = ("Anna:CLAV", "Anna:C7", "Anna:LASI")


def markers(n: int = 20) -> Array:
    """(n, 3, 3) m: three markers that move."""
    t = np.arange(n)[:, None, None] / 100.0
    return np.array([[0.1, 0.2, 1.4], [-0.1, 0.2, 1.5], [0.1, 0.3, 1.0]]) + 0.05 * np.sin(2.0 * t + np.arange(3))


def content(
    points: Array, labels: Sequence[str] = LABELS, rate: float = 100.0, unit: str = "mm", hidden: Array | None = None,
    screen: str = "",
) -> bytes:  # fmt: skip
    """A file's bytes. points (n, k, 3) m; hidden (n, k), where the residual is -1."""
    scale = {"mm": 1e3, "cm": 1e2}.get(unit, 1.0)
    writer = c3d.Writer(point_rate=rate, analog_rate=0.0, point_scale=-1.0, point_units=unit)
    if screen:
        writer.set_screen_axis("+X", screen)
    for i, frame in enumerate(points):
        rows = np.zeros((len(labels), 5), np.float32)
        rows[:, :3] = frame * scale
        if hidden is not None:
            rows[hidden[i], 3] = -1.0
        writer.add_frames([(rows, np.zeros((0, 0)))])
    writer.set_point_labels([label.ljust(32) for label in labels])
    out = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about the missing analog channels
        writer.write(out)
    return out.getvalue()


def with_plate(path: Path, points: Array, wrench: Array) -> None:
    """Writes a file with a force plate of type 2 whose z points down, and its reading (n, 6), N and N m."""
    import ezc3d

    made: Any = ezc3d.c3d()
    parameters, (n, k) = made["parameters"], points.shape[:2]
    parameters["POINT"]["RATE"]["value"], parameters["POINT"]["UNITS"]["value"] = [100.0], ["mm"]
    parameters["POINT"]["LABELS"]["value"] = [f"M{i}" for i in range(k)]
    data = np.ones((4, k, n))
    data[:3] = points.transpose(2, 1, 0) * 1e3
    made["data"]["points"] = data
    parameters["ANALOG"]["RATE"]["value"] = [100.0]
    parameters["ANALOG"]["LABELS"]["value"] = ["Fx", "Fy", "Fz", "Mx", "My", "Mz"]
    parameters["ANALOG"]["UNITS"]["value"] = ["N", "N", "N", "Nmm", "Nmm", "Nmm"]
    made["data"]["analogs"] = (wrench * [1, 1, 1, 1e3, 1e3, 1e3]).T[None]
    # Seen along its axes: y ahead, x to the left, so z is down.
    corners = np.array([[-200.0, 300, 0], [200, 300, 0], [200, -300, 0], [-200, -300, 0]]).T
    made.add_parameter("FORCE_PLATFORM", "CORNERS", corners[:, :, None])
    made.add_parameter("FORCE_PLATFORM", "ORIGIN", np.zeros((3, 1)))
    for name, values, shape in (
        ("USED", [1], [1]), ("TYPE", [2], [1]), ("ZERO", [1, 0], [2]), ("CHANNEL", [1, 2, 3, 4, 5, 6], [6, 1])
    ):  # fmt: skip
        whole = ezc3d.ezc3d.Parameter(name, "")
        whole.set(ezc3d.ezc3d.VecInt(values), ezc3d.ezc3d.VecUInt(shape))
        made["parameters"].add_parameter("FORCE_PLATFORM", whole)
    made.write(str(path))
