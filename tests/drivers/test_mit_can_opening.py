"""What opening MIT-mode actuators refuses, with words and a remedy; and what the profile may not say."""

from __future__ import annotations

from typing import Any

import pytest
from helpers.mit_can import AK, ONE, TWO, Limb, cell, config
from pydantic import ValidationError

from srl.drivers.mit_can.protocol import Register
from srl.runtime.contracts.errors import DeviceError


def refused(limb: Limb, *words: str) -> None:
    with pytest.raises(DeviceError) as caught:
        limb.fake.open()
    for word in words:
        assert word in str(caught.value)
    assert not limb.fake.health.connected


def test_a_wrong_model_is_refused_by_its_ranges() -> None:
    limb = Limb()
    for register, value in ((Register.V_MAX, 30.0), (Register.T_MAX, 10.0)):
        limb.drives.keep(0, register, value)
    refused(limb, "'shoulder' (id 1) scales by ±12.5 rad, ±30 rad/s, ±10 N m", "DM8009", "those of DM4310")


def test_swapped_ids_are_refused_where_the_models_or_the_serials_differ() -> None:
    limb = Limb()
    for k, (own, reply) in enumerate(((2, 0x12), (1, 0x11))):
        limb.drives.keep(k, Register.ESC_ID, own)
        limb.drives.keep(k, Register.MST_ID, reply)
    refused(limb, "'shoulder' (id 1) scales by ±12.5 rad, ±8 rad/s", "Correct 'model' or the ids")
    alike = {"one": {"model": "DM4310", "kp": 20, "kd": 1, "serial": 71}}
    limb = Limb(alike)
    limb.drives.keep(0, Register.SERIAL, 72)
    refused(limb, "serial number 72, the profile says 71", "two ids are swapped")


def test_two_motors_with_one_id_are_refused() -> None:
    limb = Limb()
    limb.drives.keep(1, Register.ESC_ID, 1)
    limb.drives.keep(1, Register.MST_ID, 0x11)
    refused(limb, "doesn't answer, others do")  # the second is missed first
    limb = Limb(ONE, world=cell(TWO))
    second = Limb(TWO).drives
    second.keep(1, Register.ESC_ID, 1)
    second.keep(1, Register.MST_ID, 0x11)
    take = limb.drives.take
    limb.drives.take = lambda *frame: take(*frame) + second.take(*frame)  # type: ignore[method-assign]
    refused(limb, "two motors answer as 'elbow' (id 1)", "one by one")


@pytest.mark.parametrize(("motors", "maker"), [(TWO, "damiao"), (AK, "v2")])
def test_an_answer_that_is_late_isn_t_another_motor_s(motors: dict[str, Any], maker: str) -> None:
    """On a busy host an answer may come with the one to the repeated question."""
    limb = Limb(motors, maker)
    take, late, heard = limb.drives.take, list[Any](), set[Any]()

    def slow(id: int, data: bytes, extended: bool) -> Any:
        answers = [*late, *take(id, data, extended)]
        late.clear()
        if (id, data) in heard:
            return answers
        heard.add((id, data))
        late.extend(answers)
        return []

    limb.drives.take = slow  # type: ignore[method-assign]
    limb.open()
    assert limb.fault == ""
    assert limb.state("position") == pytest.approx([0.0, 0.0], abs=1e-3)


@pytest.mark.parametrize(("motors", "maker"), [(TWO, "damiao"), (AK, "v2")])
def test_the_last_command_s_answer_that_comes_with_the_first_isn_t_another_motor_s(motors: Any, maker: str) -> None:
    """A link that was away brings what it had held back."""
    limb = Limb(motors, maker)
    take, held = limb.drives.take, [True]

    def first_comes_twice(id: int, data: bytes, extended: bool) -> Any:
        answers = take(id, data, extended)
        if answers and held[0]:
            held[0] = False
            return [answers[0], *answers]
        return answers

    limb.drives.take = first_comes_twice  # type: ignore[method-assign]
    limb.open()
    assert limb.fault == ""


def test_a_reply_on_another_identifier_is_named() -> None:
    limb = Limb()
    limb.drives.keep(1, Register.MST_ID, 0)
    refused(limb, "'elbow' (id 2) replies on 0x0, the profile says 0x12", "Set 'reply: 0x0'")


def test_who_is_missing_and_who_is_there_instead() -> None:
    limb = Limb()
    limb.drives.keep(1, Register.ESC_ID, 9)
    refused(limb, "'elbow' (id 2) doesn't answer, others do; motors that the profile doesn't name answer as 9")
    limb = Limb()
    limb.drives.unplugged.update((0, 1))
    refused(limb, "no motor answers on can://virtual/none", "120 ohm")


def test_a_watchdog_that_isn_t_taken_is_refused() -> None:
    limb = Limb()
    take = limb.drives.take

    def deaf(id: int, data: bytes, extended: bool) -> Any:
        return [] if data[2:4] == bytes((0x55, Register.TIMEOUT)) else take(id, data, extended)

    limb.drives.take = deaf  # type: ignore[method-assign]
    refused(limb, "doesn't take its watchdog: register 9 is 0, not 10000")


