"""The profile ikns-finger against the wire-level twins of its cameras and servos, over a real socket and a real pty.

Also with a finger of four Dynamixel servos instead of those behind the Firmata board.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from shutil import copy
from typing import Any

import numpy as np
import pytest
from helpers.run import Running, call
from helpers.srl_twin import TwinProcess
from helpers.wait import until
from ruamel.yaml import YAML
from scipy.spatial import cKDTree

from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.header import FLAG_RESYNCHRONISED, LINK_STALE, Cause, State
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.profile import profile, wiring
from srl.runtime.recording.reader import Recording, read

pytestmark = [pytest.mark.serial, pytest.mark.slow]  # a loop that is held up for 0.1 s counts as hung

# The wearer doesn't look at the finger: it moves by the world's time alone, in both runs alike.
ALIKE = ("sim.parts.wearer.watches={}", "sim.devices.mocap={noise: 0.0}")
PATIENT, SHORT = 60.0, 0.5  # s, for which the cameras may be silent: a host under load holds up the twins
PLAN = 20.0  # s of the profile's plan, which begins anew after it
SETTLED = 50  # cycles until `arm-angles` has found the posture
LAG = 0.5  # s of the wire, by which the finger may be later


def written(folder: Path, dynamixel: bool) -> str:
    """The profile in a folder, with its calibration."""
    home = resources.files("srl.profiles")
    text: dict[str, Any] = YAML(typ="safe", pure=True).load((home / "ikns-finger.yaml").read_text())
    if dynamixel:
        homes = {joint: servo["home"] for joint, servo in text["devices"]["finger"]["servos"].items()}
        motors = {joint: {"id": i, "model": "MX-28"} for i, joint in enumerate(homes, 1)}
        text["devices"]["finger"] = {
            "driver": "dynamixel",
            "port": "/dev/ttyUSB0",
            "baudrate": 1_000_000,
            "motors": motors,
        }
        axes = {
            joint: {"model": "MX-28", "axis": axis, "link": [0.042, 0.0, 0.0], "start": home}
            for (joint, home), axis in zip(homes.items(), ([0, 0, 1], *[[0, 1, 0]] * 3), strict=True)
        }
        text["frames"]["world"] = {}  # of the chain's tip
        finger = text["sim"]["parts"]["finger"]
        text["sim"]["parts"]["finger"] = {"part": "dynamixel-chain", "at": finger["at"], "axes": axes}
    with resources.as_file(home / "ikns-finger.calibration.json") as calibration:
        copy(calibration, folder)
    (folder / "ikns-finger.yaml").write_text(json.dumps(text))
    return str(folder / "ikns-finger.yaml")


@contextmanager
def wired(folder: Path, name: str, max_age: float) -> Iterator[tuple[TwinProcess, Running]]:
    """The twins, and a run on them that has begun to move."""
    options = [word for setting in ALIKE for word in ("--set", setting)]
    with TwinProcess(name, "--control", "--log", str(folder / "log.npz"), *options) as twins:
        arguments = (*twins.run[1:], "--record", "x.rrd", "--set", f"devices.mocap.max_age={max_age}")
        with Running(folder, *arguments, instance="ikns-finger") as run:
            run.started()
            run.until(lambda: run.header("state") == State.ACTIVE, "motion")
            yield twins, run


def fakes(name: str, seconds: float, *names: str) -> list[Array]:
    """Signals of the same profile with fakes, (cycles, elements)."""
    lockstep = Lockstep(wiring.build(*profile.load(name, ALIKE), []))
    views = lockstep.graph.row.views
    found: list[list[Array]] = [[] for _ in names]
    for _ in range(round(100 * seconds)):
        lockstep.step()
        for signal, values in zip(names, found, strict=True):
            values.append(views[signal].ravel().copy())
    return [np.array(values) for values in found]


def in_motion(recording: Recording, name: str) -> Array:
    """A signal (cycles, elements) in the cycles in which the limb was active, without the first ones."""
    active = recording.layout.header(recording.rows, "state") == State.ACTIVE
    values = recording.layout.value(recording.rows, name)[active][SETTLED:]
    return values.reshape(len(values), -1)


@pytest.mark.sampled(1)
@pytest.mark.timeout(300)
@pytest.mark.parametrize("dynamixel", [False, True], ids=["firmata", "dynamixel"])
def test_the_wire_gives_the_path_of_the_fakes(dynamixel: bool, tmp_path: Path) -> None:
    """From cameras to servos. A host under load delays and drops frames, so instants aren't compared.

    c: wherever the wire shows a posture, c is what the fakes' run has at that posture, within 0.005. The finger: at
    every instant of the world it is, within 0.03 rad (four dead bands of a servo), where the fakes' finger is then or
    was up to half a second before.
    """
    name = written(tmp_path, dynamixel)
    with wired(tmp_path, name, PATIENT) as (_, run):
        mark = run.reader.head
        run.until(lambda: run.reader.head > mark + 100 * (PLAN + 2.0), "a whole plan", timeout=120.0)
        call(tmp_path, "stop", "--exit")
        assert run.finish()["cause"] == "request"
    recording, log = read(tmp_path / "x.rrd"), np.load(tmp_path / "log.npz")
    markers, c, finger = fakes(name, log["t"][-1], "mocap.markers", "intent.c", "world.finger_position")

    distance, at = cKDTree(markers).query(in_motion(recording, "mocap.markers"))
    assert distance.max() < 1e-4, "m; the wire shows postures that the fakes' wearer doesn't have"
    found = in_motion(recording, "intent.c")
    gap = np.abs(found - c[at])
    print(f"c: {len(found)} cycles, at most {gap.max():.5f} apart (median {np.median(gap):.1e}) of {np.ptp(found):.2f}")
    assert np.ptp(found) > 0.6
    assert gap.max() < 0.005

    # The finger moves with the loop, from when it was active until it was stopped.
    now, states = recording.layout.header(recording.rows, "now"), recording.layout.header(recording.rows, "state")
    active = now[states == State.ACTIVE]
    rows = np.flatnonzero((log["now_ns"] > active[0] + 2e9) & (log["now_ns"] < active[-1]))
    moved, off = log["world.finger_position"][rows], np.empty(len(rows))
    for i, (time, q) in enumerate(zip(log["t"][rows], moved, strict=True)):
        near = finger[max(round(100 * (time - LAG)) - 1, 0) : round(100 * time) + 1]
        off[i] = np.abs(near - q).max(axis=1).min()
    print(f"finger: at most {off.max():.4f} rad off (median {np.median(off):.4f}) of {np.ptp(moved, axis=0).max():.2f}")
    assert np.ptp(moved, axis=0).max() > 0.6
    assert off.max() < 0.03


@pytest.mark.sampled(1)
@pytest.mark.timeout(300)
@pytest.mark.parametrize("fault", ["close", "mute"])
def test_a_cut_cable_of_the_cameras_holds_c_and_the_finger(fault: str, tmp_path: Path) -> None:
    with wired(tmp_path, "ikns-finger", SHORT) as (twins, run):

        def speed() -> float:
            row = run.reader.newest()
            return 0.0 if row is None else float(np.abs(run.layout.value(row[None], "intent.c_rate")).max())

        run.until(lambda: run.reader.head > 200 and speed() > 0.15, "the finger in motion")
        twins.control(f"{fault} mocap")
        run.until(lambda: run.header("state") == State.STOPPED, "the stop")
        assert call(tmp_path, "reset", code=2).stderr.count("still there") == 1
        twins.control(("open" if fault == "close" else "unmute") + " mocap")
        run.until(
            lambda: run.header("mocap.link") & LINK_STALE == 0 and run.header("mocap.link") & 1 == 1, "the cameras"
        )
        mark = run.reader.head
        run.until(lambda: run.reader.head > mark + 50, "half a second in which it could move")
        assert run.header("state") == State.STOPPED, "it must not move by itself"

        def reset() -> None:  # refused if the twin is held up just then
            call(tmp_path, "reset", code=None)

        until(lambda: run.header("state") == State.ACTIVE, reset, what="motion again")
        call(tmp_path, "stop", "--exit")
        found = run.finish(code=None)
    assert found["devices"]["mocap"]["reconnects"] == (1 if fault == "close" else 0)
    assert "intent_loss mocap" in run.stderr
    recording = read(tmp_path / "x.rrd")
    layout, rows = recording.layout, recording.rows
    states, now = layout.header(rows, "state"), layout.header(rows, "now")
    first = int(np.flatnonzero(layout.header(rows, "cause") == Cause.INTENT_LOSS)[0])
    age = (now - layout.header(rows, "mocap.stamp")) / 1e9
    print(f"{fault}: stopping {age[first] * 1e3:.0f} ms after the last sample")
    assert age[first - 1] <= SHORT, "it stops in the first cycle that finds the sample stale"
    again = first + int(np.flatnonzero(states[first:] == State.ACTIVE)[0])
    c, applied = layout.value(rows, "intent.c"), layout.value(rows, "finger.position_command.applied")
    assert np.ptp(c[first - 1 : again], axis=0).max() == 0.0, "c is held"
    # The finger brakes within the guard's limits, holds, and goes on without a step.
    stopped = first + int(np.flatnonzero(states[first:] == State.STOPPED)[0])
    assert np.ptp(applied[stopped:again], axis=0).max() == 0.0
    velocity = np.diff(applied, axis=0) / (layout.header(rows, "dt")[1:, None] * 1e-9)
    begun = int(np.flatnonzero(states == State.ACTIVE)[0])  # before, `applied` follows what the servos report
    # On a machine so busy that the servos' link stalls, a guard begins anew at what was sent.
    anew = layout.header(rows, "flags")[1:] & FLAG_RESYNCHRONISED != 0
    assert np.abs(velocity[begun:][~anew[begun:]]).max() <= 4.0 * (1 + 1e-6)
    dt = layout.header(rows, "dt")[1:, None] * 1e-9
    late = np.maximum(dt[1:] + dt[:-1], 0.020)[first - 50 :]  # a late cycle may change the speed by more
    assert (np.abs(np.diff(velocity[first - 50 :], axis=0)) <= 40.0 * late * 1.025).all()
