"""The handle's buttons: each press toggles its mode, and nothing else does."""

from __future__ import annotations

import pytest
from helpers.control import bound
from hypothesis import given
from hypothesis import strategies as st

from srl.control.cobot.guide_buttons import GuideButtons, GuideButtonsConfig


def buttons(**options: object) -> GuideButtons:
    controller = bound(GuideButtons("buttons", GuideButtonsConfig.model_validate(options)))
    controller.reset()
    return controller


def cycle(controller: GuideButtons, *pressed: float) -> list[float]:
    controller.input["buttons"][:] = pressed
    controller.update(0.01)
    modes: list[float] = controller.output["modes"].tolist()
    return modes


def test_it_starts_with_everything_off_and_the_gripper_as_told() -> None:
    assert buttons().output["modes"].tolist() == [0, 0, 0, 0]
    assert buttons(gripper="closed").output["modes"].tolist() == [0, 0, 1, 0]


@pytest.mark.parametrize("which", range(4))
def test_a_press_toggles_its_own_mode_once_however_long_it_lasts(which: int) -> None:
    controller, down = buttons(), [float(i == which) for i in range(4)]
    for expected in (down, [0.0] * 4, down):
        for _ in range(5):
            assert cycle(controller, *down) == expected
        for _ in range(3):
            assert cycle(controller, 0, 0, 0, 0) == expected
    assert sum(controller.metrics()["presses"].values()) == 3  # type: ignore[attr-defined]


def test_a_button_held_at_the_reset_counts_only_after_it_was_let_go() -> None:
    controller = buttons()
    controller.input["buttons"][:] = [1, 0, 0, 1]
    controller.reset()
    assert cycle(controller, 1, 0, 0, 1) == [0, 0, 0, 0]
    assert cycle(controller, 0, 0, 0, 1) == [0, 0, 0, 0]
    assert cycle(controller, 1, 0, 0, 1) == [1, 0, 0, 0]


def test_a_reset_keeps_the_gripper_and_clears_the_rest() -> None:
    controller = buttons()
    assert cycle(controller, 1, 1, 1, 1) == [1, 1, 1, 1]
    controller.reset()
    assert controller.output["modes"].tolist() == [0, 0, 1, 0]


@given(st.lists(st.tuples(*[st.booleans()] * 4), max_size=60))
def test_modes_are_the_parity_of_presses(pattern: list[tuple[bool, bool, bool, bool]]) -> None:
    controller, before, presses = buttons(), (False,) * 4, [0] * 4
    for now in pattern:
        modes = cycle(controller, *map(float, now))
        presses = [n + (b and not a) for n, a, b in zip(presses, before, now, strict=True)]
        before = now
        assert modes == [n % 2 for n in presses]
