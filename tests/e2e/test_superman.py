"""SUPER-MAN with the whole runtime: buttons pressed at any instant while a hand pushes at random, and a blocked tip.

Judged are the commands as the control laws asked for them, before the guard. A run is cut into chunks that start
afresh. SRL_SUPERMAN_CHUNKS says how many a profile gets; 30 are ten simulated minutes.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.run import call, summary
from ruamel.yaml import YAML

from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.header import State
from srl.runtime.models.robots import PANDA, UR16E
from srl.runtime.recording.reader import Recording, read

PROFILES = Path(__file__).parents[2] / "profiles"
CHUNKS = int(os.environ.get("SRL_SUPERMAN_CHUNKS", "1"))
SPAN = 20.0  # s of a chunk
BUTTONS = "AMGP"
PUSH = (3.0, 20.0)  # N, least and greatest; from about 25 N on the hand itself asks the arms for more than they may
TWIST = (0.1, 2.0)  # N m
EDGE = 0.03  # s in which a push rises and falls
TABLES = {"moca-man": [0.507, 0.0, 0.768], "kairos-man": [-0.26, -0.174, 0.7205]}  # m, centre: 1 mm under the rod

pytestmark = [pytest.mark.slow, pytest.mark.timeout(3600)]


@dataclass(frozen=True)
class Body:
    """What one of the two is held to.

    Attributes:
        command: the arm's command signal.
        step: of that command from one cycle to the next, in its unit.
        base: of the base's twist, likewise, m/s and rad/s.
        robot: whose joint limits hold.
    """

    profile: str
    command: str
    step: float
    base: float
    robot: Any


MOCA = Body("moca-man", "arm.torque_command", 1000.0 / 1000, 1.0 / 1000, PANDA)  # 1000 N m/s; 1 m/s2; at 1 kHz
KAIROS = Body("kairos-man", "arm.velocity_command", 15.0 / 500, 1.0 / 500, UR16E)  # 15 rad/s2; 1 m/s2; at 500 Hz


def changed(folder: Path, profile: str, change: Callable[[Any], None]) -> Path:
    """A copy of a profile with something changed."""
    yaml = YAML()
    content = yaml.load(PROFILES / f"{profile}.yaml")
    change(content)
    path = folder / f"{profile}.yaml"
    with path.open("w") as file:
        yaml.dump(content, file)
    return path


def run(folder: Path, profile: Path, seconds: float, *more: str, code: int = 0) -> tuple[dict[str, Any], Recording]:
    """As fast as it goes, recorded."""
    arguments = ("run", str(profile), "--sim", "--fast", "--duration", str(seconds), "--record", "x.rrd", *more)
    found = summary(call(folder, *arguments, "--json", code=code, timeout=900))
    recording = read(folder / "x.rrd")
    (folder / "x.rrd").unlink()
    assert recording.missing == []
    return found, recording


def pushes(seed: int, path: Path) -> None:
    """A hand's forces, world axes: each push is soon followed by its opposite, so that the robot stays about."""
    rng = np.random.default_rng([seed, 1])
    time, wrench = [0.0], [np.zeros(6)]
    t = 0.5
    while t < SPAN:
        direction = rng.normal(size=6)
        force = np.exp(rng.uniform(*np.log(PUSH))) * direction[:3] / np.linalg.norm(direction[:3])
        torque = np.exp(rng.uniform(*np.log(TWIST))) * direction[3:] / np.linalg.norm(direction[3:])
        length = rng.uniform(0.05, 1.2)
        for sign in (1.0, -1.0):
            held = sign * np.concatenate([force, torque])
            for at, value in ((t, np.zeros(6)), (t + EDGE, held), (t + EDGE + length, held)):
                time.append(at)
                wrench.append(value)
            t += 2 * EDGE + length
            time.append(t)
            wrench.append(np.zeros(6))
            t += rng.exponential(0.2) + 0.01
    np.savez(path, t=np.array(time), F=np.array(wrench))


