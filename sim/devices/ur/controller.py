"""A UR controller on a simulated arm: power, safety, speed slider, one program at a time, 500 cycles a second."""

from __future__ import annotations

from collections import deque
from math import hypot
from typing import Any, Final, Protocol

import numpy as np
import pinocchio as pin

from srl.drivers.ur.models import REACH
from srl.drivers.ur.registers import CYCLE
from srl.drivers.ur.status import RobotBits, RobotMode, RuntimeState, SafetyBits, SafetyMode
from srl.runtime.contracts import rotation
from srl.runtime.contracts.signals import Array
from srl.sim.devices.ur.force_mode import ForceMode
from srl.sim.devices.ur.kinematics import Kinematics, placement, vector
from srl.sim.devices.ur.motion import Motion
from srl.sim.parts.robots.arm import ArmPart

_PAYLOAD: Final = 30.0  # kg
_POWERING: Final = 100  # cycles from POWER_OFF to IDLE, and from IDLE to RUNNING; a real arm takes seconds
_LOCKED: Final = 2500  # shortest duration of a protective stop, in cycles (5 s)
_SLIDER: Final = 2.0  # 1/s, rate at which the speed scaling follows the slider
_PROTECTIVE_STOP: Final = 15.0  # rad/s^2
_FOLLOWING: Final = 0.1  # rad between target and joint; beyond it, something holds the arm
_TOO_FAST: Final = 1.1  # factor of a joint's greatest velocity
_RANGE: Final = np.repeat((160.0, 10.0), 3)  # N, N m, of the UR16e's flange sensor along each of its axes: data sheet
_FREE: Final = 2.0  # N m s/rad with which a joint resists a hand in freedrive
_HISTORY: Final = 1000  # cycles whose joint positions and forces are remembered
_CONTACT, _TOUCH = 10.0, 2.0  # N: a contact counts from the first on and began at the second
_STEADY: Final = 250  # cycles at rest until the arm is steady
_STILL: Final = 0.005  # rad/s

_BITS: Final = {
    SafetyMode.NORMAL: SafetyBits.NORMAL,
    SafetyMode.REDUCED: SafetyBits.REDUCED,
    SafetyMode.PROTECTIVE_STOP: SafetyBits.NORMAL | SafetyBits.PROTECTIVE_STOP | SafetyBits.STOPPED,
    SafetyMode.SAFEGUARD_STOP: SafetyBits.NORMAL | SafetyBits.SAFEGUARD_STOP | SafetyBits.STOPPED,
    SafetyMode.ROBOT_EMERGENCY_STOP: SafetyBits.ROBOT_EMERGENCY_STOP | SafetyBits.EMERGENCY_STOP | SafetyBits.STOPPED,
}


class Program(Protocol):
    """A program that runs on the controller."""

    name: str

    def cycle(self) -> bool:
        """Runs one control cycle; returns False once the program has ended."""


