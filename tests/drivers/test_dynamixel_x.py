"""X servos: their profile, their units on the wire, and the effort that `current-position` allows."""

import re
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.dynamixel import PRESSING, Rig, X, cell, config, make_twin
from pydantic import ValidationError

from srl.drivers.dynamixel.family import Family2, family
from srl.drivers.dynamixel.models import BY_NUMBER, MODELS
from srl.drivers.dynamixel.table import CURRENT_POSITION
from srl.runtime.cli import main
from srl.runtime.contracts.errors import DeviceError
from srl.runtime.contracts.signals import Kind

RPM = 2 * pi / 60
# An XL330-M288 (id 1) and an XM430-W350 (id 2): stall torque over stall current, N m/A.
PAIR = {"a": {"model": "XL330-M288", "effort": 0.1}, "b": {"model": "XM430-W350", "effort": 1.0}}
XL330, XM430 = 0.52 / 1.47, 4.1 / 2.3


def of(model: str, **options: Any) -> dict[str, dict[str, Any]]:
    return {"one": {"model": model} | options}


# -- the profile


@pytest.mark.parametrize(
    ("motors", "options", "complaint"),
    [
        (of("XM430-W350"), {"protocol": 1}, "one: the driver talks to an XM430-W350 in protocol 2 only. Set 'protocol"),
        (of("XL430-W250"), {"mode": "effort"}, "one: XL430-W250 has no current control, which mode 'effort' needs"),
        (of("2XC430-W250", effort=0.1), {"mode": "current-position"}, "Choose position, extended, velocity, or an"),
        (of("MX-28", effort=0.1), {"mode": "current-position"}, "MX-28 has no current control"),
        (of("MX-64", effort=0.1), {"mode": "current-position", "protocol": 1}, "'current-position' is for protocol 2"),
        (of("XM430-W350"), {"mode": "current-position"}, "needs 'effort'. Set up to 5.72"),
        (of("XM430-W350", effort=6.0), {"mode": "current-position"}, "can't bound its effort to 6. Set 0.0048 to 5.72"),
        (of("XM430-W350", effort=1e-3), {"mode": "current-position"}, "can't bound its effort to 0.001"),
        (of("XM430-W350", effort=1.0), {}, "'effort' bounds mode 'current-position', this is 'position'"),
        (of("XL330-M288"), {"baudrate": 4_500_000}, "no baud rate of 4500000. Set at most 4000000 in all servos"),
        (of("XM430-W530"), {}, "knows no servo 'XM430-W530'. Did you mean 'XM430-W350'"),
        (of("XL-320"), {}, "knows no servo 'XL-320'"),
        (of("XM430-W350", offset=1_044_480), {"mode": "extended"}, "1044479"),
    ],
)
def test_what_a_model_cannot_do_is_refused_with_the_remedy(motors: Any, options: Any, complaint: str) -> None:
    with pytest.raises(ValidationError) as caught:
        config(motors, **options)
    assert complaint in str(caught.value)


LEAST = f"""
name: all
rate: 100
devices:
  arm:
    driver: dynamixel
    port: /dev/ttyUSB0
    motors: {{{", ".join(f"{name}: {{id: {k}, model: {name}}}" for k, name in enumerate(MODELS, 1))}}}
setpoints: {{client.q: {{shape: [{len(MODELS)}], unit: rad, labels: [{", ".join(MODELS)}]}}}}
guard: {{arm.position_command: {{velocity: 1.0, acceleration: 5.0}}}}
controllers:
  - use: joint-setpoint
    joints: [{", ".join(MODELS)}]
    in: {{target: client.q}}
    out: {{q: arm.position_command, q_velocity: arm.position_command.velocity}}
sim:
  world: cell
  parts: {{arm: {{part: dynamixel-chain, axes: {{{", ".join(f"{name}: {{model: {name}}}" for name in MODELS)}}}}}}}
"""


@pytest.mark.parametrize("sim", [[], ["--sim"]])
def test_the_least_profile_of_each_model_passes_the_check(sim: list[str], tmp_path: Any, capsys: Any) -> None:
    path = tmp_path / "all.yaml"
    path.write_text(LEAST)
    assert main(["check", str(path), *sim]) == 0, capsys.readouterr().err


def test_the_page_has_each_models_values() -> None:
    page = (Path(__file__).parents[2] / "docs" / "devices" / "dynamixel.md").read_text()
    rows = dict(re.findall(r"^\| (2?[MX][\w-]+) \| (\d{2,} \|.*) \|$", page, re.M))
    assert list(rows) == list(MODELS)
    for name, m in MODELS.items():
        unit = f"{1e3 * m.current_unit:g} mA" if m.senses_current else "none"
        assert rows[name] == (
            f"{m.number2} | {m.nominal_voltage:g} V | {m.stall_torque:g} N m, {m.stall_current:g} A | "
            f"{m.no_load_speed:.1f} rad/s | {m.torque_constant:.3g} | {unit} | {1e3 * m.mass:g} g"
        )


def test_model_numbers_differ() -> None:
    assert len(BY_NUMBER) == len(MODELS) + 3  # each MX has one for each protocol


# -- units on the wire; the frames are made by hand from the protocol's description


