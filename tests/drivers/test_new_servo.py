"""Servos as they come from their box, all with id 1, are set up to a working arm, one after another."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers import dynamixel, feetech
from helpers.run import refused
from helpers.twin import Bench

from srl.drivers.dynamixel.new_servo import NewDynamixel
from srl.drivers.feetech.new_servo import NewFeetech
from srl.drivers.servo_bus import new_servo
from srl.drivers.servo_bus.new_servo import Found, NewServo
from srl.runtime.cli import main
from srl.runtime.contracts.errors import DeviceError
from srl.runtime.profile import profile

SIX = {f"joint_{k}": {"model": "XL330-M288", "lower": -1.0, "upper": 1.5} for k in range(1, 7)}
STS = {f"joint_{k}": {"model": "STS3215", "lower": -1.0, "upper": 1.5} for k in range(1, 7)}
MX = {"shoulder": {"model": "MX-64"}, "elbow": {"model": "MX-28"}}
FEETECH_AT_115200 = 4


class Bag:
    """Six new servos, of which some are plugged in, and what sets them up."""

    def __init__(self, twin: Any, setter: type[NewServo], family: str) -> None:
        self.twin, self.family, self.bench = twin, family, Bench(twin)
        self.config = twin.bus.config.model_copy(update={"port": twin.address})
        self.setter = setter(self.config, "arm")
        for servo in twin.servos:
            put = servo.keep if family == "feetech" else servo.put
            put("id", 1)
            put("return_delay_time", 250)
            if family == "dynamixel":
                put("baud_rate", 1)  # 57600
        twin.plugged = set()

    def plug(self, *numbers: int) -> None:
        self.twin.plugged = set(numbers)

    def find(self) -> Found:
        with self.bench.running(frozen=True):
            return self.setter.find()

    def give(self, name: str, limits: bool = False) -> list[str]:
        with self.bench.running(frozen=True):
            return [change.what for change in self.setter.give(name, self.setter.find(), limits)]

    def ids(self) -> list[int]:
        return [servo.get("id") for servo in self.twin.servos]


@pytest.fixture(params=["dynamixel", "feetech"])
def bag(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bag]:
    monkeypatch.setattr(new_servo, "LISTEN", 0.04)
    if request.param == "dynamixel":
        made = Bag(dynamixel.make_twin(SIX), NewDynamixel, "dynamixel")
    else:
        made = Bag(feetech.make_twin(STS), NewFeetech, "feetech")
    yield made
    made.twin.close()


def test_a_bag_of_new_servos_becomes_an_arm(bag: Bag) -> None:
    before = bag.twin.bus.chain.motors.counts.copy()
    for k, name in enumerate(bag.config.motors):
        bag.plug(k)
        changed = bag.give(name)
        assert "return_delay_time" in changed
        assert ("id" in changed) == (k > 0)  # the first is to have the id that it has
        assert ("baud_rate" in changed) == (bag.family == "dynamixel")
        assert bag.give(name) == []  # it is found at its new place, and is as it should be
    assert bag.ids() == [1, 2, 3, 4, 5, 6]
    assert {servo.get("return_delay_time") for servo in bag.twin.servos} == {0}
    motors = bag.twin.bus.chain.motors
    assert not motors.torque.any()
    assert (motors.counts == before).all()
    bag.plug(*range(6))
    rig = dynamixel.Rig(bag.twin) if bag.family == "dynamixel" else feetech.FeetechRig(bag.twin)
    with rig:
        rig.start()


def test_it_is_kept_over_a_power_off(bag: Bag) -> None:
    bag.plug(3)
    bag.give("joint_4")
    bag.twin.servos[3].restart()
    assert bag.find() == Found(1_000_000, 2 if bag.family == "dynamixel" else 1, 4)
    if bag.family == "feetech":
        assert bag.twin.servos[3].get("lock") == 1


def test_the_profiles_bounds_are_written_when_that_is_asked(bag: Bag) -> None:
    bag.plug(0)
    assert "max_position_limit" not in bag.give("joint_1")
    assert {"min_position_limit", "max_position_limit"} <= set(bag.give("joint_1", limits=True))
    servo = bag.twin.servos[0]
    low, high = servo.get("min_position_limit"), servo.get("max_position_limit")
    per_count = 2 * 3.141592653589793 / 4096
    assert (low - 2048) * per_count == pytest.approx(-1.0, abs=per_count)
    assert (high - 2048) * per_count == pytest.approx(1.5, abs=per_count)


@pytest.mark.parametrize("change", [{"zero": 3.0}, {"upper": None}])
def test_bounds_that_a_servo_cant_have_are_refused(bag: Bag, change: dict[str, Any]) -> None:
    bag.plug(0)
    motors = bag.config.motors
    motors["joint_1"] = motors["joint_1"].model_copy(update=change)
    with pytest.raises(DeviceError, match="limits"):
        bag.give("joint_1", limits=True)
    assert bag.twin.servos[0].get("return_delay_time") == 250  # nothing was written


def test_a_servo_that_answers_pings_alone_is_set_up(bag: Bag) -> None:
    bag.plug(1)
    servo = bag.twin.servos[1]
    servo.put("status_return_level", 0)
    if bag.family == "feetech":
        servo.kept[:] = servo.memory
    assert "id" in bag.give("joint_2")


def test_a_lock_that_was_left_open_is_closed() -> None:
    bag = Bag(feetech.make_twin(STS), NewFeetech, "feetech")
    try:
        bag.plug(0)
        bag.give("joint_1")
        bag.twin.servos[0].put("lock", 0)
        assert bag.give("joint_1") == []
        assert bag.twin.servos[0].get("lock") == 1
    finally:
        bag.twin.close()


def test_more_than_one_servo_is_refused_and_nothing_is_written(bag: Bag) -> None:
    bag.plug(0, 1)
    with pytest.raises(DeviceError, match=r"more than one servo answers .*Connect one servo alone"):
        bag.find()
    bag.twin.twice = {1}  # as on a real line, where both speak at once
    with pytest.raises(DeviceError, match=r"garbled bytes answer\. Connect one servo alone"):
        bag.find()
    assert bag.ids() == [1] * 6


def test_servos_at_two_rates_are_more_than_one(bag: Bag) -> None:
    bag.plug(0, 1)
    servo = bag.twin.servos[1]
    servo.put("id", 7)
    servo.put("baud_rate", 3 if bag.family == "dynamixel" else FEETECH_AT_115200)
    with pytest.raises(DeviceError, match=r"more than one servo answers \(id [17] at \d+ bit/s, id [17] at"):
        bag.find()


def test_a_cable_that_is_out_is_named(bag: Bag) -> None:
    with pytest.raises(DeviceError, match=r"no servo answers at .* 57600.*|no servo answers at .* 115200.*"):
        bag.find()


def test_another_model_is_refused(bag: Bag) -> None:
    bag.plug(0)
    bag.twin.servos[0].put("model_number", 1060 if bag.family == "dynamixel" else 2825)
    with pytest.raises(DeviceError, match="Correct 'model' in the profile, or connect the right servo"):
        bag.give("joint_2")
    assert bag.ids() == [1] * 6


def test_a_servo_with_torque_is_left_as_it_is(bag: Bag) -> None:
    bag.plug(0)
    motors = bag.twin.bus.chain.motors
    motors.switch(bag.twin.servos[0].i, True)
    bag.twin.servos[0].put("torque_enable", 1)
    with pytest.raises(DeviceError, match="torque of the servo for 'joint_2' is on"):
        bag.give("joint_2")
    assert bag.ids() == [1] * 6


def test_a_write_that_isnt_taken_is_found_out(bag: Bag, monkeypatch: pytest.MonkeyPatch) -> None:
    bag.plug(0)
    servo = bag.twin.servos[0]
    real = servo.write

    def deaf(address: int, data: bytes, *more: Any) -> Any:
        if address == servo_id(bag):
            return real(address, bytes((9,)), *more)
        return real(address, data, *more)

    monkeypatch.setattr(servo, "write", deaf)
    with pytest.raises(DeviceError, match=r"silent|not 2|doesn't answer"):
        bag.give("joint_2")


def servo_id(bag: Bag) -> int:
    return 7 if bag.family == "dynamixel" else 5


@pytest.mark.slow
def test_servos_of_protocol_1_are_asked_one_by_one() -> None:
    bag = Bag(dynamixel.make_twin(MX, protocol=1), NewDynamixel, "dynamixel")
    for servo in bag.twin.servos:
        servo.put("baud_rate", 34)
    try:
        bag.plug(1)
        assert bag.give("elbow") == ["return_delay_time", "id", "baud_rate"]
        assert bag.ids() == [1, 2]
    finally:
        bag.twin.close()


class Typist(io.StringIO):
    """Who plugs one servo after another, and says so; words by the number of the question."""

    def __init__(self, bag: Bag, plugs: list[tuple[set[int], str]]) -> None:
        super().__init__()
        self._bag, self._plugs = bag, plugs

    def readline(self, *_: Any) -> str:
        if not self._plugs:
            return ""
        numbers, word = self._plugs.pop(0)
        self._bag.plug(*numbers)
        return f"{word}\n"


def profile_of(bag: Bag, folder: Path) -> str:
    motors = {name: {"id": motor.id, "model": motor.model} for name, motor in bag.config.motors.items()}
    content = {
        "name": "my-arm", "rate": 100,
        "devices": {"arm": {"driver": bag.family, "port": bag.twin.address, "baudrate": 1_000_000, "motors": motors}},
    }  # fmt: skip
    path = folder / "my-arm.yaml"
    path.write_text(json.dumps(content))
    return str(path)


def test_the_command_leads_through_all(
    bag: Bag, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The first time nothing is plugged, then two at once; one is left out, and done later."""
    every = set(range(6))
    steps = [(set(), ""), ({0, 1}, ""), ({0}, ""), ({0}, "")]  # the fourth is the servo that joint_1 is
    steps += [*(({k}, "") for k in range(1, 5)), ({5}, "s"), (every, "")]
    monkeypatch.setattr("sys.stdin", Typist(bag, steps))
    path = profile_of(bag, tmp_path)
    with bag.bench.running(frozen=True):
        assert main(["setup-servos", path]) == 1
    reported = capsys.readouterr()
    assert "no servo answers" in reported.err
    assert "more than one servo answers" in reported.err
    assert "this is the servo for 'joint_1', which was set up before" in reported.err
    assert "joint_5: " in reported.err
    assert "garbled" in reported.out or "'joint_6' (id 6) doesn't answer" in reported.out
    monkeypatch.setattr("sys.stdin", Typist(bag, [({5}, ""), (every, "")]))
    with bag.bench.running(frozen=True):
        assert main(["setup-servos", path, "--only", "joint_6"]) == 0
        assert main(["setup-servos", path, "--test", "--json"]) == 0
    reported = capsys.readouterr()
    assert "all 6 servos are there, and as the profile says. Next: srl jog" in reported.out
    assert json.loads(reported.out.splitlines()[-1]) == {"device": "arm", "changed": {}, "problem": ""}
    assert bag.ids() == [1, 2, 3, 4, 5, 6]


