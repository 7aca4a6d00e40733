"""X servos in the simulated world: each with its own torque, speed and supply, and pressing no more than allowed."""

import numpy as np
import pytest
from helpers.dynamixel import MS, Rig, cell, config, make_twin
from helpers.sim import bind

from srl.drivers.dynamixel.models import MODELS
from srl.drivers.dynamixel.table import table2
from srl.sim.devices.dynamixel.fake import FakeDynamixel
from srl.sim.parts.dynamixel.motors import DynamixelMotors

ALL = {name: {"model": name} for name in MODELS}
WALL = 0.2  # rad
BOUND = {"XL330-M288": 0.15, "XM430-W350": 1.0}


def motors(models: list[str]) -> DynamixelMotors:
    chosen = [MODELS[name] for name in models]
    return DynamixelMotors(chosen, np.array([model.nominal_voltage for model in chosen]), 1e-3)


def test_each_gives_its_stall_torque_and_turns_at_its_speed_at_its_own_supply() -> None:
    made = motors(list(MODELS))
    made.torque[:], made.mode[:], made.goal_pwm[:] = 1.0, 16, 1.0
    np.testing.assert_allclose(made.step(), [model.stall_torque for model in MODELS.values()])
    np.testing.assert_allclose(made.current, [model.stall_current for model in MODELS.values()])
    made.velocity[:] = [model.no_load_speed for model in MODELS.values()]
    np.testing.assert_allclose(made.step() - made.drag * made.velocity, 0.0, atol=1e-12)


def test_a_lower_supply_weakens_it() -> None:
    made = DynamixelMotors([MODELS["XL330-M288"]], 3.7, 1e-3)
    made.torque[:], made.mode[:], made.goal_pwm[:] = 1.0, 16, 1.0
    np.testing.assert_allclose(made.step(), 0.52 * 3.7 / 5.0)


def test_each_begins_with_its_tables_defaults() -> None:
    made = motors(list(MODELS))
    twin = make_twin(ALL)
    for i, (model, servo) in enumerate(zip(MODELS.values(), twin.servos, strict=True)):
        table = table2(model)
        assert made.temperature_limit[i] == servo.get("temperature_limit") == table["temperature_limit"].default
        assert made.shutdown[i] == servo.get("shutdown")
        for gain in ("kp", "ki", "kd", "velocity_kp", "velocity_ki"):
            assert getattr(made, gain)[i] == getattr(servo.motors, gain)[i]
        servo.refresh()
        assert servo.get("present_input_voltage") == round(10 * model.nominal_voltage)
    twin.close()


def against_the_wall(model: str, mode: str, effort: float | None = None) -> tuple[float, float]:
    """The greatest torque of the motor, and what the wall bears in the end, N m."""
    world = cell({"one": {"model": model}}, upper=WALL)
    given = {"one": {"model": model} | ({} if effort is None else {"effort": effort})}
    fake = FakeDynamixel("bus", config(given, mode=mode), world, FakeDynamixel.Options())
    bind(fake)
    fake.open()
    most = 0.0
    for k in range(250):
        fake.read(world.time)
        if fake.health.stamp >= 0:
            fake.command_arrays["position_command"][:] = min(0.01 * max(k - 10, 0), WALL + 0.6)
            fake.write(world.time)
        world.advance(world.time + 10 * MS)
        most = max(most, abs(world.truth_arrays["arm_effort"][0]))
    chain = fake.chain
    assert world.truth_arrays["arm_position"][0] == pytest.approx(WALL, abs=0.02)
    return most, float(-chain._data.qfrc_constraint[chain._v[0]])


@pytest.mark.parametrize("model", BOUND)
def test_against_a_wall_it_presses_with_no_more_than_its_effort(model: str) -> None:
    effort, friction = BOUND[model], 0.02 * MODELS[model].stall_torque
    most, borne = against_the_wall(model, "current-position", effort)
    assert most <= effort
    assert 0.8 * effort < borne <= effort + friction
    assert against_the_wall(model, "position")[0] > 1.5 * effort


def test_the_twin_presses_no_more_either() -> None:
    given = {"one": {"model": "XL330-M288", "effort": 0.15}}
    world = cell({"one": {"model": "XL330-M288"}}, upper=WALL)
    with Rig(make_twin(given, world=world, mode="current-position")) as rig:
        rig.hold()
        most = 0.0
        for k in range(120):
            rig.cycle([min(0.01 * k, WALL + 0.6)])
            most = max(most, abs(world.truth_arrays["arm_effort"][0]))
        assert 0.12 < most <= 0.15
        assert rig.state["effort"][0] == pytest.approx(most, rel=0.02)


def test_after_a_reboot_it_is_bounded_again() -> None:
    given = {"one": {"model": "XM430-W350", "effort": 1.0}}
    world = cell({"one": {"model": "XM430-W350"}})
    fake = FakeDynamixel("bus", config(given, mode="current-position"), world, FakeDynamixel.Options())
    bind(fake)
    fake.open()
    bound = fake.motors.goal_current[0]
    fake.motors.fail(0, 32)
    fake.read(0)
    fake.recover(0)
    fake.world.advance(400 * MS)
    fake.read(400 * MS)
    assert fake.health.fault == ""
    assert fake.motors.goal_current[0] == bound == pytest.approx(1.0 / MODELS["XM430-W350"].torque_constant, rel=0.01)
