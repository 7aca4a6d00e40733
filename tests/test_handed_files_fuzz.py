"""Files that a person hands over, damaged: each is read or refused in one line, in bounded time and memory.

Every trial mutates a small file that a reader takes, from a fixed seed; `make exhaustive` makes many more of them.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import random
import re
import resource
import signal
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
from helpers.arm_urdf import HIP
from helpers.recording import make_layout, make_rows, make_run
from pydantic import ValidationError

from srl.drivers.cyberglove import calibration
from srl.drivers.cyberglove.protocol import LABELS
from srl.drivers.odrive.config import PATHS, OdriveConfig
from srl.runtime.contracts.errors import OptionError, SrlError
from srl.runtime.contracts.files import KeptFile
from srl.runtime.ipc.layout import Layout
from srl.runtime.models.robot_model import RobotModel
from srl.runtime.models.skeleton import bvh
from srl.runtime.profile import edit, profile
from srl.runtime.recorder.process import Recorder
from srl.runtime.recording import reader
from srl.sim.parts.body import mocap_motion
from srl.sim.parts.person.path import read_path
from srl.sim.wearer import inhard, load_wearer, topics
from srl.sim.wearer.forces import ForceRecording, load_forces
from srl.sim.wearer.mat5 import read_mat5
from srl.studies.toolkit import sheets

MEMORY: Final = 1 << 30  # bytes beyond those of the tests' own process
SECONDS: Final = 6.0  # of processor time for one file
BIG: Final = "9" * 5000  # digits; Python makes no whole number of so many
KINDS: Final = (SrlError, OptionError)


def limit_memory() -> None:
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + MEMORY, size + MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)


def limit_time(clock: int = 30) -> None:
    """From now on: of the processor, and by the clock, which ends a read that waits."""
    for way in (signal.SIGPROF, signal.SIGALRM):
        signal.signal(way, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    signal.alarm(clock)


def file(folder: Path, name: str, content: str | bytes) -> Path:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


BVH: Final = """HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  End Site
  {
    OFFSET 0 5 0
  }
}
MOTION
Frames: 2
Frame Time: 0.01
0 0 0 0 0 0
0 0 0 0 0 1
"""
SENSORS: Final = [f"s{i}" for i in range(22)]
GLOVE: Final = "person: P07\ndate: 2026-02-17\nhand: right\nsensors:\n" + "".join(
    f"  {name}: {{gain: 0.01, offset: 80}}\n" for name in LABELS[22]
)


def table(
    head: Iterable[str] = ("time", *SENSORS), step: float = 0.01, comma: str = ",", point: str = ".", n: int = 30
) -> str:
    names = list(head)
    rows = [[k * step, *(0.3 + 0.2 * np.sin(k / 5.0 + j) for j in range(len(names) - 1))] for k in range(n)]
    lines = (comma.join(f"{v:.6f}".replace(".", point) for v in row) for row in rows)
    return "\n".join([comma.join(names), *lines, ""])


def zipped(**members: bytes | np.ndarray) -> bytes:
    """An NPZ file; a member may be the bytes of its NPY."""
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(f"{name}.npy", content if isinstance(content, bytes) else npy(content))
    return made.getvalue()


def npy(array: np.ndarray) -> bytes:
    made = io.BytesIO()
    np.save(made, array)
    return made.getvalue()


HAND: Final[dict[str, Any]] = {
    "time": np.arange(30) * 0.01, "position": np.array([[float(v) for v in line.split(",")[1:]]
                                                       for line in table().splitlines()[1:]]),
    "names": np.array(SENSORS),
}  # fmt: skip
DOOR: Final[dict[str, Any]] = {
    "hand_position": HAND["position"], "hand_joint_names": HAND["names"], "episode": np.zeros(30)
}  # fmt: skip


# -- the readers


def kept(read: Callable[[KeptFile], object]) -> Callable[[Path], object]:
    return lambda path: read(KeptFile(path, path.read_bytes()))


@dataclass(frozen=True)
class Handed:
    """A reader, and how its file is made.

    Attributes:
        good: makes the file's content, and beside it what else the reader needs.
        read: the reader.
        name: of the file.
        kinds: errors with which it refuses.
        wrap: puts what was mutated into the file's form: a checksum, a compression.
        trials: of the fast run.
    """

    good: Callable[[Path], str | bytes]
    read: Callable[[Path], object]
    name: str
    kinds: tuple[type[Exception], ...] = KINDS
    wrap: Callable[[bytes], bytes] = bytes
    trials: int = 60


def four_topics(folder: Path) -> str:
    text = "rosbagTimestamp,data\n" + "".join(f"{17 * 10**17 + k * 10**7},{k / 10}\n" for k in range(8))
    for finger in ("index", "middle", "ring", "little"):
        file(folder, f"a_{finger}_finger_joint_1.csv", text)
    return text


def element(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", kind, len(data)) + data + b"\0" * (-len(data) % 8)


def matrix(*values: float) -> bytes:
    size = struct.pack("<2i", 3, len(values) // 3)
    head = element(6, struct.pack("<II", 6, 0)) + element(5, size) + element(1, b"x")
    return element(14, head + element(9, np.array(values, float).tobytes()))


def struct_of(**fields: bytes) -> bytes:
    head = element(6, struct.pack("<II", 2, 0)) + element(5, struct.pack("<2i", 1, 1)) + element(1, b"s")
    names = b"".join(name.encode().ljust(32, b"\0") for name in fields)
    return element(14, head + element(5, struct.pack("<i", 32)) + element(1, names) + b"".join(fields.values()))


def matlab(content: bytes) -> bytes:
    return b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + content


PUSHED: Final = struct_of(F=matrix(*range(12)), pos=matrix(*range(12)), vel=matrix(*[100.0] * 12))
SMALL: Final = """name: small
rate: 100
devices:
  glove: {driver: cyberglove, port: /dev/srl-glove, sensors: 22}   # of the person
