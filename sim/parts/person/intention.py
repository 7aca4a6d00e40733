"""A simulated person's intention: where the tool should be at each step of a plan."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt
from typing import Final, cast

import numpy as np

from srl.runtime.contracts.rotation import Vector, error, exp, normalised, product, turned
from srl.runtime.contracts.signals import Array
from srl.sim.parts.person.path import ArcPath, Pose, circle, read_path
from srl.sim.parts.person.plans import Follow, GoTo, Insert, Plan, Press, Step, Wait, Withdraw

_PEAK: Final = 1.875  # greatest velocity of a minimum-jerk motion over its mean velocity
_SHORTEST: Final = 0.3  # s, shortest duration of a reaching motion; ours
_RUN_UP: Final = 0.5  # s, from rest to the speed along a curve; ours
_PROGRESS: Final = 0.001  # m, less of which in the time it should take, and a reaction, is a stall; ours
_EASE: Final = 0.1  # s, time constant with which a resting hand follows the handle; ours
_ZERO: Final = (0.0, 0.0, 0.0)


@dataclass
class Aim:
    """The state that is kept between two updates. Times are s of world time; -1: not yet."""

    step: float = 0.0
    due: float = 0.0  # when the step begins
    started: float = -1.0
    settled: float = -1.0  # since when within the tolerances; on a curve: last time when the error was small enough
    length: float = 0.0  # s, duration of a reaching motion
    start: Pose = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    goal: Pose = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    turn: Vector = _ZERO  # rotation vector from start to goal
    way: float = 0.0  # m, distance along a curve or a direction
    pace: float = 0.0  # m/s, speed along it
    stop: float = 0.0  # number of the next stop on a curve
    paused: float = -1.0  # s, end of the pause
    missed: float = 0.0
    push: float = 0.0  # N, the most that a push exerts now
    deepest: float = 0.0  # m, the farthest that a push has been seen to get
    pose: Pose = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    velocity: Vector = _ZERO
    acceleration: Vector = _ZERO
    spin: Vector = _ZERO


class Intention:
    """Runs a plan; reaching motions are minimum-jerk (Flash and Hogan 1985), limited to the preferred speed.

    Attributes:
        aim: its state. `aim.pose` is the intended pose of the tool, in the world; `velocity`, `acceleration` and `spin`
            (rad/s) describe how it moves.
    """

    def __init__(
        self,
        plan: Plan,
        *,
        speed: float,
        turn_speed: float,
        reaction: float,
        stiffness: float,
        steering: float = 0.078,
        rise: float = 0.0,
        most: float = 40.0,
        lasting: Callable[[float], float] | None = None,
        beside: Vector = _ZERO,
        toward: Callable[[Vector], Vector] = lambda direction: direction,
        find: Callable[[str], Pose],
        sites: Callable[[str], Array],
    ) -> None:
        """
        Args:
            speed, turn_speed: m/s and rad/s, greatest speeds of a reaching motion.
            reaction: s, from the end of a step to the beginning of the next.
            stiffness: N/m of the hand; it sets how far a push's reference may be ahead.
            steering: s, of the steering law, for curves whose play is known.
            rise, most: N/s and N, by which a stalled push grows, and to what.
            lasting: s that a reach over so many m takes; None: `speed` decides.
            beside: m, world axes, from where a thing is to where the person takes it to be.
            toward: the direction in which the person pushes who means a given one.
            find: returns the present pose of a site or body.
            sites: returns the present positions (n, 3) of numbered sites, by their prefix.
        """
        self.plan, self.aim = plan, Aim(due=reaction)
        self._speed, self._turn_speed, self._reaction, self._stiffness = speed, turn_speed, reaction, stiffness
        self._steering, self._rise, self._most, self._lasting = steering, rise, most, lasting
        self._beside, self._toward = beside, toward
        self._find, self._sites = find, sites
        self._path: tuple[tuple[float, ...], ArcPath, list[float]] | None = None

    def begin(self, pose: Pose) -> None:
        """Starts with the tool's present pose as the intended one."""
        self.aim.pose = pose

    @property
    def step(self) -> Step | None:
        """The present step; None when all are done."""
        k = int(self.aim.step)
        return self.plan[k] if k < len(self.plan) else None

    @property
    def acting(self) -> Step | None:
        """The step being carried out; None before its reaction time is over."""
        return self.step if self.aim.started >= 0 else None

    @property
    def pushing(self) -> tuple[Vector, float] | None:
        """Direction of the push being carried out, and the most force along it, N; else None."""
        step = self.acting
        return (self._toward(step.direction), self.aim.push) if isinstance(step, Insert | Withdraw) else None

    def pressed(self, button: str) -> bool:
        """Whether a button is pressed now."""
        if self.aim.started < 0:  # as `acting`: this is asked of each button in each cycle
            return False
        step = self.step
        return isinstance(step, Press) and step.button == button

    def quit(self) -> None:
        """Ends the plan early."""
        self.aim.step = float(len(self.plan))
        self.aim.started = -1.0
        self._rest()

    def update(self, t: float, dt: float, seen: Pose, felt: Pose, off: float) -> None:
        """Advances the plan by one update.

        Args:
            t: world time, s.
            dt: s since the last update.
            seen: pose of the tool as the person sees it, delayed.
            felt: present pose of the tool.
            off: m, seen distance from the pose intended at that time.
        """
        aim, step = self.aim, self.step
        if step is None:
            return
        if aim.started < 0:
            if t < aim.due:
                return
            aim.started, aim.settled, aim.way, aim.pace, aim.stop, aim.paused = t, -1.0, 0.0, 0.0, 0.0, -1.0
            self._begin(step)
        since = t - aim.started
        if isinstance(step, GoTo):
            done = self._reach(step, t, since, seen)
        elif isinstance(step, Follow):
            done = self._follow(step, t, dt, since, off)
        elif isinstance(step, Insert | Withdraw):
            done = self._push(step, t, dt, since, seen)
        else:
            if isinstance(step, Wait):
                self._go_along(dt, felt)
            done = since >= step.seconds
        if done:
            self._rest()
            aim.step, aim.started, aim.due = aim.step + 1.0, -1.0, t + self._reaction

    # -- steps

    def _begin(self, step: Step) -> None:
        aim = self.aim
        aim.start = aim.pose
        if isinstance(step, GoTo):
            self._reach_for(self._goal(step), step.speed)
        elif isinstance(step, Follow):
            self._reach_for(self._curve(step)[0].at(0.0), None)
            if _apart(aim.start, aim.goal) < 1e-3:
                aim.length = 0.0
        elif isinstance(step, Insert | Withdraw):
            aim.push, aim.deepest, aim.settled = step.force, 0.0, aim.started

    def _goal(self, step: GoTo) -> Pose:
        x, y, z, *q = self.aim.pose
        bx, by, bz = self._beside
        if step.target is not None:
            *at, w, i, j, k = self._find(step.target)
            ox, oy, oz = turned((w, i, j, k), step.offset)
            x, y, z = at[0] + ox + bx, at[1] + oy + by, at[2] + oz + bz
            if step.align:
                q = [w, i, j, k]
        elif step.by is not None:
            x, y, z = x + step.by[0], y + step.by[1], z + step.by[2]
        elif step.position is not None:
            x, y, z = step.position[0] + bx, step.position[1] + by, step.position[2] + bz
        if step.quaternion is not None:
            q = list(normalised(step.quaternion))
        return (x, y, z, q[0], q[1], q[2], q[3])

    def _reach_for(self, goal: Pose, speed: float | None) -> None:
        """Begins a reach; a `speed` that is given isn't the person's own choice."""
        aim = self.aim
        aim.goal, aim.turn = goal, error(goal[3:], aim.start[3:])
        angle, far = sqrt(sum(v * v for v in aim.turn)), _apart(aim.start, goal)
        if speed is None and self._lasting is not None:
            length = self._lasting(far) if far > 1e-6 else 0.0
        else:
            length = _PEAK * far / (speed or self._speed)
        aim.length = max(length, _PEAK * angle / self._turn_speed, _SHORTEST)

    def _reach(self, step: GoTo, t: float, since: float, seen: Pose) -> bool:
        aim = self.aim
        if since < aim.length:
            self._swing(since / aim.length)
            return False
        self._swing(1.0)
        if _apart(seen, aim.goal) < step.tolerance and _angle(seen, aim.goal) < step.angle:
            if aim.settled < 0:
                aim.settled = t
            return t - aim.settled >= step.dwell
        aim.settled = -1.0
        return self._late(since > aim.length + step.patience)

    def _swing(self, s: float) -> None:
        """Sets the aim for the share s of a minimum-jerk motion's duration."""
        aim, T = self.aim, self.aim.length
        share = s * s * s * (10.0 + s * (6.0 * s - 15.0))
        rate = 30.0 * s * s * (1.0 - s) * (1.0 - s) / T
        bend = 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / (T * T)
        a, b = aim.start, aim.goal
        way = (b[0] - a[0], b[1] - a[1], b[2] - a[2])
        w = aim.turn
        q = product(exp(share * w[0], share * w[1], share * w[2]), a[3:])
        aim.pose = (a[0] + share * way[0], a[1] + share * way[1], a[2] + share * way[2], *q)
        aim.velocity = (rate * way[0], rate * way[1], rate * way[2])
        aim.acceleration = (bend * way[0], bend * way[1], bend * way[2])
        aim.spin = (rate * w[0], rate * w[1], rate * w[2])

    def _follow(self, step: Follow, t: float, dt: float, since: float, off: float) -> bool:
        aim = self.aim
        if since < aim.length:
            self._swing(since / aim.length)
            return False
        path, stops = self._curve(step)
        if aim.paused >= 0:
            self._rest()
            if t < aim.paused:
                return False
            aim.paused = -1.0
        left = stops[int(aim.stop)] - aim.way
        speed, caution = step.speed, step.caution
        if step.width is not None:
            # Steering law (Accot and Zhai 1997), place by place: what is left of the play on the nearer side, twice.
            speed, caution = step.width / self._steering, step.width / 2.0
        brake = speed / _RUN_UP
        wanted = min(speed, sqrt(2.0 * brake * max(left, 0.0))) * max(0.0, 1.0 - off / caution)
        if step.width is not None and step.turning:
            # Where the tool must be turned, no faster than the person turns things, and slow enough in time.
            here, there = self._along(path, aim.way), self._along(path, aim.way + aim.pace * _RUN_UP)
            wanted = min(wanted, self._turn_speed / max(path.bend(here, there), 1e-6))
        aim.pace += min(max(wanted - aim.pace, -2 * brake * dt), brake * dt)
        moved = min(max(aim.pace, 1e-4) * dt, left) if off < caution else max(aim.pace, 0.0) * dt
        aim.way += min(moved, left)
        if off < caution or aim.settled < 0:
            aim.settled = t
        if self._late(t - aim.settled > step.patience):
            return True
        last = aim.pose
        x, y, z, *q = path.at(self._along(path, aim.way))
        aim.pose = (x, y, z, q[0], q[1], q[2], q[3])
        aim.velocity = ((x - last[0]) / dt, (y - last[1]) / dt, (z - last[2]) / dt)
        aim.acceleration = _ZERO
        wx, wy, wz = error(aim.pose[3:], last[3:])
        aim.spin = (wx / dt, wy / dt, wz / dt)
        if stops[int(aim.stop)] - aim.way > 1e-6:
            return False
        aim.stop += 1.0
        aim.pace = 0.0
        if int(aim.stop) == len(stops):
            return True
        if abs(aim.way - path.length) > 1e-6:  # no pause at the far end, only a change of direction
            aim.paused = t + step.pause
        return False

    @staticmethod
    def _along(path: ArcPath, way: float) -> float:
        """m from the curve's beginning, there and back."""
        return way if way <= path.length else 2 * path.length - way

    def _curve(self, step: Follow) -> tuple[ArcPath, list[float]]:
        """The step's curve and its stops, m; computed once, and again after a world was restored."""
        key = (self.aim.step, *self.aim.start)
        if self._path is None or self._path[0] != key:
            start = self.aim.start
            if step.along is not None:
                points = self._sites(step.along)
            elif step.points is not None:
                points = np.array(step.points)
            elif step.file is not None:
                points = read_path(step.file)
            else:
                points = circle(start[:3], cast(float, step.circle)) - self._beside  # it begins here
            points = points + self._beside
            path = ArcPath(points, start[3:], turning=step.turning)
            stops = [share * path.length for share in step.pauses] + [path.length]
            if step.back:
                stops += [2 * path.length - s for s in reversed(stops[:-1])] + [2 * path.length]
            self._path = key, path, stops
        return self._path[1], self._path[2]

    def _push(self, step: Insert | Withdraw, t: float, dt: float, since: float, seen: Pose) -> bool:
        aim, d = self.aim, self._toward(step.direction)
        a = aim.start
        deep = sum((seen[i] - a[i]) * d[i] for i in range(3))
        if deep > aim.deepest + _PROGRESS:
            aim.deepest, aim.settled = deep, t
        if self._rise > 0.0 and t - aim.settled > self._reaction + _PROGRESS / step.speed:
            aim.push = max(min(aim.push + self._rise * dt, self._most), aim.push)
        way = min(aim.way + step.speed * dt, deep + 1.5 * aim.push / self._stiffness)
        way = max(way, aim.way - step.speed * dt)
        way = min(way, step.depth + 0.5 * aim.push / self._stiffness)
        pace = (way - aim.way) / dt
        aim.way = way
        aim.pose = (a[0] + way * d[0], a[1] + way * d[1], a[2] + way * d[2], *a[3:])
        aim.velocity = (pace * d[0], pace * d[1], pace * d[2])
        aim.acceleration = aim.spin = _ZERO
        if deep >= step.depth or self._late(since > step.depth / step.speed + step.patience):
            end = min(max(deep, 0.0), step.depth)
            aim.pose = (a[0] + end * d[0], a[1] + end * d[1], a[2] + end * d[2], *a[3:])
            return True
        return False

    def _go_along(self, dt: float, felt: Pose) -> None:
        aim, k = self.aim, min(dt / _EASE, 1.0)
        x, y, z, *q = aim.pose
        wx, wy, wz = error(felt[3:], (q[0], q[1], q[2], q[3]))
        q = list(normalised(product(exp(k * wx, k * wy, k * wz), (q[0], q[1], q[2], q[3]))))
        aim.pose = (x + k * (felt[0] - x), y + k * (felt[1] - y), z + k * (felt[2] - z), q[0], q[1], q[2], q[3])

    def _late(self, over: bool) -> bool:
        self.aim.missed += over
        return over

    def _rest(self) -> None:
        self.aim.velocity = self.aim.acceleration = self.aim.spin = _ZERO


def buttons(plan: Plan) -> tuple[str, ...]:
    """Names of the buttons that a plan presses, each once."""
    return tuple(dict.fromkeys(step.button for step in plan if isinstance(step, Press)))


def _apart(a: Pose, b: Pose) -> float:
    return sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


def _angle(a: Pose, b: Pose) -> float:
    x, y, z = error(a[3:], b[3:])
    return sqrt(x * x + y * y + z * z)
