"""What happens when something dies: telemetry, the loop, the supervisor. Times are printed, not asserted tightly."""

from __future__ import annotations

import json
import os
import random
import signal
import time
from pathlib import Path

import numpy as np
import pytest
from helpers.run import Running, alive, call
from helpers.wait import until

from srl.runtime.bus.client import connect
from srl.runtime.cli import main
from srl.runtime.contracts.errors import RequestError
from srl.runtime.ipc.control_socket import send_note
from srl.runtime.ipc.events import EventReader
from srl.runtime.ipc.header import Cause, State
from srl.runtime.recording.reader import read
from srl.runtime.recording.segments import folder_of, listed


@pytest.mark.serial  # a ring holds some seconds of rows: the recorder must be back in them
def test_killed_telemetry_costs_no_cycle(tmp_path: Path) -> None:
    with Running(tmp_path, "sixth-finger", "--sim", "--record", "x.rrd") as run:
        run.started()
        run.until(lambda: set(run.children()) == {"loop", "bus", "recorder"}, "all processes")
        run.until(lambda: run.reader.head > 200, "two seconds of rows")
        back = {}
        for name in ("bus", "recorder"):
            old = run.children()[name]
            os.kill(old, signal.SIGKILL)
            killed = time.monotonic()
            run.until(lambda name=name, old=old: run.children().get(name, old) != old, f"the {name} again")
            if name == "recorder":
                mark = run.reader.consumed
                run.until(lambda mark=mark: run.reader.consumed > mark, "rows taken again")
            else:
                run.until(lambda: _answers(run), "an answer from the bus")
            back[name] = time.monotonic() - killed
            mark = run.reader.head
            run.until(lambda mark=mark: run.reader.head > mark + 100, "another second of rows")
        call(tmp_path, "stop", "--exit")
        found = run.finish()
    print(f"back after {back}")
    assert found["restarts"] == {"bus": 1, "recorder": 1}
    recording = read(tmp_path / "x.rrd")
    assert recording.missing == []
    assert len(recording.rows) == found["cycles"] > mark


def _answers(run: Running) -> bool:
    try:
        with connect(run.run_folder, timeout=0.2) as client:
            return bool(client.status()["state"])
    except RequestError:
        return False


def test_a_killed_supervisor_takes_the_limb_into_its_stop(tmp_path: Path) -> None:
    with Running(tmp_path, "sixth-finger", "--sim", "--duration", "60") as run:
        run.started()
        run.until(lambda: run.header("state") == State.ACTIVE, "motion")
        children = run.children()
        reader = run.reader
        os.kill(run.process.pid, signal.SIGKILL)
        run.process.wait()
        until(lambda: reader.closed, what="the loop's own end")
        assert run.header("state") == State.ENDED
        assert run.header("cause") == Cause.REQUEST
        until(lambda: not any(alive(pid) for pid in children.values()), what="the end of all it started")


@pytest.mark.slow
def test_a_killed_loop_is_said_and_its_rows_are_kept(tmp_path: Path) -> None:
    with Running(tmp_path, "sixth-finger", "--sim", "--duration", "60", "--record", "x.rrd") as run:
        run.started()
        run.until(lambda: run.reader.head > 300, "three seconds of rows")
        os.kill(run.children()["loop"], signal.SIGKILL)
        found = run.finish(code=1)
    assert "SIGKILL" in found["death"]["how"]
    box = read(Path(found["death"]["black_box"]))
    whole = read(tmp_path / "x.rrd")
    assert box.missing == whole.missing == []
    assert len(whole.rows) == len(box.rows) >= 300
    assert (whole.rows == box.rows).all()
    assert call(tmp_path, "replay", "x.rrd").returncode == 0


