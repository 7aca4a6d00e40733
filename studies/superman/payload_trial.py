"""Trials of the watched payload: a person guides an arm with a load, hits something, or the load falls.

What the law `payload` of the profile is given is computed here: the tool's motion, the rigid load's wrench by Newton
and Euler with its whole inertia, the tool's own inertia, the person's hand, noise, and a bias that drifts. There is no
robot in it: the arm follows its path whatever it hits, until the law stops it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from ruamel.yaml import YAML
from scipy.spatial.transform import Rotation

from srl.control.cobot.load_watch import Phase
from srl.control.cobot.payload import Payload, PayloadConfig
from srl.runtime.contracts.gravity import DOWN
from srl.runtime.contracts.signals import Array
from srl.runtime.testing.bound import bound
from srl.studies.tasks.task import Value

_G: Final = np.array(DOWN)
_BEFORE, _LIFT, _AFTER = 1.0, 0.15, 1.0  # s with the gripper open; m; s after the lift
_TIMEOUT: Final = 1.0  # s, after which an unseen contact or loss counts as never seen
_DIRECTIONS: Final = {"above": (0.0, 0.0, -1.0), "beside": (1.0, 0.0, 0.0), "below": (0.0, 0.0, 1.0)}


@dataclass
class Course:
    """The tool's motion: n instants. Positions, velocities and accelerations (n, 3), m and s, of its origin, world."""

    x: Array
    v: Array
    a: Array
    turn: Rotation
    w: Array
    z: Array


