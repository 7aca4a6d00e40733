"""MVNX files: what MVN exports as XML of a recording. Versions 3 and 4 are read.

A segment's axes are MVN's (x forward, y left, z up in the T-pose), its origin is the joint towards the pelvis. Lengths
are in m, joint angles in degrees about the joint's x, y, z, in the order in which MVN turns them, ZXY.

Only what is used is kept. An entity isn't expanded: a file that declares one is refused.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final, NoReturn
from xml.parsers import expat

import numpy as np

from srl.drivers.xsens_mvn.protocol import FARTHEST, JOINT_ENDS, SEGMENTS
from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.files import open_regular
from srl.runtime.contracts.signals import Array

VERSIONS: Final = ("3", "4")
MOST: Final = 1 << 28  # bytes that are read
_DEEPEST: Final = 32  # elements within each other; MVN nests 8
_LONGEST: Final = 1 << 16  # letters of one element
_CHUNK: Final = 1 << 16
_UNIT: Final = 0.05  # by which a quaternion's length may differ from 1
_FASTEST: Final = 1000.0  # Hz
_LATE: Final = 0.1  # s by which a frame's own time may differ from that of its number; and as a share of the time
_WIDTHS: Final = {"position": 3, "orientation": 4, "jointAngle": 3}
_CENTRES: Final = (3, 9)  # numbers of a centre of mass: alone, or with velocity and acceleration
_STILL: Final = ("identity", "npose", "tpose", "tpose-isb")  # the poses of MVN's calibration, before the motion
_CUT: Final = "Cut the frame out in MVN"
_CUT_SHORT: Final = (expat.errors.XML_ERROR_NO_ELEMENTS, expat.errors.XML_ERROR_UNCLOSED_TOKEN)
_ENDS: Final = {(SEGMENTS[a - 1], SEGMENTS[b - 1]): name for name, (a, b) in JOINT_ENDS.items()}


@dataclass(frozen=True)
class Mvnx:
    """A file's motion: n frames of k segments.

    Attributes:
        segments: (k,) MVN's names.
        rate: Hz.
        times: (n,) s from the first frame.
        position: (n, k, 3) m in MVN's world.
        orientation: (n, k, 4) unit quaternions w x y z.
        joints: MVN's joints, in the order of `joint_angles`; as `JOINT_ENDS` calls them, found by their segments.
        joint_angles: (n, j, 3) rad; None if the file has none.
        centre_of_mass: (n, 3) m; None if the file has none.
        poses: position (k, 3) and orientation (k, 4) of the poses before the motion: identity, npose, tpose, tpose-isb.
        recorded: ms of Unix time at the first frame; None if the file doesn't say it.
    """

    segments: tuple[str, ...]
    rate: float
    times: Array
    position: Array
    orientation: Array
    joints: tuple[str, ...]
    joint_angles: Array | None
    centre_of_mass: Array | None
    poses: dict[str, tuple[Array, Array]]
    recorded: int | None


def read(path: Path) -> Mvnx:
    """Reads a file of two frames at least.

    Raises:
        RecordingError: with the line, what was expected there, and the remedy.
    """
    return _Reader(str(path)).read(path)


class _Reader:
    """Takes the elements as they come, so that only the numbers stay in memory."""

    def __init__(self, place: str) -> None:
        self._place = place
        self._open: list[str] = []  # names of the elements around
        self._text: list[str] | None = None  # of an element whose text is used
        self._length = 0
        self._segments: list[str] = []
        self._joints: list[str] = []
        self._ends: list[str] = []
        self._rate = 0.0
        self._kind = ""
        self._values: dict[str, Array] = {}
        self._width: dict[str, int] = {}
        self._index: list[int] = []
        self._frames: dict[str, list[Array]] = {"position": [], "orientation": [], "jointAngle": [], "centerOfMass": []}
        self._poses: dict[str, tuple[Array, Array]] = {}
        self._recorded: int | None = None
        self._begun: int | None = None  # ms, the first frame's own time
        self._parser = parser = expat.ParserCreate(namespace_separator=" ")
        parser.StartElementHandler, parser.EndElementHandler = self._start, self._end
        parser.CharacterDataHandler = self._characters
        parser.EntityDeclHandler = self._entity
        parser.buffer_text = True

    def read(self, path: Path) -> Mvnx:
        read = 0
        try:
            with open_regular(path) as file:
                while chunk := file.read(_CHUNK):
                    read += len(chunk)
                    if read > MOST:
                        problem = f"it has more than {MOST >> 20} MiB"
                        raise RecordingError(self._place, problem, "Export a part, or fewer of MVN's quantities")
                    self._parser.Parse(chunk, False)
                self._parser.Parse(b"", True)
        except OSError as error:
            raise RecordingError(self._place, f"it can't be read ({error})", "Give an .mvnx file") from error
        except expat.ExpatError as error:
            self._broken(error)
        return self._made()

    # -- the elements

    def _start(self, full: str, attributes: dict[str, str]) -> None:
        name = full.rpartition(" ")[2]
        if len(self._open) >= _DEEPEST:
            self._fail(f"elements within {_DEEPEST} others", "Give a file as MVN exports it")
        self._open.append(name)
        if len(self._open) == 1:
            self._root(name, attributes)
        elif name == "subject" and len(self._open) == 2:
            if self._rate:
                self._fail("a second 'subject'", "Export each person to a file of its own")
            self._rate = self._number(attributes.get("frameRate", ""), "frameRate")
            if not 1.0 <= self._rate <= _FASTEST:
                self._fail(f"a frameRate of {self._rate:g} Hz", f"Expected 1 to {_FASTEST:g}")
        elif name == "segment" and self._open[-2] == "segments":
            label = attributes.get("label", "")
            if not label or label in self._segments:
                self._fail(f"a segment '{label}'{' once more' * bool(label)}", "Give each segment a label of its own")
            if len(self._segments) == 200:
                self._fail("more than 200 segments", "Give a file as MVN exports it")
            self._segments.append(label)
        elif name == "joint" and self._open[-2] == "joints":
            self._ends = []
        elif name in ("connector1", "connector2") and self._open[-2] == "joint":
            self._listen()
        elif name == "frame" and self._open[-2] == "frames":
            self._frame(attributes)
        elif self._open[-2] == "frame" and self._kind and name in self._frames:
            if name in self._values:
                self._fail(f"'{name}' twice in a frame", "Give a file as MVN exports it")
            self._listen()

    def _end(self, full: str) -> None:
        name = self._open.pop()
        text, self._text = ("", None) if self._text is None else ("".join(self._text), None)
        above = self._open[-1] if self._open else ""
        if name in ("connector1", "connector2") and above == "joint":
            self._ends.append(text.partition("/")[0].strip())
        elif name == "joint" and above == "joints":
            self._joints.append(_ENDS.get((self._ends[0], self._ends[-1]), "") if self._ends else "")
        elif above == "frame" and self._kind and name in self._frames:
            self._values[name] = self._numbers(name, text)
        elif name == "frame" and above == "frames":
            self._frame_ends()

    def _characters(self, text: str) -> None:
        if self._text is not None:
            self._length += len(text)
            if self._length > _LONGEST:
                self._fail(f"'{self._open[-1]}' has more than {_LONGEST} letters", "Give a file as MVN exports it")
            self._text.append(text)

    def _entity(self, name: str, *_: object) -> None:
        self._fail(f"it declares the entity '{name[:40]}'", "Entities aren't read: MVN exports none")

    def _listen(self) -> None:
        self._text, self._length = [], 0

    def _root(self, name: str, attributes: dict[str, str]) -> None:
        if name != "mvnx":
            self._fail(f"its root is '{name[:40]}'", "Expected 'mvnx': export it as MVNX from MVN")
        version = attributes.get("version", "")
        if version not in VERSIONS:
            known = " and ".join(VERSIONS)
            self._fail(f"it is of MVNX version '{version[:20]}'; srl reads {known}", "Export it again from a newer MVN")

    # -- frames

    def _frame(self, attributes: dict[str, str]) -> None:
        if not self._segments or not self._rate:
            self._fail("a frame before the subject's segments and frame rate", "Give a file as MVN exports it")
        self._kind, self._values = attributes.get("type", "normal"), {}
        if self._kind != "normal" and self._kind not in _STILL:
            self._fail(f"a frame of type '{self._kind[:20]}'", f"Expected normal, {', '.join(_STILL)}")
        if self._kind != "normal":
            return
        number = self._whole(attributes.get("index", str(len(self._index))), "index")
        if self._index and number <= self._index[-1]:
            self._fail(f"frame {number} after frame {self._index[-1]}", "Frames must be in order")
        self._index.append(number)
        if (own := attributes.get("time")) is not None:
            self._timed(self._whole(own, "time"))
        if self._recorded is None and len(self._index) == 1 and "ms" in attributes:
            self._recorded = self._whole(attributes["ms"], "ms") or None

    def _timed(self, own: int) -> None:
        """Raises RecordingError: the frames' times say that the frame rate is another one."""
        self._begun = own if self._begun is None else self._begun
        by_number = (self._index[-1] - self._index[0]) / self._rate
        by_time = (own - self._begun) / 1000.0
        if abs(by_time - by_number) > _LATE * max(1.0, by_number):
            problem = f"this frame's time is {by_time:.3f} s after the first's, its number says {by_number:.3f} s"
            self._fail(problem, f"Is the frame rate {self._rate:g} Hz?")

    def _frame_ends(self) -> None:
        if missing := [name for name in ("position", "orientation") if name not in self._values]:
            if self._kind != "normal":
                return
            self._fail(f"the frame has no '{missing[0]}'", "Tick it in MVN's export")
        position, q = self._values["position"], self._values["orientation"].reshape(-1, 4)
        if abs(position).max() > FARTHEST:
            self._fail(f"a position of {abs(position).max():.3g} m", "MVNX has m")
        sizes = np.linalg.norm(q, axis=1)
        if (bad := np.flatnonzero(abs(sizes - 1.0) > _UNIT)).size:
            segment = self._segments[bad[0]]
            self._fail(f"the orientation of {segment} is no unit quaternion (length {sizes[bad[0]]:.3g})", _CUT)
        self._values["orientation"] = q / sizes[:, None]
        if self._kind != "normal":
            self._poses[self._kind] = position.reshape(-1, 3), self._values["orientation"]
            return
        for name, kept in self._frames.items():
            if len(self._index) > 1 and (name in self._values) != bool(kept):
                self._fail(f"'{name}' is in some frames only", "Export it for all frames, or for none")
            if name in self._values:
                kept.append(self._values[name])

    def _numbers(self, name: str, text: str) -> Array:
        words = text.split()
        try:
            values = np.array([float(word) for word in words])
        except ValueError:
            self._fail(f"a word that is no number in '{name}'", "Numbers have a point, and spaces between them")
        joints = name == "jointAngle"
        if name == "centerOfMass":
            if len(values) not in _CENTRES:
                self._fail(f"{len(values)} numbers in '{name}'", "Expected 3")
        else:
            things = self._joints if joints else self._segments
            if len(values) != _WIDTHS[name] * len(things):
                of = f"{_WIDTHS[name]} for each of {len(things)} {'joints' if joints else 'segments'}"
                self._fail(f"{len(values)} numbers in '{name}'", f"Expected {of}")
        if not np.isfinite(values).all():
            self._fail(f"a number in '{name}' that isn't finite", _CUT)
        return values

    # -- what was read

    def _made(self) -> Mvnx:
        n, k = len(self._index), len(self._segments)
        if n < 2:
            raise RecordingError(self._place, f"it has {n} frame(s) of a motion", "A motion needs two at least")
        angles, centres = self._frames["jointAngle"], self._frames["centerOfMass"]
        return Mvnx(
            tuple(self._segments), self._rate, (np.array(self._index, float) - self._index[0]) / self._rate,
            np.array(self._frames["position"]).reshape(n, k, 3),
            np.array(self._frames["orientation"]).reshape(n, k, 4),
            tuple(self._joints),
            np.deg2rad(np.array(angles)).reshape(n, -1, 3) if angles else None,
            np.array([centre[:3] for centre in centres]) if centres else None,
            self._poses, self._recorded,
        )  # fmt: skip

    def _number(self, text: str, name: str) -> float:
        try:
            return float(text)
        except ValueError:
            self._fail(f"{name} is '{text[:20]}'", "Expected a number")

    def _whole(self, text: str, name: str) -> int:
        if not text.strip().removeprefix("-").isascii() or not text.strip().removeprefix("-").isdigit():
            self._fail(f"a frame's {name} is '{text[:20]}'", "Expected a whole number")
        if len(text) > 18:
            self._fail(f"a frame's {name} has {len(text)} digits", "Correct it")
        return int(text)

    def _broken(self, error: expat.ExpatError) -> NoReturn:
        what = expat.ErrorString(error.code) or "an error"
        problem, remedy = f"it isn't well-formed XML ({what})", "Export or copy it again"
        if what in _CUT_SHORT:
            where = f"in frame {len(self._index)}" if self._index else "before its first frame"
            problem, remedy = f"the file ends {where}", "It was cut short: export or copy it again"
        raise RecordingError(f"{self._place}, line {error.lineno}", problem, remedy) from None

    def _fail(self, problem: str, remedy: str) -> NoReturn:
        raise RecordingError(f"{self._place}, line {self._parser.CurrentLineNumber}", problem, remedy)
