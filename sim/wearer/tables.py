"""Recordings as tables: CSV with a header, NPZ with named arrays."""

from __future__ import annotations

import csv
import zipfile
from pathlib import Path
from typing import Final

import numpy as np

from drivers.cyberglove.protocol import LABELS_22
from runtime.contracts.errors import RecordingError
from runtime.contracts.signals import Array
from runtime.control.hand.human_hand import JOINTS
from sim.wearer.checks import check_samples
from sim.wearer.joints import SCHEMES, to_model

Parts = list[tuple[Array, Array]]

_TIME: Final = {"time": 1.0, "t": 1.0, "time_s": 1.0, "time_ms": 1e-3, "time_us": 1e-6, "time_ns": 1e-9}
_UNITS: Final = {"_rad": 1.0, "_deg": np.pi / 180.0}
_DOOR_RATE: Final = 100.0  # Hz; files with an array `episode` contain no time


def read_csv(path: Path) -> Parts:
    """Reads a header and one row per sample: one time column, joint or sensor columns (rad, or named `..._deg`).

    Time columns: time, t, time_s, time_ms, time_us, time_ns. Names: the model's joints, a CyberGlove's
    sensors by number (s0..s21, or s0..s17 of a glove of 18) or by label, Adroit's joints. Other columns are
    ignored.
    """
    header, rows, first = read_rows(path)
    times = [i for i, name in enumerate(header) if name.lower() in _TIME]
    if len(times) != 1:
        raise RecordingError(
            f"{path}, line 1",
            f"{len(times)} time columns instead of one; the header is: {', '.join(header)[:200]}",
            f"Name one column {', '.join(_TIME)}",
        )
    scale = _TIME[header[times[0]].lower()]
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
    time = np.array([_number(row[times[0]]) for row in rows]) * scale
    check_samples(path, time, values, wanted, first)
    position = to_model(wanted, values * np.array([factors[i] for i in used]))
    if position is None:
        raise _unknown(path, "line 1", header)
    return [(time - time[0], position)]


def read_npz(path: Path) -> Parts:
    """Reads arrays `time` (n,) s, `position` (n, m) rad, `names` (m,).

    Alternatively `hand_position` (n, m), `hand_joint_names` (m,), `episode` (n,). This is the format of
    the public door openings: 100 Hz, no time array, the episode's number for each sample.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except (OSError, ValueError, zipfile.BadZipFile, EOFError) as error:
        raise RecordingError(
            str(path), f"it can't be read as NPZ ({error})", "Write it with numpy.savez, without objects"
        ) from error
    door = "hand_position" in arrays
    layout = ("hand_position", "hand_joint_names", "episode") if door else ("position", "names", "time")
    missing = [name for name in layout if name not in arrays]
    if missing:
        raise RecordingError(
            str(path),
            f"the array '{missing[0]}' is missing; it has {', '.join(arrays) or 'none'}",
            "Give time, position, names, or hand_position, hand_joint_names, episode",
        )
    try:
        values = arrays[layout[0]].astype(float)
        last = arrays[layout[2]].astype(float)
    except ValueError as error:
        raise RecordingError(str(path), f"an array isn't numeric ({error})", "Store numbers") from error
    names = [str(name) for name in arrays[layout[1]].ravel()]
    if values.ndim != 2 or values.shape[1] != len(names) or last.shape != (len(values),):
        raise RecordingError(
            str(path),
            f"{layout[0]} has shape {values.shape}, {layout[2]} {last.shape}; there are {len(names)} names",
            "Give shapes (n, m), m and (n,)",
        )
    stretches = [np.flatnonzero(last == number) for number in np.unique(last)] if door else [np.arange(len(values))]
    parts: Parts = []
    for index in stretches:
        time = np.arange(len(index)) / _DOOR_RATE if door else last
        check_samples(path, time, values[index], names, int(index[0]))
        position = to_model(names, values[index])
        if position is None:
            raise _unknown(path, layout[1], names)
        parts.append((time - time[0], position))
    return parts


def read_rows(path: Path) -> tuple[list[str], list[list[str]], int]:
    """Reads the header, rows with as many fields, and the line number of the first row."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file)
            header = [name.strip() for name in next(reader, [])]
            rows = []
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
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise RecordingError(str(path), f"it can't be read as CSV text ({error})", "Give a UTF-8 CSV file") from error
    return header, rows, 2


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
