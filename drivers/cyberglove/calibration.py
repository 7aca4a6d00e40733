"""Converts raw sensor bytes to joint angles and back, by a person's calibration (sheet cyberglove, §6).

The project's own file is YAML and lists every sensor of the glove by name:

    person: P07            # an anonymous id
    date: 2026-02-17
    hand: right
    sensors:
      thumb_roll: {points: [[69, 0.0], [131, 0.8], [198, 1.7]]}   # (raw byte, rad), a broken line
      wrist_yaw: {gain: 0.0091, offset: 128}                      # gain (rad) * (raw - offset)
      ...

Angles are anatomical, so that both hands give the same values: flexion is positive, abduction is positive when the
neighbours (or the thumb and the palm) are apart.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from datetime import date
from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, ValidationError, model_validator
from ruamel.yaml.error import YAMLError

from srl.drivers.cyberglove.protocol import LABELS
from srl.runtime.contracts import yaml_text
from srl.runtime.contracts.checksummed import HASH, ChangedError, opened
from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import ProfileError, nearest
from srl.runtime.contracts.files import KeptFile
from srl.runtime.contracts.glove_record import GloveRecord
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.validation import refusal

_RAW: Final = np.arange(256, dtype=float)
_Byte = Annotated[float, Field(ge=0, le=255)]
_Finite = Annotated[float, Field(allow_inf_nan=False)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Fit(_Part):
    """One sensor's characteristic: either `points` or `gain` and `offset`.

    Attributes:
        points: two or more (raw, rad), raw rising and rad strictly rising or falling; straight lines between them,
            and the outer lines continue beyond them.
        gain, offset: rad = gain (raw - offset); the gain isn't zero, the offset may be outside a byte's range.
    """

    points: Annotated[list[tuple[_Byte, _Finite]], Field(min_length=2)] | None = None
    gain: _Finite | None = None
    offset: _Finite | None = None

    @model_validator(mode="after")
    def _is_one_line(self) -> Fit:
        if self.points is None:
            if self.gain is None or self.offset is None:
                raise ValueError("needs points, or gain and offset")
            if self.gain == 0:
                raise ValueError("gain must not be 0")
        elif self.gain is not None or self.offset is not None:
            raise ValueError("has both points and gain or offset; give one")
        else:
            raw, rad = np.diff(np.array(self.points).T)
            if not np.all(raw > 0):
                raise ValueError("the points' raw values must rise")
            if not (np.all(rad > 0) or np.all(rad < 0)):
                raise ValueError("the points' angles must all rise or all fall")
        return self

    def angles(self) -> Array:
        """Returns (256,) rad: the angle of each raw byte."""
        if self.points is None:
            assert self.gain is not None
            assert self.offset is not None
            return self.gain * (_RAW - self.offset)
        raw, rad = np.array(self.points).T
        slope = np.diff(rad) / np.diff(raw)
        piece = np.clip(np.searchsorted(raw, _RAW) - 1, 0, len(slope) - 1)
        return rad[piece] + slope[piece] * (_RAW - raw[piece])


class _File(_Part):
    person: str = Field(pattern=r"^[A-Za-z0-9_-]{1,32}$")
    date: date
    hand: Literal["right", "left"]
    sensors: dict[str, Fit]


class Calibration:
    """A glove's calibration.

    Attributes:
        table: (n, 256) rad: the angle of each sensor at each raw byte; strictly monotonic in every row.
        note: a message for the user ("uncalibrated: ..."); empty for a calibrated glove.
        hand: "right" or "left"; None if the source doesn't say.
        person: anonymous id; empty if the source doesn't say.
        simulated: of a simulated glove.
    """

    def __init__(
        self, table: Array, *, note: str = "", hand: Literal["right", "left"] | None = None, person: str = "",
        simulated: bool = False,
    ) -> None:  # fmt: skip
        self.table = table
        self.note = note
        self.hand = hand
        self.person = person
        self.simulated = simulated
        rows = np.arange(len(table))
        self._angles = table.ravel()
        self._rows = rows * 256
        self._index = np.empty(len(table), dtype=np.intp)
        # For the inverse, row i is scaled to rise from 2 i at byte 1 to 2 i + 1 at byte 255. So the midpoints between
        # bytes, and between rows, form one rising sequence, and a single search in it finds all rows' bytes: byte b of
        # row i comes after 255 i + b - 1 of them.
        self._scale = 1.0 / (table[:, 255] - table[:, 1])
        self._shift = 2.0 * rows - table[:, 1] * self._scale
        self._lowest, self._highest = 2.0 * rows - 0.25, 2.0 * rows + 1.25
        halfway = (table[:, 1:-1] + table[:, 2:]) / 2.0 * self._scale[:, None] + self._shift[:, None]
        self._halfway = np.column_stack([halfway, 2.0 * rows + 1.5]).ravel()
        self._before = 255 * rows - 1
        self._angles_from_1 = table[:, 1:].ravel()

    def angles(self, raw: bytes, out: Array) -> None:
        """Writes the angles of n raw bytes into `out`, (n,) rad."""
        np.add(self._rows, np.frombuffer(raw, np.uint8), out=self._index)
        self._angles.take(self._index, out=out, mode="clip")

    def raw(self, angles: Array) -> NDArray[np.uint8]:
        """Returns (n,) bytes 1..255, those of the nearest angles along each line; the exact inverse of `angles`."""
        return (self._nearest(angles) - self._before).astype(np.uint8)

    def quantise(self, angles: Array, out: Array) -> None:
        """Writes the angles of the bytes that `raw` returns into `out`, (n,) rad."""
        self._angles_from_1.take(self._nearest(angles), out=out, mode="clip")

    def _nearest(self, angles: Array) -> NDArray[np.intp]:
        """Returns the (n,) indices of the nearest bytes in the flattened (n, 255) table of bytes 1..255."""
        place = angles * self._scale
        place += self._shift
        np.maximum(place, self._lowest, out=place)
        np.minimum(place, self._highest, out=place)
        return self._halfway.searchsorted(place)


def load(file: KeptFile, sensors: int) -> Calibration:
    """Reads a calibration: the project's YAML, what `srl calibrate` wrote (it begins with a brace), or a vendor's file,
    recognised by its ending `.cal`.

    Raises:
        ProfileError: with file, key and what was expected.
    """
    try:
        path, text = file.path, file.text
    except UnicodeDecodeError:
        problem = "the calibration can't be read: it isn't UTF-8 text"
        raise ProfileError(str(file.path), problem, "Name a calibration") from None
    if path.suffix == ".cal":
        return _vendor(path, text, sensors)
    return _guided(path, text, sensors) if text.lstrip().startswith("{") else _own(path, text, sensors)


def default(sensors: int) -> Calibration:
    """Returns an average hand, from the sheet's ranges: enough to see a hand move, not to control a device."""
    fits = [_typical(label) for label in LABELS[sensors]]
    return Calibration(
        np.array([fit.angles() for fit in fits]), note="uncalibrated: angles are those of an average hand"
    )


