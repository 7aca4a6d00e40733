"""The tolerances of a control_msgs/action/FollowJointTrajectory goal, by ros2_control's rules.

Source: control_msgs, JointTolerance.msg; ros2_controllers, joint_trajectory_controller, tolerances.hpp.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from srl.runtime.contracts.errors import RequestError
from srl.runtime.contracts.signals import Array

STOPPED = 0.01  # rad/s or m/s of a joint that is at its goal, ros2_control's default
_KINDS = ("position", "velocity")


@dataclass(frozen=True)
class Tolerances:
    """What a goal allows between what it asks for and what the device measures; infinite where it says nothing.

    Attributes:
        path: (2, n) of position (rad or m) and velocity (rad/s or m/s), on the way.
        goal: (2, n) likewise, at the end.
        time: s after the end in which the joints must be within `goal`; infinite: as long as it takes.
    """

    path: Array
    goal: Array
    time: float

    @classmethod
    def read(cls, goal: dict[str, Any], names: Sequence[str], measured: Sequence[bool], place: str) -> Tolerances:
        """
        Args:
            goal: the decoded FollowJointTrajectory_Goal.
            names: of the n joints.
            measured: whether the device measures position and velocity.
            place: for the error.
        Raises:
            RequestError: it asks for what nobody can judge, or isn't one by the rules.
        """
        if (
            goal["multi_dof_trajectory"]["points"]
            or goal["component_path_tolerance"]
            or goal["component_goal_tolerance"]
        ):
            raise RequestError(
                place, "it moves joints of several degrees of freedom", "Leave the multi_dof parts empty"
            )
        none = np.full(2, np.inf)
        at_rest = np.array([np.inf, STOPPED if measured[1] else np.inf])
        made = [_bounds(goal[f"{which}_tolerance"], names, measured, f"{place}: {which}_tolerance", otherwise)
                for which, otherwise in (("path", none), ("goal", at_rest))]  # fmt: skip
        late = goal["goal_time_tolerance"]["sec"] + 1e-9 * goal["goal_time_tolerance"]["nanosec"]
        if late < 0.0 and late != -1.0:
            raise RequestError(f"{place}: goal_time_tolerance", f"{late:g} s is negative", "Send s, 0 or -1 (none)")
        return cls(made[0], made[1], late if late > 0.0 else np.inf)


def _bounds(
    given: list[dict[str, Any]], names: Sequence[str], measured: Sequence[bool], place: str, otherwise: Array
) -> Array:  # fmt: skip
    """(2, n); `otherwise`: (2,) of a joint that is given 0."""
    bounds = np.repeat(otherwise[:, None], len(names), axis=1)
    for each in given:
        if each["name"] not in names:
            raise RequestError(place, f"'{each['name']}' is none of the joints", f"Name some of {', '.join(names)}")
        if each["acceleration"] not in (0.0, -1.0):
            raise RequestError(place, "nothing measures accelerations", "Leave acceleration 0")
        for k, kind in enumerate(_KINDS):
            bound = float(each[kind])
            if not (bound >= 0.0 or bound == -1.0) or bound == np.inf:
                raise RequestError(place, f"{kind} {bound:g} of '{each['name']}'", "Send a bound, 0 or -1 (none)")
            if bound > 0.0 and not measured[k]:
                raise RequestError(place, f"the device doesn't measure the {kind} of '{each['name']}'", "Leave it 0")
            if bound:
                bounds[k, names.index(each["name"])] = bound if bound > 0.0 else np.inf
    return bounds


def exceeded(bounds: Array, error: Array, names: Sequence[str]) -> str:
    """Says which joint is beyond its tolerance; "" if none is.

    Args:
        bounds: (2, n) of `Tolerances`.
        error: (2, n): desired minus measured; NaN counts as beyond, where there is a bound.
        names: of the joints.
    """
    beyond = ~(np.abs(error) <= bounds) & np.isfinite(bounds)
    for k, j in np.argwhere(beyond):
        return f"'{names[j]}' is off by {error[k, j]:.3g} in {_KINDS[k]}, beyond {bounds[k, j]:.3g}"
    return ""
