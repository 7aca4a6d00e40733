"""The simulated person: delays, noise, muscles and fatigue, and buttons."""

from __future__ import annotations

from math import log
from typing import Any

import numpy as np
import pytest
from helpers.person import MS, alone, finished, guided, hold, press, quiet, run

from srl.drivers.firmata.config import FirmataConfig
from srl.drivers.trigno import TrignoConfig
from srl.runtime.contracts.errors import WiringError
from srl.sim.devices.firmata.fake import FakeFirmata, FakeFirmataConfig
from srl.sim.devices.trigno.fake import FakeTrigno, FakeTrignoConfig
from srl.sim.parts.person.muscles import Muscles

# -- delays and noise


def lag(sight: float) -> float:
    """s by which corrections follow the handle's motion, by cross-correlation."""
    options = {**quiet(), "sight": sight, "bandwidth": 10.0, "correction": (1.0, 0.0), "activation": 0.0}
    world = guided([hold(100.0)], stiffening=0.0, trolley={"mass": 1e6, "damping": 0.0}, **options)
    robot, rng = world.parts["robot"], np.random.default_rng(5)
    place, v, rows = 0.0, 0.0, []
    for k in range(10000):
        v += 0.001 * (-2.0 * v - 4.0 * place) + 0.02 * rng.normal() * 0.03
        place += 0.001 * v
        robot.v[0] = v
        world.advance((k + 1) * 2 * MS)
        truth = world.truth_arrays
        rows.append((truth["person_tool"][0], truth["person_balance"][0] - truth["person_aim"][0]))
    x, correction = np.array(rows[500:]).T
    x, correction = np.diff(x), np.diff(correction)
    score = [float(correction[k:] @ -x[: len(x) - k]) for k in range(300)]
    return int(np.argmax(score)) * 0.002


@pytest.mark.slow
def test_sight_is_late_by_its_delay():
    short, usual, long = lag(0.0), lag(0.12), lag(0.3)
    assert short == pytest.approx(1 / (2 * np.pi * 10), abs=0.03)  # what the bandwidth of 10 Hz costs
    assert usual - short == pytest.approx(0.12, abs=0.012)
    assert long - short == pytest.approx(0.3, abs=0.012)


@pytest.mark.slow
def test_tremor_has_its_band_and_size():
    options = quiet() | {"tremor": 0.0002}
    world = alone([hold(100.0)], 0.0, stiffness=20.0, damping=1.0, correction=(0.0, 0.0), **options)
    place = run(world, 25, every=5)["person_tool"][1000:]
    place = place - place.mean(axis=0)
    assert np.sqrt((place**2).mean()) == pytest.approx(0.0002, rel=0.3)
    power = (np.abs(np.fft.rfft(place * np.hanning(len(place))[:, None], axis=0)) ** 2).sum(axis=1)
    frequency = np.fft.rfftfreq(len(place), 0.005)
    band = (frequency > 7.5) & (frequency < 12.5)
    assert power[band].sum() > 0.9 * power[frequency > 2].sum()


@pytest.mark.slow
def test_noise_grows_with_the_force():
    spread = []
    for tool in (2.0, 4.0):
        world = alone([hold(100.0)], tool, drift=0.0, tremor=0.0, stiffness=1.0, damping=0.1, correction=(0.0, 0.0))
        force = run(world, 8, every=5)["person_wrench"][:, :3]
        spread.append(np.sqrt(force.var(axis=0).sum()) / (tool * 9.81))
    assert spread == pytest.approx([0.05, 0.05], rel=0.35)


@pytest.mark.slow
def test_a_hand_held_still_is_as_still_as_people_are():
    """Sheet human_body: 1 to 3 mm RMS over 5 s."""
    for tool in (0.0, 3.0):
        place = run(alone([hold(100.0)], tool), 20)["person_tool"][500:].reshape(3, -1, 3)
        spread = np.sqrt(place.var(axis=1).sum(axis=1)).mean()
        assert 0.0005 < spread < 0.006


# -- muscles


def test_muscles_that_lift_are_active_for_a_load_and_little_with_a_robot():
    world = alone([hold(10.0)], 5.0)
    run(world, 2.0)
    muscles = next(signal.labels for signal in world.truth if signal.name == "person_activation")
    lifting = dict(zip(muscles, world.truth_arrays["person_activation"], strict=True))
    assert lifting["anterior_deltoid"] > 0.3
    assert lifting["biceps"] > 0.3
    assert lifting["triceps"] < 0.1
    robot = guided([hold(10.0)])
    run(robot, 2.0)
    person = robot.parts["person"]
    assert person.activation("biceps") < 0.3 * lifting["biceps"]
    with pytest.raises(WiringError, match="biceps"):
        person.activation("bicep")