def _own(path: Path, text: str, sensors: int) -> Calibration:
    try:
        tree = yaml_text.load(text)
    except YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        place = f"{path}: line {mark.line + 1}" if mark else str(path)
        problem = getattr(error, "problem", None) or str(error)
        raise ProfileError(place, f"this isn't valid YAML: {problem}", "Mend the text there") from None
    try:
        file = _File.model_validate(tree)
    except ValidationError as error:
        raise _refused(path, error, "docs/devices/cyberglove.md has an example") from None
    return Calibration(_table(path, file.sensors, sensors), hand=file.hand, person=file.person)


def _table(path: Path, fits: Mapping[str, Fit], sensors: int) -> Array:
    """(n, 256) rad, of lines by name. Raises ProfileError: one is missing, or is of no sensor."""
    labels = LABELS[sensors]
    for name in fits:
        if name not in labels:
            raise ProfileError(
                f"{path}: sensors.{name}",
                f"a glove of {sensors} sensors has none of this name",
                nearest(name, labels),
            )
    for name in labels:
        if name not in fits:
            raise ProfileError(f"{path}: sensors.{name}", "the sensor is missing", f"Give all {sensors} sensors a line")
    return np.array([_one_line(f"{path}: sensors.{name}", fits[name]) for name in labels])


def _one_line(place: str, fit: Fit) -> Array:
    """(256,) rad. Raises ProfileError: numbers so great or small that neighbouring counts have the same angle."""
    with np.errstate(over="ignore", invalid="ignore"):
        angles = fit.angles()
        steps = np.diff(angles)
    if not np.isfinite(angles).all() or not ((steps > 0).all() or (steps < 0).all()):
        raise ProfileError(place, "not every count has an angle of its own", "Correct its numbers")
    return angles


