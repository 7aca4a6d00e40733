"""What an earlier user left in a servo's memory: it equals what the profile says, or the bus isn't opened."""

from typing import Any

import numpy as np
import pytest
from helpers.dynamixel import TWO, Rig, config, make_twin, near, torque, truth
from pydantic import ValidationError

from srl.drivers.servo_bus.models import PER_COUNT
from srl.runtime.contracts.errors import DeviceError

REVERSE, SLAVE, TIMED, TORQUE_BY_GOAL, UNKNOWN = 1, 2, 4, 8, 64  # bits of the drive mode
FIRST = "'shoulder' (id 1)"
HELD = {1: 24, 2: 64}  # bytes that a servo keeps without power, by protocol


def motors(**first: Any) -> dict[str, dict[str, Any]]:
    """A profile's two motors, the first with more options."""
    return {"shoulder": TWO["shoulder"] | {"id": 1} | first, "elbow": TWO["elbow"] | {"id": 2}}


def left(registers: dict[str, int], protocol: int = 2, **options: Any) -> Any:
    """The twin of a bus whose first servo has these registers since before it was switched on."""
    twin = make_twin(TWO, protocol=protocol, **options)
    for name, value in registers.items():
        twin.servos[0].put(name, value)
    twin.servos[0].restart()
    return twin


def refusal(twin: Any, **options: Any) -> DeviceError:
    """The error of opening, which has set nothing in the first servo and switched no torque."""
    size, before = HELD[twin.protocol], twin.metrics()["torque"]
    held = bytes(twin.servos[0].memory[:size])
    try:
        with pytest.raises(DeviceError) as caught:
            Rig(twin, **options)
        assert bytes(twin.servos[0].memory[:size]) == held
        assert twin.metrics()["torque"] == before
    finally:
        twin.close()
    return caught.value


def says(error: DeviceError, register: str, value: int) -> None:
    """It names the servo, the register and what is in it, and what to do."""
    assert FIRST in error.problem
    assert register in error.problem.lower()
    assert str(value) in error.problem
    assert error.remedy


@pytest.mark.parametrize(
    ("register", "value", "mode"),
    [
        ("homing_offset", 1000, "position"),
        ("homing_offset", -1, "position"),
        ("homing_offset", 40960, "position"),
        ("homing_offset", 4096, "extended"),
        ("homing_offset", 1000, "velocity"),
        ("drive_mode", REVERSE, "position"),
        ("drive_mode", REVERSE, "effort"),
        ("drive_mode", TIMED, "position"),
        ("drive_mode", TORQUE_BY_GOAL, "position"),
        ("drive_mode", UNKNOWN, "position"),
        ("drive_mode", TIMED | REVERSE, "extended"),
        ("secondary_id", 2, "position"),
        ("pwm_limit", 0, "position"),
        ("velocity_limit", 0, "position"),
        ("velocity_limit", 0, "velocity"),
        ("current_limit", 0, "effort"),
        ("current_limit", 0, "position"),
    ],
)
def test_what_the_profile_does_not_say_is_refused(register: str, value: int, mode: str) -> None:
    twin = left({register: value}, mode=mode)
    says(refusal(twin), register.replace("_", " "), value)


@pytest.mark.parametrize(
    ("register", "value"),
    [
        ("drive_mode", REVERSE),
        ("drive_mode", SLAVE),
        ("max_torque", 0),
        ("multi_turn_offset", 100),
        ("resolution_divider", 2),
    ],
)
@pytest.mark.parametrize("mode", ["position", "extended"])
def test_the_same_holds_for_the_first_firmware(register: str, value: int, mode: str) -> None:
    twin = left({register: value}, protocol=1, mode=mode)
    says(refusal(twin), register.replace("_", " "), value)


def test_two_leftovers_that_hide_each_other_are_refused() -> None:
    error = refusal(left({"homing_offset": 1000, "drive_mode": REVERSE}))
    assert "homing offset" in error.problem or "drive mode" in error.problem
    turned = motors(reversed=True, zero=1000 * PER_COUNT)  # as a person corrects it, who sees only the axis
    assert refusal(left({"homing_offset": 1000, "drive_mode": REVERSE}), motors=turned).remedy