def test_pulling_and_pushing_take_other_muscles():
    fresh = Muscles(100.0, 0.0, 0.0)
    names = ("anterior_deltoid", "posterior_deltoid", "biceps", "triceps")
    for force, most in (((0, 0, -40), "triceps"), ((-40, 0, 0), "posterior_deltoid")):
        level = fresh.activations(force, 1.0)
        assert names[int(np.argmax(level))] == most
    left = Muscles(100.0, np.pi / 2, 0.0)  # facing y
    assert left.activations((0, -40, 0), 1.0) == pytest.approx(fresh.activations((-40, 0, 0), 1.0))
    assert fresh.activations((0, 0, 40), 0.5)[2] > fresh.activations((0, 0, 40), 1.0)[2]
    assert max(fresh.activations((0, 0, 1e4), 0.1)) == 1.0


@pytest.mark.parametrize("load", [0.3, 0.5, 0.7])
def test_endurance_is_that_of_the_fatigue_model(load):
    muscles, capacity, t = Muscles(100.0, 0.0, 0.0), 1.0, 0.0
    while capacity > load:
        capacity, t = muscles.tired(capacity, (0.0, 0.0, 100.0 * load), 0.01), t + 0.01
    assert t == pytest.approx(60 * -log(load) / load, rel=1e-3)
    rested = muscles.tired(capacity, (0.0, 0.0, 0.0), 60.0)
    assert 1 - rested == pytest.approx((1 - capacity) * np.exp(-2.4))


@pytest.mark.slow
def test_a_person_gives_up_when_strength_is_gone():
    world = alone([hold(1000.0)], 5.0, strength=80.0, fatigue=True, arm_load=0.0)
    seen = run(world, 60, every=100, until=finished)
    assert seen["time"][-1] == pytest.approx(60 * -log(49 / 80) / (49 / 80) + 2.0, rel=0.2)
    assert world.truth_arrays["person_progress"][2] == 1.0
    assert seen["person_capacity"][-1, 0] < 0.65


def test_an_electrode_measures_its_muscle():
    world = alone([hold(100.0)], 5.0)
    config = TrignoConfig.model_validate({"port": "tcp://127.0.0.1", "channels": {"biceps": 1, "triceps": 2}})
    fake = FakeTrigno("emg", config, world, FakeTrignoConfig(part="person"))
    fake.bind({s.name: np.zeros(s.shape) for s in fake.states}, {})
    fake.open()
    strong = []
    for k in range(100):
        world.advance((k + 1) * 20 * MS)
        fake.read(world.time)
        strong.append(fake.state_arrays["envelope"].copy())
    biceps, triceps = np.mean(strong[50:], axis=0)
    assert biceps > 3 * triceps


# -- buttons

BUTTONS = {name: {"pin": 2 + i} for i, name in enumerate(("admittance", "mode", "gripper", "priority"))}


def panel(world: Any, **options: Any) -> FakeFirmata:
    config = FirmataConfig.model_validate({"port": "x", "buttons": BUTTONS})
    fake = FakeFirmata("panel", config, world, FakeFirmataConfig.model_validate({"person": "person"} | options))
    fake.bind({s.name: np.zeros(s.shape) for s in fake.states}, {})
    fake.open()
    return fake


def test_the_person_presses_the_panels_buttons():
    world = guided([press("admittance"), hold(0.3), press("gripper", 0.4), press("mode", 0.004)], reaction=0.2)
    fake = panel(world, presses={"priority": [[0.5, 0.7]]})
    rows, raw = [], []
    for k in range(600):
        world.advance((k + 1) * 5 * MS)
        fake.read(world.time)
        rows.append(fake.state_arrays["buttons"].copy())
        raw.append([fake.button(i) for i in range(4)])
    down = np.array(rows).sum(axis=0) * 0.005
    assert down == pytest.approx([0.2, 0.0, 0.4, 0.2], abs=0.012)  # 4 ms of `mode` is a bounce
    first = np.array(rows).argmax(axis=0)[[0, 2]] * 0.005
    seen = np.array(raw).argmax(axis=0)[[0, 2]] * 0.005
    assert first - seen == pytest.approx([0.02, 0.02], abs=0.006)  # debounced


def test_a_button_the_board_hasnt_or_a_person_the_world_hasnt_is_refused():
    world = guided([press("grip")])
    with pytest.raises(WiringError, match="presses 'grip'"):
        panel(world)
    with pytest.raises(WiringError, match="no person 'someone'"):
        panel(world, person="someone")
    with pytest.raises(WiringError, match="no person 'robot'"):
        panel(world, person="robot")
