"""C3D files: markers of a motion capture system, and the wrenches of force plates. Read by ezc3d (extra `c3d`)."""

from __future__ import annotations

import io
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from srl.drivers.capture.axes import z_up_point
from srl.drivers.capture.c3d_process import FAILED, seconds
from srl.runtime.contracts import extras
from srl.runtime.contracts.errors import HostError, RecordingError
from srl.runtime.contracts.files import open_regular
from srl.runtime.contracts.signals import Array

MOST: Final = 1 << 28  # bytes that are read
_LENGTHS: Final = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
_FASTEST: Final = 10_000.0  # Hz
_FARTHEST: Final = 1e4  # m
_BLOCK: Final = 512  # bytes
_SGI: Final = 86  # the processor whose numbers have the high byte first
_UNCOUNTED: Final = 65535
_MAGIC: Final = 0x50  # the second byte of every C3D file


@dataclass(frozen=True)
class C3d:
    """A file's motion: n frames of k points.

    Attributes:
        labels: (k,) the points' names, with the subject before a colon where there is one: "Anna:LASI". Angles, forces
            and other quantities that the capture software puts among the points are left out.
        rate: Hz.
        points: (n, k, 3) m, z up; NaN where a point wasn't seen.
        plates: (n, p, 6) N and N m of each force plate at the frames' times, as the file means it (usually the ground's
            reaction), in the world's axes, about the middle of its surface: ezc3d's numbers. p may be 0.
    """

    labels: tuple[str, ...]
    rate: float
    points: Array
    plates: Array

    @property
    def subjects(self) -> tuple[str, ...]:
        """The subjects' names, in the order of their first points; "" for points without one."""
        return tuple(dict.fromkeys(label.rpartition(":")[0] for label in self.labels))

    def index(self, target: str) -> int:
        """The number of SUBJECT/MARKER; -1 if there is none, or several.

        The marker alone counts where no subject is named, and in a file that names none.
        """
        subject, _, marker = target.rpartition("/")
        if subject and any(self.subjects):
            wanted = f"{subject}:{marker}"
            return self.labels.index(wanted) if wanted in self.labels else -1
        found = [i for i, label in enumerate(self.labels) if label.rpartition(":")[2] == marker]
        return found[0] if len(found) == 1 else -1

    def trial(self, subject: str = "") -> Mapping[str, Array]:
        """(n, 3) m by marker, of one subject: what `srl.control.ikns.identify.identify` takes of a static trial."""
        return {
            label.rpartition(":")[2]: self.points[:, i]
            for i, label in enumerate(self.labels)
            if label.rpartition(":")[0] == subject
        }


def read(path: Path, up: Literal["y", "z"] | None = None) -> C3d:
    """Reads a file of two frames at least.

    Args:
        path: the file.
        up: the axis that points up; None: what the file says (POINT:Y_SCREEN), else z.
    Raises:
        RecordingError: with what was expected and the remedy.
        HostError: ezc3d isn't installed.
    """
    arrays = _arrays(path)
    rate, units = float(arrays["rate"]), "".join(arrays["units"].tolist()).strip().lower()
    if not 1.0 <= rate <= _FASTEST:
        raise RecordingError(str(path), f"a rate of {rate:g} Hz", f"Expected 1 to {_FASTEST:g}: correct POINT:RATE")
    if units not in _LENGTHS:
        problem = f"its unit of length is '{units[:20]}'"
        raise RecordingError(str(path), problem, f"Expected {', '.join(_LENGTHS)}: correct POINT:UNITS")
    points = np.asarray(arrays["points"], float)
    labels = [str(label).strip() for label in arrays["labels"]][: points.shape[1]]
    others = {str(label).strip() for label in arrays["others"]}
    kept = [i for i, label in enumerate(labels) if label and label not in others]
    labels, points, residuals = [labels[i] for i in kept], points[:, kept] * _LENGTHS[units], arrays["residuals"]
    if len(points) < 2 or not kept:
        problem = f"it has {len(points)} frame(s) of {len(kept)} named points"
        raise RecordingError(str(path), problem, "A motion needs two frames and a marker at least")
    if twice := [label for label in labels if labels.count(label) > 1]:
        problem = f"two of its points are called '{twice[0]}'"
        raise RecordingError(str(path), problem, "Give each its own name, or its subject's name before a colon")
    # Not seen: the residual says so, or all three are zero, as some programs write it.
    hidden = (residuals[:, kept] < 0) | (points == 0.0).all(axis=2) | ~np.isfinite(points).all(axis=2)
    points[hidden] = np.nan
    if hidden.all():
        raise RecordingError(str(path), "none of its points was ever seen", "Give a trial with labelled markers")
    if (far := np.nanmax(abs(points))) > _FARTHEST:
        raise RecordingError(str(path), f"a point {far:.3g} m away", "Is POINT:UNITS right?")
    plates = np.asarray(arrays.get("plates", np.zeros((len(points), 0, 6))), float)
    if (up or _up("".join(arrays["up"].tolist()))) == "y":
        points, plates = _z_up(points), np.concatenate([_z_up(plates[..., :3]), _z_up(plates[..., 3:])], axis=-1)
    return C3d(tuple(labels), rate, points, plates)


