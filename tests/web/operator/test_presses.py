"""Presses on the panel, as the run of `srl jog --panel` takes them, and what they move: in lockstep, without a page."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.run import refused

from srl.commissioning.jog.hold import FINE, Hold
from srl.commissioning.jog.presses import Presses
from srl.commissioning.jog.profile_subset import PRESS, RAMP, WAY, subset
from srl.control.setpoint.jog import REST
from srl.runtime.contracts.errors import RequestError
from srl.runtime.contracts.signals import Kind
from srl.runtime.ipc import presses
from srl.runtime.ipc.header import DEVICE, LINK_CONNECTED, State
from srl.runtime.ipc.presses import FRESH, MOVES
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.profile import profile

JOINTS = ("a", "b")


@pytest.fixture
def folder(tmp_path: Path) -> RunFolder:
    return RunFolder(tmp_path)


@pytest.fixture
def hold() -> Hold:
    return Hold(JOINTS, 0.03)


@pytest.fixture
def end(folder: RunFolder, hold: Hold) -> Iterator[Presses]:
    with Presses(folder, 2, hold) as made:
        yield made


def send(folder: RunFolder, data: bytes) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        sender.sendto(data, str(folder.press_socket))


def soon() -> int:
    return time.monotonic_ns() + round(0.9 * FRESH * 1e9)


def test_a_press_arrives_and_lives_for_as_long_as_it_says(folder: RunFolder, end: Presses, hold: Hold) -> None:
    expires = 0
    while not hold.moving:  # on a busy machine it may be too late
        expires = soon()
        assert presses.send(folder, 1, -1, expires)
        assert end.pressed() == []
    assert hold.joint == 1
    way, press = hold.at(expires / 1e9 - 0.01)
    assert way.tolist() == [0.0, -1.0]
    assert press[0] >= 1
    assert hold.expires(expires / 1e9 - 0.01) == pytest.approx(expires / 1e9, abs=0.01)
    assert hold.at(expires / 1e9 + 0.01)[1][0] == 0


def test_a_fine_press_moves_at_a_fifth(folder: RunFolder, end: Presses, hold: Hold) -> None:
    while not hold.moving:
        presses.send(folder, 0, -1, soon(), fine=True)
        end.pressed()
    assert hold.moving == -FINE


@pytest.mark.parametrize(
    "content",
    [
        {}, {"joint": 2, "way": 1}, {"joint": -1, "way": 1}, {"joint": True, "way": 1}, {"joint": 0, "way": 2},
        {"joint": 0, "way": 1.0}, {"joint": 0, "way": None}, {"joint": 0, "way": "1"}, {"joint": 0.0, "way": 1},
        {"joint": 0, "way": 1, "fine": "yes"}, {"joint": 0, "way": 1, "fine": 2},
        {"joint": 0, "way": 1, "expires": None}, {"joint": 0, "way": 1, "expires": 0},
        {"joint": 0, "way": 1, "expires": 1 << 62}, {"joint": 0, "way": 1, "expires": float("nan")},
        {"joint": 0, "way": 1, "expires": float("inf")}, {"joint": 10**30, "way": 1},
    ],
)  # fmt: skip
def test_what_is_no_press_moves_nothing(folder: RunFolder, end: Presses, hold: Hold, content: dict[str, Any]) -> None:
    send(folder, json.dumps({"expires": soon()} | content).encode())
    end.pressed()
    assert hold.at(time.monotonic())[1][0] == 0


@pytest.mark.parametrize("data", [b"", b"\xff", b"[]", b"1" * 4000, b'{"joint": 0'])
def test_what_is_no_message_moves_nothing(folder: RunFolder, end: Presses, hold: Hold, data: bytes) -> None:
    send(folder, data)
    end.pressed()
    assert hold.at(time.monotonic())[1][0] == 0


def test_without_a_run_that_takes_presses_none_leaves(folder: RunFolder) -> None:
    assert not presses.send(folder, 0, 1, soon())


def test_the_socket_is_for_user_and_group(folder: RunFolder, end: Presses) -> None:
    assert folder.press_socket.stat().st_mode & 0o777 == 0o660


@pytest.mark.parametrize("name", ["servo-jog", "finger-jog", "ur-jog"])
def test_a_held_jog_ends_within_a_tenth_of_a_second_of_the_last_picture(name: str) -> None:
    made = subset(*profile.load(name, []), None, 0.1, [], panel=True)
    lockstep, row = Lockstep(made.graph), made.graph.row
    period = 1.0 / float(made.profile.rate)
    hold = Hold(tuple(made.speed), FRESH)
    words = row.devices[made.graph.layout.devices.index("terminal")]
    words[DEVICE.stamp], words[DEVICE.link] = -1, LINK_CONNECTED
    now, states, found = 0.0, set[State](), list[tuple[float, float]]()

    def go(until: float, pressed: bool) -> float:
        """Cycles until then; a press with each, that lives as long as it may. Returns when the last one was made."""
        nonlocal now
        reported = now
        while now < until:
            now += period
            if pressed:
                reported = now
                hold.press(0, 1.0, reported + FRESH, reported)
            row.views[WAY][:], row.views[PRESS][:] = hold.at(now)
            words[DEVICE.stamp] = (lockstep.count + 1) * lockstep.period
            states.add(lockstep.step())
            found.append((now, float(made.actuator.applied.ravel()[0])))
        return reported

    go(REST + 0.2, pressed=False)
    assert State.ACTIVE in states
    found.clear()
    dead = go(now + 0.5, pressed=True)
    # The connection is dead. The last press is taken as late as it can be: a number that the law hasn't seen yet.
    late = dead + FRESH - period
    go(late, pressed=False)
    hold.press(0, 1.0, dead + FRESH, dead)
    go(dead + 0.5, pressed=False)
    times, q = np.array(found).T
    speed = q if made.actuator.command.kind is Kind.VELOCITY else np.diff(q, prepend=q[0]) / period
    full = made.speed[next(iter(made.speed))]
    assert speed[times <= dead].max() == pytest.approx(full)
    # Braking has begun by then; the ramp to rest follows.
    assert (speed[times > dead + 0.1 + period / 2] < full * 0.999).all()
    braked = speed[times > dead + 0.1 + RAMP * 2 + 2 * period]
    assert np.abs(braked).max() < 1e-9
    assert FRESH + MOVES + 1.0 / presses.SLOWEST <= 0.1 + 1e-9


def test_a_loop_that_is_too_slow_to_end_a_jog_in_time_is_refused() -> None:
    with pytest.raises(RequestError, match="100 Hz or more"):
        subset(*profile.load("servo-jog", ["rate=50"]), None, 0.1, [], panel=True)


def test_steps_are_for_a_terminal() -> None:
    assert "--step" in refused("jog", "finger-jog", "--sim", "--panel", "--step")
