"""The driver's profile, and what it finds, checks, sets and refuses when it opens a bus."""

from typing import Any

import numpy as np
import pytest
from helpers.dynamixel import THREE, Rig, config, make_twin
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from srl.drivers.dynamixel import Dynamixel, session
from srl.drivers.dynamixel.family import family
from srl.drivers.servo_bus import asking
from srl.drivers.servo_bus.models import CENTRE, PER_COUNT
from srl.runtime.contracts.errors import DeviceError
from srl.runtime.contracts.signals import Kind, Stop

BOTH = pytest.mark.parametrize("protocol", [2, 1])
TWO = {"shoulder": {"model": "MX-106"}, "elbow": {"model": "MX-64"}}


def truth(rig: Rig) -> Any:
    return rig.twin.bus.world.truth_arrays["arm_position"].copy()


def near(found: Any, wanted: Any, atol: Any) -> None:
    """Each within its own tolerance."""
    assert (np.abs(np.asarray(found) - wanted) <= atol).all(), (found, wanted)


def torque(rig: Rig) -> Any:
    return rig.twin.metrics()["torque"]


# -- the profile


@pytest.mark.parametrize(
    ("options", "motors", "complaint"),
    [
        ({"mode": "effort"}, THREE, "slide: MX-28 has no current control, which mode 'effort' needs"),
        ({}, {"a": {"model": "MX-64"}, "b": {"model": "MX-64", "id": 1}}, "id 1 is used twice, by a and b"),
        ({}, {"a": {"model": "MX-64", "home": 0.1}, "b": {"model": "MX-64"}}, "b has no home"),
        ({"baudrate": 123456}, THREE, "no servo of protocol 2 has a baud rate of 123456"),
        ({}, {"a": {"model": "MX-64", "lower": 1.0, "upper": 0.5}}, r"lower \(1\) must be less"),
        ({}, {"a": {"model": "MX-12"}}, "MX-28"),
    ],
)
def test_a_profile_that_can_not_work_is_refused(options, motors, complaint):
    with pytest.raises(ValidationError, match=complaint):
        config(motors, **options)


def test_what_is_declared():
    bus = Dynamixel("bus", config())
    assert [s.name for s in bus.states] == ["position", "velocity", "effort", "temperature", "voltage"]
    (command,) = bus.commands
    assert (command.name, command.kind, command.feedback) == ("position_command", Kind.POSITION, "position")
    assert command.stops == (Stop.HOLD, Stop.LIMP)
    assert command.labels == ("shoulder", "elbow", "slide")
    homed = Dynamixel("bus", config({k: m | {"home": 0.0} for k, m in THREE.items()}))
    assert Stop.RETRACT in homed.commands[0].stops
    np.testing.assert_array_equal(homed.home["position_command"], np.zeros(3))
    effort = Dynamixel("bus", config(TWO, mode="effort"))
    assert effort.commands[0].kind is Kind.TORQUE
    assert effort.commands[0].stops == (Stop.HOLD, Stop.DAMP, Stop.LIMP)
    slide = Dynamixel("bus", config({"s": {"model": "MX-28", "m_per_rad": 0.01}}, mode="velocity"))
    assert (slide.commands[0].unit, slide.states[0].unit) == ("m/s", "m")


@given(
    st.lists(st.floats(-3, 3), min_size=3, max_size=3),
    st.sampled_from([1, 2]),
    st.booleans(),
    st.floats(-1, 1),
)
def test_goals_and_samples_are_inverse_to_each_other_within_a_count(angles, protocol, flipped, zero):
    motors = {k: m | {"reversed": flipped, "zero": zero} for k, m in THREE.items()}
    f = family(config(motors, protocol=protocol, mode="extended"))
    f.low[:], f.high[:] = -28672, 28672
    scale = np.array([-1.0 if flipped else 1.0] * 2 + [-0.01 if flipped else 0.01])
    wanted = np.array(angles) * np.abs(scale)
    f.encode(wanted)
    raw = f.last
    np.testing.assert_allclose(((raw - CENTRE) * PER_COUNT - zero) * scale, wanted, atol=0.51 * PER_COUNT)


# -- opening


@BOTH
def test_opening_moves_nothing_lets_nothing_go_and_sets_what_must_be_set(protocol):
    with Rig(make_twin(protocol=protocol)) as rig:
        assert torque(rig) == [False] * 3
        assert [s.get("return_delay_time") for s in rig.twin.servos] == [0, 0, 0]
        if protocol == 2:
            assert [s.get("bus_watchdog") for s in rig.twin.servos] == [5, 5, 5]
        limits = rig.driver.limits["position_command"]
        assert limits.lower[0] == pytest.approx(-np.pi)
        assert limits.upper[2] == pytest.approx(np.pi * 0.01, abs=1e-4)
        assert limits.velocity[0] == pytest.approx(4.712, abs=1e-3)
        assert rig.driver.fileno() is not None
        rig.start()
        assert np.isfinite(rig.state["temperature"]).all()
        np.testing.assert_allclose(rig.state["voltage"], 12.0)
        rig.run(20)
        assert torque(rig) == [False] * 3
        assert rig.driver.health.errors == 0


