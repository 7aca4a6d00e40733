"""Faults of drives on CAN, on a limb that hangs on them: what the wearer feels, from onset to safe.

The limb stands out level, two links of 0.15 m with 0.5 kg each and a drive at the knee; or seven links of 0.05 m.
The loop goes on to hold, as after a stop of category hold. Figures of docs/devices/odrive.md and cubemars-servo.md.
"""

from dataclasses import dataclass

import numpy as np
import pytest
from helpers.can_drives import FakeRig, cell, odrive, servo

from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.runtime.contracts.signals import Stop

SEVEN = tuple(f"j{k}" for k in range(1, 8))
KINDS = {"odrive": odrive, "cubemars-servo": servo}
both = pytest.mark.parametrize("kind", KINDS)


@dataclass
class Felt:
    """s until the sample is stale, and until a fault is named; rad and N m of each axis, the most from onset on."""

    stale: float
    named: float
    moved: np.ndarray
    early: np.ndarray  # rad, in the first 0.45 s
    pushed: np.ndarray


def limb(kind, names, **options):
    config = KINDS[kind](names=names, **options)
    link = {"link": [0.05, 0, 0], "mass": 0.1} if len(names) == 7 else {"mass": 0.5}
    return FakeRig(config, cell(kind, names, **link))


def play(rig, break_, seconds=1.0):
    where = rig.hold(0.5)
    assert rig.fault == ""
    begin, start = len(rig.log), rig.truth()
    stale = named = np.inf
    onset = rig.now
    break_(rig)
    while rig.now < onset + seconds * 1e9:
        span = (rig.now - onset) * 1e-9
        try:
            rig.cycle(where)
        except DeviceLostError:
            rig.advance()
        if rig.now - rig.fake.health.stamp > 105_000_000:
            stale = min(stale, span)
        if rig.fault or not rig.fake.health.connected:
            named = min(named, span)
    moved = np.abs(np.array([row[1] for row in rig.log[begin:]]) - start)
    pushed = np.abs(np.array([row[2] for row in rig.log[begin:]]))
    return Felt(stale, named, moved.max(axis=0), moved[:90].max(axis=0), pushed.max(axis=0))


def unplug(rig):
    options = rig.fake.drive_options
    rig.fake.drive_options = options.model_copy(update={"loss": ((rig.now * 1e-9, 1e9),)})


@both
def test_unplugged(kind):
    """It holds, unchanged, until the drives' own time limit; then it falls. The limb stops after 0.1 s."""
    rig = limb(kind, ("hip", "knee"))
    felt = play(rig, unplug, 1.2)
    assert felt.stale <= 0.12
    assert felt.named <= 0.52
    assert felt.early.max() < 0.05
    assert felt.moved[0] > 0.5, "a limb that hangs falls"
    assert felt.pushed[0] < 1.05 * 3.3
    assert not rig.fake.health.connected
    with pytest.raises(DeviceError):
        rig.fake.open()


@both
def test_one_of_seven_silent(kind):
    def break_(rig):
        rig.nodes[3].mute = True

    rig = limb(kind, SEVEN)
    felt = play(rig, break_)
    assert felt.stale <= 0.12
    assert felt.named <= 0.52
    assert "j4 is silent" in rig.fault
    assert felt.moved.max() < 0.15, "all seven are held, the silent one, too"
    assert all(rig.torque)


@both
def test_a_bus_that_takes_nothing(kind):
    def break_(rig):
        rig.driver._link.write = lambda message: False

    rig = limb(kind, ("hip", "knee"))
    felt = play(rig, break_, 1.2)
    assert felt.named <= 0.27
    assert "the bus takes no commands" in rig.fault
    assert felt.early.max() < 0.05
    assert felt.moved[0] > 0.5
    del rig.driver._link.write
    rig.run(0.2, [0.0, 0.0])
    assert max(abs(row[2][0]) for row in rig.log[-30:]) == 0, "it isn't pulled back to where it was told to be"


def test_a_brown_out_of_an_odrive():
    """It forgets its turns: 0 where it stands."""
    rig = limb("odrive", ("hip", "knee"))
    rig.hold(0.5)
    rig.run(0.6, [0.5, 0.0])
    rig.nodes[0].brown_out()
    rig.run(0.5, [0.5, 0.0])
    assert "hip jumped from 0." in rig.fault
    assert rig.torque == [False, True]
    assert max(abs(row[2][0]) for row in rig.log[-90:]) == 0, "no torque drives it to a wrong place"


def test_a_brown_out_of_a_cubemars_actuator():
    """Within half a turn of its rotor it still knows where it is, and obeys again; beyond, its position is lost."""
    rig = limb("cubemars-servo", ("hip", "knee"))
    rig.hold(0.5)
    rig.nodes[0].brown_out()
    rig.run(0.3, [0.0, 0.0])
    assert rig.fault == ""
    assert rig.truth()[0] == pytest.approx(0.0, abs=0.05)
    rig.run(0.6, [0.5, 0.0])
    rig.nodes[0].brown_out()
    before = len(rig.log)
    rig.run(0.3, [0.5, 0.0])
    assert "hip jumped" in rig.fault
    assert max(abs(row[2][0]) for row in rig.log[before + 4 :]) == 0


@both
def test_too_hot(kind):
    def break_(rig):
        rig.fake.chain.motors.stage[rig.nodes[0].i] = 120.0

    rig = limb(kind, ("hip", "knee"))
    felt = play(rig, break_)
    assert felt.named <= 0.12
    assert "too hot" in rig.fault
    assert rig.torque == [False, True]
    assert felt.moved[0] > 1.0, "a drive that protects itself lets go"
    assert felt.moved[1] < 0.1, "the other goes on to hold"


@both
def test_the_loop_dies_by_torque(kind):
    """The frames that the supervisor sends make a damping of it; after the time limit the limb falls."""
    rig = limb(kind, ("hip", "knee"), mode="torque")
    rig.run(0.02)
    for _ in range(160):
        wanted = np.clip(-60 * rig.state["position"] - 3 * rig.state["velocity"], -15, 15)
        rig.cycle(wanted)
    begin = len(rig.log)
    for _ in range(2):  # each is sent twice
        for i in range(2):
            for message in rig.driver.halt(i):
                rig.fake.take(message)
    for _ in range(200):
        rig.advance()
    angle = np.array([row[1][0] for row in rig.log[begin:]])
    speed = np.diff(angle) * 200
    assert speed[:90].max() < 1.3, "rad/s: damped"
    assert speed.max() > 2.0, "and then let go"


@both
def test_limp_lets_it_fall(kind):
    rig = limb(kind, ("hip", "knee"))
    rig.hold(0.5)
    rig.run(0.3, stop=Stop.LIMP)
    assert max(abs(row[2][0]) for row in rig.log[-50:]) == 0
    assert rig.truth()[0] > 0.3


def test_lost_frames_are_survived():
    rig = FakeRig(odrive(), cell("odrive", ("hip", "knee"), mass=0.5), dropout=0.2)
    rig.hold(0.5)
    rig.run(0.5, [0.2, 0.1])
    assert rig.fault == ""
    assert rig.truth() == pytest.approx([0.2, 0.1], abs=0.06)