class UrController:
    """The simulated controller; see the module's text.

    Attributes:
        robot_mode, safety_mode: as RTDE reports them.
        motion: the joints' targets.
        program: the running or paused program; None: no program.
        slider: 0 to 1.
        scaling: 0 to 1, the actual speed of motions.
        inputs, outputs: digital, bit by bit.
        cycles: control cycles since the controller's start.
        force_limit: N, force at the flange that causes a protective stop.
        stops: reasons of the protective stops so far, in words, the newest hundred.
        locked_until: cycle before which a protective stop doesn't end.
        wrench: (6,) N, N m, of this cycle, at the TCP, axes of `base`, without the weight of the payload that was
            set. `base` stands upright, as set at the pendant.
        kinematics: with the TCP that was set.
        force: force mode.
    """

    def __init__(self, arm: ArmPart, force_limit: float) -> None:
        self.arm, self.force_limit = arm, force_limit
        self.robot_mode, self.safety_mode = RobotMode.RUNNING, SafetyMode.NORMAL
        self._fastest = arm.robot.dq_max * _TOO_FAST
        self.kinematics = Kinematics(arm.robot)
        self.motion = Motion(arm.position, self.kinematics, arm.robot.dq_max)
        self.force = ForceMode(self.kinematics)
        self.program: Program | None = None
        self.slider = self.scaling = 1.0
        self.inputs = self.outputs = 0
        self.cycles = -1
        self.stops: list[str] = []
        self.emergency = self.safeguard = False  # the contacts of the buttons and of the light curtain
        self.payload = (arm.declared.mass, arm.declared.com)
        self._zero = np.zeros(6)  # N, N m, flange frame: offset of the force sensor since it was zeroed
        self._past: deque[tuple[Array, Array]] = deque(maxlen=_HISTORY)
        self._moved_at = -_STEADY
        self._ready_at = -1  # cycle in which the robot mode advances by itself
        self.locked_until = 0
        self.wrench = self._feel()
        self._tell()

    # -- one cycle

    def cycle(self) -> None:
        """Runs one control cycle on the present state of the world."""
        self.cycles += 1
        self.wrench = self._feel()
        self._past.append((self.arm.position, self.wrench[:3]))
        if np.abs(self.motion.qd).max() > _STILL or self.force.on:
            self._moved_at = self.cycles
        self._supervise()
        self._power()
        runs = self.safety_mode in (SafetyMode.NORMAL, SafetyMode.REDUCED)
        if self.robot_mode is RobotMode.RUNNING and self.program is not None and runs and not self.program.cycle():
            self.program = None
        if self.program is None and (self.motion.driven or self.force.on):
            self.end_force_mode()
            self.motion.stop(_PROTECTIVE_STOP)  # a program that ends leaves no motion behind
        goal = self.slider if runs else 0.0
        step = _SLIDER * CYCLE
        self.scaling = min(max(goal, self.scaling - step), self.scaling + step) if runs else 0.0
        if self.motion.doing == "free":
            self.motion.follow(self.arm.position, self.arm.velocity)
        self.motion.cycle(self.scaling)
        self.force.cycle(self.motion.q, self.motion.qd, self.wrench)
        if self.motion.singular and self.motion.doing == "stop-tool":
            self.motion.stop(_PROTECTIVE_STOP)
        elif self.motion.singular:
            self.protective_stop("too near to a singularity")
        self._tell()

    def _supervise(self) -> None:
        q = self.arm.position
        if self.emergency:
            self.safety_mode = SafetyMode.ROBOT_EMERGENCY_STOP
            self.power_off()
        elif self.safety_mode is SafetyMode.ROBOT_EMERGENCY_STOP:
            self.safety_mode = SafetyMode.NORMAL
        if self.robot_mode is not RobotMode.RUNNING:
            self.force.end()
            self.motion.halt(q)
            return
        if self.safety_mode is SafetyMode.PROTECTIVE_STOP:
            return
        if self.safeguard:
            if self.safety_mode is not SafetyMode.SAFEGUARD_STOP:
                self.safety_mode = SafetyMode.SAFEGUARD_STOP
                self.end_force_mode()
                self.motion.stop(_PROTECTIVE_STOP)
        elif self.safety_mode is SafetyMode.SAFEGUARD_STOP:
            self.safety_mode = SafetyMode.NORMAL
        joints = self.arm.robot.labels
        target, rate = self.target()
        fast = np.abs(rate) > self._fastest
        # The controller stops by the joints' currents, too, which know of more than the sensor's range.
        felt = self.arm.flange_wrench()[:3]
        beyond_range = felt - np.minimum(np.maximum(felt, -_RANGE[:3]), _RANGE[:3])
        force = hypot(*(self.wrench[:3] + self.arm.flange()[0] @ beyond_range).tolist())
        behind = np.abs(target - q) > _FOLLOWING
        beyond = (np.abs(q) > REACH) & (np.sign(q) * rate > 0)  # the way back is free once the stop was ended
        if fast.any():
            self.protective_stop(f"{joints[int(fast.argmax())]} is faster than its limit")
        elif beyond.any():
            self.protective_stop(f"{joints[int(beyond.argmax())]} is beyond its limit")
        elif behind.any():
            self.protective_stop(f"{joints[int(behind.argmax())]} doesn't follow")
        elif force > self.force_limit:
            self.protective_stop(f"force {force:.0f} N")
        elif self.force.strays(target, q):
            self.protective_stop("force mode strayed beyond its limits")

    def _power(self) -> None:
        if self.cycles == self._ready_at:
            self.robot_mode = RobotMode.IDLE if self.robot_mode is RobotMode.POWER_ON else RobotMode.RUNNING
            self.motion.halt(self.arm.position)

    def _tell(self) -> None:
        if self.robot_mode is RobotMode.RUNNING and self.motion.doing == "free":
            self.arm.command("torque", -_FREE * self.arm.velocity)
        elif self.robot_mode is RobotMode.RUNNING:
            self.arm.command("position", *self.target())
        else:
            self.arm.command("brake")

    # -- actions of users and of the dashboard

    def power_on(self) -> None:
        """Switches the drives on; the mode becomes IDLE later."""
        if self.robot_mode is RobotMode.POWER_OFF and not self.emergency:
            self.robot_mode, self._ready_at = RobotMode.POWER_ON, self.cycles + _POWERING

    def brake_release(self) -> None:
        """Releases the brakes of an IDLE arm; the mode becomes RUNNING later."""
        if self.robot_mode is RobotMode.IDLE and self._ready_at <= self.cycles:
            self._ready_at = self.cycles + _POWERING

    def power_off(self) -> None:
        """Applies the brakes and switches the drives off."""
        self.program = None
        self.robot_mode, self._ready_at = RobotMode.POWER_OFF, -1

    def protective_stop(self, why: str) -> None:
        """Stops the arm; the program is paused and stays paused."""
        if self.safety_mode is SafetyMode.PROTECTIVE_STOP:
            return
        self.safety_mode, self.stops = SafetyMode.PROTECTIVE_STOP, [*self.stops[-99:], why]
        self.locked_until = self.cycles + _LOCKED
        self.end_force_mode()
        self.motion.stop(_PROTECTIVE_STOP)

    def unlock(self) -> bool:
        """Ends a protective stop; returns False if the stop isn't 5 s old yet."""
        if self.safety_mode is SafetyMode.PROTECTIVE_STOP:
            if self.cycles < self.locked_until:
                return False
            self.safety_mode = SafetyMode.NORMAL
            self.motion.halt(self.arm.position)
            if self.program is not None:
                self.program = _Paused(self.program.name)
        return True

    def run(self, program: Program) -> bool:
        """Runs a program in place of any other; returns False if the arm isn't ready for one."""
        if self.robot_mode is not RobotMode.RUNNING or self.safety_bits & SafetyBits.STOPPED:
            return False
        self.end_force_mode()
        if self.program is not None and self.motion.doing != "hold":
            self.motion.stop(_PROTECTIVE_STOP)
        self.program = program
        return True

    def end_program(self) -> None:
        """Ends the program; the arm stops."""
        self.program = None

    # -- what programs ask for and set

    def target(self) -> tuple[Array, Array]:
        """(6,) rad and (6,) rad/s: the joints' targets, force mode included."""
        if not self.force.on:
            return self.motion.q, self.motion.qd
        return self.motion.q + self.force.q, self.motion.qd + self.force.qd

    def end_force_mode(self) -> None:
        """end_force_mode: the arm comes to rest where it is, and any motion ends."""
        if self.force.on:
            q, qd = self.target()
            self.motion.follow(q, qd)
            self.force.end()
            self.motion.stop(_PROTECTIVE_STOP)

    def set_tcp(self, pose: Any) -> None:
        """set_tcp: the TCP in the flange's frame, a pose. Raises ValueError."""
        self.kinematics.tcp = placement(pose)

    def steady(self) -> bool:
        """is_steady: whether the arm has been at rest for half a second."""
        return self.cycles - self._moved_at >= _STEADY

    def past(self, steps: int) -> Array:
        """(6,) rad, joint positions that many cycles ago. Raises ValueError: too long ago."""
        if not 0 <= steps < len(self._past):
            raise ValueError(f"joint positions are known of the last {len(self._past)} cycles")
        return self._past[-1 - steps][0]

    def contact(self, direction: Array) -> int:
        """tool_contact: how many cycles ago a contact began that hinders motion along `direction`; 0: no contact.

        Args:
            direction: (3,) in `base`; zeros: any.
        """
        length = float(np.linalg.norm(direction))

        def against(force: Array) -> float:
            return float(np.linalg.norm(force)) if length < 1e-9 else -float(force @ direction) / length

        if not self._past or against(self._past[-1][1]) < _CONTACT:
            return 0
        steps = 1
        while steps < len(self._past) - 1 and against(self._past[-1 - steps][1]) > _TOUCH:
            steps += 1
        return steps

    # -- values for RTDE

    @property
    def safety_bits(self) -> SafetyBits:
        """RTDE `safety_status_bits`."""
        return self.bits_of(self.safety_mode)

    @staticmethod
    def bits_of(mode: SafetyMode) -> SafetyBits:
        """The bits of a safety mode."""
        return _BITS[mode]

    @property
    def robot_bits(self) -> RobotBits:
        """RTDE `robot_status_bits`."""
        on = self.robot_mode in (RobotMode.POWER_ON, RobotMode.IDLE, RobotMode.RUNNING)
        return RobotBits(RobotBits.POWER_ON * on | RobotBits.PROGRAM_RUNNING * (self.program is not None))

    @property
    def runtime_state(self) -> RuntimeState:
        """RTDE `runtime_state`."""
        if self.program is None:
            return RuntimeState.STOPPED
        paused = isinstance(self.program, _Paused) or bool(self.safety_bits & SafetyBits.STOPPED)
        return RuntimeState.PAUSED if paused else RuntimeState.PLAYING

    def flange(self) -> Array:
        """(6,): pose of the flange in `base`."""
        turn, at = self.arm.flange()
        return np.concatenate([at, rotation.log(rotation.from_matrix(turn))])

    def tool(self) -> Array:
        """(6,): pose of the TCP in `base`."""
        return vector(pin.SE3(*self.arm.flange()) * self.kinematics.tcp)

    def tool_twist(self) -> Array:
        """(6,) m/s, rad/s: velocity of the TCP, axes of `base`."""
        twist = self.arm.flange_twist()
        twist[:3] += _cross(twist[3:], self._lever())
        return twist

    def _lever(self) -> Array:
        """(3,) m from the flange to the TCP, axes of `base`."""
        turned: Array = self.arm.flange()[0] @ self.kinematics.tcp.translation
        return turned

    def _feel(self) -> Array:
        turn, _ = self.arm.flange()
        # The sensor's own range, of what is mounted on the flange with its weight: zeroing doesn't widen it.
        felt = np.minimum(np.maximum(self.arm.flange_wrench(), -_RANGE), _RANGE)
        mass, cog = self.payload
        weight = mass * self.arm.down()
        felt = felt - self._zero
        force = turn @ felt[:3] - weight
        moment = turn @ felt[3:] - _cross(turn @ cog, weight)
        moment -= _cross(self._lever(), force)
        return np.concatenate([force, moment])

    def set_payload(self, mass: float, cog: tuple[float, float, float]) -> None:
        """URScript's set_payload: kg, and its centre of mass in the flange's frame, m. Raises ValueError.

        It zeroes the force sensor: a contact force present at that moment isn't felt, and is missing afterwards.
        """
        self.know_payload(mass, cog)
        self.zero_sensor()

    def zero_sensor(self) -> None:
        """zero_ftsensor: whatever the sensor feels now counts as no force from now on."""
        turn, _ = self.arm.flange()
        wrench = self._feel()
        moment = wrench[3:] + _cross(self._lever(), wrench[:3])
        self._zero = self._zero + np.concatenate([turn.T @ wrench[:3], turn.T @ moment])

    def know_payload(self, mass: float, cog: tuple[float, float, float]) -> None:
        """Sets the payload as at the pendant, with the sensor zeroed without contact. Raises ValueError."""
        if not 0 <= mass <= _PAYLOAD or len(cog) != 3 or not all(abs(x) <= 1 for x in cog):
            raise ValueError(f"a payload is 0 to {_PAYLOAD:g} kg, its centre within 1 m")
        self.payload = (mass, cog)
        self.arm.tell_payload(mass, cog)


def _cross(first: Array, second: Array) -> Array:
    """(3,): a x b. Of plain numbers, as numpy's own overhead would be most of the cost."""
    (a, b, c), (x, y, z) = first.tolist(), second.tolist()
    return np.array((b * z - c * y, c * x - a * z, a * y - b * x))


class _Paused:
    """A program that a protective stop has in effect ended: only `play` at the pendant would resume it."""

    def __init__(self, name: str) -> None:
        self.name = name

    def cycle(self) -> bool:
        return True
