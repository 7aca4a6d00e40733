"""`srl run --twin`: the real drivers on the devices' twins, by one command."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import numpy as np
import pytest
from helpers.run import Running, alive, call, refused
from helpers.srl_twin import TwinProcess, twins_of
from helpers.wait import until

from srl.recordings import read
from srl.runtime.cli import on_twins
from srl.runtime.contracts.errors import RequestError
from srl.runtime.ipc.header import State
from srl.runtime.profile import profile, wiring


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--sim"], "a world of their own"),
        (["--fast"], "the twins keep real time"),
        (["--no-run-code"], "isn't bound by it"),
    ],
)
def test_what_contradicts_twins_is_refused(more: list[str], words: str) -> None:
    assert words in refused("run", "servo-jog", "--twin", *more)


def test_a_device_without_a_twin_is_not_opened_unless_others_are_named() -> None:
    said: list[str] = []
    with pytest.raises(RequestError, match="no twin is there for arm, so the real device would be opened"):
        on_twins._name_the_real(("suit", "arm"), {"suit"}, False, said.append)
    on_twins._name_the_real(("suit", "arm"), {"suit"}, True, said.append)
    on_twins._name_the_real(("suit", "arm"), {"suit", "arm"}, False, said.append)
    assert said == ["REAL: arm. On twins: suit"]


@pytest.mark.parametrize("devices", [{"suit"}, {"arm"}, set()])
def test_beside_a_real_device_the_limb_starts_as_ever(devices: set[str]) -> None:
    """human-srl waits for its start, and begins by itself where nobody wears it."""
    graph = wiring.build(*profile.load("human-srl"))
    assert on_twins._start("human-srl", [], devices) == []
    assert not on_twins.Twins([], frozenset(devices)).alone(graph)
    both = devices | {"suit", "arm"}
    assert on_twins._start("human-srl", [], both) == ["start=auto"]
    assert on_twins.Twins([], frozenset(both)).alone(graph)


@pytest.mark.slow
def test_a_real_limb_beside_a_twin_waits_for_its_confirmation(tmp_path: Path) -> None:
    with TwinProcess("sixth-finger", "finger") as real:  # it stands for one
        port = f"devices.finger.port={real.addresses['finger']}"
        with Running(tmp_path, "sixth-finger", "--twin", "glove", "--set", port, instance="sixth-finger") as run:
            run.started()
            run.until(lambda: run.reader.head > 100, "a second of it")
            assert run.header("state") == State.READY


@pytest.mark.slow
def test_a_device_that_isnt_there_is_named_with_those_that_are() -> None:
    said = refused("run", "servo-jog", "--twin", "thumb")
    assert "no device 'thumb'" in said
    assert "finger" in said


@pytest.mark.slow
@pytest.mark.serial  # a twin in real time: beside other tests it is late, and looks like a device that fails
def test_the_servo_on_the_wire_moves_and_the_recording_replays(tmp_path: Path) -> None:
    call(
        tmp_path, "run", "servo-jog", "--twin", "--set", "motion=cycle", "--duration", "4", "--record", "run.rrd",
    )  # fmt: skip
    recording = read(tmp_path / "run.rrd")
    measured, sent = recording.value("finger.position"), recording.value("finger.position_command.sent")
    assert float(np.ptp(measured[:, 0])) > 0.3
    assert float(np.nanmax(np.abs(measured - sent))) > 1e-3  # the servo lags: it isn't an echo
    assert not list((tmp_path / "state").rglob("latches.json"))
    assert "identical" in call(tmp_path, "replay", "run.rrd").stdout


@pytest.mark.slow
def test_the_users_own_start_counts_and_the_twins_end_with_the_run(tmp_path: Path) -> None:
    with Running(tmp_path, "sixth-finger", "--twin", "--set", "start=manual", instance="sixth-finger") as run:
        run.started()
        run.until(lambda: run.header("state") == State.READY, "that it waits for its start")
        (twin,) = twins_of(run.process.pid)
        os.kill(run.process.pid, signal.SIGKILL)
        until(lambda: not alive(twin), what="the end of the twins")


def test_a_jog_is_on_twins_or_simulated() -> None:
    assert "a world of their own" in refused("jog", "servo-jog", "--twin", "--sim")
