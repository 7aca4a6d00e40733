"""The world `augmented-hand`: a person's hand, extra fingers worn at the wrist, objects to grasp."""

from __future__ import annotations

from collections.abc import Mapping
from math import isnan
from typing import Final, Self
from xml.etree.ElementTree import Element, tostring

import mujoco
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from runtime.contracts.frames import Frames
from runtime.contracts.gravity import DOWN
from runtime.contracts.signals import Array, Signal
from runtime.contracts.terms import POINT
from runtime.contracts.world import World, WorldConfig
from runtime.control.hand.human_hand import FINGER_JOINTS, FINGERS, JOINTS
from sim.parts.hand.finger import FingerConfig, add_finger
from sim.parts.hand.hand import add_hand
from sim.parts.hand.objects import ObjectConfig, add_object
from sim.parts.hand.servo import ServoBank
from sim.wearer import Wearer, WearerConfig, make_wearer
from sim.world.mjcf import add

_TICK: Final = 10_000_000  # ns; period at which the wearer's intention is read and the hand's motion is stored
_MEMORY: Final = 64  # ticks of the hand's past motion that are stored for slow sensors


class AugmentedHandConfig(WorldConfig):
    """Options of the world."""

    timestep: float = Field(default=0.001, ge=1e-5, le=0.005, description="s, of the physics")
    gravity: tuple[float, float, float] = Field(default=DOWN, description="m/s^2, in frame hand")
    strength: float = Field(default=1.0, gt=0, description="multiplies the greatest torque of every joint of the hand")
    fingers: tuple[FingerConfig, ...] = Field(default=(FingerConfig(),), min_length=1)
    objects: tuple[ObjectConfig, ...] = ()
    wearer: WearerConfig = WearerConfig()

    @model_validator(mode="after")
    def _distinct(self) -> Self:
        names = [finger.name for finger in self.fingers]
        if len(set(names)) < len(names) or "hand" in names:
            raise ValueError("each finger needs a name of its own, other than 'hand'")
        return self


