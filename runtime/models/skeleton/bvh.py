"""Biovision Hierarchy (BVH) files: a skeleton and its motion, read and written.

Nothing is assumed about a file but its grammar: channels may come in any order and number, position channels replace
OFFSET and may change from frame to frame, end sites have no channels. The frame time is as written; exporters round it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NoReturn, cast

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.files import read_regular
from srl.runtime.contracts.rotation import (
    EulerQuaternions,
    Order,
    about_axis,
    euler_angles,
    matrices,
    product,
)
from srl.runtime.contracts.signals import Array
from srl.runtime.models.skeleton.tree import Node, Tree

_AXES: Final = {"X": 0, "Y": 1, "Z": 2}
MOST: Final = 1 << 28  # bytes that are read
DEEPEST: Final = 200  # joints within each other
_END: Final = "_End"  # of an end site's name, which is its parent's otherwise


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
    end: bool = False


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

    def quaternions(self, index: int) -> Array:
        """(n, 4): the same rotation as unit quaternions w x y z."""
        channels, n = self.joints[index].rotations, len(self.frames)
        angles = np.deg2rad(self.frames[:, [column for _, column in channels]])
        order = "".join("XYZ"[axis] for axis, _ in channels)
        out = np.empty((n, 4))
        if sorted(order) == ["X", "Y", "Z"]:
            EulerQuaternions(cast(Order, order), n).fill(angles, out)
            return out
        out[:] = 1.0, 0.0, 0.0, 0.0
        for (axis, _), half in zip(channels, angles.T / 2.0, strict=True):
            turn = [np.cos(half), np.zeros(n), np.zeros(n), np.zeros(n)]
            turn[axis + 1] = np.sin(half)
            out = np.array(product(tuple(out.T), tuple(turn))).T  # type: ignore[arg-type]  # arrays for numbers
        return out

    def pose(self, names: Sequence[str], unit: float = 0.01) -> tuple[Array, Array]:
        """The motion of joints relative to their parents.

        Args:
            names: k joints.
            unit: m per unit of the file's lengths.

        Returns:
            (n, k, 4) unit quaternions, (n, k, 3) m.

        Raises:
            KeyError: the file has no such joint.
        """
        rows = [self.index(name) for name in names]
        if min(rows) < 0:
            raise KeyError(names[rows.index(-1)])
        turns = np.stack([self.quaternions(row) for row in rows], axis=1)
        return turns, np.stack([self.translation(row) for row in rows], axis=1) * unit

    def tree(self, unit: float = 0.01) -> Tree:
        """The skeleton at rest, m. `unit`: m per unit of the file's lengths."""
        nodes = []
        for joint in self.joints:
            x, y, z = (joint.offset * unit).tolist()
            nodes.append(
                Node(joint.name, "" if joint.parent < 0 else self.joints[joint.parent].name, (x, y, z), joint.end)
            )
        return Tree(nodes)

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
    """Reads a file of two frames at least.

    Raises:
        RecordingError: with the line, what was expected there, and the remedy.
    """
    return _Parser(str(path), _lines(path)).parse()


def read_tree(path: Path, unit: float = 0.01) -> Tree:
    """Reads a file's skeleton alone; its motion may be missing. `unit`: m per unit of its lengths.

    Raises:
        RecordingError: as `read`.
    """
    return parse_tree("\n".join(_lines(path)), str(path), unit)


def parse_tree(text: str, place: str, unit: float = 0.01) -> Tree:
    """As `read_tree`, of a file's text; `place` is for errors."""
    joints = _Parser(place, text.splitlines()).hierarchy()
    try:
        return Bvh(joints, np.empty((0, 0)), 1.0).tree(unit)
    except ValueError as error:
        raise RecordingError(place, str(error), "Give each joint a name of its own") from None