def _frames(head: bytes, processor: int) -> int:
    """How many frames a file's first block says; 0 where there are more than it can count.

    ezc3d takes what is there for all. `processor`: of the parameters' first block.
    """
    first, last = (int.from_bytes(head[i : i + 2], "big" if processor == _SGI else "little") for i in (6, 8))
    return 0 if last == _UNCOUNTED else last - first + 1


def _up(axis: str) -> str:
    """The axis that points up on the screen, of the file's word for it, such as "+Z"."""
    return "y" if axis.strip().upper() == "+Y" else "z"


def _z_up(vectors: Array) -> Array:
    x, y, z = z_up_point(np.moveaxis(vectors, -1, 0))  # type: ignore[arg-type]  # arrays for numbers
    return np.stack([x, y, z], axis=-1)


def _arrays(path: Path) -> dict[str, NDArray[Any]]:
    """What ezc3d finds in the file, in a process of its own."""
    if find_spec("ezc3d") is None:
        raise HostError(str(path), "this needs the package 'ezc3d'", extras.remedy("ezc3d"))
    try:
        with open_regular(path) as file:
            head = file.read(_BLOCK)
            file.seek((max(head[:1], b"\1")[0] - 1) * _BLOCK)
            parameters, size = file.read(4), file.seek(0, 2)
    except OSError as error:
        raise RecordingError(str(path), f"it can't be read ({error})", "Give a .c3d file") from error
    if len(head) < _BLOCK or head[1] != _MAGIC or len(parameters) < 4:
        raise RecordingError(str(path), "it doesn't begin as a C3D file", "Give a .c3d file")
    if size > MOST:
        raise RecordingError(str(path), f"it has more than {MOST >> 20} MiB", "Export a part, or fewer channels")
    command = [sys.executable, "-m", "srl.drivers.capture.c3d_process", str(path.absolute())]
    try:
        ended = subprocess.run(
            command, capture_output=True, stdin=subprocess.DEVNULL, timeout=4 * seconds(size), check=False
        )
    except OSError as error:
        raise HostError(
            str(path), f"its reader can't be started: {error.strerror}", "Look at the host's limits"
        ) from None
    except subprocess.TimeoutExpired:
        ended = None
    if ended is not None and ended.returncode == 0:
        try:
            with np.load(io.BytesIO(ended.stdout), allow_pickle=False) as arrays:
                found = dict(arrays)
        except ValueError:
            ended = None
        else:
            if (there := len(found["points"])) < (said := _frames(head, parameters[3])):
                problem = f"it has {there} of the {said} frames that its head says"
                raise RecordingError(str(path), problem, "It was cut short: export or copy it again")
            return found
    lines = ended.stderr.decode(errors="replace").strip().splitlines() if ended is not None else []
    why = lines[-1] if ended is not None and ended.returncode == FAILED and lines else "ezc3d can't read it"
    raise RecordingError(str(path), f"it is damaged or cut short ({why[:200]})", "Export or copy it again")