class AugmentedHand(World):
    """Simulates the hand and the extra fingers.

    Hand joints follow the wearer with limited torque; servos follow their pulses. Contacts can stop both.
    Joint targets of the hand change every 10 ms and are interpolated linearly in between. Servo `i` is joint
    `i % 4` of finger `i // 4`. The frame `hand` is the world's frame: the wrist doesn't move.
    """

    Config = AugmentedHandConfig
    summary = "a 20-joint hand wearing robotic fingers, moved by a script or by a recording"

    def __init__(self, config: AugmentedHandConfig, seed: int, frames: Frames | None = None) -> None:
        super().__init__(config, seed, frames)
        self.wearer: Wearer = make_wearer(config.wearer, seed)
        self.duration = self.wearer.duration if np.isfinite(self.wearer.duration) else None
        self._config = config
        self._model = model = mujoco.MjModel.from_xml_string(mjcf(config))
        self._data = data = mujoco.MjData(model)
        self._step_ns = round(config.timestep * 1e9)
        self._tick = max(1, _TICK // self._step_ns)  # steps
        self._step = 0  # number of steps done
        n = 4 * len(config.fingers)
        hand, servos = slice(0, 20), slice(20, 20 + n)
        # Views of MuJoCo's own arrays; joints and actuators are ordered: hand, fingers, objects.
        self._hand_qpos, self._servo_qpos, self._servo_qvel = (
            data.qpos[hand],
            data.qpos[servos],
            data.qvel[servos],
        )
        self._hand_rate, self._servo_ctrl = data.ctrl[hand], data.ctrl[servos]
        self._servo_force, self._set_points = data.actuator_force[servos], data.act
        self._servo_gain, self._servo_bias = (
            model.actuator_gainprm[servos, 0],
            model.actuator_biasprm[servos],
        )
        bands = np.repeat([finger.servo.dead_band for finger in config.fingers], 4)
        self._bank, self._servos = ServoBank(bands), range(n)
        self._gain, self._bias = self._servo_gain.copy(), self._servo_bias.copy()
        self._powered = [True] * n  # which servos have these gains at present
        self._drag = model.dof_damping[servos].reshape(n, -1)[:, 0].copy()
        # Sites are in the order of the bodies: the hand's five fingertips, then those of the extra fingers.
        self._hand_sites, self._finger_sites = data.site_xpos[:5], data.site_xpos[5:]
        self._bodies, self._weld_active = data.xpos, data.eq_active
        self._object_bodies = np.array(
            [model.body(f"object_{i}").id for i in range(len(config.objects))], dtype=np.intp
        )
        self._finger_of_geom = _finger_of_geom(model, config)
        self._welds = [  # (step of release, equality)
            (round(item.held_until / config.timestep), model.equality(f"object_{i}").id)
            for i, item in enumerate(config.objects)
            if item.held_until
        ]
        self._hand_qpos[:] = self._set_points[:] = self.wearer.target(0.0)
        self._past = np.tile(self._hand_qpos, (_MEMORY, 1))  # (64, 20); row k % 64 holds tick k
        self._drive_servos()
        self.truth = _truth(config)
        self.bind({signal.name: np.zeros(signal.shape) for signal in self.truth})

    def bind(self, truth: Mapping[str, Array]) -> None:
        super().bind(truth)
        self._copies = [
            (truth["hand_position"], self._hand_qpos),
            (truth["finger_position"], self._servo_qpos),
            (truth["finger_velocity"], self._servo_qvel),
            (truth["hand_tips"], self._hand_sites),
            (truth["finger_tip"], self._finger_sites),
        ]
        self._fill()

    def advance(self, until: int) -> None:
        goal = until // self._step_ns
        while self._step < goal:
            step, tick = self._step, self._tick
            if step % tick == 0:
                self._will(step)
            if self._bank.latch(step):
                self._drive_servos()
            stop = min(goal, step - step % tick + tick)
            if (due := self._bank.next_step()) is not None:
                stop = min(stop, due)
            for release, weld in self._welds:
                self._weld_active[weld] = step < release
                if step < release:
                    stop = min(stop, release)
            mujoco.mj_step(self._model, self._data, stop - step)
            self._step = stop
            if stop % tick == 0:
                self._past[stop // tick % _MEMORY] = self._hand_qpos
        self.time = max(self.time, until)
        self._fill()

    def hand_position(self, at: int | None = None) -> Array:
        """Joint angles of the hand (20,), rad.

        Args:
            at: world time, ns, at most 0.6 s ago; default: now. The motion is stored every 10 ms and
                interpolated in between.
        """
        now = self._step * self._step_ns
        if at is None or at >= now:
            return self._hand_qpos.copy()
        span = self._tick * self._step_ns
        newest = self._step // self._tick
        tick, rest = divmod(max(at, (newest - _MEMORY + 1) * span, 0), span)
        before = self._past[tick % _MEMORY]
        if rest == 0:
            return before.copy()
        if tick < newest:
            after = self._past[(tick + 1) % _MEMORY]
        else:
            after, span = self._hand_qpos, now - newest * span
        between = after - before
        between *= rest / span
        between += before
        return between

    def finger_position(self) -> Array:
        """Joint angles of the extra fingers (4 k,), rad."""
        return self._servo_qpos.copy()

    def set_servo(self, servo: int, target: float | None, at: int = 0) -> None:
        """Sets one servo's target; see `set_servos`."""
        self.set_servos({servo: target}, at)

    def set_servos(self, targets: Mapping[int, float | None], at: int = 0) -> None:
        """Sets the targets that the servos' pulses encode from `at` on.

        Args:
            targets: target angles, rad, by servo number (4 times the finger plus the joint). None ends the
                servo's pulses, which leaves it limp.
            at: world time, ns; a time in the past means from now on.
        """
        step, servos = max(-(-at // self._step_ns), self._step), self._servos
        for servo, target in targets.items():
            self._bank.command(servos[servo], np.nan if target is None else target, step)

    @property
    def servo_names(self) -> tuple[str, ...]:
        """The servos' names, by number: the joint's; with several fingers `<finger>_<joint>`."""
        return _servo_names(self._config)

    def place_servos(self, angles: Mapping[int, float]) -> None:
        """Places servos, by number, at angles (rad): where the user has put a finger before the run.

        Has an effect only before the first step.
        """
        if self._step == 0:
            for servo, angle in angles.items():
                self._servo_qpos[servo] = angle
            self._fill()

    def servo_targets(self) -> Array:
        """(4 k,) rad: the target that each servo holds at present; NaN for a servo without pulses."""
        return self._bank.held.copy()

    def save(self) -> NDArray[np.float64]:
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        physics = np.empty(mujoco.mj_stateSize(self._model, kind))
        mujoco.mj_getState(self._model, self._data, physics, kind)
        # Effort and contact force belong to the step before the saved state and can't be recomputed from it.
        truth = [self.truth_arrays[signal.name].ravel() for signal in self.truth]
        head = [float(self.time), float(self._step)]
        return np.concatenate([head, physics, *truth, self._past.ravel(), self._bank.save()])

    def restore(self, state: NDArray[np.float64]) -> None:
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        sizes = [2, mujoco.mj_stateSize(self._model, kind), *(s.size for s in self.truth), self._past.size]
        head, physics, *truth, past, bank = np.split(state, np.cumsum(sizes))
        self.time, self._step = int(head[0]), int(head[1])
        mujoco.mj_setState(self._model, self._data, physics, kind)
        for signal, values in zip(self.truth, truth, strict=True):
            self.truth_arrays[signal.name][...] = values.reshape(signal.shape)
        self._past[...] = past.reshape(self._past.shape)
        self._bank.restore(bank)
        self._drive_servos()

    def _will(self, step: int) -> None:
        """Starts moving the hand's set-points to the wearer's target one tick from now."""
        span = self._tick * self._config.timestep
        goal = self.wearer.target(step * self._config.timestep + span)
        goal -= self._set_points
        np.divide(goal, span, out=self._hand_rate)

    def _drive_servos(self) -> None:
        """Sets the servos' targets and sets the gains of servos without pulses to 0."""
        held = self._bank.held.tolist()
        self._servo_ctrl[:] = [0.0 if isnan(target) else target for target in held]
        if (powered := [not isnan(target) for target in held]) != self._powered:
            self._powered = powered
            self._servo_gain[:] = self._gain * powered
            self._servo_bias[:] = self._bias * np.array(powered)[:, None]

    def _fill(self) -> None:
        data, out = self._data, self.truth_arrays
        mujoco.mj_kinematics(self._model, data)  # after a step, positions are one step behind the joint angles
        for copy, original in self._copies:
            copy[...] = original
        effort = out["finger_effort"]
        np.multiply(self._drag, self._servo_qvel, out=effort)
        np.subtract(self._servo_force, effort, out=effort)
        out["contact_force"][...] = 0.0
        if data.ncon:
            self._contact_force(out["contact_force"])
        if self._object_bodies.size:
            self._bodies.take(self._object_bodies, axis=0, out=out["object_position"], mode="clip")

    def _contact_force(self, out: Array) -> None:
        """Adds the normal forces of each extra finger's contacts to `out` (k,), N."""
        force = np.empty(6)
        for number, pair in enumerate(self._finger_of_geom[self._data.contact.geom].tolist()):
            for finger in pair:
                if finger >= 0:
                    mujoco.mj_contactForce(self._model, self._data, number, force)
                    out[finger] += force[0]


def mjcf(config: AugmentedHandConfig) -> str:
    """The world as an MJCF document; joints, actuators and sites are ordered: hand, fingers, objects."""
    root = Element("mujoco", model="augmented-hand")
    add(root, "compiler", angle="radian")
    option = {"timestep": config.timestep, "gravity": config.gravity}
    add(root, "option", integrator="implicitfast", cone="elliptic", **option)
    world = add(root, "worldbody")
    add(world, "light", pos="0 -0.5 1.5", dir="0 0.3 -1", directional=True)
    actuators = add(root, "actuator")
    equality = add(root, "equality")
    add_hand(world, actuators, config.strength)
    for finger in config.fingers:
        add_finger(world, actuators, finger)
    for number, item in enumerate(config.objects):
        add_object(world, equality, f"object_{number}", item)
    return tostring(root, encoding="unicode")


def _truth(config: AugmentedHandConfig) -> tuple[Signal, ...]:
    names = tuple(finger.name for finger in config.fingers)
    servos = _servo_names(config)
    n = len(servos)
    signals = [
        Signal(name="hand_position", shape=(20,), unit="rad", labels=JOINTS),
        Signal(name="finger_position", shape=(n,), unit="rad", labels=servos),
        Signal(name="finger_velocity", shape=(n,), unit="rad/s", labels=servos),
        Signal(name="finger_effort", shape=(n,), unit="N m", labels=servos),
        _points("hand_tips", FINGERS),
        _points("finger_tip", names),
        Signal(name="contact_force", shape=(len(names),), unit="N", labels=names),
    ]
    if config.objects:
        signals.append(_points("object_position", tuple(f"object_{i}" for i in range(len(config.objects)))))
    return tuple(signals)


def _servo_names(config: AugmentedHandConfig) -> tuple[str, ...]:
    fingers = config.fingers
    return tuple(j if len(fingers) == 1 else f"{f.name}_{j}" for f in fingers for j in FINGER_JOINTS)


def _points(name: str, labels: tuple[str, ...]) -> Signal:
    shape = (len(labels), 3)
    return Signal(name=name, shape=shape, unit="m", frame="hand", labels=labels, components=(POINT,), visual="points")


def _finger_of_geom(model: mujoco.MjModel, config: AugmentedHandConfig) -> NDArray[np.int64]:
    """(ngeom,): number of the extra finger to which each geom belongs, or -1."""
    numbers = {finger.name: number for number, finger in enumerate(config.fingers)}
    return np.array([numbers.get(model.geom(i).name.split("/")[0], -1) for i in range(model.ngeom)])
