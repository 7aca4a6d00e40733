"""The files of a former or foreign run: only their owner reads them; damaged ones are named wherever they are read."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from helpers import environment
from helpers.recording import make_layout, make_rows, make_run

from srl.runtime.cli import main
from srl.runtime.contracts.errors import SrlError
from srl.runtime.ipc.channel import Channel
from srl.runtime.ipc.events import EventReader
from srl.runtime.ipc.launch import Launch
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.requests import RequestReader, RequestWriter
from srl.runtime.ipc.ring import RingReader, RingWriter
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.ipc.stop_slots import StopSlots


@pytest.fixture
def run(tmp_path: Path) -> RunFolder:
    """A run folder with all its files, and three rows."""
    before = os.umask(0)
    try:
        layout = make_layout()
        layout.meta["bus"] = None
        folder, ring, _ = make_run(tmp_path / "run", layout)
        for row in make_rows(layout, 3):
            ring.append(row)
        RequestWriter.create(folder.requests)
        StopSlots.create(folder.stops)
        Launch("made-up", "name: made-up\n").save(folder.launch)
    finally:
        os.umask(before)
    return folder


def test_only_their_owner_reads_them(run: RunFolder) -> None:
    files = [path for path in run.path.iterdir()]
    assert len(files) == 6
    assert {path.name: oct(path.stat().st_mode & 0o777) for path in files} == {path.name: "0o600" for path in files}


def truncated(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-7])


def emptied(path: Path) -> None:
    path.write_bytes(b"")


def binary(path: Path) -> None:
    path.write_bytes(bytes(range(256)) * (max(path.stat().st_size // 256, 1)))


def other_keys(path: Path) -> None:
    path.write_text(json.dumps({"devices": [], "colour": "red"}))


def a_list(path: Path) -> None:
    path.write_text("[1, 2]")


def nested(path: Path) -> None:
    path.write_text("[" * 100_000)


def header(index: int, value: int) -> Callable[[Path], None]:
    """A ring's header that lies."""

    def damage(path: Path) -> None:
        words = np.memmap(path, np.int64, "r+")
        words[index] = value
        words.flush()

    damage.__name__ = f"word {index} is {value}"
    return damage


ANY = [truncated, emptied, binary, other_keys, a_list, nested]
WIDTH, CAPACITY, HEAD, CONSUMED = 1, 2, 3, 5
RING = [*ANY, header(WIDTH, 0), header(WIDTH, 1 << 60), header(CAPACITY, -1), header(HEAD, -5), header(CONSUMED, 99)]
READERS: dict[str, tuple[Callable[[Path], object], list[Callable[[Path], None]]]] = {
    "launch": (Launch.load, ANY),
    "layout": (Layout.load, ANY),
    "stops": (StopSlots, [truncated, emptied, other_keys]),
    "rows": (RingReader, RING),
    "events": (EventReader, [*RING, header(WIDTH, 2)]),
    "requests": (RequestReader, RING),
}


@pytest.mark.parametrize(
    ("file", "damage"), [(f, d) for f, (_, ds) in READERS.items() for d in ds], ids=lambda x: getattr(x, "__name__", x)
)
def test_a_damaged_file_is_named_with_a_remedy(run: RunFolder, file: str, damage: Callable[[Path], None]) -> None:
    path = getattr(run, file)
    damage(path)
    with pytest.raises(SrlError) as error:
        READERS[file][0](path)
    assert str(path) in error.value.place
    assert error.value.problem
    assert error.value.remedy


def test_a_layout_whose_signals_overlap_is_refused(run: RunFolder) -> None:
    content = json.loads(run.layout.read_text())
    content["fields"][1]["offset"] = 0
    run.layout.write_text(json.dumps(content))
    with pytest.raises(SrlError, match="no place of its own"):
        Layout.load(run.layout)


@pytest.mark.parametrize("size", [float("inf"), 1 << 70])
def test_a_layout_with_a_size_that_is_none_is_refused(run: RunFolder, size: float) -> None:
    content = json.loads(run.layout.read_text())
    content["fields"][0]["shape"] = [size]
    run.layout.write_text(json.dumps(content))
    with pytest.raises(SrlError, match="the layout is damaged"):
        Layout.load(run.layout)


@pytest.mark.parametrize("file", ["rows", "layout", "events"])
@pytest.mark.parametrize("damage", [truncated, binary, other_keys], ids=lambda d: d.__name__)
def test_replay_of_a_damaged_black_box(
    run: RunFolder, file: str, damage: Callable[[Path], None], capsys: pytest.CaptureFixture[str]
) -> None:
    damage(getattr(run, file))
    assert main(["replay", str(run.path)]) == 2
    output = capsys.readouterr().err
    assert output.startswith("srl replay: ")
    assert str(getattr(run, file)) in output
    assert "Traceback" not in output


def test_replay_of_a_layout_without_its_profile(run: RunFolder, capsys: pytest.CaptureFixture[str]) -> None:
    layout = make_layout()
    rows = make_rows(layout, 1)
    rows[:, 0] = 0  # the first cycle
    ring = RingWriter.create(run.rows, layout.width, 16)
    ring.append(rows[0])
    assert main(["replay", str(run.path)]) == 2
    assert "it lacks label" in capsys.readouterr().err


META = {"label": "x", "profile": "name: toy", "overrides": [], "simulated": [], "limits": {}}
META |= {"automatic": True, "versions": {}, "blas": "", "latches": []}
WRONG = [("label", 3), ("profile", None), ("overrides", 1.5), ("simulated", 7), ("limits", 1), ("versions", "x")]
WRONG += [("limits", {"arm.q": 3}), ("latches", "person"), ("latches", [[]])]


@pytest.mark.parametrize(("key", "value"), WRONG)
def test_replay_of_a_layout_with_other_types(
    run: RunFolder, key: str, value: object, capsys: pytest.CaptureFixture[str]
) -> None:
    layout = make_layout()
    rows = make_rows(layout, 1)
    rows[:, 0] = 0  # the first cycle
    ring = RingWriter.create(run.rows, layout.width, 16)
    ring.append(rows[0])
    layout.meta |= META | {key: value}
    layout.save(run.layout)
    assert main(["replay", str(run.path)]) == 2
    assert f"the layout is damaged: {key}" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("file", ["rows", "layout", "events"])
@pytest.mark.parametrize("module", ["srl.runtime.bus", "srl.runtime.recorder"])
def test_bus_and_recorder_refuse_damaged_files(run: RunFolder, module: str, file: str, tmp_path: Path) -> None:
    other_keys(getattr(run, file))
    more = ["--out", str(tmp_path / "x.rrd")] if module.endswith("recorder") else []
    done = subprocess.run(
        [sys.executable, "-m", module, str(run.path), *more], env=environment(), capture_output=True, text=True,
        timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 2, done.stderr
    assert str(getattr(run, file)) in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("damage", [truncated, other_keys], ids=lambda d: d.__name__)
def test_the_loop_tells_its_supervisor_of_a_damaged_launch_file(run: RunFolder, damage: Callable[[Path], None]) -> None:
    damage(run.launch)
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    done = subprocess.run(
        [sys.executable, "-m", "srl.runtime.loop", str(run.path), str(theirs.fileno())], env=environment(),
        pass_fds=[theirs.fileno()], capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    theirs.close()
    assert done.returncode == 2, done.stderr
    assert done.stderr == ""
    heard = Channel(ours).receive()
    assert heard is not None
    assert (heard[0]["say"], heard[0]["place"]) == ("failed", str(run.launch))
    ours.close()