def presses(seed: int) -> dict[str, list[list[float]]]:
    """Windows of each button, s: any of them at any instant, at times two together."""
    rng = np.random.default_rng([seed, 2])
    found: dict[str, list[list[float]]] = {}
    for button in BUTTONS:
        t, windows = 0.3 if button == "A" else float(rng.uniform(0.4, 1.5)), []
        while t < SPAN:
            held = float(rng.uniform(0.03, 0.4))
            windows.append([t, t + held])
            t += held + float(rng.exponential(1.2)) + 0.02
        found[button] = windows
    return found


def at_random(folder: Path, body: Body, seed: int) -> Path:
    """The profile with those pushes and presses."""
    pushes(seed, folder / "pushes.npz")

    def change(content: Any) -> None:
        person = content["sim"]["parts"]["person"]
        for key in ("plan", "tool"):
            del person[key]
        person["recording"] = {"file": str(folder / "pushes.npz")}
        panel = content["sim"]["devices"]["panel"]
        del panel["person"]
        panel["presses"] = presses(seed)
        content["seed"] = seed

    return changed(folder, body.profile, change)


def largest_step(recording: Recording, name: str) -> Array:
    """Of a signal from one active cycle to the next, by element."""
    active = recording.int("state") == State.ACTIVE
    both = active[1:] & active[:-1]
    return np.asarray(np.abs(np.diff(recording.value(name), axis=0))[both].max(axis=0))


def all_finite(recording: Recording) -> None:
    for name, field in recording.layout.fields.items():
        if field.role in ("command", "applied", "internal", "truth"):
            assert np.isfinite(recording.value(name)).all(), name


def within_limits(recording: Recording, robot: Any) -> None:
    """The simulated truth, stopping included: joints stay within position, velocity and torque limits."""
    q, qd, tau = (recording.value(f"world.arm_{name}") for name in ("position", "velocity", "effort"))
    assert (q >= robot.q_lower).all()
    assert (q <= robot.q_upper).all()
    assert (np.abs(qd) <= robot.dq_max).all(), np.abs(qd).max(axis=0)
    assert (np.abs(tau) <= robot.tau_max * (1 + 1e-9)).all(), np.abs(tau).max(axis=0)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("chunk", range(CHUNKS))
@pytest.mark.parametrize("body", [MOCA, KAIROS], ids=lambda b: b.profile)
def test_no_button_at_any_instant_makes_a_step(tmp_path: Path, body: Body, chunk: int) -> None:
    found, recording = run(tmp_path, at_random(tmp_path, body, 100 + chunk), SPAN)
    events = [event.text for event in recording.events]
    assert found["cause"] == "end", events
    pressed = found["result"]["keys"]["presses"]
    arm, base = largest_step(recording, body.command), largest_step(recording, "base.twist_command")
    q = recording.value("world.arm_position")
    room = np.minimum(q - body.robot.q_lower, body.robot.q_upper - q).min()
    print(
        f"{body.profile} {chunk}: presses {sum(pressed.values())}, step of the arm's command {arm.max():.4f} of"
        f" {body.step:g}, of the base's {base.max():.5f} of {body.base:g}, least room of a joint {room:.3f} rad,"
        f" speed {np.max(np.abs(recording.value('world.arm_velocity')) / body.robot.dq_max):.2f} of the limit,"
        f" guard {found['result']['guard']}, {found['result']['guide']}, {found['result']['body']}, {events}"
    )
    assert min(pressed.values()) >= 3
    all_finite(recording)
    within_limits(recording, body.robot)
    assert (arm <= body.step * (1 + 1e-9)).all(), arm
    assert (base <= body.base * (1 + 1e-9)).all(), base
    assert np.abs(np.diff(recording.value("hand.position_command"), axis=0)).max() <= 1.5 * 2e-3