class Sensed:
    """The law, and what it is given.

    Attributes:
        law: bound, with arrays of its own.
        mass, com, inertia: the load's, kg, m in the tool's axes, kg m^2 about its middle.
    """

    def __init__(self, text: str, s: Mapping[str, Any], seed: int) -> None:
        entries = YAML(typ="safe", pure=True).load(text)["controllers"]
        found = next(entry for entry in entries if entry["use"] == "payload")
        options = {k: v for k, v in found.items() if k not in ("use", "name", "in", "out")}
        self.law = bound(Payload("payload", PayloadConfig(**options | {"axes": "world"})))  # the tool is at the flange
        self.s, self.rng = s, np.random.default_rng(seed)
        self.dt: float = 1.0 / s["rate"]
        self.mass = self.rng.uniform(*s["mass"])
        self.com = self.rng.uniform(*np.array(s["com"]).T)
        x, y, z = s["size"]
        self.inertia = self.mass / 12 * np.diag([y * y + z * z, x * x + z * z, x * x + y * y])
        self.bias = self._drawn(s["accuracy"])
        self._late = [np.zeros(6)] * max(round(s["late"] / self.dt), 1)

    def _drawn(self, accuracy: Mapping[str, float]) -> Array:
        """A bias of which 95 % lie within the sensor's accuracy."""
        return self.rng.normal(0, np.repeat([accuracy["force"], accuracy["torque"]], 3) / 1.96)

    def pull(self, c: Course, mass: float, com: Array, inertia: Array) -> Array:
        """(n, 6) N, N m: a rigid body's wrench on the tool, at its origin, world axes."""
        r = c.turn.apply(com)
        force = mass * (_G - c.a - np.cross(c.z, r) - np.cross(c.w, np.cross(c.w, r)))
        R = c.turn.as_matrix()
        I = R @ inertia @ np.swapaxes(R, 1, 2)  # noqa: E741
        spun = np.einsum("nij,nj->ni", I, c.z) + np.cross(c.w, np.einsum("nij,nj->ni", I, c.w))
        return np.hstack([force, np.cross(r, force) - spun])

    def wrench(self, c: Course, share: Array) -> Array:
        """(n, 6): of a share (n,) of the load and of the tool's inertia; its weight is taken off in the arm."""
        s = self.s
        tool = self.pull(c, s["tool"], np.array(s["tool_com"]), np.zeros((3, 3)))
        still = Course(c.x, 0 * c.v, 0 * c.a, c.turn, 0 * c.w, 0 * c.z)
        tool -= self.pull(still, s["tool"], np.array(s["tool_com"]), np.zeros((3, 3)))
        return share[:, None] * self.pull(c, self.mass, self.com, self.inertia) + tool

    def feel(self, c: Course, wrench: Array, closed: bool) -> dict[str, Array]:
        """Runs the law; returns its outputs (n, ...), and `contact` and `stop` (n,)."""
        s, n, rng, law = self.s, len(c.x), self.rng, self.law
        keep = np.exp(-self.dt / s["drift_time"])
        hand = s["admittance"]["mass"] * c.a + s["admittance"]["damping"] * c.v
        noise = rng.normal(0, np.repeat([s["noise"]["force"], s["noise"]["torque"]], 3), (n, 6))
        speeds = rng.normal(0, np.repeat([s["speed_noise"], s["turn_noise"]], 3), (n, 6))
        felt = rng.normal(0, s["hand_noise"], (n, 3))
        at = np.hstack([c.x, c.turn.as_quat()[:, [3, 0, 1, 2]]])
        R = c.turn.as_matrix()
        out = {name: np.zeros((n, *array.shape)) for name, array in law.output.items()}
        out |= {"contact": np.zeros(n, bool), "stop": np.zeros(n, bool)}
        for k in range(n):
            self.bias = keep * self.bias + np.sqrt(1 - keep * keep) * self._drawn(s["accuracy"])
            pushed = np.concatenate([hand[k], np.zeros(3)])
            self._late.append(pushed)
            offset = np.concatenate([R[k] @ self.bias[:3], R[k] @ self.bias[3:]])
            given = law.input
            given["flange_wrench"][:] = wrench[k] + self._late.pop(0) + noise[k] + offset
            given["hand"][:3] = hand[k] + felt[k]
            given["pose"][:] = at[k]
            given["twist"][:] = np.hstack([c.v[k], c.w[k]]) + speeds[k]
            given["modes"][2] = closed
            law.update(self.dt)
            for name, array in law.output.items():
                out[name][k] = array
            out["contact"][k], out["stop"][k] = law.watch.contact, law.contact
        return out

    def rest(self, x: Array, seconds: float) -> Course:
        """The tool at rest."""
        n = max(round(seconds / self.dt), 1)
        return course(np.repeat(x[None], n, axis=0), self._down(n), self.dt)

    def _down(self, n: int) -> Rotation:
        return Rotation.from_euler("x", np.full((n, 1), np.pi))

    def pick_up(self) -> Array:
        """The gripper closes, takes the weight over and lifts the load; returns where the tool is (3,)."""
        x = np.array([0.5, 0.0, 0.8])
        start = self.rest(x, _BEFORE)
        self.law.input["pose"][3] = 1.0
        self.law.reset()
        self.feel(start, self.wrench(start, np.zeros(len(start.x))), False)
        taken = self.rest(x, 0.3)
        self.feel(taken, self.wrench(taken, np.linspace(0, 1, len(taken.x))), True)
        t = np.arange(round(1.0 / self.dt)) * self.dt
        up = x + _LIFT * smooth(t)[:, None] * np.array([0, 0, 1.0])
        lifted = course(up, self._down(len(t)), self.dt)
        self.feel(lifted, self.wrench(lifted, np.ones(len(t))), True)
        after = self.rest(up[-1], _AFTER)
        self.feel(after, self.wrench(after, np.ones(len(after.x))), True)
        return up[-1]

    def guided(self, x: Array, seconds: float) -> Course:
        """Smooth reaches one after another, with turning, within the stated accelerations and way."""
        s, rng = self.s, self.rng
        places, angles, left = [x[None]], [np.zeros((1, 3))], seconds
        while left > 0:
            way = rng.normal(size=3)
            way *= rng.uniform(*s["reach"]) / np.linalg.norm(way)
            here, turned = places[-1][-1], angles[-1][-1]
            target = np.clip(here + way, x - s["room"], x + s["room"])
            size = max(float(np.linalg.norm(target - here)), 0.02)
            # A minimum-jerk reach over `size` in T has the greatest acceleration 5.77 size / T^2.
            T = max(float(np.sqrt(5.77 * size / rng.uniform(*s["acceleration"]))), 0.4)
            tilt = rng.uniform(-1, 1, 3) * s["turn"]
            p = smooth(np.arange(1, round(T / self.dt) + 1) * self.dt / T)[:, None]
            places.append(here + p * (target - here))
            angles.append(turned + p * (tilt - turned))
            left -= T
        turn = Rotation.from_euler("ZYX", np.vstack(angles)) * Rotation.from_euler("x", np.pi)
        return course(np.vstack(places), turn, self.dt)


def smooth(t: Any) -> Array:
    """The minimum-jerk way from 0 to 1, at t (n,) from 0 to 1."""
    t = np.asarray(t, dtype=float)
    return 10 * t**3 - 15 * t**4 + 6 * t**5


def course(x: Array, turn: Rotation, dt: float) -> Course:
    """The motion through places (n, 3) and orientations."""
    v = np.gradient(x, dt, axis=0) if len(x) > 1 else 0 * x
    a = np.gradient(v, dt, axis=0) if len(x) > 1 else 0 * x
    w = np.zeros_like(x)
    if len(x) > 2:
        w[1:-1] = (turn[2:] * turn[:-2].inv()).as_rotvec() / (2 * dt)
    z = np.gradient(w, dt, axis=0) if len(x) > 1 else 0 * x
    return Course(x, v, a, turn, w, z)


