"""Each actuator hangs for three seconds in mid-motion, as a stopped process, and goes on: with the whole runtime."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from helpers.peer import Peer, load, peer_of
from helpers.run import Running
from helpers.wait import until

from srl.runtime.bus.client import Client, connect
from srl.runtime.ipc.control_socket import send_request
from srl.runtime.ipc.header import Cause, State

HANG = 3.0  # s

pytestmark = [pytest.mark.slow, pytest.mark.serial]  # how far an actuator goes on by itself, and for how long


class Case(NamedTuple):
    """What hangs, how it is moved, and how far it may go on by itself, in the truth's unit."""

    profile: str
    setpoint: str
    target: Any  # of the time in s
    truth: str
    coast: float
    causes: tuple[Cause, ...] = (Cause.DEVICE_LOSS,)


def _swing(amplitude: float, size: int) -> Any:
    """Velocities that keep their sign for 4 s: three seconds of them at once would be seen."""
    return lambda t: np.full(size, amplitude if t % 8 < 4 else -amplitude)


def _wave(amplitude: float, size: int) -> Any:
    return lambda t: np.full(size, amplitude * np.sin(2 * np.pi * t / 6))


BOTH = (Cause.DEVICE_LOSS, Cause.DEVICE_FAULT)  # whichever is seen first
CASES = [
    Case("ur-jog", "client.velocity", _swing(0.15, 6), "arm_position", 0.03, BOTH),
    Case("panda-jog", "client.velocity", _swing(0.15, 7), "arm_position", 0.03, BOTH),
    Case("servo-jog", "client.position", _wave(0.6, 2), "finger_position", 0.12),
    Case("hand-jog", "client.closure", lambda t: 0.3 + _wave(0.25, 1)(t), "hand_motor", 0.4),
    # The base obeys the last command for 0.5 s by its own watchdog and then brakes: 0.13 m at 0.21 m/s (0.15 along x
    # and along y). A command that was on its way when the base hung starts the watchdog again: 0.17 m were seen.
    # Three seconds of commands at once would be 0.6 m.
    Case("base-jog", "client.twist", _swing(0.15, 3), "base_pose", 0.25),
]


@contextmanager
def streaming(client: Client, case: Case) -> Iterator[None]:
    """A client that says where to go, 25 times a second."""
    done = threading.Event()
    start = time.monotonic()

    def send() -> None:
        while not done.wait(0.04):
            client.setpoint(case.setpoint, case.target(time.monotonic() - start))

    thread = threading.Thread(target=send)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


def moved(peer: Peer, case: Case) -> np.ndarray:
    return np.array(peer.metrics()["truth"][case.truth])


def until_moving(run: Running, client: Client, peer: Peer, case: Case) -> None:
    """Asks again whenever it stands in a stop: a host under load may be late enough for one at any time."""
    begin = moved(peer, case)

    def ask() -> None:
        if run.header("state") != State.ACTIVE:
            send_request(run.run_folder, "reset")  # refused while the device is away or recovers

    until(
        lambda: run.header("state") == State.ACTIVE and np.abs(moved(peer, case) - begin).max() >= 0.05,
        ask,
        what=lambda: f"motion; {client.status()}",
        timeout=40.0,
        pause=0.1,
    )


@pytest.mark.sampled(3)
@pytest.mark.parametrize("case", CASES, ids=[case.profile for case in CASES])
def test_no_burst_no_old_sample_a_safe_stop_and_a_recovery(tmp_path: Path, case: Case) -> None:
    name, _, _ = load(case.profile)
    with (
        peer_of(case.profile) as peer,
        Running(
            tmp_path, case.profile, "--set", f"devices.{name}.port={peer.address}", "--confirm", instance=case.profile
        ) as run,
    ):
        run.started()
        run.until(run.run_folder.bus_socket.exists, "the bus")
        with connect(run.run_folder) as client, streaming(client, case):
            until_moving(run, client, peer, case)
            run.reader.take()
            peer.stop()
            stopped = time.monotonic_ns()
            run.until(lambda: run.header("state") in (State.STOPPING, State.STOPPED), "the stop")
            seen = time.monotonic_ns() - stopped
            assert run.header("cause") in case.causes
            time.sleep(max(0.0, HANG - (time.monotonic_ns() - stopped) * 1e-9))
            rows = run.reader.take()
            peer.cont()
            first = moved(peer, case)
            path = []
            for _ in range(50):
                path.append(moved(peer, case))
                time.sleep(0.02)
            went = np.abs(np.array(path) - first).max()
            # No sample from before is taken for a fresh one: the stamps stand still while the peer does.
            now, stamp = run.layout.header(rows, "now"), run.layout.header(rows, f"{name}.stamp")
            hung = now > stopped + 200_000_000
            assert hung.sum() > 50
            assert stamp[hung].max() <= stopped + 100_000_000
            assert went <= case.coast, f"it went on by {went:.3f}"
            print(f"{case.profile}: stop after {seen / 1e6:.0f} ms, went on by {went:.4f}")
            until_moving(run, client, peer, case)