@pytest.mark.parametrize(("arguments", "words"), [
    (["sixth-finger"], "0 devices have servos to set up"), (["so101", "--only", "wrist"], "no motor 'wrist'"),
    (["so101", "leg"], "no device 'leg'"),
])  # fmt: skip
def test_what_cant_be_set_up_is_named(arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["setup-servos", *arguments]) == 2
    assert words in capsys.readouterr().err


def test_no_input_ends_it(bag: Bag, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", Typist(bag, []))
    assert main(["setup-servos", profile_of(bag, tmp_path)]) == 2
    assert bag.ids() == [1] * 6


LEROBOT = {"drive_mode": 0, "homing_offset": -1400, "range_min": 1000, "range_max": 3000}


def lerobot(folder: Path, **changes: Any) -> Path:
    motors = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
    file = folder / "so101.json"
    lines = {name: {"id": k} | LEROBOT | changes for k, name in enumerate(motors, 1)}
    file.write_text(json.dumps(lines))
    return file


def test_a_calibration_of_lerobot_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Their bounds are counts that the servo reports, with its offset in it."""
    monkeypatch.chdir(tmp_path)
    assert main(["new", "my-arm", "--from", "so101"]) == 0
    before = Path("my-arm.yaml").read_text()
    assert main(["setup-servos", "my-arm.yaml", "--lerobot", str(lerobot(tmp_path))]) == 0
    assert Path("my-arm.yaml.old").read_text() == before
    checked, _ = profile.load("my-arm.yaml")
    motor = checked.devices["arm"].options["motors"]["elbow_flex"]
    assert (motor["id"], motor["offset"]) == (3, -1400)
    assert motor["lower"] == pytest.approx((1000 - 2048) * 2 * 3.14159265 / 4096, abs=1e-4)
    assert motor["upper"] == pytest.approx((3000 - 2048) * 2 * 3.14159265 / 4096, abs=1e-4)


@pytest.mark.parametrize(
    ("changes", "words"),
    [({"drive_mode": 1}, "drive_mode"), ({"range_min": 3000}, "is empty"), ({"gear": 1}, "gear"), ({"id": "1"}, "id")],
)
def test_another_file_is_refused_and_the_profile_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, changes: dict[str, Any], words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["new", "my-arm", "--from", "so101"]) == 0
    before = Path("my-arm.yaml").read_text()
    assert words in refused("setup-servos", "my-arm.yaml", "--lerobot", str(lerobot(tmp_path, **changes)))
    assert Path("my-arm.yaml").read_text() == before
    assert "no file of yours" in refused("setup-servos", "so101", "--lerobot", str(lerobot(tmp_path)))
