"""Which of two arms is meant: never a guess, since the other one's distances say nothing of it."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from srl.control.reach.options import ReachConfig
from srl.control.skeleton.body_clearance import BodyClearance, BodyClearanceConfig
from srl.control.skeleton.collision import CollisionConfig
from srl.control.strap.law import StrapBaseConfig
from srl.runtime.cli import main
from srl.runtime.contracts.errors import SrlError, WiringError
from srl.runtime.contracts.signals import Command, Kind
from srl.runtime.models.models import ArmsModel
from srl.runtime.profile import profile, wiring

TWO = ArmsModel(sides=("right", "left"))
CLEAR = (
    "{{use: body-clearance, lag: 0.06, tracking: 0.006, least: 0.02, uncertainty: 0.05{side},"
    " in: {{rotation: suit.rotation, translation: suit.translation}}}}"
)
LIMITS = {key: {f"J{i}": value for i in range(1, 8)} for key, value in
          {"lower": -1.0, "upper": 1.0, "velocity": 1.0, "acceleration": 4.0}.items()}  # fmt: skip
OTHER = {
    ReachConfig: LIMITS,
    BodyClearanceConfig: {"least": 0.02, "uncertainty": 0.0},
    StrapBaseConfig: {"axes": {f"J{i}": {"lower": -1, "upper": 1} for i in range(1, 8)}},
}


@pytest.mark.parametrize("options", [BodyClearanceConfig, CollisionConfig, ReachConfig, StrapBaseConfig])
def test_of_two_arms_one_must_be_named_and_of_one_it_is_that_one(options):
    other = OTHER.get(options, {})
    with pytest.raises(ValidationError, match="two arms"):
        options(arms=TWO, **other)
    left = options(arms=ArmsModel(sides=("left",)), **other)
    assert left.arms.arms.side(left.side) == "left"
    options(arms=TWO, side="left", **other)
    with pytest.raises(ValidationError, match="no right one"):
        options(arms=ArmsModel(sides=("left",)), side="right", **other)


def build(right: str, left: str) -> wiring.Graph:
    both = {"right": right, "left": left}
    return wiring.build(
        *profile.load(
            "human-srl-two",
            [
                f"guard.{arm}.position_command.clear={CLEAR.format(side=side and f', side: {side}')}"
                for arm, side in both.items()
            ],
        )
    )


def test_a_slide_that_the_device_takes_for_a_turn_is_refused():
    """Its numbers would be rad for m: 0.1 m of a slide would be 6 degrees of a servo."""
    turn = ["devices.arm.motors.J5={id: 5, model: MX-64, home: 0.0}", "sim=null"]
    with pytest.raises(WiringError, match=r"J5.*slides.*J5.*turns") as error:
        wiring.build(*profile.load("human-srl", turn))
    assert "m_per_rad" in error.value.remedy
    names = tuple(f"J{i}" for i in range(1, 8))
    options = BodyClearanceConfig(least=0.02, uncertainty=0.0)
    for slides, fine in ((None, True), (("J5",), True), ((), False), (("J4", "J5"), False)):
        command = Command(name="c", shape=(7,), unit="rad", kind=Kind.POSITION, labels=names, slides=slides)
        if fine:
            BodyClearance("p", options, command)
            continue
        with pytest.raises(WiringError, match=r"in the arms and .* in the device"):
            BodyClearance("p", options, command)
    slide = "devices.arm.motors.J6={id: 6, model: MX-28, home: 0.0, m_per_rad: 0.02}"
    with pytest.raises(WiringError, match=r"J6.*turns.*J6.*slides"):
        wiring.build(*profile.load("human-srl", [slide, "sim=null"]))


@pytest.mark.parametrize(("bound", "far"), [("upper", "0.3"), ("lower", "-0.21")])
def test_limits_of_a_slide_beyond_the_stroke_are_refused(bound, far, capsys):
    guard = ["--set", f"guard.arm.position_command.{bound}.J5={far}"]
    motor = ["--set", f"devices.arm.motors.J5.{bound}={far}"]
    stroke = ["--set", "guard.arm.position_command.clear.stroke=0.3"]
    assert main(["check", "human-srl", *guard]) == 0  # the motor's own bound keeps it nearer
    assert main(["check", "human-srl", *guard, *motor]) == 2
    output = capsys.readouterr().err
    assert "guard.arm.position_command" in output
    assert "the clearance is right up to 0.2" in output
    assert main(["check", "human-srl", *guard, *motor, *stroke]) == 0


def test_in_a_profile_each_arm_has_a_clearance_of_its_own():
    limbs = [each.clearance.limb for each in build("right", "left").clearances.values()]
    assert [limb[1] for limb in limbs] == ["right", "left"]  # type: ignore[index]
    with pytest.raises(WiringError, match=r"left\.position_command.*one and the same limb"):
        build("right", "right")
    with pytest.raises(SrlError, match="two arms"):
        build("right", "")
