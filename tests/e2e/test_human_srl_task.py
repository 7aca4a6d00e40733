"""The profile human-srl-task whole: the simulated wearer shows a task, and the arm repeats it behind the guard."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from helpers.run import call, summary

from srl.control.operation.law import Mode
from srl.control.operation.record import TaskRecord
from srl.runtime.models import record_file
from srl.runtime.recording.reader import read

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


@pytest.mark.exhaustive
def test_task_is_taught_repeated_and_replayed(tmp_path: Path) -> None:
    done = summary(
        call(
            tmp_path,
            "run",
            "human-srl-task",
            "--sim",
            "--fast",
            "--duration",
            "60",
            "--record",
            "x.rrd",
            "--json",
            timeout=400,
        )
    )
    assert (done["state"], done["cause"]) == ("ended", "end")
    reported = done["result"]["task"]
    assert (reported["taught"], reported["refused"]) == (1, None)
    assert reported["done"] >= 1
    assert reported["error_mean_mm"] < 15.0
    recording = read(tmp_path / "x.rrd")
    modes = recording.value("task.state")[:, 0].astype(int)
    order = [mode for i, mode in enumerate(modes) if i == 0 or modes[i - 1] != mode]
    assert order[:4] == [Mode.NO_TASK, Mode.TEACHING, Mode.CHECKING, Mode.PAUSED]
    assert Mode.WAITING in order
    position = recording.value("arm.position_command.applied")[modes > Mode.NO_TASK]
    assert np.abs(np.diff(position, axis=0)).max() < 0.8 / 100 + 1e-6
    call(tmp_path, "replay", "x.rrd", timeout=400)


def test_task_is_calibrated_and_run_from_its_file(tmp_path: Path) -> None:
    far = ("--set", "controllers.1.shift=[-0.2, 0.1, 0.4]")  # where the hanging hand isn't
    actions = ("--set", "sim.parts.wearer.script=actions", *far)
    done = call(
        tmp_path, "calibrate", "human-srl-task", "independent-operation", "--person", "P07", "--sim", "--json",
        "-o", "p07.task.json", "--record", "shown.rrd", *actions, timeout=400,
    )  # fmt: skip
    reported = json.loads(done.stdout)
    assert reported["simulated"] is True
    assert (tmp_path / "p07.task.json.report.png").stat().st_size > 10_000
    made = record_file.read(TaskRecord, tmp_path / "p07.task.json")
    assert (made.person, made.frame, made.hand) == ("P07", "Spine", "RightHand")
    assert made.path.length == pytest.approx(reported["length_m"], abs=1e-3)
    call(
        tmp_path, "calibrate", "human-srl-task", "independent-operation", "--recording", "shown.rrd",
        "-o", "again.task.json", *actions, timeout=400,
    )  # fmt: skip
    assert (tmp_path / "again.task.json").read_text() == (tmp_path / "p07.task.json").read_text()
    ran = call(
        tmp_path, "run", "human-srl-task", "--sim", "--fast", "--duration", "60", "--json", *far,
        "--set", "controllers.1.task=p07.task.json", "--set", "sim.parts.wearer.script=still",
        "--set", "sim.devices.lever.presses=[]", timeout=400,
    )  # fmt: skip
    reported = summary(ran)["result"]["task"]
    assert reported["person"] == "P07"
    assert reported["done"] >= 1


@pytest.mark.exhaustive
def test_task_out_of_reach_is_refused_by_the_calibration(tmp_path: Path) -> None:
    done = call(
        tmp_path, "calibrate", "human-srl-task", "independent-operation", "--person", "P07", "--sim",
        "-o", "p07.task.json", "--set", "sim.parts.wearer.script=actions",
        "--set", "controllers.1.shift=[0.0, 1.0, 0.0]", code=2, timeout=400,
    )  # fmt: skip
    assert "doesn't reach" in done.stderr
    assert not (tmp_path / "p07.task.json").exists()
