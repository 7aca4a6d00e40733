"""A client of the bus that resets and starts at full speed, against the whole runtime: the limb doesn't move."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.peer import load, peer_of
from helpers.run import Running, call
from helpers.wait import until

from srl.runtime.bus.client import Client, connect
from srl.runtime.contracts.errors import NoAnswerError, RequestError
from srl.runtime.ipc.header import CYCLE, State

pytestmark = pytest.mark.slow

MOVING = (State.HOMING, State.ACTIVE)
MINUTE = 60.0  # s, as long as the client insists; of a run on fakes LESS of it, hundreds of requests
LESS = 10.0  # s


@contextlib.contextmanager
def streaming(run: Running, size: int) -> Iterator[threading.Event]:
    """A client that says where to go, 25 times a second, until the event is set."""
    ended = threading.Event()

    def stream() -> None:
        with connect(run.run_folder) as client:
            while not ended.wait(0.04):
                with contextlib.suppress(NoAnswerError):  # the run is over
                    client.setpoint("client.position", np.full(size, 0.3 * np.sin(time.monotonic())))

    thread = threading.Thread(target=stream)
    thread.start()
    try:
        yield ended
    finally:
        ended.set()
        thread.join()


def insist(run: Running, client: Client, seconds: float) -> tuple[np.ndarray[Any, Any], int]:
    """Asks for reset and start as fast as answers come, for so long; returns its rows, and how often it was answered.

    It ends with the run: a host under load may hold up its loop until its supervisor ends it.
    """
    blocks, asked, end = [], 0, time.monotonic() + seconds
    run.reader.take()
    while time.monotonic() < end and run.process.poll() is None:
        for what in ("reset", "start"):
            with pytest.raises(RequestError) as refusal:
                client.command(what)
            asked += not isinstance(refusal.value, NoAnswerError)
        blocks.append(run.reader.take())
    assert asked
    return np.concatenate(blocks), asked


def leave(run: Running) -> dict[str, Any]:
    """Ends the run. One that has just ended by itself, on a host under load, answers nobody; one that goes on fails."""
    call(run.folder, "stop", "--exit", code=None)
    return run.finish(code=None)


def assert_still(run: Running, rows: np.ndarray[Any, Any], asked: int, command: str, after: str) -> None:
    motion = np.ptp(run.layout.value(rows, f"{command}.applied"), axis=0).max()
    print(f"after {after}: {asked} requests, {run.header('refused')} refused; {command} moved by {motion:g}")
    assert run.reader.lost == 0
    assert not set(rows[:, CYCLE.state].tolist()) & set(MOVING)
    assert motion == 0
    assert run.header("refused") >= asked  # every refusal is in the rows


@pytest.mark.sampled(1)
@pytest.mark.timeout(300)
@pytest.mark.parametrize("what", ["local stop", "fault", "e-stop"])
def test_no_client_ends_a_stop_that_is_not_its_own(tmp_path: Path, what: str) -> None:
    # A setpoint that isn't there yet is no number, and an emergency input that is none stops.
    estop = ["--set", "emergency=[{signal: client.position, element: abduction, when: 9}]"] if what == "e-stop" else []
    arguments = ("finger-jog", "--sim", "--record", "x.rrd", "--duration", "200", *estop)
    with Running(tmp_path, *arguments, instance="finger-jog") as run:
        run.started()
        run.until(run.run_folder.bus_socket.exists, "the bus")
        with connect(run.run_folder) as client, streaming(run, 4) as streamed:
            run.until(lambda: run.header("client.frames") > 20, "setpoints")
            if what == "fault":
                streamed.set()
            elif what == "local stop":
                call(tmp_path, "stop")
            run.until(lambda: run.header("state") == State.STOPPED, "the stop")
            assert client.status()["latches"] == [{"local stop": "person", "e-stop": "emergency"}.get(what, what)]
            rows, asked = insist(run, client, LESS)
            assert_still(run, rows, asked, "finger.position_command", what)
            call(tmp_path, "reset")
            if what != "e-stop":  # a reset forgets the setpoints, so this one stops again
                run.until(lambda: run.header("state") == State.ACTIVE, "motion after a local reset")
            call(tmp_path, "stop", "--exit")
        assert run.finish(code=None)["refused"] >= asked
    # The machine's decisions about all of them are the same in a replay.
    assert json.loads(call(tmp_path, "replay", "x.rrd", "--json").stdout)["identical"] is True


@pytest.mark.timeout(300)
def test_latches_of_real_actuators_outlive_their_run(tmp_path: Path) -> None:
    """A host under load may let the actuator become stale, a fault, at any time: those aren't counted here."""
    name, _, _ = load("servo-jog")
    path = tmp_path / "state" / "servo-jog" / "latches.json"

    def kept() -> set[str]:
        return set(json.loads(path.read_text())["latches"]) - {"fault"} if path.exists() else set()

    def reset(run: Running) -> None:
        def ask() -> None:
            if run.header("state") != State.ACTIVE:
                call(tmp_path, "reset", code=None)

        until(lambda: run.header("state") == State.ACTIVE, ask, what="motion after a local reset")

    with peer_of("servo-jog") as peer:
        arguments = ("servo-jog", "--set", f"devices.{name}.port={peer.address}", "--confirm")

        def begin() -> Running:
            run = Running(tmp_path, *arguments, instance="servo-jog")
            run.started()
            run.until(run.run_folder.bus_socket.exists, "the bus")
            return run

        with begin() as run:
            reset(run)
            assert kept() == {"restart"}
            os.kill(run.children()["loop"], signal.SIGKILL)
            run.finish(code=1)
        # A clean end of a run that nobody reset keeps the latch.
        with begin() as run:
            assert run.header("state") == State.STOPPED
            call(tmp_path, "stop", "--exit")
            assert "restart" in run.finish()["latches"]
        with begin() as run, connect(run.run_folder) as client:
            rows, asked = insist(run, client, MINUTE)
            assert_still(run, rows, asked, f"{name}.position_command", "restart")
        with begin() as run, connect(run.run_folder) as client:
            reset(run)
            client.command("stop")
            call(tmp_path, "stop")
            run.until(lambda: kept() == {"person", "bus", "restart"}, "the file")
            leave(run)
        assert kept() >= {"person", "bus"}
        with begin() as run:
            assert run.header("state") == State.STOPPED
            reset(run)
            run.until(lambda: kept() == {"restart"}, "the file")
            ended = leave(run)
        assert kept() == (set() if ended["cause"] == "request" else {"restart"})
