"""The whole runtime on simulated devices: the finger follows, recordings are whole, replays are exact."""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from helpers.run import call, summary

from srl.runtime.ipc.header import State
from srl.runtime.loop.replay import perturbed, replay
from srl.runtime.recording.reader import Recording, read


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("sim")


@pytest.fixture(scope="module")
def done(folder: Path) -> subprocess.CompletedProcess[str]:
    return call(
        folder,
        "run",
        "sixth-finger",
        "--sim",
        "--fast",
        "--duration",
        "8",
        "--record",
        "x.rrd",
        "--figure",
        "x.png",
        "--json",
    )


@pytest.fixture(scope="module")
def run(done: subprocess.CompletedProcess[str]) -> dict[str, object]:
    return summary(done)


@pytest.fixture(scope="module")
def recording(folder: Path, run: dict[str, object]) -> Recording:
    return read(folder / "x.rrd")


def test_the_summary_says_what_happened(run: dict[str, object]) -> None:
    assert run["profile"] == "sixth-finger"
    assert (run["state"], run["cause"]) == ("ended", "end")
    assert run["cycles"] > 800  # and the few in which it brakes
    assert run["rate_hz"] == pytest.approx(100.0)
    for name in ("period_us", "cycle_us"):
        assert set(run[name]) == {"p50", "p99", "p999", "max"}  # type: ignore[call-overload]
    assert set(run["phases_us"]) == {"read", "control", "guard", "write", "log"}  # type: ignore[call-overload]
    assert run["devices"]["glove"]["state"] == "ok"  # type: ignore[index]
    assert run["restarts"] == {"bus": 0, "recorder": 0}
    assert run["recording_complete"] is True


def test_its_own_end_is_no_warning(done: subprocess.CompletedProcess[str]) -> None:
    (said,) = (line for line in done.stderr.splitlines() if "is over" in line)
    assert re.fullmatch(r"srl: cycle 800: the run's time or its task is over", said)
    assert "exit" not in done.stderr
    assert "warning" not in done.stderr


def test_every_cycle_is_in_the_recording(run: dict[str, int], recording: Recording) -> None:
    assert recording.missing == []
    assert recording.layout.header(recording.rows, "cycle").tolist() == list(range(run["cycles"]))
    assert (np.diff(recording.layout.header(recording.rows, "now")) == 10_000_000).all()


def test_the_finger_closes_with_the_hand(recording: Recording) -> None:
    """Simulated: the distance of the finger's tip to the thumb's falls as the index finger nears the thumb."""
    value = lambda name: recording.layout.value(recording.rows, name)  # noqa: E731
    thumb = value("world.hand_tips")[:, 0]
    finger = np.linalg.norm(value("world.finger_tip") - thumb, axis=1)
    index = np.linalg.norm(value("world.hand_tips")[:, 1] - thumb, axis=1)
    assert np.ptp(finger) > 0.02
    assert np.corrcoef(finger[50:], index[50:])[0, 1] > 0.7


def test_the_physics_follows_what_was_applied_not_its_echo(recording: Recording) -> None:
    value = lambda name: recording.layout.value(recording.rows, name)  # noqa: E731
    applied, measured = value("finger.position_command.applied"), value("world.finger_position")
    gap = np.abs(applied - measured)[100:]
    assert np.median(gap) < 0.05
    assert gap.max() > 1e-4  # a servo lags; equality would be an echo


def test_commands_stay_within_the_guards_limits(recording: Recording) -> None:
    applied = recording.layout.value(recording.rows, "finger.position_command.applied")
    started = int(np.argmax(recording.layout.header(recording.rows, "state") == State.ACTIVE))
    velocity = np.diff(applied[started:], axis=0) * 100
    assert np.abs(velocity).max() <= 4.0 + 1e-6
    assert (
        np.abs(np.diff(velocity, axis=0)).max() * 100 <= 40.0 * (1 + 1e-6) * 2
    )  # of position samples, not of the profile


@pytest.mark.slow
def test_a_replay_gives_the_same_bits(folder: Path, recording: Recording) -> None:
    found = json.loads(call(folder, "replay", "x.rrd", "--json").stdout)
    assert found["largest_difference"] == 0.0
    assert found["identical"] is True
    assert found["cycles"] > 800


@pytest.mark.parametrize(("element", "cycle"), [(4, 100), (0, 555)])
def test_a_replay_notices_one_perturbed_sample(recording: Recording, element: int, cycle: int) -> None:
    rows = perturbed(recording.layout, recording.rows, f"glove.position:{cycle}:1e-6")
    comparison = replay(recording.layout, rows, "perturbed")
    assert comparison.largest > 0.0
    assert not comparison.identical


def test_the_same_seed_gives_the_same_run(folder: Path, recording: Recording) -> None:
    call(folder, "run", "sixth-finger", "--sim", "--fast", "--duration", "8", "--record", "again.rrd")
    again = read(folder / "again.rrd")
    for name, field in recording.layout.fields.items():
        a, b = recording.layout.value(recording.rows, name), again.layout.value(again.rows, name)
        assert a.tobytes() == b.tobytes(), f"{name} ({field.role}) differs"


@pytest.mark.slow
def test_a_recording_is_never_overwritten(folder: Path, run: dict[str, object]) -> None:
    done = call(folder, "run", "sixth-finger", "--sim", "--fast", "--duration", "1", "--record", "x.rrd", code=2)
    assert "x.rrd" in done.stderr


def test_the_figure_is_a_picture(folder: Path, run: dict[str, object]) -> None:
    assert (folder / "x.png").read_bytes().startswith(b"\x89PNG")
