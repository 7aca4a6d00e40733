"""A simulated person's arm at a handle or with a tool in the hand: impedance, intention, sight, delay and noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import exp as decay
from math import sqrt
from typing import Any, ClassVar, Final, cast
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from srl.runtime.contracts.errors import WiringError, nearest
from srl.runtime.contracts.rotation import (
    Quaternion,
    Vector,
    conjugate,
    error,
    exp,
    normalised,
    product,
    turned,
)
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import POINT, WRENCH
from srl.sim.parts.person.config import PersonConfig
from srl.sim.parts.person.intention import Intention, buttons
from srl.sim.parts.person.known import known_tool
from srl.sim.parts.person.memory import flat, refill
from srl.sim.parts.person.muscles import PULLS, Muscles
from srl.sim.parts.person.noise import Tremor, Wander
from srl.sim.parts.person.path import Pose
from srl.sim.parts.person.places import Places
from srl.sim.parts.person.sight import Sight
from srl.sim.parts.person.vigour import duration
from srl.sim.wearer.forces import load_forces
from srl.sim.world.mjcf import CONTACT, add
from srl.sim.world.part import Mjcf, Part, PartConfig
from srl.sim.world.robot_mjcf import SPECK

_UPDATE: Final = 0.002  # s between two updates
_HAND_INERTIA: Final = 0.004  # kg m^2, of the hand and the part of the forearm that turns with it; ours
_NOISE_TIME: Final = 0.03  # s, correlation time of the force's noise (about 5 Hz); ours
_DRIFT_TIME: Final = 2.0  # s, correlation time of the error in the perceived position of objects; ours
_STIFFENS: Final = 0.2  # s, time constant with which stiffness follows the force; ours
_GIVES_UP: Final = 2.0  # s with too little strength, after which the person gives up
_ZERO: Final = (0.0, 0.0, 0.0)


@dataclass
class _Body:
    """The state between two updates, apart from the intention, and values of the previous update."""

    started: float = 0.0
    place: Vector = _ZERO  # position of the hand, m
    turn: Quaternion = (1.0, 0.0, 0.0, 0.0)
    meant: Pose = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)  # the aim after the muscles' delay
    drive: Vector = _ZERO  # N, the force that moves the known tool, after the delay
    pace: Vector = _ZERO  # m/s and rad/s of the aim, after the delay
    spin: Vector = _ZERO
    twist: Vector = _ZERO  # N m about the tool that turn the known tool
    wander: tuple[float, ...] = (0.0,) * 6
    capacity: float = 1.0
    effort: float = 0.0  # N, the force averaged over the last tenths of a second
    beyond: float = 0.0  # s for which the required force has exceeded the strength
    gave_up: float = 0.0
    wrench: tuple[float, ...] = (0.0,) * 6
    balance: Vector = _ZERO  # m, equilibrium position of the hand
    active: tuple[float, ...] = (0.0,) * len(PULLS)


class PersonPart(Part):
    """A person's arm with the body `<name>/hand`, in whose frame the person grips.

    Force of the hand = K (x_e - x) + D (v_e - v) + the force that moves the known tool and holds its weight + noise +
    tremor, limited to the strength. x_e is the planned position of the tool, after the muscles' delay, plus the
    correction of the errors that the person sees. Sight has a delay, a bandwidth, and a drifting error in the perceived
    position of objects.

    Truth (world axes): `<name>_wrench` (6,) N, N m, of the hand, about it; `<name>_push` (2, 3), its point (m) and
    force (N); `<name>_balance` (3,) m, x_e of the hand;
    `<name>_aim` and `<name>_tool` (3,) m, intended and actual position of the tool; `<name>_activation` (4,)
    0..1; `<name>_capacity` (1,) remaining share of the strength; `<name>_progress` (3,): number of the step, steps
    missed, whether the person gave up the plan.

    Attributes:
        buttons: the buttons that the plan presses.
        duration: s of the recording; None without a recording.
    """

    Config: ClassVar[type[PartConfig]] = PersonConfig
    summary = "a person's arm at a handle or with a tool in the hand, by a plan or as recorded"

    def __init__(self, name: str, config: PartConfig, seed: int) -> None:
        super().__init__(name, config, seed)
        self._config = config = cast(PersonConfig, config)
        self.buttons = buttons(config.plan)
        self.truth = (
            Signal(name=f"{name}_wrench", shape=(6,), unit="N, N m", labels=WRENCH),
            Signal(
                name=f"{name}_push",
                shape=(2, 3),
                unit="m, N",
                labels=("hand", "force"),
                components=(POINT,),
                visual="arrow",
            ),
            Signal(name=f"{name}_balance", shape=(3,), unit="m", labels=POINT),
            Signal(name=f"{name}_aim", shape=(3,), unit="m", labels=POINT),
            Signal(name=f"{name}_tool", shape=(3,), unit="m", labels=POINT),
            Signal(name=f"{name}_activation", shape=(len(PULLS),), unit="1", labels=tuple(PULLS)),
            Signal(name=f"{name}_capacity", shape=(1,), unit="1"),
            Signal(name=f"{name}_progress", shape=(3,), unit="1", labels=("step", "missed", "gave_up")),
        )
        self._forces = (
            None if config.recording is None else load_forces(config.recording, f"sim.parts.{name}.recording")
        )
        self.duration = None if self._forces is None else self._forces.duration
        self._muscles = Muscles(config.strength, config.facing, config.arm_load)
        self._tremor = Tremor(seed, name, config.tremor, config.hand_mass)
        self._body = _Body()

    # -- the model

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        config, name = self._config, self.name
        self._free = free = parent is mjcf.worldbody
        if free and config.recording is not None:
            problem = "a 'recording' is replayed at a handle, and this person stands in the world"
            raise WiringError(f"sim.parts.{name}.at", problem, "Name a body of the handle, such as grip/grip")
        hand = mjcf.body(parent, f"{name}/hand", **self.at())
        mass, inertia = (config.hand_mass, _HAND_INERTIA) if free else (SPECK, SPECK)
        add(hand, "inertial", pos=(0, 0, 0), mass=mass, diaginertia=(inertia,) * 3)
        if free:
            hand.set("gravcomp", "1")
            add(hand, "freejoint", name=f"{name}/hand")
        add(
            hand,
            "geom",
            name=f"{name}/hand",
            type="sphere",
            size=0.035,
            mass=0,
            rgba="0.85 0.68 0.58 1",
            **CONTACT["none"],
        )

    def bind(self, model: Any, data: Any) -> None:
        self._model, self._data, config = model, data, self._config
        timestep = float(model.opt.timestep)
        self.every = max(1, round(_UPDATE / timestep))
        self._timestep, self._dt = timestep, self.every * timestep
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        hand = int(model.body(f"{self.name}/hand").id)
        self._place, self._turn, self._applied = data.xpos[hand], data.xquat[hand], data.xfrc_applied[hand]
        places = Places(model, data, self.name)
        self._reach = places.fixed_in(hand, config.tool)
        self._known = known_tool(config, model, data, hand, self._free)
        self._wander = Wander(self.seed, self.name, self._dt, (_NOISE_TIME,) * 3 + (_DRIFT_TIME,) * 3)
        self._sight = Sight(config.sight, config.bandwidth, config.correction, self._dt)
        self._lag = 1.0 - decay(-self._dt / config.activation) if config.activation else 1.0
        self._body = _Body(turn=_four(self._turn.tolist()), place=_three(self._place.tolist()))
        self.intention = Intention(
            config.plan,
            speed=config.speed,
            turn_speed=config.turn_speed,
            reaction=config.reaction,
            stiffness=config.stiffness,
            steering=config.steering,
            rise=config.push_rise,
            most=config.push_most,
            lasting=None if config.reward is None else self._lasting,
            beside=config.aim_bias,
            toward=self._toward,
            find=places.pose,
            sites=places.sites,
        )

    def _lasting(self, distance: float) -> float:
        """s that a reach over so many m takes, with the tool as the person knows it."""
        config = self._config
        known = self._known
        load = known.mass - config.hand_mass if self._free else known.mass
        return duration(distance, config.arm_mass, max(load, 0.0), known.drag, cast(float, config.reward))

    def _toward(self, direction: Vector) -> Vector:
        """The direction in which the person pushes who means a given one."""
        return turned(exp(*self._config.aim_tilt), direction)

    # -- motion

    def drive(self, step: int) -> None:
        mujoco.mj_kinematics(self._model, self._data)  # after a step, bodies are one step behind the joints
        place, turn = _three(self._place.tolist()), _four(self._turn.tolist())
        if self._forces is not None:
            self._replay(step * self._timestep, turn)
            return
        body, config, dt, number = self._body, self._config, self._dt, step // self.every
        reach, grip = turned(turn, self._reach[0]), product(turn, self._reach[1])
        tool: Pose = (place[0] + reach[0], place[1] + reach[1], place[2] + reach[2], *grip)
        if not body.started:
            self._begin(tool, place, turn)
        px, py, pz = body.place
        vx, vy, vz = (place[0] - px) / dt, (place[1] - py) / dt, (place[2] - pz) / dt
        wx, wy, wz = error(turn, body.turn)
        wx, wy, wz = wx / dt, wy / dt, wz / dt
        body.place, body.turn = place, turn
        body.wander = wander = self._wander.next(body.wander, number)

        # What the person saw `sight` ago sets the intention and corrects the muscles' action.
        seen, off = self._sight.seen(number)
        self.intention.update(step * self._timestep, dt, seen, tool, sqrt(off[0] ** 2 + off[1] ** 2 + off[2] ** 2))
        meant = self._lagged()
        drift = config.drift
        ex = meant[0] - tool[0] + drift * wander[3]
        ey = meant[1] - tool[1] + drift * wander[4]
        ez = meant[2] - tool[2] + drift * wander[5]
        rx, ry, rz = error(meant[3:], grip)
        self._sight.take(number, tool, (ex, ey, ez, rx, ry, rz))
        pushing = self.intention.pushing
        shift = self._sight.correction(off, None if pushing is None else pushing[0])

        # Position of the hand that puts the tool where it should be.
        way = turned(meant[3:], turned(conjugate(self._reach[1]), self._reach[0]))
        bx, by, bz = meant[0] - way[0] + shift[0], meant[1] - way[1] + shift[1], meant[2] - way[2] + shift[2]
        body.balance = (bx, by, bz)
        K, D = self._stiffness()
        Kr, Dr = config.turn_stiffness, config.turn_damping
        (sx, sy, sz), push, weight = body.spin, body.drive, self._known.weight
        # The hand's own velocity, at a distance from the tool that it turns.
        pace = (
            body.pace[0] - sy * way[2] + sz * way[1],
            body.pace[1] - sz * way[0] + sx * way[2],
            body.pace[2] - sx * way[1] + sy * way[0],
        )
        fx = K * (bx - place[0]) + D * (pace[0] - vx) + push[0] + weight[0]
        fy = K * (by - place[1]) + D * (pace[1] - vy) + push[1] + weight[1]
        fz = K * (bz - place[2]) + D * (pace[2] - vz) + push[2] + weight[2]
        tx = Kr * (rx + shift[3]) + Dr * (sx - wx)
        ty = Kr * (ry + shift[4]) + Dr * (sy - wy)
        tz = Kr * (rz + shift[5]) + Dr * (sz - wz)
        if not self._free:
            # The force that moves the known tool acts on the tool, not on the hand beside it.
            px, py, pz = body.twist
            tx += px + reach[1] * push[2] - reach[2] * push[1]
            ty += py + reach[2] * push[0] - reach[0] * push[2]
            tz += pz + reach[0] * push[1] - reach[1] * push[0]
        if weight != _ZERO:
            lx, ly, lz = turned(turn, self._known.lever)
            tx += ly * weight[2] - lz * weight[1]
            ty += lz * weight[0] - lx * weight[2]
            tz += lx * weight[1] - ly * weight[0]
        if pushing is not None:
            d, most = pushing
            over = fx * d[0] + fy * d[1] + fz * d[2] - most
            if over > 0:
                fx, fy, fz = fx - over * d[0], fy - over * d[1], fz - over * d[2]
        self._exert((fx, fy, fz), (tx, ty, tz), step * self._timestep)

    def _stiffness(self) -> tuple[float, float]:
        """Stiffness and damping, N/m and N s/m; an arm that exerts more force is stiffer."""
        config, f = self._config, self._body.effort
        more = min(1.0 + config.stiffening * f / config.stiffness, 2.0)
        return config.stiffness * more, config.damping * sqrt(more)

    def _begin(self, tool: Pose, place: Vector, turn: Quaternion) -> None:
        body = self._body
        body.started = 1.0
        body.place, body.turn, body.meant = place, turn, tool
        self.intention.begin(tool)
        self._sight.begin(tool)

    def _lagged(self) -> Pose:
        """Applies the muscles' delay to the aim, its motion and its force; returns the delayed aim."""
        aim, body, k = self.intention.aim, self._body, self._lag
        x, y, z, *q = body.meant
        gx, gy, gz, *_ = aim.pose
        held: Quaternion = (q[0], q[1], q[2], q[3])
        if held != aim.pose[3:]:
            wx, wy, wz = error(aim.pose[3:], held)
            held = normalised(product(exp(k * wx, k * wy, k * wz), held))
        body.meant = meant = (x + k * (gx - x), y + k * (gy - y), z + k * (gz - z), *held)
        tool = self._known
        v, a, m, d = aim.velocity, aim.acceleration, tool.mass, tool.drag
        body.drive = _mixed(body.drive, (m * a[0] + d * v[0], m * a[1] + d * v[1], m * a[2] + d * v[2]), k)
        spin = _mixed(body.spin, aim.spin, k)
        if spin != _ZERO or body.spin != _ZERO or body.twist != _ZERO:
            known = [
                tool.inertia * (w - was) / self._dt + tool.turn_drag * w for w, was in zip(spin, body.spin, strict=True)
            ]
            body.twist = _mixed(body.twist, _three(known), k)
        body.pace, body.spin = _mixed(body.pace, v, k), spin
        return meant

    def _exert(self, force: Vector, torque: Vector, t: float) -> None:
        """Adds unintended forces, limits to the strength, applies the wrench and updates fatigue."""
        body, config, wander = self._body, self._config, self._body.wander
        size = sqrt(force[0] ** 2 + force[1] ** 2 + force[2] ** 2)
        body.effort += self._dt / _STIFFENS * (size - body.effort)
        noise = (config.noise_floor + config.noise * size) / sqrt(3.0)
        most = config.strength * body.capacity
        scale = min(1.0, most / size) if size > 0 else 1.0
        body.beyond = body.beyond + self._dt if scale < 1.0 else 0.0
        shake = self._tremor.at(t)
        force = (
            scale * force[0] + noise * wander[0] + shake[0],
            scale * force[1] + noise * wander[1] + shake[1],
            scale * force[2] + noise * wander[2] + shake[2],
        )
        size = sqrt(force[0] ** 2 + force[1] ** 2 + force[2] ** 2)
        if size > most:
            force = (force[0] * most / size, force[1] * most / size, force[2] * most / size)
        size = sqrt(torque[0] ** 2 + torque[1] ** 2 + torque[2] ** 2)
        twist = min(1.0, config.turn_strength / size) if size > 0 else 1.0
        self._apply((*force, twist * torque[0], twist * torque[1], twist * torque[2]))
        if config.fatigue:
            body.capacity = self._muscles.tired(body.capacity, force, self._dt)
            if body.beyond > _GIVES_UP and not body.gave_up:
                body.gave_up = 1.0
                self.intention.quit()

    def _replay(self, t: float, turn: Quaternion) -> None:
        forces = self._forces
        assert forces is not None
        fx, fy, fz, tx, ty, tz = forces.at(t)
        if forces.frame == "hand":
            (fx, fy, fz), (tx, ty, tz) = turned(turn, (fx, fy, fz)), turned(turn, (tx, ty, tz))
        self._body.balance = _three(self._place.tolist())
        self._apply((fx, fy, fz, tx, ty, tz))

    def _apply(self, wrench: tuple[float, ...]) -> None:
        body = self._body
        body.wrench = wrench
        body.active = self._muscles.activations((wrench[0], wrench[1], wrench[2]), body.capacity)
        self._applied[:] = wrench

    # -- values for other modules

    @property
    def wrench(self) -> Array:
        """(6,) N, N m, wrench of the hand, world axes, about the hand."""
        return np.array(self._body.wrench)

    def activation(self, muscle: str) -> float:
        """The present activation, from 0 (relaxed) to 1 (greatest voluntary contraction).

        Raises:
            WiringError: there is no such muscle.
        """
        names = tuple(PULLS)
        if muscle not in names:
            raise WiringError(f"sim.parts.{self.name}", f"it has no muscle '{muscle}'", nearest(muscle, names))
        return self._body.active[names.index(muscle)]

    def pressed(self, button: str) -> bool:
        """Whether the person presses a button of the panel now."""
        return self.intention.pressed(button)

    @property
    def done(self) -> bool:
        """Whether the plan has ended or the person gave it up."""
        return self.intention.step is None

    def fill(self, truth: Mapping[str, Array]) -> None:
        wrench, push, balance, its_aim, its_tool, activation, capacity, progress = self.setters(truth)
        body, aim, place = self._body, self.intention.aim, self._place.tolist()
        reach = turned(_four(self._turn.tolist()), self._reach[0])
        tool = [place[i] + reach[i] for i in range(3)]
        wrench(*body.wrench)
        push(*place, *body.wrench[:3])
        balance(*body.balance)
        its_tool(*tool)
        its_aim(*(aim.pose[:3] if body.started else tool))
        activation(*body.active)
        capacity(body.capacity)
        progress(aim.step, aim.missed, body.gave_up)

    def save(self) -> Array:
        return np.array([*flat(self._body), *flat(self.intention.aim), *self._sight.save()])

    def restore(self, state: Array) -> None:
        values = iter(state.tolist())
        refill(self._body, values)
        refill(self.intention.aim, values)
        self._sight.restore(values)


def _three(v: list[float]) -> Vector:
    return (v[0], v[1], v[2])


def _four(v: list[float]) -> Quaternion:
    return (v[0], v[1], v[2], v[3])


def _mixed(old: Vector, new: Vector, k: float) -> Vector:
    return (old[0] + k * (new[0] - old[0]), old[1] + k * (new[1] - old[1]), old[2] + k * (new[2] - old[2]))
