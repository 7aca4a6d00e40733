"""A client in another process against the whole runtime: states, requests, parameters, setpoints; and who listens."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import psutil
import pytest
from helpers.run import Running, call

from srl.runtime.bus.client import Client, connect
from srl.runtime.contracts.errors import RequestError
from srl.runtime.ipc.header import Cause, Latch, State


def test_states_requests_and_parameters(tmp_path: Path) -> None:
    with Running(tmp_path, "sixth-finger", "--sim", "--duration", "60") as run:
        run.started()
        run.until(run.run_folder.bus_socket.exists, "the bus")
        with connect(run.run_folder) as client:
            run.until(client.alive, "the liveliness token")
            run.until(lambda: run.header("state") == State.ACTIVE, "motion")
            assert client.status()["state"] == "active"
            seen = {}
            for update in client.states(timeout=3.0):
                seen[update.name] = update
                if {"glove/position", "finger/position_command"} <= seen.keys():
                    break
            assert seen["glove/position"].values.shape == (22,)
            with pytest.raises(RequestError, match="start"):  # it is active already
                client.command("start")
            assert client.command("stop")["ok"] is True
            run.until(lambda: run.header("state") == State.STOPPED, "the stop")
            assert client.command("reset")["ok"] is True
            run.until(lambda: run.header("state") == State.ACTIVE, "motion again")
            name, parameter = next(iter(client.parameters().items()))
            assert client.set_param(name, parameter["lower"])["ok"] is True
            assert client.get_param(name)["value"] == parameter["lower"]
            row = run.reader.newest()
            assert row is not None
            assert run.layout.value(row, name) == parameter["lower"]
            for bad in (float("nan"), parameter["upper"] + 1.0):
                with pytest.raises(RequestError, match=name):
                    client.set_param(name, bad)
        _only_local(run)
        done = call(tmp_path, "top", "--once")
        assert "active" in done.stdout.lower()


def _only_local(run: Running) -> None:
    """Every listening or bound socket of the service is a Unix one or on loopback."""
    family = psutil.Process(run.process.pid)
    for process in (family, *family.children(recursive=True)):
        for connection in process.net_connections("inet"):
            assert connection.laddr.ip in ("127.0.0.1", "::1"), f"{process.cmdline()} has {connection}"


@pytest.mark.slow
def test_setpoints_move_the_finger_and_bad_ones_are_refused(tmp_path: Path) -> None:
    with Running(tmp_path, "finger-jog", "--sim", "--duration", "60", instance="finger-jog") as run:
        run.started()
        run.until(run.run_folder.bus_socket.exists, "the bus")
        with connect(run.run_folder) as client:
            run.until(client.alive, "the liveliness token")
            run.until(lambda: run.header("state") == State.ACTIVE, "motion")
            goal = [0.2, 0.3, 0.6, 0.4]
            for bad in ([float("nan"), 0.0, 0.0, 0.0], [float("inf")] * 4, [0.1, 0.2]):
                with pytest.raises(RequestError, match=r"client[./]position"):
                    client.setpoint("client.position", bad, answer=True)
            _stream(client, goal, 2.0)
            row = run.reader.newest()
            assert row is not None
            applied = run.layout.value(row, "finger.position_command.applied")
            assert applied == pytest.approx(goal, abs=1e-3)
            # The client falls silent: a loss of intent. Clients may not end a fault's stop. A reset on this machine is
            # granted, and nothing old is obeyed.
            run.until(lambda: run.header("cause") == Cause.INTENT_LOSS, "the loss of intent")
            run.until(lambda: run.header("state") == State.STOPPED, "the stop")
            with pytest.raises(RequestError, match=r"may not release what stands \(fault\)"):
                client.command("reset")
            call(tmp_path, "reset", "finger-jog")
            time.sleep(0.3)  # in which it could stop again
            assert run.header("state") == State.ACTIVE
            _stream(client, [0.0, 0.7, 0.5, 0.5], 1.0)
        # The supervisor's own word that the bus died is no person's stop, though it comes the same way.
        os.kill(run.children()["bus"], signal.SIGKILL)
        run.until(lambda: run.header("state") == State.STOPPED, "the stop")
        assert (run.header("cause"), run.header("latches")) == (Cause.BUS_LOSS, Latch.FAULT)


def _stream(client: Client, goal: list[float], seconds: float) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        client.setpoint("client.position", goal)
        time.sleep(0.05)
