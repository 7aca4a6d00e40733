"""What an earlier user left in a Feetech servo's memory: it equals what the profile says, or the bus isn't opened."""

from typing import Any

import numpy as np
import pytest
from helpers.feetech import TWO, FeetechRig, make_twin

from srl.drivers.servo_bus.models import PER_COUNT
from srl.runtime.contracts.errors import DeviceError

FIRST = "'shoulder' (id 1)"
# Bits of the phase, by the maker's memory table; a servo comes with SPEED_UNIT and FREE.
DRIVEN_BACK, SPEED_UNIT, FREE, SEVERAL_TURNS, COUNTS_BACK = 1, 4, 8, 16, 128
USUAL = SPEED_UNIT | FREE


def motors(**first: Any) -> dict[str, dict[str, Any]]:
    """A profile's two motors, the first with more options."""
    return {"shoulder": TWO["shoulder"] | {"id": 1} | first, "elbow": TWO["elbow"] | {"id": 2}}


def left(registers: dict[str, int], **options: Any) -> Any:
    """The twin of a bus whose first servo has kept these registers since before it was switched on."""
    twin = make_twin(TWO, **options)
    for name, value in registers.items():
        twin.servos[0].keep(name, value)
    twin.servos[0].restart()
    return twin


def refusal(twin: Any, **options: Any) -> DeviceError:
    """The error of opening, which has kept nothing in any servo and switched no torque."""
    kept, before = [bytes(servo.kept) for servo in twin.servos], twin.metrics()["torque"]
    try:
        with pytest.raises(DeviceError) as caught:
            FeetechRig(twin, **options)
        assert [bytes(servo.kept) for servo in twin.servos] == kept
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


@pytest.mark.parametrize("offset", [300, -1, 2047, -2047])
@pytest.mark.parametrize("mode", ["position", "extended"])
def test_an_offset_of_which_the_profile_says_nothing_is_refused(offset: int, mode: str) -> None:
    error = refusal(left({"homing_offset": offset}, mode=mode))
    says(error, "homing offset", offset)
    assert "offset" in error.remedy  # the key that says it is meant


def test_each_servo_is_looked_at() -> None:
    twin = make_twin()
    twin.servos[1].keep("homing_offset", 300)
    assert "'elbow' (id 2) has a homing offset of 300" in refusal(twin).problem


def test_an_offset_that_the_profile_says_must_be_in_the_servo() -> None:
    says(refusal(left({}), motors=motors(offset=300)), "homing offset", 0)
    says(refusal(left({"homing_offset": 299}), motors=motors(offset=300)), "homing offset", 299)
    says(refusal(left({"homing_offset": 300}), motors=motors(offset=0)), "homing offset", 300)


def test_a_servo_that_holds_goes_on_holding_when_it_is_refused() -> None:
    twin = left({"homing_offset": 300})
    for servo in twin.servos:
        servo.motors.switch(servo.i, True)
    says(refusal(twin), "homing offset", 300)
    assert twin.metrics()["torque"] == [True, True]


@pytest.mark.parametrize("bit", [DRIVEN_BACK, SPEED_UNIT, FREE, COUNTS_BACK])
@pytest.mark.parametrize("mode", ["position", "extended"])
def test_a_phase_that_turns_directions_or_units_is_refused(bit: int, mode: str) -> None:
    phase = (USUAL | (SEVERAL_TURNS if mode == "extended" else 0)) ^ bit
    says(refusal(left({"phase": phase}, mode=mode)), "phase", phase)


@pytest.mark.parametrize("bit", [2, 32, 64])
def test_bits_of_the_phase_that_are_the_hardware_s_own_are_left_alone(bit: int) -> None:
    with FeetechRig(left({"phase": USUAL | bit})) as rig:
        rig.start()
        assert rig.fault == ""


def test_a_servo_without_any_torque_is_refused() -> None:
    says(refusal(left({"max_torque": 0})), "torque", 0)
    twin = left({})
    twin.servos[0].put("torque_limit", 0)
    says(refusal(twin), "torque limit", 0)


def test_an_offset_that_the_profile_says_is_counted() -> None:
    output = motors(offset=300, zero=-300 * PER_COUNT)
    with FeetechRig(left({"homing_offset": 300}), motors=output) as rig:
        where = rig.hold()
        np.testing.assert_allclose(rig.state["position"], rig.truth(), atol=0.005)
        rig.run(35, where + np.array([0.2, 0.0]))
        np.testing.assert_allclose(rig.truth(), where + np.array([0.2, 0.0]), atol=0.02)


def test_a_twin_of_a_profile_with_an_offset_stands_where_its_limb_stands() -> None:
    with FeetechRig(make_twin(motors(offset=-85))) as rig:
        rig.start()
        assert rig.twin.servos[0].get("homing_offset") == -85
        np.testing.assert_allclose(rig.state["position"], rig.truth(), atol=0.005)
