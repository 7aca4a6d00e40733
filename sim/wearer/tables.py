"""Recordings as tables: CSV with a header, NPZ with named arrays."""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path
from typing import Final

import numpy as np

from srl.drivers.cyberglove.protocol import LABELS_22
from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.files import read_regular
from srl.runtime.contracts.signals import Array
from srl.runtime.models.human_hand import JOINTS
from srl.sim.wearer import npz
from srl.sim.wearer.checks import check_samples
from srl.sim.wearer.joints import SCHEMES, numbered, to_model, unused

Parts = list[tuple[Array, Array]]

_TIME: Final = {"time": 1.0, "t": 1.0, "time_s": 1.0, "time_ms": 1e-3, "time_us": 1e-6, "time_ns": 1e-9}
_UNITS: Final = {"_rad": 1.0, "_deg": np.pi / 180.0}
_DOOR: Final = ("hand_position", "hand_joint_names", "episode")
_PLAIN: Final = ("position", "names", "time")
_EPISODES: Final = 10_000
_MOST: Final = 1 << 28  # bytes of a CSV file
_DOOR_RATE: Final = 100.0  # Hz; files with an array `episode` contain no time


def read_csv(path: Path) -> Parts:
    """Reads a header and one row per sample: one time column, joint or sensor columns (rad, or named `..._deg`).

    Time columns: time, t, time_s, time_ms, time_us, time_ns. Names: the model's joints, a CyberGlove's
    sensors by number (s0..s21, or s0..s17 of a glove of 18) or by label, Adroit's joints. Other columns are
    ignored.
    """
    header, rows, first = read_rows(path)
    own = time_column(f"{path}, line 1", header)
    if own is None:
        problem = f"0 time columns instead of one; the header is: {', '.join(header)[:200]}"
        raise RecordingError(f"{path}, line 1", problem, f"Name one column {', '.join(_TIME)}")
    names, factors = [], []
    for name in header:
        suffix = next((s for s in _UNITS if name.lower().endswith(s)), "")
        names.append(name[: len(name) - len(suffix)])
        factors.append(_UNITS.get(suffix, 1.0))
    known = {source for scheme in SCHEMES.values() for terms in scheme.values() for source, _ in terms}
    known |= {f"s{i}" for i in range(22)} | set(LABELS_22)
    used = [i for i, name in enumerate(names) if name in known]
    wanted = [names[i] for i in used]
    values = np.array([[_number(row[i]) for i in used] for row in rows]).reshape(len(rows), len(used))
    time = np.array([_number(row[own[0]]) for row in rows]) * own[1]
    refuse_twice(f"{path}, line 1", wanted)
    refuse_twice(f"{path}, line 1", numbered(wanted))
    check_samples(path, time, values, wanted, first)
    position = to_model(wanted, values * np.array([factors[i] for i in used]))
    if position is None:
        raise _unknown(path, "line 1", header)
    return [(time - time[0], position)]


def time_column(place: str, header: list[str]) -> tuple[int, float] | None:
    """The number of a table's time column, and s in its unit; None if it has none.

    Raises:
        RecordingError: it has several.
    """
    found = [(i, _TIME[name.lower()]) for i, name in enumerate(header) if name.lower() in _TIME]
    if len(found) > 1:
        names = ", ".join(header[i] for i, _ in found)
        raise RecordingError(place, f"{len(found)} time columns instead of one: {names}", "Leave one")
    return found[0] if found else None


def read_npz(path: Path) -> Parts:
    """Reads arrays `time` (n,) s, `position` (n, m) rad, `names` (m,).

    Alternatively `hand_position` (n, m), `hand_joint_names` (m,), `episode` (n,). This is the format of
    the public door openings: 100 Hz, no time array, the episode's number for each sample.
    """
    arrays = npz.arrays(path, (*_DOOR, *_PLAIN))
    door = _DOOR[0] in arrays
    layout = _DOOR if door else _PLAIN
    missing = [name for name in layout if name not in arrays]
    if missing:
        raise RecordingError(
            str(path),
            f"the array '{missing[0]}' is missing; it has {', '.join(arrays) or 'none'}",
            "Give time, position, names, or hand_position, hand_joint_names, episode",
        )
    values, last = arrays[layout[0]], arrays[layout[2]]
    if values.dtype.kind == "U" or last.dtype.kind == "U":
        raise RecordingError(str(path), f"{layout[0]} or {layout[2]} holds texts", "Store numbers")
    names = [str(name) for name in arrays[layout[1]].ravel()]
    if values.ndim != 2 or values.shape[1] != len(names) or last.shape != (len(values),):
        raise RecordingError(
            str(path),
            f"{layout[0]} has shape {values.shape}, {layout[2]} {last.shape}; there are {len(names)} names",
            "Give shapes (n, m), m and (n,)",
        )
    if not len(values):
        raise RecordingError(str(path), "it has no sample", "A motion needs two at least")
    refuse_twice(str(path), names)
    stretches = [np.arange(len(values))]
    if door and not np.isfinite(last).all():
        raise RecordingError(str(path), "an episode has no number", "Number each sample's episode")
    if door:
        order = np.argsort(last, kind="stable")
        stretches = np.split(order, np.flatnonzero(np.diff(last[order]) != 0) + 1)
    if len(stretches) > _EPISODES:
        raise RecordingError(str(path), f"it has {len(stretches)} episodes", f"At most {_EPISODES} are read")
    parts: Parts = []
    for index in stretches:
        time = np.arange(len(index)) / _DOOR_RATE if door else last
        check_samples(path, time, values[index], names, int(index[0]))
        position = to_model(names, values[index])
        if position is None:
            raise _unknown(path, layout[1], names)
        parts.append((time - time[0], position))
    return parts


