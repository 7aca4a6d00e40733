"""Reads InHARD: people in a Perception Neuron suit who assemble something, with labelled actions.

Dallel, Havard, Baudry and Savatier, InHARD - Industrial Human Action Recognition Dataset in the Context of Industrial
Collaborative Robotics, IEEE ICHMS 2020. Its description is public (vhavard/InHARD); the data set is downloaded by who
uses it. A folder holds `InHARD.csv`, one row an action, and `Skeleton/FILE.bvh` at 120 Hz. The description names 17
joints; what else of the suit's skeleton a file has is taken, too. It doesn't say whether frames count from 0 or 1: here
from 0, the end included, which is 8 ms at most.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from srl.drivers.noitom.skeleton import Kind, Skeleton
from srl.drivers.replay.suit_motion import CM, rotations, rows
from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.files import read_regular
from srl.runtime.contracts.signals import Array
from srl.runtime.models.skeleton import bvh

_MOST: Final = 1 << 26  # bytes of the table
TABLE: Final = "InHARD.csv"
_SKELETONS: Final = "Skeleton"
_BODY: Final = (
    "Hips", "Spine", "Head", *(f"{side}{part}" for side in ("Right", "Left")
                               for part in ("UpLeg", "Leg", "Foot", "Shoulder", "Arm", "ForeArm", "Hand")),
)  # fmt: skip
_COLUMNS: Final = ("File_name", "Subject", "Meta_action_label", "Action_start_bvh_frame", "Action_end_bvh_frame")


@dataclass(frozen=True)
class Action:
    """One labelled stretch. Frames `first` to `last`, included, of the file's motion."""

    file: str
    subject: str
    label: str
    first: int
    last: int


@dataclass(frozen=True)
class Motion:
    """A file's motion.

    Attributes:
        names: (k,) of the joints.
        rate: Hz.
        rotation: (n, k, 4) w x y z of each in its parent.
        translation: (n, k, 3) m, of each in its parent.
    """

    names: tuple[str, ...]
    rate: float
    rotation: Array
    translation: Array


def actions(folder: Path) -> list[Action]:
    """The labelled stretches, in the order of the table; labels are slugs: "picking-left". Raises RecordingError."""
    path = folder / TABLE
    try:
        with io.StringIO(read_regular(path, _MOST).decode("utf-8-sig"), newline="") as file:
            head = file.readline()
            marks = [mark for mark in ",;\t" if mark in head]
            file.seek(0)
            table = csv.DictReader(file, delimiter=max(marks, key=head.count, default=","))
            names = [name.strip() for name in table.fieldnames or ()]
            if missing := [name for name in _COLUMNS if name not in names]:
                problem = f"it has no column '{missing[0]}'; it has {', '.join(names)[:120]}"
                raise RecordingError(str(path), problem, "Give the table of the data set")
            table.fieldnames = names
            return [_action(path, number + 2, row) for number, row in enumerate(table)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        problem = f"it can't be read as text ({error})"
        raise RecordingError(str(path), problem, "Name the unpacked folder of the data set") from None


def motion(folder: Path, file: str, kind: Kind = "axis-neuron") -> Motion:
    """The motion of a file of the table. Raises RecordingError: it isn't there, or of another skeleton."""
    path = folder / _SKELETONS / f"{file}.bvh"
    made = bvh.read(path)
    names = tuple(name for name in Skeleton(kind).names if name in _BODY or made.index(name) >= 0)
    joints = rows(path, made, names)
    translation = np.stack([made.translation(row) for row in joints], axis=1) * CM
    return Motion(names, 1.0 / made.frame_time, rotations(path, made, joints), translation)


def stretches(folder: Path, kind: Kind = "axis-neuron") -> Iterator[tuple[Action, Motion]]:
    """Each labelled stretch with its part of the motion; each file is read once. Raises RecordingError."""
    found = actions(folder)
    for file in dict.fromkeys(action.file for action in found):
        whole = motion(folder, file, kind)
        for action in found:
            if action.file != file:
                continue
            if action.last >= len(whole.rotation):
                problem = f"an action ends at frame {action.last}, the file has {len(whole.rotation)}"
                raise RecordingError(f"{folder / TABLE}: {file}", problem, "Give the table of these files")
            at = slice(action.first, action.last + 1)
            yield action, Motion(whole.names, whole.rate, whole.rotation[at], whole.translation[at])


def _action(path: Path, line: int, row: dict[str, str]) -> Action:
    try:
        first, last = int(row["Action_start_bvh_frame"]), int(row["Action_end_bvh_frame"])
        label = re.sub(r"[^a-z0-9]+", "-", row["Meta_action_label"].strip().lower()).strip("-")
        if not 0 <= first < last or not label:
            raise ValueError
    except (ValueError, TypeError, AttributeError):
        problem = "it isn't an action with a label and two frames, the first before the last"
        raise RecordingError(f"{path}, line {line}", problem, "Correct or remove the line") from None
    return Action(row["File_name"].strip(), row["Subject"].strip(), label, first, last)
