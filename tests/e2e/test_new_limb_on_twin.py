"""A stranger's URDF becomes a profile that runs on its twin: `srl new --urdf`, `srl twin`, the `srl run` it prints."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

import numpy as np
import pytest
from helpers.arm_urdf import HIP
from helpers.run import call
from helpers.srl_twin import TwinProcess

from srl.runtime.ipc.header import State
from srl.runtime.recording.reader import read

pytestmark = [pytest.mark.slow, pytest.mark.serial]

REPORT_EVERY = {
    "odrive": ("firmware=0.5", "watchdog_set=true"),
    "cubemars-servo": ("timeout=1.0",),
    "mit-can": ("maker=damiao",),
}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("driver", REPORT_EVERY)
def test_a_new_limb_is_held_by_its_twin_s_drives(driver: str, tmp_path: Path) -> None:
    (tmp_path / "hip.urdf").write_text(HIP)
    output = [word for each in REPORT_EVERY[driver] for word in ("--set", f"devices.arm.{each}")]
    call(tmp_path, "new", "mine", "--urdf", "hip.urdf", "--tip", "tool", "--driver", driver, *output)
    with TwinProcess(str(tmp_path / "mine.yaml")) as twin:
        with contextlib.suppress(PermissionError):  # what else runs on this machine is no silence of the drives
            os.sched_setscheduler(twin.process.pid, os.SCHED_FIFO, os.sched_param(10))
        done = call(tmp_path, *twin.run, "--duration", "4", "--record", "on.rrd", "--json", code=None)
        os.sched_setscheduler(twin.process.pid, os.SCHED_OTHER, os.sched_param(0))
    assert done.returncode == 0, f"{done.stderr}\n{twin.output}"
    recording = read(tmp_path / "on.rrd")
    state = recording.int("state")
    first = int(np.argmax(state == State.ACTIVE))
    assert len(state) - first > 300, "3 s at 100 Hz"
    assert (state[first:-1] == State.ACTIVE).all(), "it lost nothing on the way"
    position = recording.value("arm.position")[first:]
    assert np.ptp(position, axis=0).max() < 0.05, "held where it hung"