def made(mode: str, **options: Any) -> Family2:
    bus = family(config(PAIR if mode == "current-position" else bare(), mode=mode, **options))
    assert isinstance(bus, Family2)
    return bus


def bare() -> dict[str, dict[str, Any]]:
    return {name: {"model": motor["model"]} for name, motor in PAIR.items()}


def test_golden_frames_of_an_xl330_and_an_xm430() -> None:
    bus = made("current-position")
    wire, registers = bus.wire, bus.tables
    mode, current = registers[0]["operating_mode"], registers[0]["goal_current"]
    assert wire.write(1, mode.address, mode.encode(CURRENT_POSITION)).hex() == "fffffd00010600030b00055ce3"
    # 0.1 N m / (0.52 / 1.47 N m/A) / 1 mA = 282.7, 1 N m / (4.1 / 2.3 N m/A) / 2.69 mA = 208.5
    goals = [current.encode(bus.volatile(i)["goal_current"]) for i in (0, 1)]
    assert wire.write(1, current.address, goals[0]).hex() == "fffffd000107000366001a014e79"
    assert wire.write(2, current.address, goals[1]).hex() == "fffffd00020700036600d0004ef5"
    bus.set_limits([bytes(147)] * 2)
    assert bus.encode(np.array([-2 * pi, pi / 2])).hex() == "fffffd00fe110083740004000100f8ffff02000c00003916"


@pytest.mark.parametrize(
    ("answers", "position", "velocity", "effort"),
    [
        (
            ("fffffd00010e005500fa009cffffff00040000170f", "fffffd00020e0055009cff32000000000c0000e4fa"),
            (-pi / 2, pi / 2), (-22.9 * RPM, 11.45 * RPM), (0.250 * XL330, -0.269 * XM430),
        ),
    ],
)  # fmt: skip
def test_golden_samples_of_an_xl330_and_an_xm430(answers: Any, position: Any, velocity: Any, effort: Any) -> None:
    bus = made("position")
    statuses = bus.parser().statuses(bytes.fromhex("".join(answers)))
    assert [status.id for status in statuses] == [1, 2]
    out = {name: np.zeros(2) for name in ("position", "velocity", "effort")}
    bus.decode(b"".join(status.data for status in statuses), bus.sample[1], out)
    for name, wanted in (("position", position), ("velocity", velocity), ("effort", effort)):
        np.testing.assert_allclose(out[name], wanted, rtol=1e-12)


def test_a_torque_goal_is_in_each_motors_own_current() -> None:
    bus = made("effort")
    bus.set_limits([bytes.fromhex("00" * 38 + "ff07" + "00" * 107)] * 2)
    bus.encode(np.array([0.1, 1.0]))
    assert bus.last.tolist() == [283, 209]


# -- the bus


def test_a_wrong_model_on_the_bus_names_both() -> None:
    wrong = {"shoulder": {"model": "XH430-W350", "id": 1}, "elbow": {"model": "XL330-M288", "id": 2}}
    twin = make_twin(X)
    with pytest.raises(DeviceError) as caught:
        Rig(twin, motors=wrong)
    twin.close()
    assert "'shoulder' (id 1) is XM430-W350 (model number 1020), the profile says XH430-W350" in caught.value.problem


def pressing() -> Rig:
    return Rig(make_twin(PRESSING, cell(PRESSING, upper=8.0), mode="current-position"))


def currents(rig: Rig) -> list[int]:
    return [servo.get("goal_current") for servo in rig.twin.servos]


WANTED = [int(2.0 / XM430 / 2.69e-3), int(0.2 / XL330 / 1e-3)]


def test_the_bound_is_written_when_the_bus_is_opened() -> None:
    with pressing() as rig:
        assert [servo.get("operating_mode") for servo in rig.twin.servos] == [CURRENT_POSITION] * 2
        assert currents(rig) == WANTED
        assert rig.driver.commands[0].kind is Kind.POSITION
        goal = rig.hold() + np.array([2 * pi + 0.3, -0.4])  # more than a turn
        rig.run(200, goal)
        np.testing.assert_allclose(rig.state["position"], goal, atol=0.03)


def test_a_lower_current_limit_of_the_servo_is_respected() -> None:
    twin = make_twin(PRESSING, mode="current-position")
    twin.servos[1].put("current_limit", 100)
    with Rig(twin) as rig:
        assert currents(rig) == [WANTED[0], 100]
        rig.hold()
        assert rig.driver.health.fault == ""


def test_the_bound_is_written_again_after_a_recovery() -> None:
    with pressing() as rig:
        rig.hold()
        rig.twin.bus.chain.motors.fail(1, 32)
        rig.run(30, [0.0, 0.0])
        assert "elbow: overload" in rig.driver.health.fault
        rig.driver.recover(rig.now)
        rig.run(100)
        assert rig.driver.health.fault == ""
        assert currents(rig) == WANTED


def test_the_bound_is_written_again_after_the_watchdog() -> None:
    with pressing() as rig:
        where = rig.hold()
        rig.bench.run(0.5)
        for servo in rig.twin.servos:
            servo.put("goal_current", 0)
        rig.run(5, where)
        assert "the bus watchdog" in rig.driver.health.fault
        rig.driver.recover(rig.now)
        rig.run(5, where)
        assert rig.driver.health.fault == ""
        assert currents(rig) == WANTED