setpoints:
  client.goal: {shape: [2], unit: rad, labels: [a, b]}
side: left
choices: {side: {left: {stop: {}}, right: {}}}
"""
GUIDED: Final = {
    "format": "srl-glove-1", "person": "P07", "date": "2026-02-17", "hand": "right", "simulated": False,
    "signal": "glove.raw", "sensors": {name: {"gain": 0.01, "offset": 80.0, "noise": 0.1} for name in LABELS[22]},
    "average": [], "uncertain": 0.1, "again": 0.1,
}  # fmt: skip
ENDPOINTS: Final = json.dumps(
    {"fw_version": "0.6.10", "hw_version": "5.2.0", "endpoints": {p: {"id": 7, "type": k} for p, k in PATHS.items()}}
)
POSES: Final = "time,x,y,z,qw,qx,qy,qz\n" + "".join(f"{k / 50},0,0,0,1,0,0,0\n" for k in range(30))
FORCES: Final = "time,Fx,Fy,Fz\n" + "".join(f"{k / 100},1,2,3\n" for k in range(30))
ACTIONS: Final = "File_name,Subject,Meta_action_label,Action_start_bvh_frame,Action_end_bvh_frame\nP01,P,Pick,0,10\n"


glove: Final = kept(lambda file: calibration.load(file, 22))


def forces(path: Path) -> object:
    return load_forces(ForceRecording(file=path), "force")


def endpoints(path: Path) -> object:
    options: dict[str, Any] = {"endpoints": KeptFile(path, path.read_bytes())}
    return OdriveConfig.model_construct(**options).numbers()


def override(path: Path) -> object:
    text = path.read_bytes().decode("utf-8", "replace").replace("\0", "")
    return profile.parse("a.yaml", SMALL, [text]), edit.edited("a.yaml", SMALL, [text])


def black_box(folder: Path) -> bytes:
    layout = make_layout(100, 2)
    run, ring, events = make_run(folder, layout, 16)
    for row in make_rows(layout, 10):
        ring.append(row)
    ring.close()
    events.close()
    return run.rows.read_bytes()


def recording(folder: Path) -> bytes:
    layout = make_layout(20, 2)
    run, ring, _ = make_run(folder, layout, 64)
    for row in make_rows(layout, 40):
        ring.append(row)
    ring.finish()
    Recorder(run, folder / "made.rrd").run()
    return (folder / "made.rrd").read_bytes()


def array(name: str, members: dict[str, Any]) -> Handed:
    """An array within an NPZ."""
    return Handed(
        lambda _: npy(members[name]), load_wearer, "a.npz", wrap=lambda data: zipped(**members | {name: data})
    )


READERS: Final[dict[str, Handed]] = {
    "BVH": Handed(lambda _: BVH, bvh.read, "a.bvh", trials=200),
    "BVH's tree": Handed(lambda _: BVH, bvh.read_tree, "a.bvh", trials=200),
    "table of a hand": Handed(lambda _: table(n=8), load_wearer, "a.csv", trials=100),
    "NPZ of a hand": Handed(lambda _: zipped(**HAND), load_wearer, "a.npz"),
    "positions": array("position", HAND), "times": array("time", HAND), "names": array("names", HAND),
    "episodes": array("episode", DOOR),
    "topic": Handed(four_topics, lambda path: topics.read(path.parent), "a_thumb_base.csv", trials=30),
    "forces": Handed(lambda _: FORCES, forces, "a.csv"),
    "forces in NPZ": Handed(lambda _: npy(np.ones((9, 6))), forces, "a.npz",
                            wrap=lambda data: zipped(t=np.arange(9) * 0.01, F=data)),
    "forces in MATLAB": Handed(lambda _: matlab(PUSHED), forces, "a.mat", trials=200),
    "MATLAB, packed": Handed(lambda _: PUSHED, read_mat5, "a.mat",
                             wrap=lambda data: matlab(element(15, zlib.compress(data))), trials=200),
    "poses": Handed(lambda _: POSES, lambda path: mocap_motion.read(path, 100.0), "a.csv"),
    "points": Handed(lambda _: "x,y,z\n0,0,0\n0.1,0,0\n0.2,0.1,0\n", read_path, "a.csv", trials=200),
    "actions": Handed(lambda _: ACTIONS, lambda path: inhard.actions(path.parent), "InHARD.csv", trials=200),
    "sheet": Handed(lambda _: "person,time\nP07,1.5\n", lambda path: sheets.read(path, ["time"]), "a.csv", trials=90),
    "profile": Handed(lambda _: SMALL, lambda path: profile.load(str(path)), "a.yaml", trials=60),
    "override": Handed(lambda _: "devices.glove.port={a: [1, 2.5, 'b'], c: 2026-02-17}", override, "a.txt", trials=20),
    "glove": Handed(lambda _: GLOVE, glove, "a.yaml", trials=15),
    "glove, guided": Handed(lambda _: json.dumps(GUIDED), glove, "a.json"),
    "VirtualHand": Handed(lambda _: "a 1 2 3 4 5 80 7 8 0.01 0.01\n" * 30, glove, "a.cal"),
    "endpoints": Handed(lambda _: ENDPOINTS, endpoints, "a.json", (ValueError,), trials=200),
    "URDF": Handed(lambda _: HIP, kept(lambda file: RobotModel.model_validate({"urdf": file}).robot.n), "a.urdf",
                   (*KINDS, ValidationError), trials=40),
    "layout": Handed(lambda _: make_layout(100, 2).text, Layout.load, "layout.json"),
    "recording": Handed(recording, lambda path: reader.read(path).events, "a.rrd", trials=40),
    "black box": Handed(black_box, lambda path: reader.read(path.parent), "rows.ring"),
}  # fmt: skip
SLOW: Final = ("override", "profile", "actions", "glove")


# -- the mutations

NUMBERS: Final = ("0", "-1", "2", "1e308", "-1e308", "1e-320", "1e999", "nan", BIG, "9" * 14, "9" * 20, "²", "0x1f",
                  "1_0", "1:30", "0,5", "2026-02-31", "!!int a", "true", "")  # fmt: skip
INTEGERS: Final = (0, 1, -1, 2, 14, 127, 1 << 15, (1 << 31) - 1, 1 << 31, 1 << 40, (1 << 62) + 1, (1 << 63) - 1)
ODD: Final = ("\0", "\ufeff", "²", "\u2028", "é", "\r", "\t", '"', "'", ",", ";", ":", "{", "}", "[", "]", "<", "&a ",
              "*a", "!!bool ", "%", "#", "|", "?", "- ", "\\ud800", "\\UFFFFFFFF", "[" * 1500, "{" * 1500)  # fmt: skip
MOST: Final = 200_000  # bytes of a mutated file


def mutated(good: bytes, rng: random.Random) -> bytes:
    for _ in range(rng.choice((1, 1, 2, 4))):
        text = good.decode(errors="ignore")
        text = text if text.encode() == good else ""
        good = spoilt(text, rng).encode() if text and rng.random() < 0.85 else damaged(bytearray(good), rng)
    return good[:MOST]


def spoilt(text: str, rng: random.Random) -> str:
    """Another number, word, line or sign in a text."""
    way, ends = rng.randrange(6), sorted((rng.randrange(len(text) + 1), rng.randrange(len(text) + 1)))
    start, end, new = *ends, rng.choice(ODD)
    if way < 2 and (found := list(re.finditer(r"-?\d+(\.\d+)?" if way else r"[^\W\d]+", text))):
        start, end = rng.choice(found).span()
        new = rng.choice(NUMBERS) if way else rng.choice((rng.choice(found)[0], new))
    elif way < 4 and len(lines := text.splitlines(keepends=True)) > 1:
        i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
        lines[i : i + rng.randrange(2)] = [lines[j]] * rng.choice((0, 1, 1, 2, 500))
        return "".join(lines)
    elif way == 4:
        new = text[start:end] * rng.choice((0, 2, 3, 400))
    else:
        end = start
    return text[:start] + new + text[end:]


def damaged(data: bytearray, rng: random.Random) -> bytes:
    """Other bytes in a file: a bit, a whole number, a piece."""
    way, at, size = rng.randrange(5), rng.randrange(len(data) + 1), rng.choice((1, 2, 4, 8))
    if way == 0 and at < len(data):
        data[at] ^= 1 << rng.randrange(8)
    elif way == 1:
        at -= at % size
        data[at : at + size] = (rng.choice(INTEGERS) % (1 << 8 * size)).to_bytes(size, rng.choice(("little", "big")))
    elif way == 2:
        del data[at : at + rng.randrange(1, 40)]
    elif way == 3:
        data[at:at] = rng.choice((rng.randbytes(size), data[at : at + 64] * rng.choice((1, 300))))
    else:
        del data[at:]
    return bytes(data)


def faults(handed: Handed, folder: Path, first: int, count: int) -> list[str]:
    found, last = dict[str, str](), first + count
    made, at = handed.good(folder), first
    good = made if isinstance(made, bytes) else made.encode()
    while at < last and len(found) < 12:
        output = ["", ""]
        out, into = os.pipe()
        if not (child := os.fork()):
            with contextlib.suppress(BaseException):
                trials(handed, good, folder / handed.name, range(at, last), into)
            os._exit(0)
        os.close(into)
        with os.fdopen(out, encoding="utf-8", errors="replace") as pipe:
            for line in pipe:
                output = line.rstrip("\n").split("\t", 1)
                if output[1]:
                    found.setdefault(re.sub(r"\d+|'.*'", "", output[1])[:60], f"trial {output[0]}: {output[1]}")
        _, status = os.waitpid(child, 0)
        if how := os.WIFSIGNALED(status) and signal.Signals(os.WTERMSIG(status)).name:
            found.setdefault(how, f"trial {output[0]}: killed by {how}: a hang or a crash")
        at = int(output[0] or last) + 1
    return list(found.values())


def trials(handed: Handed, good: bytes, path: Path, numbers: range, into: int) -> None:
    """Tells each number before its trial, and what went wrong after it; the process may die in any."""
    limit_memory()
    for number in numbers:
        os.write(into, f"{number}\t\n".encode())
        limit_time()
        path.unlink(missing_ok=True)
        path.write_bytes(handed.wrap(mutated(good, random.Random(f"{handed.name} {number}"))))
        try:
            handed.read(path)
        except handed.kinds as error:
            lines = str(error).splitlines() if isinstance(error, KINDS) else [""]
            fault = "" if len(lines) == 1 else f"{len(lines)} lines: {lines[:2]}"
        except BaseException as error:
            at = error.__traceback__
            while at is not None and at.tb_next is not None:
                at = at.tb_next
            where = f"{Path(at.tb_frame.f_code.co_filename).name}:{at.tb_lineno}" if at is not None else ""
            fault = f"{type(error).__name__} at {where}: {str(error)[:100]!r}"
        else:
            continue
        if fault:
            os.write(into, f"{number}\t{fault}\n".encode(errors="replace"))


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] * (n in SLOW)) for n in READERS])
def test_a_damaged_file_is_read_or_refused(name: str, tmp_path: Path) -> None:
    assert faults(READERS[name], tmp_path, 0, READERS[name].trials) == []


@pytest.mark.slow
@pytest.mark.exhaustive
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("name", READERS)
def test_many_damaged_files_are_read_or_refused(name: str, tmp_path: Path) -> None:
    assert faults(READERS[name], tmp_path, 10_000, 30 * READERS[name].trials) == []