@pytest.mark.sampled(1)
@pytest.mark.parametrize("body", [MOCA, KAIROS], ids=lambda b: b.profile)
def test_a_blocked_tip_presses_no_harder_than_hand_and_leash(tmp_path: Path, body: Body) -> None:
    """A rod on the flange over a table, a hand that pushes down with 15 N for 5 s while the admittance is on."""
    push = 15.0
    time = np.array([0.0, 1.0, 1.0 + EDGE, 6.0, 6.0 + EDGE, 7.0])
    wrench = np.zeros((len(time), 6))
    wrench[2:4, 2] = -push
    np.savez(tmp_path / "pushes.npz", t=time, F=wrench)

    def change(content: Any) -> None:
        sim = content["sim"]
        person = sim["parts"]["person"]
        for key in ("plan", "tool"):
            del person[key]
        person["recording"] = {"file": str(tmp_path / "pushes.npz")}
        del sim["devices"]["panel"]["person"]
        sim["devices"]["panel"]["presses"] = {"A": [[0.5, 0.8]]}
        low = {"size": [0.02, 0.02, 0.3], "mass": 0.05, "at": {"parent": "arm/flange", "position": [0.0, 0.0, 0.15]}}
        sim["parts"]["rod"] = {"part": "box", **low}
        sim["parts"]["table"] = {"part": "box", "size": [0.2, 0.2, 0.1], "at": {"position": TABLES[body.profile]}}
        sim["parts"]["table"]["stiffness"] = sim["parts"]["rod"]["stiffness"] = 0.02  # s: a padded table

    found, recording = run(tmp_path, changed(tmp_path, body.profile, change), 7.0)
    force = np.abs(recording.value("world.table_contact_force")[:, 2])
    dt = 1e-9 * np.median(recording.layout.header(recording.rows, "dt"))
    assert force.max() > 5.0, "it never touched"
    # Before it the arm's mass lands: MOCA's slowest mode has 4.6 rad/s.
    pressed = force[np.flatnonzero(force > 5.0)[0] + round(0.3 / dt) :]
    ahead = np.linalg.norm((recording.value("guide.pose") - recording.value("tool.pose"))[:, :3], axis=1)
    print(f"{body.profile}: contact {pressed.max():.1f} N, impact {force.max():.1f} N, {found['cause']}")
    assert found["cause"] == "end"
    assert ahead.max() < 0.03 + 2 * push / 1000
    assert pressed.max() < 2 * push + 500 * (0.03 + push / 1000)


def test_a_closed_gripper_that_hits_a_table_stops_kairos(tmp_path: Path) -> None:
    """Nothing is held: led up by some 10 cm, then down at 5 cm/s. Faster, the arm stops itself at once."""

    def change(content: Any) -> None:
        sim = content["sim"]
        del sim["parts"]["person"]
        sim["devices"]["panel"] = {"presses": {"A": [[0.3, 0.4]], "G": [[0.6, 0.7]]}}
        sim["parts"]["grip"]["pushes"] = [
            {"start": 1.0, "end": 1.6, "wrench": [0, 0, 8.0, 0, 0, 0]},
            {"start": 2.5, "end": 7.0, "wrench": [0, 0, -2.3, 0, 0, 0]},
        ]
        low = {"size": [0.03, 0.03, 0.14], "mass": 0.05, "at": {"parent": "arm/flange", "position": [0.0, 0.0, 0.17]}}
        sim["parts"]["rod"] = {"part": "box", **low}
        sim["parts"]["table"] = {"part": "box", "size": [0.2, 0.2, 0.1], "at": {"position": TABLES["kairos-man"]}}
        sim["parts"]["table"]["stiffness"] = sim["parts"]["rod"]["stiffness"] = 0.02  # s: a padded table

    found, recording = run(tmp_path, changed(tmp_path, "kairos-man", change), 7.0, code=1)
    force = np.abs(recording.value("world.table_contact_force")[:, 2])
    dt = 1e-9 * float(np.median(recording.layout.header(recording.rows, "dt")))
    touched = np.flatnonzero(force > 1.0)
    first = int(touched[touched * dt > 2.5][0])
    states = recording.layout.header(recording.rows, "state")
    stop = first + int(np.flatnonzero(states[first:] != State.ACTIVE)[0])
    late = 1e3 * (stop - first) * dt
    print(f"stop {late:.0f} ms after the touch, force then {force[stop]:.0f} N, largest {force[first:].max():.0f} N")
    assert found["cause"] == "contact"
    assert found["fault_source"] == "held"
    assert late < 60.0
    assert force[-100:].max() < force[first:].max()