def guide(text: str, parameters: dict[str, Any], seed: int) -> Mapping[str, Value]:
    """A person guides a load for `seconds`, without contact.

    Args:
        text: the profile's, with a law `payload`.
        parameters: `setup`, the assumptions; `seconds`.
        seed: of load, motion and noise.
    Returns:
        hours: of guiding. stops, contacts: number of beginnings. force, torque: N, N m, the largest that was taken for
        something outside. mass: kg, the load's; mass_error; deviation, kg, as the law states it; com_error, m.
    """
    sensed = Sensed(text, parameters["setup"], seed)
    x = sensed.pick_up()
    c = sensed.guided(x, parameters["seconds"])
    found = sensed.feel(c, sensed.wrench(c, np.ones(len(c.x))), True)
    load = found["load"][-1]
    return {
        "hours": len(c.x) * sensed.dt / 3600, "stops": begins(found["stop"]), "contacts": begins(found["contact"]),
        "force": float(np.linalg.norm(found["outside"][:, :3], axis=1).max()),
        "torque": float(np.linalg.norm(found["outside"][:, 3:], axis=1).max()),
        "acceleration": float(np.linalg.norm(c.a, axis=1).max()),
        "mass": sensed.mass, "mass_error": float(load[0] - sensed.mass), "deviation": float(found["deviation"][-1, 0]),
        "com_error": float(np.linalg.norm(load[1:] - sensed.com)),
        "carrying": bool((found["phase"] == Phase.CARRYING).all()),
    }  # fmt: skip


def contact(text: str, parameters: dict[str, Any], seed: int) -> Mapping[str, Value]:
    """The tool with its load meets something stiff, at a speed, and goes on until the law stops it; then it brakes.

    Args:
        text: the profile's, with a law `payload`.
        parameters: `setup`; `where`: "above", "beside" or "below" the tool; `speed`, m/s; `stiffness`, N/m.
        seed: of load and noise.
    Returns:
        seen, stopped: s from the first touch; None if it took longer than a second. force: N, when the law stopped it.
        peak: N, until it stood. assumed: N, what had to be felt in that direction before, with an assumed load.
    """
    s = parameters["setup"]
    sensed = Sensed(text, s, seed)
    place = sensed.pick_up()
    towards = -np.array(_DIRECTIONS[parameters["where"]])  # of the motion; the force is against it
    x, speed, force, seen, stopped, at_stop, peak = place.copy(), 0.0, 0.0, None, None, 0.0, 0.0
    touched, braking, t = -1.0, False, 0.0
    wall = 0.1 + sensed.rng.uniform(0, 0.02)  # m away: the speed is reached before
    while t < 10.0:
        a = -s["brake"] if braking else s["start"] if speed < parameters["speed"] else 0.0
        a = max(a, -speed / sensed.dt)
        speed += a * sensed.dt
        x = x + speed * sensed.dt * towards
        depth = float((x - place) @ towards) - wall
        force = parameters["stiffness"] * max(depth, 0.0)
        if depth > 0.0 and touched < 0.0:
            touched = t
        peak = max(peak, force)
        still = sensed.rest(x, sensed.dt)
        still.v[:], still.a[:] = speed * towards, a * towards
        wrench = sensed.wrench(still, np.ones(1))
        wrench[0, :3] -= force * towards
        found = sensed.feel(still, wrench, True)
        t += sensed.dt
        if touched >= 0.0 and seen is None and found["contact"][0]:
            seen = t - touched
        if touched >= 0.0 and stopped is None and found["stop"][0]:
            stopped, at_stop, braking = t - touched, force, True
        if (braking and speed == 0.0) or (touched >= 0.0 and t - touched > _TIMEOUT):
            break
    return {"mass": sensed.mass, "seen": seen, "stopped": stopped, "force": at_stop, "peak": peak}


def drop(text: str, parameters: dict[str, Any], seed: int) -> Mapping[str, Value]:
    """The load falls out of the gripper while the tool rests.

    Args:
        text: the profile's, with a law `payload`.
        parameters: `setup`.
        seed: of load and noise.
    Returns:
        mass: kg. gone: s until less than a tenth of it is left of the identified load; None if it took longer than a
        second. stops: number of stops.
    """
    sensed = Sensed(text, parameters["setup"], seed)
    x = sensed.pick_up()
    c = sensed.rest(x, _TIMEOUT)
    found = sensed.feel(c, sensed.wrench(c, np.zeros(len(c.x))), True)
    there = found["load"][:, 0] > 0.1 * sensed.mass
    gone = None if there[-1] else float((np.flatnonzero(there)[-1] + 1) * sensed.dt) if there.any() else 0.0
    return {"mass": sensed.mass, "gone": gone, "stops": begins(found["stop"]), "drops": sensed.law.watch.drops}


def begins(flags: Array) -> int:
    """How often a flag (n,) goes from false to true."""
    return int(np.sum(np.diff(flags.astype(int), prepend=0) > 0))