def test_a_servo_that_holds_goes_on_holding_when_it_is_refused() -> None:
    twin = left({"homing_offset": 1000})
    for servo in twin.servos:
        servo.motors.switch(servo.i, True)
    says(refusal(twin), "homing offset", 1000)
    assert twin.metrics()["torque"] == [True, True]


def test_several_turns_under_torque_are_refused_where_the_profile_wants_one() -> None:
    twin = left({"operating_mode": 4})
    twin.servos[0].motors.switch(twin.servos[0].i, True)
    says(refusal(twin), "operating mode", 4)
    says(refusal(left({"operating_mode": 4}), configure=False), "operating mode", 4)


def test_a_group_that_is_none_of_this_bus_is_left_alone() -> None:
    for harmless in (200, 255, 1):  # its own id is obeyed as such
        with Rig(left({"secondary_id": harmless})) as rig:
            rig.start()
            assert rig.driver.health.fault == ""


def _moved(rig: Rig) -> None:
    """Position and limb agree before and after a command, and the limb goes where it was told to."""
    where = rig.hold()
    near(rig.state["position"], truth(rig), 0.005)
    rig.run(35, where + np.array([0.2, -0.1]))
    near(rig.state["position"], truth(rig), 0.01)
    near(truth(rig), where + np.array([0.2, -0.1]), 0.02)
    assert torque(rig) == [True, True]


@pytest.mark.parametrize("mode", ["position", "extended"])
def test_an_offset_that_the_profile_says_is_counted(mode: str) -> None:
    output = motors(offset=1000, zero=1000 * PER_COUNT)
    with Rig(left({"homing_offset": 1000}, mode=mode), motors=output) as rig:
        _moved(rig)


def test_a_reverse_mode_that_the_profile_says_is_counted() -> None:
    with Rig(left({"drive_mode": REVERSE}), motors=motors(reverse_mode=True, reversed=True)) as rig:
        _moved(rig)


def test_both_said_are_counted() -> None:
    output = motors(offset=1000, reverse_mode=True, reversed=True, zero=1000 * PER_COUNT)
    with Rig(left({"homing_offset": 1000, "drive_mode": REVERSE}), motors=output) as rig:
        _moved(rig)


@pytest.mark.parametrize(
    ("output", "registers", "words", "value"),
    [
        ({"offset": 1000}, {}, "homing offset", 0),
        ({"offset": 1000}, {"homing_offset": 999}, "homing offset", 999),
        ({"offset": 1000}, {"homing_offset": 1000, "drive_mode": REVERSE}, "drive mode", REVERSE),
        ({"reverse_mode": True}, {}, "drive mode", 0),
        ({"reverse_mode": True}, {"drive_mode": REVERSE, "homing_offset": 5}, "homing offset", 5),
        ({"reverse_mode": True}, {"drive_mode": REVERSE | TIMED}, "drive mode", REVERSE | TIMED),
    ],
)
def test_what_the_profile_says_must_be_in_the_servo(
    output: dict[str, Any], registers: dict[str, int], words: str, value: int
) -> None:
    says(refusal(left(registers), motors=motors(**output)), words, value)


@pytest.mark.parametrize(
    ("output", "options"),
    [
        ({"offset": 1025}, {"mode": "position"}),  # over one turn a servo ignores it
        ({"offset": 1_044_480}, {"mode": "extended"}),
        ({"offset": 100}, {"protocol": 1}),
    ],
)
def test_an_offset_that_no_servo_applies_is_no_profile(output: dict[str, Any], options: dict[str, Any]) -> None:
    with pytest.raises(ValidationError, match="offset") as caught:
        config(motors(**output), **options)
    assert "extra" not in str(caught.value).lower()


def test_a_twin_has_in_its_memory_what_its_profile_says() -> None:
    with Rig(make_twin(motors(offset=-300, reverse_mode=True))) as rig:
        assert rig.twin.servos[0].get("homing_offset") == -300
        assert rig.twin.servos[0].get("drive_mode") == REVERSE
        _moved(rig)
