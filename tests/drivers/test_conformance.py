"""Every driver that takes commands, against a link that takes none, half of one, every second one, or another device.

On a CAN bus each joint has a frame of its own: half of a command is that of some joints, and what counts as sent, and
where the guard goes on, is told by joint.

Whatever the link does: what reaches the device is what the row says was sent, and makes no step beyond the limits from
what was sent before (`UnderGuard.judge`). Real drivers and their twins, under the real cycle and guard; in lockstep,
except for the base, whose zenoh process has a clock of its own.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from helpers.serial_wires import SerialWire
from helpers.under_guard import UnderGuard
from helpers.wires import WIRES

from srl.runtime.contracts.signals import Kind
from srl.runtime.ipc.header import State
from srl.runtime.ipc.requests import RequestKind

# Their motors know where they stand only within a part of a turn, so after a loss of power they must be parked.
FORGETFUL = ("cubemars-servo", "mit-can-v2", "mit-can-v3", "odrive")
DATAGRAMS = tuple(name for name in WIRES if name.startswith(("base", "panda")))
# What the fast tests look at: a kind of bus each. Of the rest of the family CI takes a third for each test, another one
# for the next test; `make exhaustive` takes all.
FEW = ("dynamixel-position-2", "feetech", "firmata", "mit-can-damiao", "softhand")
MANY = tuple(name for name in WIRES if name not in FEW)


def wires(turn, names=tuple(WIRES), slow=()):
    """A test for each of these wires; `turn` says which third of the slow ones CI takes."""
    marks = {name: [pytest.mark.serial] * (name == "base") for name in names}
    for i, name in enumerate(name for name in WIRES if name in names and name in slow):
        marks[name] += [pytest.mark.slow] + [pytest.mark.exhaustive] * ((i + turn) % 3 > 0)
    return pytest.mark.parametrize("name", [pytest.param(name, marks=marks[name]) for name in names])


@pytest.fixture
def under(name, monkeypatch, tmp_path):
    with UnderGuard(WIRES[name](monkeypatch, tmp_path)) as made:
        yield made


def moves_on(u, first):
    """With a good link again the limb meets the wave, after a reset if it has stopped; then the guard is left alone.

    `first`: number of the first row with the bad link.
    """
    sent = u.rows[-1].commands
    u.until(lambda: u.state is not State.ACTIVE or u.rows[-1].commands > sent, most=0.2)
    u.meet()
    met = len(u.rows)
    u.run(0.3)
    u.judge()
    assert not u.resynchronised(first - 50, first), "before"
    assert not u.resynchronised(met), "once the wave was met again"


@wires(0, slow=MANY)
def test_in_normal_operation_the_guard_is_left_alone(under):
    """The declared period and resolution, with an adapter that holds back for 16 ms what comes."""
    u = under
    if isinstance(u.wire, SerialWire):
        u.wire.valve.latency = 16_000_000
    u.until(u.follows)
    first = len(u.rows)
    u.run(2.0)
    rows = u.rows[first:]
    left = [row for before, row in pairwise(rows) if row.commands > before.commands]
    command = u.setting.command
    assert max(np.diff([row.now for row in left])) <= command.period * 1e9
    assert (np.max([np.abs(row.sent - row.applied) for row in left], axis=0) <= command.resolution).all()
    assert not u.resynchronised(first)
    u.judge()


@wires(1, slow=MANY)
@pytest.mark.parametrize(
    "seconds", [pytest.param(0.1, marks=pytest.mark.slow), 0.5, pytest.param(2.0, marks=pytest.mark.slow)]
)
def test_a_link_that_takes_nothing(under, seconds):
    u, valve = under, under.wire.valve
    u.until(u.follows)
    u.run(0.5)
    u.await_middle(seconds)
    first, before = len(u.rows), u.rows[-1].sent
    valve.shut = True
    u.run(seconds)
    assert valve.refused
    if u.state is State.ACTIVE:  # else the device has noticed it, or has stopped by itself
        assert np.abs(u.rows[-1].asked - before).max() > 3 * u.setting.spring, "the wave is far by now"
        assert u.resynchronised(first), "the row shows it"
    valve.open()
    moves_on(u, first)


@wires(2, [name for name in WIRES if name not in DATAGRAMS], slow=MANY)
def test_a_link_that_takes_half_a_frame(under):
    u, valve = under, under.wire.valve
    u.until(u.follows)
    u.run(0.5)
    u.await_middle(0.15)
    first = len(u.rows)
    valve.halve = True
    u.run(0.15)
    assert valve.refused
    valve.open()
    moves_on(u, first)


@wires(3, slow=MANY)
def test_a_link_that_takes_every_second_command(under):
    u, valve = under, under.wire.valve
    u.until(u.follows)
    u.run(0.5)
    first = len(u.rows)
    valve.every_second = True
    u.run(1.0)
    assert valve.refused > 10
    valve.open()
    moves_on(u, first)


@wires(4, [name for name in WIRES if name not in FORGETFUL], slow=MANY)
def test_a_device_that_comes_back_as_another(under):
    u, wire = under, under.wire
    u.until(u.follows)
    u.run(0.5)
    wire.leave()
    u.until(lambda: u.device.lost)
    gone, last = len(u.rows), u.rows[-1].sent
    wire.come_back()
    u.until(lambda: not u.device.lost)
    u.run(0.3)
    assert u.state is State.STOPPED
    assert not any(row.active for row in u.rows[gone:])
    assert not any(value for row in u.rows[gone:] for _, value in row.got), "nothing moves before a reset"
    assert u.meet() > 0
    begin = next(row for row in u.rows[gone:] if row.active)
    if u.setting.command.kind is Kind.POSITION:
        where = last if begin.measured is None else begin.measured
        assert begin.applied == pytest.approx(where, abs=1.01 * u.setting.spring)
    u.judge()


@wires(5, FORGETFUL)
def test_a_device_that_may_have_lost_its_position_is_moved_no_more(under):
    """Not by a reset, either: only a person can say where the limb stands, by parking it."""
    u, wire = under, under.wire
    u.until(u.follows)
    u.run(0.5)
    wire.leave()
    u.until(lambda: u.device.lost)
    gone = len(u.rows)
    wire.come_back()
    u.until(lambda: any("still away" in event or "is back" in event for event in u.events))
    for _ in range(5):
        u.step(RequestKind.RESET)
        u.run(0.2)
    assert "park" in u.device.driver.health.fault + u.events[-1]
    assert u.state is not State.ACTIVE
    assert not any(row.got for row in u.rows[gone:])
    u.judge()


# By wire: s of a stall, and the fault that tells what the device has done by itself; "": `.sent` shows that it rests.
OWN = {
    "base": (0.35, ""),
    "mit-can-damiao": (0.35, "its watchdog"),
    "odrive": (0.7, "watchdog"),
    "softhand": (0.45, "switched its motor off"),
    "dynamixel-position-2": (0.5, "the bus watchdog"),
    "dynamixel-velocity-2": (0.5, "the bus watchdog"),
    "dynamixel-current-position-2": (0.5, "the bus watchdog"),
    "dynamixel-effort-2": (0.5, "the bus watchdog"),
    "panda-torque": (0.1, "communication_constraints_violation"),
    "panda-velocity": (0.1, "communication_constraints_violation"),
    "panda-position": (0.1, "communication_constraints_violation"),
    "ur-velocity": (0.4, "no command came"),
    "ur-position": (0.4, "no command came"),
}


@wires(6, OWN, slow=MANY)
def test_what_a_device_does_by_itself_is_known(name, monkeypatch, tmp_path):
    options = {"watchdog": 0.2} if name.startswith(("dynamixel", "mit-can")) else {}
    seconds, fault = OWN[name]
    with UnderGuard(WIRES[name](monkeypatch, tmp_path, **options)) as u:
        u.until(u.follows)
        u.await_middle(0.2)
        u.wire.valve.shut = True
        u.run(seconds)
        if name in ("base", "ur-velocity"):
            assert not u.rows[-1].sent.any()
        u.wire.valve.open()
        u.until(lambda: not u.device.lost)
        u.until(lambda: fault in u.device.driver.health.fault, most=1.0)
        u.meet()
        u.judge()
