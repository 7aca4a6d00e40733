"""Our Dynamixel driver against dynamixel-sdk (Python): goals out, samples in, seven servos, one twin for both.

The twin runs in its own process and answers at once; its world stands still. Each exchange is a sync write of seven
goal positions and a sync read of current, velocity and position, decoded to numbers. Our driver sleeps in poll() while
it waits; the SDK reads its port again and again.
"""

from __future__ import annotations

import select
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any, Final

import numpy as np

from bench.pairs import Row, measure
from srl.drivers.dynamixel import Dynamixel
from srl.drivers.dynamixel.config import DynamixelConfig
from srl.runtime.testing.bound import bound

EXCHANGES: Final = 150  # per run: runs differ more than exchanges do
BAUDRATE: Final = 1_000_000
MODELS: Final = ("MX-106", "MX-106", "MX-64", "MX-64", "MX-64", "MX-28", "MX-28")
_SDK: Final = "dynamixel-sdk"


def run() -> list[Row]:
    """Measures exchanges per second, and the CPU time of one exchange."""
    with _twin() as address:
        pairs = measure(lambda: _ours(address), {_SDK: lambda: _sdk(address)})
    rate = pairs.row("dynamixel", "exchanges a second, 7 servos", "rate", _SDK, "1/s")
    cpu = pairs.row(
        "dynamixel", "CPU time of an exchange, 7 servos", "cpu", _SDK, "us", "a third or less", lambda r: r <= 1 / 3
    )
    return [rate, cpu]


def _config(port: str) -> DynamixelConfig:
    motors = {f"joint_{k}": {"id": k, "model": model} for k, model in enumerate(MODELS, 1)}
    return DynamixelConfig.model_validate({"port": port, "baudrate": BAUDRATE, "motors": motors})


def _ours(port: str) -> dict[str, float]:
    driver = bound(Dynamixel("bus", _config(port)))
    driver.open()
    fd = driver.fileno()
    assert fd is not None
    waiting = select.poll()
    waiting.register(fd, select.POLLIN)

    def exchange() -> None:
        """Runs until the next sample has come; a check of the servos may come in between."""
        stamp = driver.health.stamp
        driver.write(time.monotonic_ns())
        while driver.health.stamp == stamp:
            waiting.poll(100)
            driver.read(time.monotonic_ns())
            if driver.health.unsent == 0:
                driver.write(time.monotonic_ns())

    try:
        while driver.health.stamp < 0:
            driver.read(time.monotonic_ns())
            waiting.poll(100)
        driver.command_arrays["position_command"][:] = driver.state_arrays["position"]
        return _measure(exchange)
    finally:
        driver.close()


def _sdk(port: str) -> dict[str, float]:
    sdk = import_module("dynamixel_sdk")  # a development dependency, without types
    handler, packets = sdk.PortHandler(port), sdk.PacketHandler(2.0)
    handler.setBaudRate(BAUDRATE)
    goals, states = sdk.GroupSyncWrite(handler, packets, 116, 4), sdk.GroupSyncRead(handler, packets, 126, 10)
    ids = range(1, len(MODELS) + 1)
    for id in ids:
        packets.write1ByteTxRx(handler, id, 9, 0)  # no return delay, as ours
        goals.addParam(id, [0, 8, 0, 0])
        states.addParam(id)
    position = np.zeros(len(MODELS))
    velocity, effort, command = position.copy(), position.copy(), position.copy()

    def exchange() -> None:
        for id in ids:
            goal = round(command[id - 1] * 4096 / 6.283185307179586) + 2048
            goals.changeParam(id, list(goal.to_bytes(4, "little", signed=True)))
        while goals.txPacket() or states.txRxPacket():
            pass  # the SDK gives up after some 34 ms; a busy host may delay the twin that long
        for id in ids:
            position[id - 1] = (_signed(states.getData(id, 132, 4), 32) - 2048) * 6.283185307179586 / 4096
            velocity[id - 1] = _signed(states.getData(id, 128, 4), 32) * 0.0239808
            effort[id - 1] = _signed(states.getData(id, 126, 2), 16) * 0.00336

    try:
        return _measure(exchange)
    finally:
        handler.closePort()


def _measure(exchange: Any) -> dict[str, float]:
    for _ in range(10):
        exchange()
    started, cpu = time.perf_counter(), time.process_time()
    for _ in range(EXCHANGES):
        exchange()
    spent, busy = time.perf_counter() - started, time.process_time() - cpu
    return {"rate": EXCHANGES / spent, "cpu": busy / EXCHANGES * 1e6}


def _signed(value: int, bits: int) -> int:
    return value - (1 << bits) if value >> bits - 1 else value


@contextmanager
def _twin() -> Iterator[str]:
    command = [sys.executable, "-m", "bench.dynamixel"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        yield process.stdout.readline().strip()
    finally:
        process.terminate()
        process.wait()


def _serve() -> None:
    from srl.sim.devices.dynamixel.fake import FakeDynamixel, FakeDynamixelConfig
    from srl.sim.devices.dynamixel.twin import DynamixelTwin
    from srl.sim.world.cell import Cell, CellConfig

    axes = {f"joint_{k}": {"model": model} for k, model in enumerate(MODELS, 1)}
    world = Cell(CellConfig.model_validate({"parts": {"arm": {"part": "dynamixel-chain", "axes": axes}}}), seed=0)
    twin = DynamixelTwin(FakeDynamixel("bus", _config("/dev/null"), world, FakeDynamixelConfig()))
    twin.open()
    print(twin.address, flush=True)
    waiting = select.poll()
    waiting.register(twin.door._fd, select.POLLIN)  # type: ignore[union-attr]
    while True:
        if any(event & select.POLLHUP for _, event in waiting.poll(100)):
            time.sleep(0.001)  # nobody has the port open
        twin.service(time.monotonic_ns())


if __name__ == "__main__":
    _serve()
