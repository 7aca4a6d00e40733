"""`waypoints`: a limb goes to named postures, in time-optimal motions with bounded jerk."""

from __future__ import annotations

from typing import Any, Final, Self

import numpy as np
import ruckig
from pydantic import Field, model_validator

from srl.control.arm.options import each, joints
from srl.control.shared.ramp import Ramps, factor
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.errors import OptionError, nearest
from srl.runtime.contracts.per_element import Finite, Positive
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.models.robot_model import RobotOption

_SAME: Final = 1e-6  # rad or m, by which a command that was let through may differ

_PerJoint = dict[str, Positive] | Positive


class WaypointsConfig(ControllerConfig):
    """Options of `waypoints`."""

    robot: RobotOption = Field(description="the arm, for its joints and their limits")
    waypoints: dict[str, dict[str, Finite]] = Field(min_length=1, description="rad or m, by name and by joint")
    then: dict[str, str] = Field(default_factory=dict, description="waypoint that follows by itself, by waypoint")
    rest: float = Field(0.0, ge=0, description="s at a waypoint before the one that follows")
    speed: _PerJoint = Field(description="rad/s, by joint")
    acceleration: _PerJoint = Field(description="rad/s2, by joint")
    jerk: _PerJoint = Field(description="rad/s3, by joint")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        robot = self.robot
        for name, posture in self.waypoints.items():
            values = each(posture, robot, f"waypoints.{name}")
            for joint, value, lower, upper in zip(robot.labels, values, robot.q_lower, robot.q_upper, strict=True):
                if not lower <= value <= upper:
                    problem = f"waypoints.{name}: {joint} at {value:g} isn't within {lower:g} to {upper:g}"
                    raise OptionError(problem, "Give it in rad, or m where it slides")
        for key in ("speed", "acceleration", "jerk"):
            each(getattr(self, key), robot, key)
        for name in (*self.then, *self.then.values()):
            if name not in self.waypoints:
                raise OptionError(f"then: there is no waypoint '{name}'", nearest(name, self.waypoints))
        return self


