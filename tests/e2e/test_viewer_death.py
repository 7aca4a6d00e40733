"""The viewer's process is killed in a run: the loop goes on, it is said, and the recording has every row."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
from helpers.run import Running

from srl.runtime.recording.reader import read


@pytest.mark.slow
def test_a_killed_viewer_is_said_and_costs_the_run_nothing(tmp_path: Path) -> None:
    with Running(tmp_path, "sixth-finger", "--sim", "--duration", "12", "--record", "x.rrd", "--view") as run:
        run.started()
        run.until(lambda: "viewing" in run.children(), "the viewer")
        old = run.children()["viewing"]
        os.kill(old, signal.SIGKILL)
        run.until(lambda: run.children().get("viewing", old) != old, "the viewer again")
        mark = run.reader.head
        run.until(lambda: run.reader.head > mark + 100, "another second of rows")
        found = run.finish()
    assert found["restarts"] == {"bus": 0, "recorder": 0, "viewer": 1}
    assert "viewer ended (killed by SIGKILL); it is started again, the loop goes on" in run.stderr
    recording = read(tmp_path / "x.rrd")
    assert recording.missing == []
    assert len(recording.rows) == found["cycles"]