def _guided(path: Path, text: str, sensors: int) -> Calibration:
    """Reads what `srl calibrate PROFILE glove` wrote. Raises ProfileError: it was changed, or is something else."""
    again = "Calibrate again: `srl calibrate PROFILE glove`"
    try:
        made = GloveRecord.model_validate_json(json.dumps(opened(text)))
    except ChangedError as error:
        remedy = f'{again}; if you changed it on purpose, take "{HASH}" out'
        raise ProfileError(str(path), str(error), remedy) from None
    except ValidationError as error:
        raise _refused(path, error, again) from None
    except (ValueError, RecursionError) as error:
        problem = f"it is no JSON: {error}" if isinstance(error, ValueError) else "it is nested too deeply"
        raise ProfileError(str(path), problem, again) from None
    fits = {name: Fit(gain=line.gain, offset=line.offset) for name, line in made.sensors.items()}
    known = [name for name in made.average if name in LABELS[sensors]]
    table = _table(path, fits | {name: _typical(name) for name in known}, sensors)
    notes = ["calibrated in simulation, which says nothing about a real glove"] if made.simulated else []
    notes += [f"{', '.join(known)}: of an average hand"] if known else []
    return Calibration(table, note="; ".join(notes), hand=made.hand, person=made.person, simulated=made.simulated)


def _refused(path: Path, error: ValidationError, remedy: str) -> ProfileError:
    """The error of a file whose values don't fit."""
    first = refusal(error)
    return ProfileError(first.at(str(path)), first.problem, first.remedy_or(remedy))


# The lines of the sensors in the vendor's file, counted from 0, in the record's order (§6).
_VENDOR_LINES: Final = {
    22: (*range(2, 6), *range(7, 10), *(12, 13, 14, 15), *range(17, 21), *range(22, 26), *(27, 28, 29)),
    18: (*range(2, 6), *(7, 8), *(12, 13, 15), *(17, 18, 20), *(22, 23, 25), *(27, 28, 29)),
}
_OFFSET, _GAIN = 6, 9  # words of a line, counted from 0
_GAIN_ELSEWHERE: Final = {15: 10}  # the vendor's tool writes line 15's gain (middle abduction) into line 10


def _vendor(path: Path, text: str, sensors: int) -> Calibration:
    """Reads VirtualHand's file: angle = (raw - offset) gain, rad. Its signs differ between versions."""
    lines = [line.split() for line in text.splitlines()]

    def number(line: int, word: int, what: str) -> float:
        try:
            value = float(lines[line][word])
        except (IndexError, ValueError):
            value = np.nan
        if not np.isfinite(value):
            raise ProfileError(
                f"{path}: line {line + 1}",
                f"word {word + 1} isn't a number, expected the {what} of a VirtualHand calibration",
                f"Check that the file is one of a glove with {sensors} sensors, or write the YAML form",
            )
        return value

    rows = []
    for label, line in zip(LABELS[sensors], _VENDOR_LINES[sensors], strict=True):
        source = _GAIN_ELSEWHERE.get(line, line)
        gain = number(source, _GAIN, "gain")
        if gain == 0:
            raise ProfileError(f"{path}: line {source + 1}", f"the gain of {label} is 0", "Calibrate the glove again")
        fit = Fit(gain=gain, offset=number(line, _OFFSET, "offset"))
        rows.append(_one_line(f"{path}: line {line + 1}", fit))
    return Calibration(np.array(rows), note="vendor calibration: check each joint's sign before use")


def _typical(label: str) -> Fit:
    """Returns a typical line: flat hand at raw 80, fist at 190; abductions fall from 50° at 6 to 0 at 153 (§6)."""
    if label.endswith("abduction"):
        return Fit(points=[(6, 0.87), (153, 0.0)])
    if label.startswith("wrist"):
        return Fit(gain=0.01, offset=128)
    return Fit(points=[(80, 0.0), (190, _FIST[label if label in _FIST else label[-3:]])])


_FIST: Final = {  # rad, by sensor or by joint
    "thumb_roll": 1.2,
    "thumb_mpj": 0.9,
    "thumb_ij": 1.2,
    "palm_arch": 0.4,
    "mpj": 1.45,
    "pij": 1.75,
    "dij": 1.1,
}
