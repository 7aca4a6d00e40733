"""Named postures: motions within their bounds, presses on the way, what the guard holds back."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.arm_urdf import HIP
from pydantic import ValidationError

from srl.control.arm.waypoints import Waypoints, WaypointsConfig
from srl.runtime.contracts.files import KeptFile
from srl.runtime.models.robot_model import RobotModel
from srl.testing import ControllerConformance, bound

ROBOT = RobotModel.model_validate({"urdf": KeptFile(Path("hip.urdf"), HIP.encode()), "tip": "tool"}).robot
AHEAD = {"yaw": 0.0, "shoulder": 0.4, "elbow": 0.6, "wrist": 0.0}
ASIDE = {"wrist": 0.1, "elbow": 0.6, "shoulder": 0.2, "yaw": 1.0}
Q = np.array([-0.3, 0.1, 0.2, 0.0])
DT = 0.01


def law(**options: Any) -> Waypoints:
    given = {
        "robot": ROBOT,
        "waypoints": {"ahead": AHEAD, "aside": ASIDE},
        "speed": 1.0,
        "acceleration": 4.0,
        "jerk": 40.0,
    }
    made = bound(Waypoints("go", WaypointsConfig.model_validate(given | options)))
    made.applied["q"][:] = Q
    return made


def run(made: Waypoints, cycles: int) -> tuple[np.ndarray, np.ndarray]:
    q, v = [], []
    for _ in range(cycles):
        made.update(DT)
        made.applied["q"][:] = made.output["q"]
        q.append(made.output["q"].copy())
        v.append(made.output["q_velocity"].copy())
    return np.array(q), np.array(v)


class TestConformance(ControllerConformance):
    inputs = {"go": [0.0, 1.0]}  # noqa: RUF012
    start = {"q": Q, "q_velocity": np.zeros(4)}  # noqa: RUF012

    def law(self) -> Waypoints:
        return law()


def pressed(made: Waypoints, name: str) -> None:
    made.input["go"][:] = [float(each == name) for each in ("ahead", "aside")]


def test_a_press_goes_there_within_the_bounds_also_when_it_comes_on_the_way() -> None:
    made = law()
    made.reset()
    run(made, 2)
    pressed(made, "ahead")
    q1, v1 = run(made, 30)
    pressed(made, "aside")
    q2, v2 = run(made, 400)
    q, v = np.vstack([q1, q2]), np.vstack([v1, v2])
    assert q[-1] == pytest.approx([ASIDE[name] for name in ROBOT.labels], abs=1e-9)
    assert made.output["at"].tolist() == [0.0, 1.0]
    assert np.abs(v).max() <= 1.0 + 1e-9
    a = np.diff(v, axis=0) / DT
    assert np.abs(a).max() <= 4.0 + 1e-6
    assert np.abs(np.diff(a, axis=0)).max() / DT <= 40.0 * 1.01
    assert np.abs(np.diff(q, axis=0)).max() <= DT * 1.001


def test_nothing_moves_after_a_reset_while_a_button_is_held() -> None:
    made = law()
    pressed(made, "aside")
    made.reset()
    q, _ = run(made, 50)
    assert (q == Q).all()
    made.input["go"][:] = np.nan
    run(made, 1)
    made.input["go"][:] = 0.0
    run(made, 1)
    pressed(made, "aside")
    q, _ = run(made, 50)
    assert q[-1][0] > Q[0] + 0.1


def test_a_reset_where_nobody_knows_where_the_limb_is_begins_there_later() -> None:
    made = law()
    made.applied["q"][:] = np.nan
    made.reset()
    made.update(DT)
    pressed(made, "aside")
    made.update(DT)
    assert not np.isfinite(made.output["q"]).any(), "the guard refuses it"
    made.applied["q"][:] = Q
    q, _ = run(made, 50)
    assert (q == Q).all(), "an old press moves nothing"
    made.input["go"][:] = 0.0
    run(made, 1)
    pressed(made, "aside")
    q, _ = run(made, 50)
    assert q[0] == pytest.approx(Q, abs=1e-3)
    assert q[-1][0] > Q[0] + 0.1


def test_one_waypoint_follows_another_after_its_rest() -> None:
    made = law(then={"ahead": "aside", "aside": "ahead"}, rest=0.2)
    made.reset()
    run(made, 1)
    pressed(made, "ahead")
    run(made, 1500)
    assert made.metrics()["arrivals"] >= 4


def test_the_speed_is_followed_gradually_and_zero_waits_on_the_way() -> None:
    made = law()
    made.reset()
    run(made, 1)
    pressed(made, "aside")
    run(made, 40)
    made.param["speed"][()] = 0.0
    q, v = run(made, 110)
    assert np.abs(np.diff(v, axis=0)).max() / DT <= 5.1
    assert np.abs(v[-1]).max() == 0.0
    assert q[-1][0] < 0.9
    made.param["speed"][()] = 1.0
    q, _ = run(made, 300)
    assert q[-1] == pytest.approx([ASIDE[name] for name in ROBOT.labels], abs=1e-9)


def test_what_the_guard_holds_back_is_not_wound_up() -> None:
    made = law()
    made.reset()
    run(made, 1)
    pressed(made, "aside")
    for _ in range(200):
        made.update(DT)  # nothing is let through
    assert np.abs(made.output["q"] - Q).max() < 0.02
    q, v = run(made, 400)
    assert np.abs(v).max() <= 1.0 + 1e-9
    assert q[-1] == pytest.approx([ASIDE[name] for name in ROBOT.labels], abs=1e-6)


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"waypoints": {"far": {**AHEAD, "yaw": 90.0}}}, "waypoints.far: yaw at 90 isn't within -1.5 to 1.5"),
        ({"waypoints": {"far": {"yaw": 0.0}}}, "waypoints.far"),
        ({"then": {"ahead": "asside"}}, "no waypoint 'asside'.*'aside'"),
        ({"speed": {"yaw": 1.0}}, "speed"),
    ],
)
def test_options_that_do_not_fit_are_refused(options: dict[str, Any], reason: str) -> None:
    with pytest.raises(ValidationError, match=reason):
        law(**options)
