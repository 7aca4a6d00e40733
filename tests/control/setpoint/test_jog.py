"""A press moves for a while and no longer; what isn't pressed stands."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.control import bound
from pydantic import ValidationError

from srl.control.setpoint.jog import HOLD, REST, Jog, JogConfig

DT = 0.01
RESTED = round(REST / DT) + 1  # cycles


def made(command: str = "position", **options: object) -> Jog:
    given = {"speed": {"a": 0.1, "b": 0.2}, "acceleration": {"a": 2.0, "b": 4.0}, "command": command} | options
    law = bound(Jog("jog", JogConfig.model_validate(given)))
    law.reset()
    run(law, RESTED)
    return law


def run(law: Jog, cycles: int) -> list[float]:
    """Joint a's command in each cycle, which the guard passes as it is."""
    found = []
    for _ in range(cycles):
        law.update(DT)
        if "q" in law.output:
            law.applied["q"][:] = law.output["q"]
        found.append(float(law.output["q" if "q" in law.output else "velocity"][0]))
    return found


def press(law: Jog, number: float, *way: float) -> None:
    law.input["press"][0] = number
    law.input["way"][:] = way


@pytest.mark.parametrize("acceleration", [0.2, 2.0, 200.0])
def test_a_tap_moves_by_its_time_and_speed_at_most_and_brakes_by_itself(acceleration: float) -> None:
    law = made(acceleration={"a": acceleration, "b": 1.0})
    press(law, 1, 1.0, 0.0)  # and nothing more is heard
    way = run(law, 150)
    assert 0.0 < way[-1] <= HOLD * 0.1 + 1e-12
    assert np.diff(way).max() <= 0.1 * DT + 1e-12
    assert len(set(way[-50:])) == 1
    if acceleration >= 2.0:
        assert way[-1] == pytest.approx(HOLD * 0.1)


def test_presses_that_follow_one_another_move_at_the_speed() -> None:
    law = made("velocity")
    speeds: list[float] = []
    for number in range(1, 30):
        press(law, number, -1.0, 0.0)
        speeds += run(law, 9)
    assert speeds[10:] == pytest.approx([-0.1] * len(speeds[10:]))
    after = run(law, 30)
    first = next(i for i, v in enumerate(after) if v > -0.1)
    assert first * DT <= HOLD
    assert after[-1] == 0.0


def test_no_press_and_a_press_that_lasts_move_nothing_more() -> None:
    law = made()
    assert set(run(law, 50)) == {0.0}
    press(law, 1, 1.0, 0.0)
    run(law, 100)
    (still,) = set(run(law, 50))
    press(law, 0, 1.0, 0.0)
    assert set(run(law, 50)) == {still}


@pytest.mark.parametrize("lost", [(np.nan, 1.0, 1.0), (2.0, np.nan, 1.0), (np.inf, 1.0, 1.0)])
def test_what_isnt_finite_is_no_press(lost: tuple[float, float, float]) -> None:
    law = made()
    press(law, *lost)
    assert set(run(law, 30)) == {0.0}


def test_a_key_that_is_held_through_a_reset_moves_nothing() -> None:
    law = made("velocity")
    law.reset()
    for number in range(1, 40):
        press(law, number, 1.0, 0.0)
        assert set(run(law, 3)) == {0.0}
    press(law, 0, 0.0, 0.0)
    run(law, RESTED)
    press(law, 50, 1.0, 0.0)
    assert run(law, 6)[-1] == pytest.approx(0.1)


def test_a_way_beyond_one_is_no_faster() -> None:
    law = made("velocity")
    press(law, 1, 5.0, -7.0)
    run(law, 10)
    np.testing.assert_allclose(law.output["velocity"], [0.1, -0.2])


def test_what_the_guard_withholds_isnt_made_up_for() -> None:
    law = made()
    press(law, 1, 1.0, 0.0)
    for number in range(2, 30):
        law.update(DT)  # the applied position stays, as at a bound
        press(law, number, 1.0, 0.0)
    assert law.output["q"][0] <= 0.1 * DT + 1e-12


def test_each_joint_has_both_its_limits() -> None:
    with pytest.raises(ValidationError, match="must have the joints of 'speed'"):
        JogConfig.model_validate({"speed": {"a": 1.0}, "acceleration": {"b": 1.0}})