def _lines(path: Path) -> list[str]:
    try:
        return read_regular(path, MOST).decode("utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(str(path), f"it can't be read as text ({error})", "Give a BVH text file") from error


def write(path: Path, tree: Tree, rotation: Array, translation: Array, period: float, order: Order = "ZXY") -> None:
    """Writes a file, cm and degrees. Every joint has six channels: its place in its parent, then its rotation.

    Args:
        path: where; a file that is there is replaced.
        tree: n nodes.
        rotation: (frames, n, 4) unit quaternions of the nodes in their parents; those of end sites aren't used.
        translation: (frames, n, 3) m, of the same.
        period: s between two frames.
        order: of the rotation channels.

    Raises:
        RecordingError: it can't be written.
    """
    joints = list(tree.joints)
    columns = np.empty((len(rotation), len(joints), 6))
    columns[:, :, :3] = translation[:, joints] * 100.0
    turns = matrices(rotation[:, joints].reshape(-1, 4))
    columns[:, :, 3:] = np.rad2deg(euler_angles(turns, order)).reshape(-1, len(joints), 3)
    head = ["HIERARCHY", *_block(tree, 0, order), "MOTION", f"Frames: {len(columns)}", f"Frame Time: {period:.9g}"]
    try:
        with path.open("w", encoding="ascii") as file:
            file.write("\n".join(head) + "\n")
            np.savetxt(file, columns.reshape(len(columns), -1), fmt="%.8f")
    except OSError as error:
        raise RecordingError(str(path), f"it can't be written ({error.strerror})", "Choose another place") from error


def _block(tree: Tree, index: int, order: Order, depth: int = 0) -> list[str]:
    """The lines of a node and of all that hangs on it."""
    node, indent = tree.nodes[index], "\t" * depth
    x, y, z = (100.0 * value + 0.0 for value in node.offset)  # no -0.0
    title = "End Site" if node.end else f"{'JOINT' if depth else 'ROOT'} {node.name}"
    lines = [f"{indent}{title}", f"{indent}{{", f"{indent}\tOFFSET {x:.8f} {y:.8f} {z:.8f}"]
    if not node.end:
        turns = " ".join(f"{axis}rotation" for axis in order)
        lines.append(f"{indent}\tCHANNELS 6 Xposition Yposition Zposition {turns}")
        for child in tree.children(index):
            lines += _block(tree, child, order, depth + 1)
    return [*lines, f"{indent}}}"]


class _Parser:
    def __init__(self, place: str, lines: list[str]) -> None:
        self._place, self._lines, self._at = place, lines, 0
        self._joints: list[Joint] = []
        self._columns = 0

    def hierarchy(self) -> list[Joint]:
        self._expect("HIERARCHY")
        words = self._expect("ROOT")
        self._joint(" ".join(words[1:]), -1)
        return self._joints

    def parse(self) -> Bvh:
        self.hierarchy()
        self._expect("MOTION")
        count = self._count(self._expect("Frames:"))
        where = self._at
        frame_time = self._floats(self._expect("Frame", "Time:")[2:], 1)[0]
        if not 0 < frame_time < 10:
            self._fail(f"a frame time of {frame_time:g} s", "It must be positive, in seconds")
        rows = [i for i, line in enumerate(self._lines[self._at :], self._at + 1) if line.strip()]
        left = len(rows)
        if left != count:
            self._at = rows[count] if left > count else where  # the first that is too many, or where they are said
            self._fail(
                f"{count} frames are said, and {left} lines follow", "Correct 'Frames:', or cut what is no frame"
            )
        frames: NDArray[np.float64] = np.empty((count, self._columns))
        for row in range(count):
            frames[row] = self._floats(self._next(f"frame {row + 1} of {count}"), self._columns)
        return Bvh(self._joints, frames, frame_time)

    def _joint(self, name: str, parent: int, end: bool = False, depth: int = 0) -> None:
        """Reads the block in braces of a joint or end site, with all its descendants."""
        if depth > DEEPEST:
            self._fail(f"joints within {DEEPEST} others", "No skeleton is so deep: correct the braces")
        self._expect("{")
        offset = np.array(self._floats(self._expect("OFFSET")[1:], 3))
        joint, index = Joint(name, parent, offset, end=end), len(self._joints)
        self._joints.append(joint)
        while (words := self._next("'}'"))[0] != "}":
            kind = words[0].upper()
            if kind == "CHANNELS":
                self._channels(joint, words[1:])
            elif kind == "JOINT":
                self._joint(" ".join(words[1:]), index, depth=depth + 1)
            elif kind == "END":
                self._joint(name + _END, index, end=True, depth=depth + 1)
            else:
                self._fail(f"'{words[0]}'", "Expected CHANNELS, JOINT, End Site or '}'")

    def _channels(self, joint: Joint, words: list[str]) -> None:
        if not words or words[0] != str(len(words) - 1):
            self._fail(f"CHANNELS {' '.join(words)}", "Expected their number, then as many names")
        for word in words[1:]:
            axis, kind = _AXES.get(word[:1].upper()), word[1:].lower()
            if axis is None or kind not in ("position", "rotation"):
                self._fail(f"the channel '{word}'", "Expected Xposition ... Zrotation")
            (joint.positions if kind == "position" else joint.rotations).append((axis, self._columns))
            self._columns += 1

    def _next(self, expected: str) -> list[str]:
        while self._at < len(self._lines):
            self._at += 1
            if words := self._lines[self._at - 1].split():
                if len(words) > 1 and words[-1] == "{":  # on the line of its joint, as some programs write it
                    self._lines[self._at - 1] = "{"
                    self._at -= 1
                    return words[:-1]
                return words
        self._fail("the file ends", f"Expected {expected}; it may have been cut short")

    def _expect(self, *start: str) -> list[str]:
        words = self._next(f"'{' '.join(start)}'")
        if start[-1].endswith(":"):  # the number may follow without a space
            words = " ".join(words).replace(":", ": ", 1).split()
        if tuple(word.upper() for word in words[: len(start)]) != tuple(map(str.upper, start)):
            self._fail(f"'{' '.join(words)[:60]}'", f"Expected '{' '.join(start)}'")
        return words

    def _count(self, words: list[str]) -> int:
        if len(words) != 2 or not re.fullmatch("[0-9]{1,9}", words[1]) or int(words[1]) < 2:
            self._fail(f"'{' '.join(words)}'", "Expected 'Frames:' and a number, 2 at least")
        return int(words[1])

    def _floats(self, words: list[str], count: int) -> list[float]:
        try:
            values = [float(word) for word in words]
        except ValueError:
            comma = next((word for word in words if re.fullmatch(r"-?\d+,\d+", word)), "")
            if comma:
                self._fail(f"'{comma}' has a decimal comma", "Write numbers with a point")
            self._fail("a word that is no number", f"Expected {count} number(s)")
        if len(values) != count:
            self._fail(f"{len(values)} number(s)", f"Expected {count}")
        if not np.isfinite(values).all():
            self._fail("a number that isn't finite", "Cut the frame out or fill the gap")
        return values

    def _fail(self, problem: str, remedy: str) -> NoReturn:
        raise RecordingError(f"{self._place}, line {self._at}", problem, remedy)
