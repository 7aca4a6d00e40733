"""Reads a folder with one CSV per joint, each with its own time stamps, as a topic recorder exports them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import numpy as np

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.signals import Array
from srl.runtime.models.human_hand import JOINTS
from srl.sim.wearer.checks import check_samples
from srl.sim.wearer.motion import Curve
from srl.sim.wearer.tables import read_rows

_LONGEST: Final = 86_400.0  # s
_RATE: Final = 100.0  # Hz of the common time base
_TOPIC: Final = re.compile(r"(thumb|index|middle|ring|pinkie|little)(?:_finger)?_(?:joint_([123])|(base))\.csv$")
_PLACES: Final = {"1": "mcp_flexion", "2": "pip_flexion", "3": "dip_flexion"}
_THUMB: Final = {"base": "tm_flexion", "1": "mcp_flexion", "2": "ip_flexion"}


def read(folder: Path) -> tuple[Array, Array]:
    """Time (n,), s, and position (n, 20), rad, where all topics overlap, at 100 Hz.

    Files `*<finger>_finger_joint_<1|2|3>.csv` (1 MCP, 2 PIP, 3 DIP; of the thumb 1 MCP, 2 IP) and
    `*thumb_base.csv` (TM flexion), columns `rosbagTimestamp` (ns) and `data` (rad). Other files are ignored;
    joints without a file stay at zero.
    """
    curves: dict[str, Curve] = {}
    start, end = -np.inf, np.inf
    origin: int | None = None
    for file in sorted(folder.iterdir()):
        joint = _joint(file.name)
        if joint is None:
            continue
        stamps, values = _topic(file)
        if not len(stamps):
            raise RecordingError(str(file), "it has no samples", "Leave the file out")
        origin = int(stamps[0]) if origin is None else origin
        time = (stamps - origin) * 1e-9  # subtract whole ns first: a double holds present-day stamps only to 256 ns
        check_samples(file, time, values, ["data"], 2)
        curves[joint] = Curve(time, values)
        start, end = max(start, time[0]), min(end, time[-1])
    if len(curves) < 5:
        raise RecordingError(
            str(folder),
            f"{len(curves)} topic(s) of finger joints found",
            "Expected files such as _force_joints_hand_index_finger_joint_1.csv, at least five",
        )
    if end - start < 2.0 / _RATE:
        raise RecordingError(str(folder), "the topics have no time in common", "Check their time stamps")
    if end - start > _LONGEST:
        raise RecordingError(str(folder), f"they last {end - start:.3g} s", f"At most {_LONGEST:g} s are read")
    time = np.arange(start, end, 1.0 / _RATE)
    position = np.zeros((time.size, len(JOINTS)))
    for joint, curve in curves.items():
        position[:, JOINTS.index(joint)] = curve.at(time)[:, 0]
    return time - start, position


def _joint(name: str) -> str | None:
    match = _TOPIC.search(name)
    if match is None:
        return None
    finger, number, base = match.groups()
    finger = "little" if finger == "pinkie" else finger
    place = (_THUMB if finger == "thumb" else _PLACES).get(base or number)
    return f"{finger}_{place}" if place else None


def _topic(file: Path) -> tuple[Array, Array]:
    header, rows, first = read_rows(file)
    if header[:2] != ["rosbagTimestamp", "data"]:
        raise RecordingError(
            f"{file}, line 1",
            f"the header is '{', '.join(header)[:100]}'",
            "Expected the columns rosbagTimestamp (ns) and data (rad)",
        )
    for line, row in enumerate(rows, first):
        if not re.fullmatch("[0-9]{1,19}", row[0].strip()):
            raise RecordingError(
                f"{file}, line {line}, column 'rosbagTimestamp'",
                f"'{row[0]}' is not a whole number of ns",
                "Repair or drop the line",
            )
    try:
        stamps = np.array([int(row[0]) for row in rows], dtype=np.int64)
    except OverflowError:
        raise RecordingError(f"{file}, column 'rosbagTimestamp'", "a time beyond 2262", "Give ns") from None
    try:
        values = np.array([float(row[1]) for row in rows]).reshape(-1, 1)
    except ValueError as error:
        raise RecordingError(f"{file}, column 'data'", str(error), "Give angles in radian") from error
    return stamps, values  # type: ignore[return-value]
