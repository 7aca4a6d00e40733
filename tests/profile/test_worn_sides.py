"""A profile that says two things of which arm a device is, or nothing of one of two arms."""

from __future__ import annotations

import pytest

from srl.runtime.contracts.errors import WiringError
from srl.runtime.profile import profile, wiring

RIGHT, LEFT = "guard.right.position_command.clear", "guard.left.position_command.clear"
# Without the law `skeleton`, which the profile's frame for pictures reads.
FRAMES = ("frames={world: {}, suit: {parent: world, quaternion: [0.5, 0.5, 0.5, 0.5]}}",)
LIMITS = ", ".join(
    f"{key}: {{{', '.join(f'J{i}: {value}' for i in range(1, 8))}}}"
    for key, value in (("lower", -1), ("upper", 1), ("velocity", 0.8), ("acceleration", 4))
)
SUIT = "rotation: suit.rotation, translation: suit.translation"


def laws(*more: str, right: str = "right", left: str = "left") -> str:
    """Each arm follows the other one, by a law that is told these sides; and further laws."""
    made = [
        f"{{use: reach, name: {q}-motion, side: {side}, in: {{{SUIT}, target: {target}.position}}, {LIMITS}, "
        f"out: {{q: {q}.position_command, q_velocity: {q}.position_command.velocity}}}}"
        for q, target, side in (("right", "left", right), ("left", "right", left))
    ]
    return f"controllers=[{', '.join((*made, *more))}]"


def collision(arm: str) -> str:
    return f"{{use: collision, side: left, in: {{{SUIT}, arm: {arm}.position}}}}"


def skeleton(right: str, left: str) -> str:
    return f"{{use: skeleton, in: {{{SUIT}, right: {right}.position, left: {left}.position}}}}"


def warnings(*changes: str) -> list[str]:
    frames = FRAMES if any(change.startswith("controllers=") for change in changes) else ()
    return wiring.build(*profile.load("human-srl-two", [*changes, *frames, "record={}"]), []).warnings


@pytest.mark.parametrize(
    ("changes", "law"),
    [
        ([f"{RIGHT}.side=left", f"{LEFT}.side=right"], "skeleton"),
        ([laws(skeleton("left", "right"))], "skeleton"),
        ([laws(collision("right"))], "collision"),
        ([laws(right="left", left="right")], "right-motion"),
    ],
)
def test_a_law_and_a_clearance_that_take_a_device_for_different_arms_are_refused(changes: list[str], law: str) -> None:
    with pytest.raises(WiringError, match=f"arm here, and the (left|right) one in the law '{law}'"):
        warnings(*changes)


def test_a_law_may_read_the_other_arm_too_if_it_commands_its_own() -> None:
    assert warnings(laws(collision("left"), skeleton("right", "left"))) == []


def test_an_arm_that_exists_and_has_no_clearance_is_doubted_where_both_are_named() -> None:
    found = warnings(f"{LEFT}=null", laws())
    assert any(f"{RIGHT}: the left arm has no clearance of its own" in warning for warning in found)
