"""Biovision Hierarchy (BVH) files: a skeleton and its motion."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NoReturn

import numpy as np
from numpy.typing import NDArray

from runtime.contracts.errors import RecordingError
from runtime.contracts.rotation import about_axis
from runtime.contracts.signals import Array

_AXES: Final = {"X": 0, "Y": 1, "Z": 2}


@dataclass
class Joint:
    """One joint or end site.

    Attributes:
        parent: its index, -1 for the root.
        offset: (3,), the file's unit of length.
        positions, rotations: (axis, column of the frame) in the order of CHANNELS.
    """

    name: str
    parent: int
    offset: Array
    positions: list[tuple[int, int]] = field(default_factory=list)
    rotations: list[tuple[int, int]] = field(default_factory=list)


@dataclass
class Bvh:
    """A file's content: joints (end sites as `<parent>_End`), frames (n, channels), s between frames."""

    joints: list[Joint]
    frames: Array
    frame_time: float

    def index(self, name: str) -> int:
        """The number of a joint; -1 if there is no joint with this name."""
        return next((i for i, joint in enumerate(self.joints) if joint.name == name), -1)

    def rotation(self, index: int) -> Array:
        """(n, 3, 3): a joint's rotation relative to its parent, the product of its channels in file order."""
        R = np.broadcast_to(np.eye(3), (len(self.frames), 3, 3))
        for axis, column in self.joints[index].rotations:
            R = R @ about_axis(axis, np.deg2rad(self.frames[:, column]))
        return R

    def translation(self, index: int) -> Array:
        """(n, 3): a joint's position in its parent. Position channels replace OFFSET; they aren't added to it."""
        joint = self.joints[index]
        p = np.tile(joint.offset, (len(self.frames), 1))
        for axis, column in joint.positions:
            p[:, axis] = self.frames[:, column]
        return p

    def world_positions(self) -> Array:
        """(n, joints, 3): forward kinematics, in the file's unit and axes."""
        n = len(self.frames)
        R = np.empty((len(self.joints), n, 3, 3))
        p = np.empty((n, len(self.joints), 3))
        for i, joint in enumerate(self.joints):
            local, place = self.rotation(i), self.translation(i)
            if joint.parent < 0:
                R[i], p[:, i] = local, place
            else:
                up = R[joint.parent]
                R[i] = up @ local
                p[:, i] = p[:, joint.parent] + np.einsum("nij,nj->ni", up, place)
        return p


def read(path: Path) -> Bvh:
    """Reads a file.

    Raises:
        RecordingError: with the line, what was expected there, and the remedy.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(str(path), f"it can't be read as text ({error})", "Give a BVH text file") from error
    return _Parser(path, lines).parse()


class _Parser:
    def __init__(self, path: Path, lines: list[str]) -> None:
        self._path, self._lines, self._at = path, lines, 0
        self._joints: list[Joint] = []
        self._columns = 0

    def parse(self) -> Bvh:
        self._expect("HIERARCHY")
        words = self._expect("ROOT")
        self._joint(" ".join(words[1:]), -1)
        self._expect("MOTION")
        count = self._count(self._expect("Frames:"))
        frame_time = self._floats(self._expect("Frame", "Time:")[2:], 1)[0]
        if not 0 < frame_time < 10:
            self._fail(f"a frame time of {frame_time:g} s", "It must be positive, in seconds")
        frames: NDArray[np.float64] = np.empty((count, self._columns))
        for row in range(count):
            frames[row] = self._floats(self._next(f"frame {row + 1} of {count}"), self._columns)
        return Bvh(self._joints, frames, frame_time)

    def _joint(self, name: str, parent: int) -> None:
        """Reads the block in braces of a joint or end site, with all its descendants."""
        self._expect("{")
        offset = np.array(self._floats(self._expect("OFFSET")[1:], 3))
        joint, index = Joint(name, parent, offset), len(self._joints)
        self._joints.append(joint)
        while (words := self._next("'}'"))[0] != "}":
            if words[0] == "CHANNELS":
                self._channels(joint, words[1:])
            elif words[0] == "JOINT":
                self._joint(" ".join(words[1:]), index)
            elif words[0] == "End":
                self._joint(f"{name}_End", index)
            else:
                self._fail(f"'{words[0]}'", "Expected CHANNELS, JOINT, End Site or '}'")

    def _channels(self, joint: Joint, words: list[str]) -> None:
        if not words or not words[0].isdigit() or int(words[0]) != len(words) - 1:
            self._fail(f"CHANNELS {' '.join(words)}", "Expected their number, then as many names")
        for word in words[1:]:
            axis, kind = _AXES.get(word[:1]), word[1:]
            if axis is None or kind not in ("position", "rotation"):
                self._fail(f"the channel '{word}'", "Expected Xposition ... Zrotation")
            (joint.positions if kind == "position" else joint.rotations).append((axis, self._columns))
            self._columns += 1

    def _next(self, expected: str) -> list[str]:
        while self._at < len(self._lines):
            self._at += 1
            if words := self._lines[self._at - 1].split():
                return words
        self._fail("the file ends", f"Expected {expected}; it may have been cut short")

    def _expect(self, *start: str) -> list[str]:
        words = self._next(f"'{' '.join(start)}'")
        if tuple(words[: len(start)]) != start:
            self._fail(f"'{' '.join(words)[:60]}'", f"Expected '{' '.join(start)}'")
        return words

    def _count(self, words: list[str]) -> int:
        if len(words) != 2 or not words[1].isdigit() or int(words[1]) < 2:
            self._fail(f"'{' '.join(words)}'", "Expected 'Frames:' and a number, 2 at least")
        return int(words[1])

    def _floats(self, words: list[str], count: int) -> list[float]:
        try:
            values = [float(word) for word in words]
        except ValueError:
            self._fail("a word that is no number", f"Expected {count} number(s)")
        if len(values) != count:
            self._fail(f"{len(values)} number(s)", f"Expected {count}")
        if not np.isfinite(values).all():
            self._fail("a number that isn't finite", "Cut the frame out or fill the gap")
        return values

    def _fail(self, problem: str, remedy: str) -> NoReturn:
        raise RecordingError(f"{self._path}, line {self._at}", problem, remedy)