def refusal(twin, **options) -> DeviceError:
    with pytest.raises(DeviceError) as caught:
        Rig(twin, **options)
    twin.close()
    assert caught.value.remedy
    return caught.value


def test_another_model_is_named():
    other = {"shoulder": {"model": "MX-106", "id": 1}, "elbow": {"model": "MX-106", "id": 2}}
    error = refusal(make_twin(TWO), motors=other)
    assert "'elbow' (id 2) is MX-64 (model number 311), the profile says MX-106" in error.problem


def test_a_missing_motor_is_named_with_those_that_are_there():
    twin = make_twin()
    twin.absent = {2}
    assert "'elbow' (id 2) doesn't answer; 1, 3 do" in refusal(twin).problem


def test_a_stranger_on_the_bus_is_named():
    twin = make_twin(TWO)
    wrong = {"shoulder": {"model": "MX-106", "id": 1}, "elbow": {"model": "MX-64", "id": 9}}
    assert "servos the profile doesn't name answer as 2" in refusal(twin, motors=wrong).problem


@BOTH
def test_two_servos_with_one_id_are_suspected(protocol):
    twin = make_twin(protocol=protocol)
    twin.twice = {2}
    error = refusal(twin)
    assert "'elbow' (id 2) answers with garbled bytes" in error.problem
    assert "the same id" in error.remedy


def test_an_adapter_s_echo_is_skipped_in_protocol_2_and_refused_in_protocol_1():
    twin = make_twin()
    twin.echo = True
    with Rig(twin) as rig:
        where = rig.hold()
        rig.run(60, where + np.array([0.2, 0.0, 0.0]))
        assert rig.state["position"][0] == pytest.approx(0.2, abs=0.01)
        assert rig.driver.health.errors == 0
    twin = make_twin(protocol=1)
    twin.echo = True
    assert "returns the host's own bytes" in refusal(twin).problem


def test_another_baud_rate_and_protocol_are_found(monkeypatch):
    monkeypatch.setattr(asking, "ANSWER", 0.03)
    error = refusal(make_twin(), baudrate=57600)
    assert "with 1000000 baud and protocol 2 there are: 1 (MX-106 (model number 321)), 2" in error.problem
    assert error.remedy == "Set 'baudrate: 1000000'"
    error = refusal(make_twin(protocol=1), protocol=2)
    assert error.remedy == "Set 'protocol: 1'"
    error = refusal(make_twin(protocol=1, baudrate=57600), protocol=2, baudrate=1_000_000)
    assert error.remedy == "Set 'baudrate: 57600' and 'protocol: 1'"


def test_silence_says_what_was_tried(monkeypatch):
    monkeypatch.setattr(asking, "ANSWER", 0.03)
    monkeypatch.setattr(session, "SCAN", 0.03)
    twin = make_twin()
    twin.muted = True
    assert "nor at 1000000, 57600" in refusal(twin).problem


def test_a_servo_that_only_answers_pings_is_made_to_speak():
    twin = make_twin()
    twin.servos[1].put("status_return_level", 0)
    with Rig(twin) as rig:
        rig.start()
        assert twin.servos[1].get("status_return_level") == 2


def test_an_operating_mode_is_not_changed_under_torque_or_against_the_profile():
    twin = make_twin(TWO)
    assert (
        "operating mode of 'shoulder' (id 1) is 3, the profile needs 1"
        in refusal(twin, mode="velocity", configure=False).problem
    )
    twin = make_twin(TWO)
    for servo in twin.servos:
        servo.motors.switch(servo.i, True)
    error = refusal(twin, mode="velocity")
    assert "its torque is on" in error.problem
    assert "Support the limb" in error.remedy


def test_joint_limits_of_protocol_1_are_not_overwritten():
    twin = make_twin(TWO, protocol=1)
    twin.servos[0].put("cw_angle_limit", 1000)
    assert "angle limits 1000 to 4095, which mode 'velocity' would overwrite" in refusal(twin, mode="velocity").problem


def test_the_servos_own_position_limits_bound_the_command():
    twin = make_twin(TWO)
    twin.servos[0].put("min_position_limit", 1024)
    twin.servos[0].put("max_position_limit", 3072)
    reversed_first = {"shoulder": {"model": "MX-106", "id": 1, "reversed": True}, "elbow": {"model": "MX-64", "id": 2}}
    with Rig(twin, motors=reversed_first) as rig:
        limits = rig.driver.limits["position_command"]
        np.testing.assert_allclose([limits.lower[0], limits.upper[0]], [-np.pi / 2, np.pi / 2])


@BOTH
def test_position_limits_without_room_are_refused(protocol):
    twin = make_twin(protocol=protocol)
    low, high = ("min_position_limit", "max_position_limit") if protocol == 2 else ("cw_angle_limit", "ccw_angle_limit")
    twin.servos[1].put(low, 3000)
    twin.servos[1].put(high, 1000)
    with pytest.raises(DeviceError, match=r"'elbow' \(id 2\), 3000 to 1000, leave no room"):
        Rig(twin)
    twin.close()
