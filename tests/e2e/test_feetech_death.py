"""A limb of Feetech servos, which have no watchdog: the loop's death on a real pty, and the stop of its supervisor."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers.feetech import FeetechTwin, make_twin
from helpers.run import Running, call, summary
from helpers.twin import Bench
from helpers.wait import until

from srl.runtime.ipc.header import State

pytestmark = pytest.mark.slow

PROFILE = """
name: bench-servos
summary: two STS servos that go to and fro
rate: 100
devices:
  arm:
    driver: feetech
    port: {port}
    motors:
      shoulder: {{id: 1, model: STS3250, lower: -1.2, upper: 1.2}}
      elbow: {{id: 2, model: STS3215, lower: -1.2, upper: 1.2}}
controllers:
  - use: posture-cycle
    name: motion
    rest: 0.0
    postures: [{{shoulder: 0.3, elbow: 0.2}}, {{shoulder: -0.3, elbow: -0.2}}]
    in: {{position: arm.position}}
    out: {{q: arm.position_command, q_velocity: arm.position_command.velocity}}
guard:
  arm.position_command: {{velocity: 0.5, acceleration: 2.0}}
stop: {{arm: {stop}}}
bus: null
sim:
  world: cell
  parts:
    arm:
      part: feetech-chain
      axes: {{shoulder: {{model: STS3250}}, elbow: {{model: STS3215}}}}
"""


@pytest.fixture
def twin() -> Iterator[FeetechTwin]:
    made = make_twin()
    with Bench(made) as bench, bench.running():
        yield made


def write(folder: Path, stop: str, port: str) -> Path:
    path = folder / "bench-servos.yaml"
    path.write_text(PROFILE.format(stop=stop, port=port))
    return path


def torque(twin: FeetechTwin) -> object:
    return twin.metrics()["torque"]


@pytest.mark.parametrize("stop", ["hold", "limp"])
def test_the_loop_is_killed(tmp_path: Path, twin: FeetechTwin, stop: str) -> None:
    profile = write(tmp_path, stop, twin.address)
    with Running(tmp_path, str(profile), "--confirm", instance="bench-servos") as run:
        run.started()
        run.until(lambda: run.header("state") == State.ACTIVE, "motion")
        until(lambda: twin.servos[0].get("goal_position") > 2100, what="a motion")
        loop, seen = run.children()["loop"], dict(twin.seen)
        os.kill(loop, signal.SIGKILL)
        found = run.finish(code=1)
        assert "SIGKILL" in found["death"]["how"]
        assert "Traceback" not in run.stderr
        until(lambda: twin.seen["sync_write"] > seen["sync_write"])
        if stop == "limp":
            until(lambda: torque(twin) == [False, False])
        else:
            assert torque(twin) == [True, True]
            goals = [servo.get("goal_position") for servo in twin.servos]
            assert all(1700 < goal < 2400 for goal in goals)


def test_the_profile_is_checked_and_runs_with_fakes(tmp_path: Path) -> None:
    profile = write(tmp_path, "hold", "/dev/null")
    assert "device arm (feetech" in call(tmp_path, "check", str(profile)).stdout
    done = call(tmp_path, "run", str(profile), "--sim", "--fast", "--duration", "2", "--json")
    assert summary(done)["cause"] == "end"