def test_the_turn_is_told_by_the_travel_or_the_park_and_never_guessed() -> None:
    joint = {"model": "DM4340", "kp": 40, "kd": 2}
    parked = Limb({"elbow": joint | {"lower": 2.5, "upper": 5.0}}, world=cell({"elbow": joint}, start=3.5))
    motors = parked.drives.motors
    motors.power_off(0)
    parked.drives.power_up()
    assert motors.angle[0] == pytest.approx(3.5 - 2 * 3.14159265)
    parked.open()
    assert parked.state("position")[0] == pytest.approx(3.5, abs=1e-3)
    refused(Limb({"elbow": joint | {"lower": 1.0, "upper": 2.0}}), "outside its travel of 1 to 2")
    refused(Limb({"elbow": joint | {"lower": -4.0, "upper": 4.0}}, world=cell({"elbow": joint}, start=3.5)),
            "could stand at -2.78, 3.50", "Add 'park'")  # fmt: skip
    refused(Limb({"elbow": AK["elbow"] | {"park": 0.3}}, "v2"), "isn't parked at 0.3: it could stand at")
    without = {"elbow": {key: value for key, value in AK["elbow"].items() if key != "park"}}
    refused(Limb(without, "v2"), "-1.40, -0.70, -0.00, 0.70, 1.40", "only within 0.70")
    refused(Limb(ONE, world=cell(ONE, start=12.45)), "where its range of ±12.5 ends and wraps")


def test_a_cubemars_is_enabled_only_if_the_profile_lets_it() -> None:
    limb = Limb(AK, "v2", enable_at_open=False)
    refused(limb, "only once it is enabled", "enable_at_open: true")
    assert limb.on == [False, False]
    limb = Limb(AK, "v2").open()
    rows = limb.drives.motors
    assert limb.on == [True, True]
    assert rows.kp.tolist() == [0, 0]
    assert rows.kd == pytest.approx(2.0, abs=2e-3)


def test_a_silent_cubemars_names_those_who_answer() -> None:
    limb = Limb(AK, "v2")
    limb.drives.unplugged.add(0)
    refused(limb, "'shoulder' (id 1) doesn't answer in MIT mode", "servo mode")
    limb = Limb(AK, "v3", enable_at_open=False)
    refused(limb, "'shoulder' (id 1) sends no status", "periodic status")


def test_who_was_enabled_by_an_earlier_run_is_kept_from_falling() -> None:
    limb = Limb().open()
    limb.hold()
    limb.fake.close()
    limb.fake.open()
    limb.run(1.0)
    assert limb.on == [True, True]
    assert not limb.fault
    assert limb.drives.motors.kp.tolist() == [0, 0]


@pytest.mark.parametrize(
    ("change", "output"),
    [
        ({"firmware": None, "kind": "v2"}, "the firmware of a CubeMars isn't said"),
        ({"firmware": "v2"}, "a Damiao has no firmware generation"),
        ({"motors": {"a": TWO["elbow"] | {"id": 16}}}, "id 16 doesn't fit"),
        ({"motors": {"a": TWO["elbow"] | {"model": "AK80-9"}}}, "there is no damiao 'AK80-9'"),
        ({"motors": {"a": TWO["elbow"] | {"kd": 0}}}, "position needs kp and kd above 0"),
        ({"motors": {"a": TWO["elbow"] | {"lower": None}}}, "its travel isn't said"),
        (
            {"motors": {"a": TWO["elbow"] | {"upper": 13.0}}},
            "'upper' is 13.00 rad at the shaft, the wire carries ±12.4",
        ),
        ({"motors": {"a": TWO["elbow"] | {"id": 3}, "b": TWO["elbow"] | {"id": 3}}}, "id 3 is used twice"),
        ({"motors": {"a": TWO["elbow"] | {"reply": 2}, "b": TWO["elbow"]}}, "a replies on 0x2"),
        ({"watchdog": 0.0}, "greater than or equal to 0.02"),
    ],
)
def test_a_profile_that_can_t_be_is_refused(change: dict[str, Any], output: str) -> None:
    if "motors" in change:
        numbered = enumerate(change["motors"].items(), 1)
        change = {"motors": {n: {"id": k, "lower": -2.0, "upper": 2.0} | m for k, (n, m) in numbered}}
    with pytest.raises(ValidationError, match=output):
        config(maker=change.pop("kind", "damiao"), **change)


def test_a_v3_without_known_ranges_needs_them() -> None:
    motors = {"a": {"id": 1, "model": "AK80-64", "lower": -1.0, "upper": 1.0, "kp": 20, "kd": 1}}
    with pytest.raises(ValidationError, match="no source gives the ranges of an AK80-64 with firmware v3"):
        config(maker="v3", motors=motors)
    known = {"position": 12.56, "velocity": 8, "torque": 100}
    assert config(maker="v3", motors={"a": motors["a"] | {"range": known}}).motors["a"].span("v3").torque == 100