@pytest.mark.slow
@pytest.mark.sampled(1)
@pytest.mark.parametrize("seed", range(6))
def test_when_everything_is_killed_at_once_every_row_that_was_taken_is_there(
    tmp_path: Path, seed: int, capsys: pytest.CaptureFixture[str]
) -> None:
    """At a random instant: before, during and after segments are merged."""
    draw, out = random.Random(seed), tmp_path / "x.rrd"
    with Running(tmp_path, "sixth-finger", "--sim", "--duration", "120", "--record", "x.rrd") as run:
        run.started()
        run.until(lambda: set(run.children()) == {"loop", "bus", "recorder"}, "all processes")
        run.until(lambda: run.reader.consumed > 0, "the first rows on the disk")
        taken = run.reader.consumed + draw.randrange(500)  # 5 s; the first segment has 2 s
        run.until(lambda: run.reader.consumed >= taken, "rows on the disk")
        time.sleep(draw.uniform(0, 0.3))  # anywhere within a batch and a merge
        pids = [run.process.pid, *run.children().values()]
        draw.shuffle(pids)
        for pid in pids:
            os.kill(pid, signal.SIGKILL)
        run.process.wait()
        until(lambda: not any(alive(pid) for pid in pids), what="their end")
    ring = read(run.run_folder.path)
    kept = read(folder_of(out))
    assert ring.missing == kept.missing == []
    assert len(kept.rows) >= run.reader.consumed >= taken
    assert np.array_equal(kept.rows, ring.rows[: len(kept.rows)])
    assert [event.text for event in kept.events] == [event.text for event in ring.events[: len(kept.events)]]
    assert not out.exists()
    assert main(["recordings", str(tmp_path), "--json"]) == 0
    (reported,) = (e for e in json.loads(capsys.readouterr().out)["recordings"] if e["name"] == "x.rrd.segments")
    assert f"hasn't finished it; it has rows to number {len(kept.rows)}" in reported["problem"]
    assert ("torn" in reported["problem"]) == (kept.salvaged > 0)
    assert main(["replay", str(folder_of(out))]) == 0
    files = [file.name for file in listed(folder_of(out))]
    print(f"{len(ring.rows)} rows were computed, {len(kept.rows)} kept, {kept.salvaged} bytes torn, in {files}")


def test_stop_reset_and_start_reach_the_loop(tmp_path: Path) -> None:
    with Running(tmp_path, "sixth-finger", "--sim", "--duration", "60", "--set", "bus=null") as run:
        run.started()
        run.until(lambda: run.header("state") == State.ACTIVE, "motion")
        assert send_note(run.run_folder, "old.rrd was deleted")
        events = EventReader(run.run_folder.events)
        run.until(lambda: any(event.text == "old.rrd was deleted" for event in events.take()), "the note's event")
        assert "stopp" in call(tmp_path, "stop").stdout
        run.until(lambda: run.header("state") == State.STOPPED, "the stop")
        assert call(tmp_path, "start", code=2).stderr  # not ready but stopped: refused, with the reason
        call(tmp_path, "reset", "sixth-finger")
        run.until(lambda: run.header("state") == State.ACTIVE, "motion again")
        call(tmp_path, "stop", "--exit")
        found = run.finish()
    assert (found["state"], found["cause"]) == ("ended", "request")


@pytest.mark.slow
def test_one_instance_of_a_name_at_a_time(tmp_path: Path) -> None:
    with Running(tmp_path, "sixth-finger", "--sim", "--duration", "60", "--set", "bus=null") as run:
        run.started()
        done = call(tmp_path, "run", "sixth-finger", "--sim", code=2)
        assert "running already" in done.stderr
        call(tmp_path, "run", "sixth-finger", "--sim", "--fast", "--duration", "1", "--instance", "second")


@pytest.mark.slow
def test_a_bus_that_hangs_doesnt_hold_up_the_end(tmp_path: Path) -> None:
    with Running(tmp_path, "sixth-finger", "--sim", "--duration", "60", "--record", "x.rrd") as run:
        run.started()
        run.until(lambda: set(run.children()) == {"loop", "bus", "recorder"}, "all processes")
        run.until(lambda: run.header("state") == State.ACTIVE, "motion")
        os.kill(run.children()["bus"], signal.SIGSTOP)
        run.process.send_signal(signal.SIGTERM)
        found = run.finish()  # within 60 s; the recorder alone may take 120
    assert found["recording_complete"] is True