class Waypoints(Controller):
    """Goes to a waypoint when its element of `go` rises above a half; all joints arrive at the same time.

    Inputs: `go` (k,), 1 by waypoint, such as buttons. Outputs: `q` (n,) rad and `q_velocity` (n,) rad/s (m and m/s of a
    joint that slides); `at` (k,), 1 at the waypoint where the limb was commanded to rest.

    The motions are Ruckig's (Berscheid and Kroeger 2021, RSS): the fastest within speed, acceleration and jerk. A new
    waypoint is taken up in motion. After a reset the limb stands, also while an element is still high. What the guard
    holds back isn't wound up: the motion is planned anew from what was applied. If at a reset nobody knows where the
    limb is, no waypoint is taken and the command isn't a number, until it is known.
    """

    Config = WaypointsConfig
    summary = "a limb goes to named postures, fast, with bounded jerk (ruckig)"

    def __init__(self, name: str, config: WaypointsConfig) -> None:
        super().__init__(name, config)
        robot, names = config.robot, tuple(config.waypoints)
        self.inputs = (Signal(name="go", shape=(len(names),), unit="1", labels=names),)
        self.outputs = (
            joints(robot, "q", "rad"), joints(robot, "q_velocity", "rad/s"),
            Signal(name="at", shape=(len(names),), unit="1", labels=names),
        )  # fmt: skip
        self._ramps = Ramps(factor("speed", 0.0, 1.0, "of all speeds; 0 waits on the way"))
        self.parameters = self._ramps.parameters
        self._config, self._n, self._names = config, robot.n, names
        self._postures = [each(config.waypoints[name], robot, name) for name in names]
        self._then = {names.index(a): names.index(b) for a, b in config.then.items()}
        self._otg = ruckig.Ruckig(robot.n)
        self._plan: Any = None
        self._ask = ruckig.InputParameter(robot.n)
        self._ask.max_velocity = each(config.speed, robot, "speed").tolist()
        self._ask.max_acceleration = each(config.acceleration, robot, "acceleration").tolist()
        self._ask.max_jerk = each(config.jerk, robot, "jerk").tolist()
        self._goal, self._arrived = -1, False
        self._time = self._left = 0.0
        self._q, self._was = np.zeros(robot.n), np.zeros(robot.n)
        self._state: tuple[Array, Array, Array] = (np.zeros(robot.n),) * 3  # of the plan: q, its rate, that one's rate
        self._high = np.ones(len(names), dtype=bool)
        self._plans = self._arrivals = self._failures = 0

    def reset(self) -> None:
        self._ramps.reset(self.param)
        self._high[:] = True  # a button that is held through a reset moves nothing
        self._stand(self.applied.get("q", self.output["q"]))
        self._write(np.zeros(self._n))

    def _stand(self, q: Array) -> None:
        self._q[:], self._was[:] = q, q
        self._plan, self._goal, self._arrived = None, -1, False
        self._state = (self._q.copy(), np.zeros(self._n), np.zeros(self._n))

    def update(self, dt: float) -> None:
        self._ramps.update(self.param, dt)
        share = self._ramps.values["speed"]
        self._heed(dt, share)
        go = self.input["go"]
        if np.isfinite(go).all():
            rising = np.flatnonzero((go > 0.5) & ~self._high)
            self._high[:] = go > 0.5
            if len(rising) and np.isfinite(self._q).all():
                self._begin(int(rising[0]))
        if self._arrived and self._goal in self._then:
            self._left -= dt
            if self._left <= 0.0:
                self._begin(self._then[self._goal])
        self._was[:] = self._q
        rate = np.zeros(self._n)
        if self._plan is not None:
            self._time = min(self._time + share * dt, self._plan.duration)
            self._state = tuple(np.array(v) for v in self._plan.at_time(self._time))  # type: ignore[assignment]
            self._q[:], rate = self._state[0], share * self._state[1]
            if self._time >= self._plan.duration:
                self._arrive()
                rate = np.zeros(self._n)
        self._write(rate)

    def metrics(self) -> dict[str, object]:
        """Motions planned, waypoints reached, and plans that failed."""
        return {"plans": self._plans, "arrivals": self._arrivals, "failures": self._failures}

    def _heed(self, dt: float, share: float) -> None:
        """Begins anew where the guard let less of the last step through."""
        applied = self.applied.get("q")
        if applied is None or not np.isfinite(applied).all():
            return
        if not np.isfinite(self._q).all():
            self._stand(applied)
        elif (np.abs(applied - self._q) > _SAME).any() and self._goal >= 0:
            real = (applied - self._was) / max(dt, 1e-9) / max(share, 0.1)
            planned = self._state[1]
            rate = np.clip(real, np.minimum(planned, 0.0), np.maximum(planned, 0.0))
            self._q[:] = applied
            self._state = (applied.copy(), rate, np.zeros(self._n))
            self._begin(self._goal)

    def _begin(self, goal: int) -> None:
        ask = self._ask
        q, rate, acceleration = self._state
        ask.current_position, ask.current_velocity = q.tolist(), rate.tolist()
        ask.current_acceleration = acceleration.tolist()
        ask.target_position = self._postures[goal].tolist()
        plan = ruckig.Trajectory(self._n)
        try:
            failed = self._otg.calculate(ask, plan) != ruckig.Result.Working
        except ruckig.RuckigError:
            failed = True
        if failed:  # the motion that it had goes on to its end
            self._failures += 1
            return
        self._plan, self._time, self._goal, self._arrived = plan, 0.0, goal, False
        self._plans += 1

    def _arrive(self) -> None:
        self._plan, self._arrived, self._left = None, True, self._config.rest
        self._state = (self._q.copy(), np.zeros(self._n), np.zeros(self._n))
        self._arrivals += 1

    def _write(self, rate: Array) -> None:
        self.output["q"][:], self.output["q_velocity"][:] = self._q, rate
        self.output["at"][:] = 0.0
        if self._arrived:
            self.output["at"][self._goal] = 1.0