def unused_columns(path: Path) -> tuple[str, ...]:
    """The columns of a table, CSV or NPZ, from which a hand takes nothing. The table was read before."""
    if path.suffix.lower() == ".npz":
        found = npz.arrays(path, (_DOOR[1], _PLAIN[1]))
        names = [str(name) for name in found.get(_DOOR[1], found.get(_PLAIN[1], np.empty(0))).ravel()]
    else:
        names = [name for name in read_rows(path)[0] if name.lower() not in _TIME]
    plain = [next((name.removesuffix(s) for s in _UNITS if name.lower().endswith(s)), name) for name in names]
    left = set(unused(plain))
    return tuple(name for name, short in zip(names, plain, strict=True) if short in left)


def read_rows(path: Path) -> tuple[list[str], list[list[str]], int]:
    """Reads the header, rows with as many fields, and the line number of the first row."""
    rows: list[list[str]] = []
    try:
        with io.StringIO(read_regular(path, _MOST).decode("utf-8-sig"), newline="") as file:
            reader = csv.reader(file)
            header = [name.strip() for name in next(reader, [])]
            _refuse_other_separators(path, header, next(file, ""))
            file.seek(0)
            reader = csv.reader(file)
            next(reader, [])
            for row in reader:
                if not row:
                    continue
                if len(row) != len(header):
                    raise RecordingError(
                        f"{path}, line {reader.line_num}",
                        f"{len(row)} fields, the header has {len(header)}",
                        "The file may have been cut short; repair or drop the line",
                    )
                rows.append(row)
            _refuse_decimal_commas(path, rows)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise RecordingError(str(path), f"it can't be read as CSV text ({error})", "Give a UTF-8 CSV file") from error
    refuse_twice(f"{path}, line 1", header)
    return header, rows, 2


def refuse_twice(place: str, names: list[str]) -> None:
    """Raises RecordingError where a column's name is there twice, in whatever case: one of the two would be taken."""
    seen: set[str] = set()
    for name in names:
        if name and name.lower() in seen:
            raise RecordingError(place, f"'{name}' is there twice", "Give each column a name of its own")
        seen.add(name.lower())


def _refuse_other_separators(path: Path, header: list[str], first: str) -> None:
    """Raises RecordingError for a table as spreadsheets of many countries write it."""
    line = ",".join(header)
    found = next((name for mark, name in ((";", "semicolons"), ("\t", "tabs")) if mark in line and "," not in line), "")
    if found:
        comma = " and decimal commas" if re.search(r"\d,\d", first) else ""
        raise RecordingError(
            f"{path}, line 1", f"its columns are separated by {found}{comma}",
            "Save it with commas between the columns and points for decimals",
        )  # fmt: skip


def _refuse_decimal_commas(path: Path, rows: list[list[str]]) -> None:
    for line, row in enumerate(rows, 2):
        if "," in "".join(row) and (cell := next((c for c in row if re.fullmatch(r"-?\d+,\d+", c.strip())), "")):
            problem = f"'{cell}' has a decimal comma"
            raise RecordingError(f"{path}, line {line}", problem, "Write numbers with a point")


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")


def _unknown(path: Path, where: str, names: list[str]) -> RecordingError:
    return RecordingError(
        f"{path}, {where}",
        f"fewer than five known joints or sensors among: {', '.join(names)[:200]}",
        f"Use the model's names ({JOINTS[5]}, ...), CyberGlove's s0 to s21, or Adroit's FFJ3, ...",
    )
