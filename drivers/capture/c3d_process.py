"""Reads a C3D file with ezc3d in a process of its own: `python -m srl.drivers.capture.c3d_process FILE`.

ezc3d crashes or doesn't end on some damaged files. It writes an NPZ to its standard output; the reader is
`srl.drivers.capture.c3d`. Exit code 3: the file can't be read, with the reason on stderr.
"""

from __future__ import annotations

import os
import resource
import sys
from typing import Any, Final

import numpy as np

SECONDS: Final = 3.0  # of processor time, and more for a large file: half a second a MiB
_MEMORY: Final = 2 << 30  # bytes, and 16 for each of the file's
FAILED: Final = 3
_GROUPS: Final = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS")  # of POINT: names of points that are none


def seconds(size: int) -> float:
    """s of processor time for a file of so many bytes."""
    return SECONDS + 0.5 * size / (1 << 20)


def _limit(kind: int, most: int) -> None:
    soft, hard = resource.getrlimit(kind)
    least = min(value for value in (most, soft, hard) if value != resource.RLIM_INFINITY)
    resource.setrlimit(kind, (least, hard))


def _read(path: str) -> dict[str, Any]:
    import ezc3d

    try:
        file = ezc3d.c3d(path, extract_forceplat_data=True)
    except Exception:  # ezc3d refuses the whole file where it doesn't know a plate
        file = ezc3d.c3d(path)
    point, data = file["parameters"]["POINT"], file["data"]

    def values(group: Any, name: str) -> list[Any]:
        found = list(np.ravel(group[name]["value"])) if name in group else []
        # Of more than 255 names the others are in LABELS2, LABELS3, ...
        for number in range(2, 10):
            found += list(np.ravel(group[f"{name}{number}"]["value"])) if f"{name}{number}" in group else []
        return found

    made: dict[str, Any] = {
        "points": data["points"][:3].transpose(2, 1, 0),
        "residuals": data["meta_points"]["residuals"][0].T,
        "labels": np.array([str(name) for name in values(point, "LABELS")], dtype="U"),
        "others": np.array([str(name) for group in _GROUPS for name in values(point, group)], dtype="U"),
        "rate": np.array(float(np.ravel(point["RATE"]["value"])[0])),
        "units": np.array([str(unit) for unit in values(point, "UNITS")][:1], dtype="U"),
        "up": np.array([str(axis) for axis in values(point, "Y_SCREEN")][:1], dtype="U"),
    }
    subframes = data["analogs"].shape[2] // max(len(made["points"]), 1)
    plates = [p for p in data.get("platform", ()) if p["unit_force"] == "N" and p["unit_moment"] in ("Nmm", "Nm")]
    if plates and subframes and len(plates) == len(data["platform"]):
        scale = [1.0 if p["unit_moment"] == "Nm" else 1e-3 for p in plates]
        wrench = [np.vstack([p["force"], p["moment"] * s]) for p, s in zip(plates, scale, strict=True)]
        made["plates"] = np.stack([w.T[::subframes][: len(made["points"])] for w in wrench], axis=1)
    return made


def main(path: str) -> int:
    """Returns the exit code."""
    size = os.stat(path).st_size
    _limit(resource.RLIMIT_AS, _MEMORY + 16 * size)
    _limit(resource.RLIMIT_CPU, round(seconds(size)))
    _limit(resource.RLIMIT_CORE, 0)
    # ezc3d's own words go elsewhere: standard output is for the result.
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    try:
        made = _read(path)
    except ImportError:
        raise
    except Exception as error:
        print(" ".join(str(error).split())[:200] or type(error).__name__, file=sys.stderr)
        return FAILED
    with out:
        np.savez(out, **made)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
