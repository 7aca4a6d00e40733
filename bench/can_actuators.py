"""Our MIT-mode driver against damiao-motor: one cycle of 1, 4 and 7 motors on one bus, one twin for both.

The twin runs in its own process, at a multicast bus of this host, and answers each command at once. A cycle is a
command to every motor and the reply of every motor, as numbers. What is compared is the CPU time of the client's
process. Both look for replies each millisecond; damiao-motor has a thread for that.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from typing import Any, Final

from bench.pairs import Row, measure
from srl.drivers.mit_can import MitCan
from srl.drivers.mit_can.config import MitCanConfig
from srl.runtime.testing.bound import bound
from srl.sim.devices.shared.can import GROUP

COUNTS: Final = (1, 4, 7)
CYCLES: Final = 100  # per run: runs differ more than cycles do
PAIRS: Final = 6
WAIT: Final = 1e-3  # s between two looks for replies: the peer's own
MODEL: Final = "DM4340"
BUS: Final = f"can://udp_multicast/{GROUP}?hop_limit=0"  # the port is python-can's own, the only one the peer takes
_PEER: Final = "damiao-motor"
_REPLY: Final = 0x10  # a motor's reply: its id and this


def run() -> list[Row]:
    """Returns a row for each number of motors: CPU time of a cycle, and of a frame in its text."""
    rows = []
    for count in COUNTS:
        with _twin(count):
            pairs = measure(partial(_ours, count), {_PEER: partial(_peer, count)}, PAIRS)
        what = f"CPU time of a cycle, {count} motor{'s' if count > 1 else ''}, {2 * count} frames"
        rows.append(pairs.row("can-actuators", what, "cpu", _PEER, "us", "not more", lambda r: r <= 1))
    return rows


def _config(count: int) -> MitCanConfig:
    motors = {
        f"joint_{k}": {"id": k, "reply": _REPLY + k, "model": MODEL, "kp": 20, "kd": 1, "lower": -2, "upper": 2}
        for k in range(1, count + 1)
    }
    return MitCanConfig.model_validate({"port": BUS, "maker": "damiao", "motors": motors})


def _ours(count: int) -> dict[str, float]:
    driver = bound(MitCan("bus", _config(count)))
    driver.open()

    def cycle() -> None:
        before = driver.health.frames
        driver.write(time.monotonic_ns())
        end = time.monotonic() + 1.0
        while driver.health.frames < before + count and time.monotonic() < end:
            time.sleep(WAIT)
            driver.read(time.monotonic_ns())

    try:
        cycle()
        driver.command_arrays[driver.commands[0].name][:] = driver.state_arrays["position"]
        return _measure(cycle)
    finally:
        driver.close()


def _peer(count: int) -> dict[str, float]:
    host = import_module("damiao_motor").DaMiaoController(channel=GROUP, bustype="udp_multicast")
    try:
        motors = [host.add_motor(k, _REPLY + k, "4340") for k in range(1, count + 1)]
        for motor in motors:
            motor.ensure_control_mode("MIT")
            motor.enable()
        taken = [0] * count
        for k, motor in enumerate(motors):  # what its own thread calls for a reply
            motor.process_feedback_frame = _counted(motor.process_feedback_frame, taken, k)

        def cycle() -> None:
            before = sum(taken)
            for motor in motors:
                motor.send_cmd_mit(stiffness=20.0, damping=1.0)
            end = time.monotonic() + 1.0
            while sum(taken) < before + count and time.monotonic() < end:
                time.sleep(WAIT)

        return _measure(cycle)
    finally:
        for motor in host.all_motors():
            motor.disable()
        host.shutdown()


def _counted(take: Callable[..., Any], taken: list[int], k: int) -> Callable[..., Any]:
    def counted(*args: Any, **more: Any) -> Any:
        taken[k] += 1
        return take(*args, **more)

    return counted


def _measure(cycle: Callable[[], None]) -> dict[str, float]:
    for _ in range(10):
        cycle()
    cpu = time.process_time()
    for _ in range(CYCLES):
        cycle()
    return {"cpu": (time.process_time() - cpu) / CYCLES * 1e6}


@contextmanager
def _twin(count: int) -> Iterator[None]:
    command = [sys.executable, "-m", "bench.can_actuators", str(count)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        process.stdout.readline()
        yield
    finally:
        process.terminate()
        process.wait()


def _serve(count: int) -> None:
    from srl.sim.devices.mit_can.fake import FakeMitCan
    from srl.sim.devices.mit_can.twin import MitCanTwin
    from srl.sim.world.cell import Cell, CellConfig

    axes = {
        f"joint_{k}": {"axis": [0, 1, 0], "link": [0.1, 0, 0], "mass": 0.1, "lower": -3, "upper": 3, "model": MODEL}
        for k in range(1, count + 1)
    }
    part = {"part": "actuator-chain", "axes": axes}
    world = Cell(CellConfig.model_validate({"parts": {"arm": part}, "gravity": [0, 0, 0]}), seed=0)
    twin = MitCanTwin(FakeMitCan("bus", _config(count), world, FakeMitCan.Options(bus=BUS)))
    twin.open()
    print(twin.address, flush=True)
    while True:
        world.advance(world.time + 1_000_000)
        twin.service(time.monotonic_ns())
        time.sleep(2e-4)


if __name__ == "__main__":
    _serve(int(sys.argv[1]))
