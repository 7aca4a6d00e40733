"""Motors on a CAN bus and the loop's death: the supervisor's stop frames over multicast, and what the wearer feels.

A whole `srl run` on a bus of python-can, one process each for supervisor and loop; the motors are the twin's, in real
time. Two links hang out level and go to and fro; somebody supports them until their motors hold them. Run with `-s` to
see the rows of the devices' pages: figures of a shared machine, and the motors are simulated.
"""

from __future__ import annotations

import json
import os
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import can_drives, mit_can
from helpers.live_can import Live
from helpers.run import Running, call
from helpers.wait import until

from srl.runtime.ipc.header import State
from srl.sim.devices.cubemars_servo.twin import CubemarsServoTwin
from srl.sim.devices.odrive.twin import OdriveTwin
from srl.sim.devices.shared.can import CanTwin

pytestmark = pytest.mark.slow

TAIL = 0.4  # s after the onset that are looked at


def mit(maker: str, **fake: Any) -> tuple[CanTwin, dict[str, Any]]:
    motors = mit_can.TWO if maker == "damiao" else mit_can.AK
    twin = mit_can.twin(motors, maker)
    twin.drives.silence = fake.get("silence", 0.0)
    given = mit_can.config(motors, maker)
    return twin, {"driver": "mit-can"} | given.model_dump(exclude_unset=True, mode="json")


def drives(kind: str) -> tuple[CanTwin, dict[str, Any]]:
    names = ("shoulder", "elbow")
    config: Any = can_drives.odrive(names, firmware="0.5", bitrate=1_000_000) if kind == "odrive" else (
        can_drives.servo(names)
    )  # fmt: skip
    fake = can_drives.make_fake(config)
    twin = (OdriveTwin if kind == "odrive" else CubemarsServoTwin)(fake)
    return twin, {"driver": kind} | config.model_dump(exclude_unset=True, mode="json")


CASES: dict[str, tuple[Any, str, int, bool]] = {  # the motors, the stop, the signal, whether frames come
    "Damiao, killed, `hold`": (lambda: mit("damiao"), "hold", signal.SIGKILL, True),
    "Damiao, stopped (SIGSTOP), `damp`": (lambda: mit("damiao"), "damp", signal.SIGSTOP, True),
    "AK V2, killed, `hold`": (lambda: mit("v2"), "hold", signal.SIGKILL, True),
    "AK V2, stopped (SIGSTOP), `hold`": (lambda: mit("v2"), "hold", signal.SIGSTOP, False),
    "ODrive, stopped (SIGSTOP), `hold`": (lambda: drives("odrive"), "hold", signal.SIGSTOP, True),
    "AK in servo mode, killed, `hold`": (lambda: drives("cubemars-servo"), "hold", signal.SIGKILL, True),
}


@pytest.mark.serial
@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", CASES)
def test_every_motor_of_the_bus_is_stopped(tmp_path: Path, name: str) -> None:
    make, stop, how, frames = CASES[name]
    twin, device = make()
    with Live(twin) as live:
        profile = tmp_path / "limb.yaml"
        profile.write_text(json.dumps({
            "name": "limb", "rate": 100, "bus": None, "devices": {"arm": device | {"port": twin.address}},
            "controllers": [{
                "use": "posture-cycle", "name": "motion", "rest": 0.0, "near": 0.1, "in": {"position": "arm.position"},
                "postures": [{"shoulder": 0.15, "elbow": 0.15}, {"shoulder": -0.15, "elbow": -0.15}],
                "out": {"q": "arm.position_command", "q_velocity": "arm.position_command.velocity"},
            }],
            "guard": {"arm.position_command": {"velocity": 0.3, "acceleration": 2.0, "lower": -0.5, "upper": 0.5}},
            "stop": {"arm": stop},
        }))  # fmt: skip
        with Running(tmp_path, str(profile), instance="limb") as run:
            run.started()
            run.until(lambda: run.header("state") == State.ACTIVE, "motion")

            def moves() -> bool:
                if run.header("state") == State.STOPPED:  # a busy machine: the motors' thread was late
                    call(tmp_path, "reset", "limb", code=None)
                swing = np.ptp([q for _, q, _ in live.felt[-3000:]], axis=0).min()
                return bool(swing > 0.1) and run.header("state") == State.ACTIVE

            run.until(moves, "it goes to and fro")
            loop = run.children()["loop"]
            onset = time.monotonic()
            os.kill(loop, how)
            found = run.finish(code=1)
            until(lambda: live.felt[-1][0] > onset + TAIL)
        late = onset + (0.1 if how == signal.SIGSTOP else 0.001)  # the loop's own frames are behind
        came = [(at, message) for at, message in live.taken if at > late]
        assert "Traceback" not in run.stderr
        assert "death" in found
        felt = [row for row in live.felt if onset < row[0] <= onset + TAIL]
        moved = np.abs(felt[-1][1] - felt[0][1])
        steps = np.abs(np.diff([t for _, _, t in felt][::4], axis=0)).max(axis=0)
        listens = {message.arbitration_id for _, message in came}
        first = {i: min(at for at, m in came if m.arbitration_id == i) - onset for i in listens}
        ms = f"{1e3 * max(first.values()):.0f}" if first else "none"
        print(f"\n| {name} | {ms} | {moved[0]:.2f}, {moved[1]:.2f} | {steps[0]:.2f}, {steps[1]:.2f} |")
        if frames:
            assert len(listens) == 2, "each motor has its stop frame"
        else:
            assert not came
            assert "gets no stop frame" in run.stderr
            assert moved.max() < 0.05, "it goes on holding"
