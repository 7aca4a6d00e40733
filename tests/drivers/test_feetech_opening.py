"""Opening a Feetech bus: who is there, what is refused and how, and that nothing is kept or moved."""

import pytest
from helpers.feetech import FeetechRig, config, make_twin
from helpers.twin import Bench, bound

from srl.drivers.feetech import Feetech, opening
from srl.drivers.servo_bus import asking
from srl.runtime.contracts.errors import DeviceError


def refusal(twin, **options):
    with Bench(twin) as bench:
        base = twin.bus.config.model_dump() | {"port": twin.address} | options
        driver = bound(Feetech("bus", type(twin.bus.config).model_validate(base)))
        with bench.running(frozen=True), pytest.raises(DeviceError) as caught:
            driver.open()
        assert not driver.health.connected
        return caught.value


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(asking, "ANSWER", 0.03)
    monkeypatch.setattr(opening, "SCAN", 0.05)


def test_opening_moves_nothing_and_writes_nothing_that_is_kept():
    twin = make_twin()
    kept = [bytes(servo.kept) for servo in twin.servos]
    with FeetechRig(twin) as rig:
        assert [bytes(servo.kept) for servo in twin.servos] == kept
        assert rig.torque == [False, False]
        assert rig.goals == [2048, 2048]
        assert [servo.get("return_delay_time") for servo in twin.servos] == [0, 0]
        assert rig.driver.health.message == "firmware 3.10"


def test_an_open_lock_is_closed_before_anything_is_set():
    twin = make_twin()
    for servo in twin.servos:
        servo.put("lock", 0)
        servo.keep("status_return_level", 0)
    kept = [bytes(servo.kept) for servo in twin.servos]
    with FeetechRig(twin):
        assert [servo.get("lock") for servo in twin.servos] == [1, 1]
        assert [servo.get("status_return_level") for servo in twin.servos] == [1, 1]
        assert [bytes(servo.kept) for servo in twin.servos] == kept
        for servo in twin.servos:
            servo.restart()
        assert [servo.get("return_delay_time") for servo in twin.servos] == [250, 250]


def test_servos_that_hold_go_on_holding():
    with FeetechRig(make_twin()) as rig:
        where = rig.hold()
        rig.driver.close()
        rig.open()
        assert rig.torque == [True, True]
        rig.run(5, where)
        assert rig.fault == ""


def test_a_wrong_model_is_refused():
    twin = make_twin()
    twin.servos[0].keep("model_number", 777)
    error = refusal(twin)
    assert "'shoulder' (id 1) is STS3215 (model number 777), the profile says STS3250" in error.problem
    twin = make_twin()
    twin.servos[0].memory[3:5] = (1284).to_bytes(2, "big")  # an SCS has the high byte first
    error = refusal(twin)
    assert "is SCS0009 (model number 1284)" in error.problem
    assert "no sync read" in error.remedy


def test_swapped_ids_of_one_model_are_refused_by_their_offsets():
    motors = {"one": {"model": "STS3215", "offset": -85}, "two": {"model": "STS3215", "offset": 300}}
    twin = make_twin(motors)
    twin.servos[0].keep("id", 2)
    twin.servos[1].keep("id", 1)
    error = refusal(twin)
    assert "'one' (id 1) has a homing offset of 300, the profile says -85" in error.problem


def test_two_servos_with_one_id():
    twin = make_twin()
    twin.twice.add(1)
    error = refusal(twin)
    assert "'shoulder' (id 1) answers with garbled bytes" in error.problem
    assert "all new ones have id 1" in error.remedy


def test_one_of_several_is_missing(quick):
    twin = make_twin()
    twin.servos[1].keep("id", 9)
    error = refusal(twin)
    assert error.problem == "'elbow' (id 2) doesn't answer; 1 do; servos the profile doesn't name answer as 9"


def test_another_baud_rate_is_found(quick):
    twin = make_twin()
    for servo in twin.servos:
        servo.keep("baud_rate", 4)
    error = refusal(twin)
    assert "with 115200 baud there are: 1, 2" in error.problem
    assert error.remedy == "Set 'baudrate: 115200'"


def test_silence_says_what_was_tried(quick):
    twin = make_twin()
    twin.muted = True
    assert "nor at 115200, 500000, 250000, 128000" in refusal(twin).problem


def test_an_adapter_that_echoes_is_refused():
    twin = make_twin()
    twin.echo = True
    assert "returns the host's own bytes" in refusal(twin).problem


@pytest.mark.parametrize(
    ("register", "value", "words"),
    [
        ("operating_mode", 1, "has operating mode 1, expected 0"),
        ("phase", 28, "counts several turns (phase) with position limits 0 to 4095, which doesn't fit mode 'position'"),
        ("max_position_limit", 0, "counts one turn (phase) with position limits 0 to 0"),
        ("min_position_limit", 4095, "the position limits of 'shoulder' (id 1), 4095 to 4095, leave no room"),
    ],
)
def test_a_servo_that_is_set_up_otherwise_is_refused(register, value, words):
    twin = make_twin()
    twin.servos[0].keep(register, value)
    error = refusal(twin)
    assert words in error.problem
    assert twin.servos[0].get(register) == value


def test_one_turn_isnt_taken_for_several():
    assert "doesn't fit mode 'extended'" in refusal(make_twin(), mode="extended").problem


def test_a_setting_that_isnt_taken_is_an_error():
    twin = make_twin()
    write = twin.servos[0].write
    twin.servos[0].write = lambda address, data: None if address == 7 else write(address, data)
    assert "doesn't take its return delay time (0)" in refusal(twin).problem


def test_limits_are_the_narrower_ones():
    motors = {"one": {"model": "STS3215", "lower": -1.0, "upper": 9.0}}
    with FeetechRig(make_twin(motors)) as rig:
        limits = rig.driver.limits["position_command"]
        assert limits.lower == pytest.approx([-1.0])
        assert limits.upper == pytest.approx([2047 * 2 * 3.141592653589793 / 4096])
        assert limits.velocity == pytest.approx([4.71], abs=0.01)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"baudrate": 57600}, "no servo has a baud rate of 57600"),
        ({"motors": {"a": {"id": 1, "model": "STS3215"}, "b": {"id": 1, "model": "STS3215"}}}, "used twice"),
        ({"motors": {"a": {"id": 1, "model": "SCS0009"}}}, "STS3215"),
        ({"motors": {"a": {"id": 253, "model": "STS3215"}}}, "252"),
        ({"motors": {"a": {"id": 1, "model": "STS3215", "zero": float("nan")}}}, "finite"),
        ({"motors": {"a": {"id": 1, "model": "STS3215", "offset": 3000}}}, "2047"),
        ({"mode": "velocity"}, "extended"),
    ],
)
def test_wrong_profiles_are_refused(options, words):
    with pytest.raises(ValueError, match=words):
        config(**options)


def test_error_bits_at_opening_are_told():
    twin = make_twin()
    twin.bus.chain.motors.errors[1] = 32
    with FeetechRig(twin) as rig:
        assert "elbow: overload" in rig.fault


def test_mixed_firmware_is_told():
    twin = make_twin()
    twin.servos[0].keep("firmware_minor", 9)
    with FeetechRig(twin) as rig:
        assert "firmware 3.10, 3.9 (mixed" in rig.driver.health.message


def test_limits_without_room_are_refused():
    error = refusal(make_twin({"one": {"model": "STS3215", "lower": 4.0, "upper": 5.0}}))
    assert "the limits of 'one' leave no room: 4 to 3.14" in error.problem
