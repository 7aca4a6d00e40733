"""The unmodified drivers against the wire-level twins over real ptys, and what happens when a cable falls out."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.run import Running, alive, call, environment, srl
from scipy.spatial import cKDTree

from srl.runtime.contracts.errors import UNAVAILABLE
from srl.runtime.ipc.header import LINK_STALE, Cause, State
from srl.runtime.recording.reader import Recording, read

pytestmark = pytest.mark.serial  # a loop that is held up for 0.1 s counts as hung, a glove silent for 0.1 s as lost

QUIET = "sim.devices.glove={noise: 0.0}"  # so that both runs see the same bytes at the same posture
REST = 8.0  # s in which the recorded hand lies still, so that every run begins from the same posture


class Twins:
    """`srl twin` in the background, with faults by its standard input."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        (folder / "ports").mkdir(exist_ok=True)
        self.ports = {name: folder / "ports" / name for name in ("glove", "finger")}
        self.process = subprocess.Popen(
            srl("twin", "sixth-finger", "--link", str(folder / "ports"), "--control", "--json", *arguments),
            env=environment(folder), cwd=folder, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert self.process.stdout is not None
        self.announced: dict[str, Any] = json.loads(self.process.stdout.readline())

    def __enter__(self) -> Twins:
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.end()

    def do(self, line: str) -> None:
        """A fault, done when this returns."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()
        assert json.loads(self.process.stdout.readline())["control"] == line.split(maxsplit=1)[0]

    def end(self) -> None:
        """Its own end, so that its log is written."""
        self.process.send_signal(signal.SIGTERM)
        self.process.wait(timeout=20)

    def run_arguments(self) -> list[str]:
        """What `srl run` needs to talk to them."""
        return [str(a) for a in self.announced["run"][1:]]


FLEXION = {4, 5, 6, 7, 8, 9, 11, 12, 13, 15, 16, 17}


def _recorded(path: Path, t: np.ndarray, grasp: np.ndarray) -> Path:
    """A recorded hand (22 glove sensors) that closes as `grasp` goes from 0 to 1."""
    rest = np.zeros_like(t)
    columns = [0.3 + grasp if s in FLEXION else 0.2 + 0.6 * grasp if s in (0, 1, 2) else rest for s in range(22)]
    header = "time," + ",".join(f"s{s}" for s in range(22))
    np.savetxt(path, np.column_stack([t, *columns]), delimiter=",", header=header, comments="", fmt="%.9f")
    return path


@pytest.fixture(scope="module")
def hand(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Still, closes in 5 s, holds, opens; no joint of the finger comes to its limit, where paths would part."""
    t = np.arange(0.0, REST + 13.0, 0.01)

    def ramp(begin: float, length: float) -> np.ndarray:
        x = np.clip((t - begin) / length, 0.0, 1.0)
        return x**3 * (10 - 15 * x + 6 * x * x)

    grasp = ramp(REST, 5.0) - ramp(REST + 6.5, 5.0)
    return _recorded(tmp_path_factory.mktemp("hand") / "hand.csv", t, 0.35 * grasp)


@pytest.fixture(scope="module")
def waving(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Always in motion, and never so far that the hand touches the finger."""
    t = np.arange(0.0, 90.0, 0.01)
    return _recorded(tmp_path_factory.mktemp("hand") / "waving.csv", t, 0.12 * (1 - np.cos(np.pi * t)))


@pytest.fixture(scope="module")
def twin_run(tmp_path_factory: pytest.TempPathFactory, hand: Path) -> tuple[Recording, Any]:
    """The profile against the twins, in real time; and what the twins saw."""
    folder = tmp_path_factory.mktemp("twins")
    with Twins(folder, "--wearer", str(hand), "--log", "log.npz", "--set", QUIET) as twins:
        with Running(folder, *twins.run_arguments(), "--duration", str(REST + 11.5), "--record", "x.rrd") as run:
            found = run.finish()
        twins.end()
    assert found["cause"] == "end"
    return read(folder / "x.rrd"), np.load(folder / "log.npz")


@pytest.mark.slow
def test_the_path_is_that_of_the_fakes(tmp_path: Path, hand: Path, twin_run: tuple[Recording, Any]) -> None:
    """Paths of the fingertip, not instants: every point of one lies near the other, within what the servos resolve.

    A servo's dead band is 4 us of pulse, 7 mrad; at the four joints' distances from the tip that is 2.7 mm.
    """
    recording, log = twin_run
    arguments = ["--wearer", str(hand), "--duration", str(REST + 13.0), "--record", "f.rrd", "--set", QUIET]
    call(tmp_path, "run", "sixth-finger", "--sim", "--fast", *arguments)
    fakes = read(tmp_path / "f.rrd")
    commanded = [_active(r, "mapping.skeleton")[:, -1] for r in (recording, fakes)]
    twin, fake = log["world.finger_tip"], _active(fakes, "world.finger_tip")[100:]
    # From where the twin's servos had been put onto their home.
    measured = [twin[np.linalg.norm(twin - fake[0], axis=1).argmin() :], fake]
    moved = np.linalg.norm(np.ptp(commanded[1], axis=0))
    assert moved > 0.05
    for what, (a, b) in (("commanded", commanded), ("measured", measured)):
        gaps = np.concatenate([cKDTree(_dense(b)).query(a)[0], cKDTree(_dense(a)).query(b)[0]]) * 1e3
        median, length = np.median(gaps), moved * 1e3
        print(f"{what}: tip paths at most {gaps.max():.2f} mm apart (median {median:.3f}) of {length:.0f} mm")
        assert gaps.max() < 2.7


def _active(recording: Recording, name: str) -> np.ndarray:
    """A signal in the cycles in which the limb was active."""
    active = recording.layout.header(recording.rows, "state") == State.ACTIVE
    return recording.layout.value(recording.rows, name)[active]


def _dense(path: np.ndarray) -> np.ndarray:
    """A path with points between its points."""
    k = np.arange(len(path))
    fine = np.linspace(0, len(path) - 1, 20 * len(path))
    return np.column_stack([np.interp(fine, k, column) for column in path.T])


@pytest.mark.slow
def test_what_was_commanded_is_what_the_servos_got(twin_run: tuple[Recording, Any]) -> None:
    recording, log = twin_run
    applied = recording.layout.value(recording.rows, "finger.position_command.applied")
    for joint in range(4):
        last = log["finger.pulse_us"][log["finger.servo"] == joint][-1]
        angle = (last - 1472.0) / (2400 - 544) * 3.142
        assert angle == pytest.approx(applied[-1, joint], abs=0.002)


@pytest.mark.sampled(1)
@pytest.mark.slow
@pytest.mark.parametrize("fault", ["close", "mute"])
def test_a_glove_that_falls_out_in_motion(fault: str, tmp_path: Path) -> None:
    """Safe stop within max_age and a cycle, no step in the command, motion again after a reset."""
    with (
        Twins(tmp_path) as twins,
        Running(tmp_path, *twins.run_arguments(), "--duration", "60", "--record", "x.rrd") as run,
    ):
        run.started()
        run.until(lambda: run.header("state") == State.ACTIVE and run.reader.head > 250, "two seconds of motion")
        twins.do(f"{fault} glove")
        run.until(lambda: run.header("state") == State.STOPPED, "the stop")
        assert call(tmp_path, "reset", code=2).stderr.count("still there") == 1
        twins.do(("open" if fault == "close" else "unmute") + " glove")
        run.until(
            lambda: run.header("glove.link") & LINK_STALE == 0 and run.header("glove.link") & 1, "the glove again"
        )
        time.sleep(0.3)  # in which it could move
        assert run.header("state") == State.STOPPED, "it must not move by itself"
        call(tmp_path, "reset")
        run.until(lambda: run.header("state") == State.ACTIVE, "motion again")
        mark = run.reader.head
        run.until(lambda: run.reader.head > mark + 100, "a second of motion")
        call(tmp_path, "stop", "--exit")
        found = run.finish()
    assert found["devices"]["glove"]["reconnects"] == (1 if fault == "close" else 0)
    recording = read(tmp_path / "x.rrd")
    word = lambda name: recording.layout.header(recording.rows, name)  # noqa: E731
    first = int(np.flatnonzero(word("cause") == Cause.INTENT_LOSS)[0])
    age = (word("now") - word("glove.stamp")) / 1e9
    print(f"{fault}: stopping {age[first] * 1e3:.1f} ms after the last sample")
    assert age[first - 1] <= 0.1, "it stops in the first cycle that finds the sample stale"
    _assert_no_step(recording)


def _assert_no_step(recording: Recording) -> None:
    """Applied commands keep the profile's velocity and acceleration, over the stop and the reset."""
    applied = recording.layout.value(recording.rows, "finger.position_command.applied")
    dt = recording.layout.header(recording.rows, "dt")[1:, None] * 1e-9
    begun = int(np.flatnonzero(recording.layout.header(recording.rows, "state") == State.ACTIVE)[0])
    velocity = (np.diff(applied, axis=0) / dt)[begun:]
    assert np.abs(velocity).max() <= 4.0 * (1 + 1e-6)
    late = np.maximum(dt[1:] + dt[:-1], 0.020)[begun:]  # a cycle that the host made late may change the speed by more
    assert (np.abs(np.diff(velocity, axis=0)) <= 40.0 * late * 1.025).all()


@pytest.mark.sampled(1)
@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_the_supervisor_stops_the_servos_when_the_loop_dies(how: signal.Signals, tmp_path: Path, waving: Path) -> None:
    with Twins(tmp_path, "--log", "log.npz", "--wearer", str(waving)) as twins:
        with Running(tmp_path, *twins.run_arguments(), "--duration", "60") as run:
            run.started()
            run.until(lambda: run.header("state") == State.ACTIVE and run.reader.head > 250, "two seconds of motion")
            pid = run.children()["loop"]
            moving = np.abs(run.layout.value(run.reader.take()[-30:], "finger.position_command.velocity")).max()
            assert moving > 0.1
            died = time.monotonic_ns()
            os.kill(pid, how)
            found = run.finish(code=1)
            assert not alive(pid)
        time.sleep(0.7)  # the finger comes to rest
        twins.end()
    log = np.load(tmp_path / "log.npz")
    after = log["finger.servo_ns"] > died
    commands = log["finger.servo"][after].tolist()
    # The twin's clock is that of its world, which is behind by milliseconds on a busy machine.
    arrived = (log["finger.servo_ns"][-8:-4].max() - died) / 1e6
    assert arrived > -10.0, "not the loop's own commands"
    after[:-4] = False
    every = log["finger.servo"].tolist()
    for stop in (every[-4:], every[-8:-4]):
        assert sorted(stop) == [0, 1, 2, 3], "each servo's stop, before the dead loop was reaped and after it"
    on_the_way = commands[:-8]  # the dead loop's last frame, of the servos whose pulses it changed
    assert len(set(on_the_way)) == len(on_the_way), "not more than one frame besides"
    box = read(Path(found["death"]["black_box"]))
    applied = box.layout.value(box.rows, "finger.position_command.applied")[-1]
    held = (log["finger.pulse_us"][after] - 1472.0) / (2400 - 544) * 3.142
    still = np.abs(log["world.finger_velocity"][-20:]).max()
    fast = np.abs(log["world.finger_velocity"]).max(axis=1) > 0.05
    rest = (log["now_ns"][fast].max() - died) / 1e6
    print(f"{how.name}: stop frames at the servos {arrived:.1f} ms after it, the finger still after {rest:.0f} ms")
    assert held == pytest.approx(applied, abs=0.002)
    assert still < 0.05
    assert len(box.rows) >= 250
    # The next run on real devices begins in the stop.
    with Twins(tmp_path) as twins, Running(tmp_path, *twins.run_arguments(), "--duration", "60") as run:
        run.started()
        assert (run.header("state"), run.header("cause")) == (State.STOPPED, Cause.RESTART)
        run.until(lambda: run.header("glove.stamp") > 0, "the glove's first sample")
        run.until(lambda: run.header("glove.link") & LINK_STALE == 0, "the glove's freshness")
        call(tmp_path, "reset")
        run.until(lambda: run.header("state") == State.ACTIVE, "motion after the reset")
        call(tmp_path, "stop", "--exit")
        run.finish()


@pytest.mark.slow
def test_without_a_confirmation_nothing_moves(tmp_path: Path) -> None:
    with Twins(tmp_path, "--log", "log.npz") as twins:
        arguments = [a for a in twins.run_arguments() if a != "--confirm"]
        with Running(tmp_path, *arguments, "--duration", "60") as run:
            run.started()
            time.sleep(1.5)  # in which it could move
            assert run.header("state") == State.READY
            call(tmp_path, "start")
            run.until(lambda: run.header("state") == State.ACTIVE, "motion")
            begun = run.header("now")
            call(tmp_path, "stop", "--exit")
            run.finish()
            assert "home" in run.stderr
        twins.end()
    log = np.load(tmp_path / "log.npz")
    assert log["finger.servo_ns"].min() > begun - 2_000_000_000


@pytest.mark.slow
def test_the_wrong_board_on_a_port_is_named(tmp_path: Path) -> None:
    with Twins(tmp_path) as twins:
        glove, finger = twins.ports["glove"], twins.ports["finger"]
        for name, port, other in (("glove", finger, glove), ("finger", glove, finger)):
            arguments = ["run", "sixth-finger", "--confirm", "--duration", "2", "--set", f"devices.{name}.port={port}"]
            arguments += ["--sim", "finger" if name == "glove" else "glove"]
            done = call(tmp_path, *arguments, code=UNAVAILABLE)
            print(done.stderr.strip())
            assert name in done.stderr
            assert str(port) in done.stderr
            assert str(other) not in done.stderr
