"""The controller of a simulated Franka robot: modes, motions, reflexes, in steps of one millisecond. No wire.

Source: protocol sheet franka-fci, sections 4 to 7. `srl.sim.devices.panda.twin` lists the facts that the sheet leaves
open and this simulation chooses.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Literal, Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from srl.drivers.panda.packets import ERRORS, Controller, Generator, RobotMode, error_names
from srl.drivers.panda.protocol import Status
from srl.drivers.panda.requests import Body, Move, SetLoad
from srl.runtime.contracts.compiled import bind_or_python, undone
from srl.runtime.contracts.signals import Array
from srl.runtime.models.robots import FR3, PANDA, Payload
from srl.runtime.models.robots.pinocchio_model import FLANGE, pinocchio_model
from srl.sim.devices.panda.felt import Felt
from srl.sim.devices.panda.motion import DT, LOST_IN_A_ROW, JointGenerator, Reception, Setpoint, limits_of, torque_error
from srl.sim.devices.panda.settings import Settings

RECOVERY: Final = 20  # ms, duration of automatic error recovery
START: Final = 500  # ms in which a client must send its first packet before lost packets count
OVERSPEED: Final = 0.05  # share of the greatest velocity by which the measured one may exceed its limit
BEYOND: Final = 0.01  # rad, the same for the position
DAMPING: Final = 0.7  # damping ratio of the joint impedance
FLIP: Final = -0.467002423653011  # rad, angle of joint 4 at which the elbow's sign changes
_JOINT: Final = (Generator.JOINT_POSITION, Generator.JOINT_VELOCITY)


class Arm(Protocol):
    """What the controller uses of the arm: measured values of the present millisecond, (7,) each, filled in place.

    `stiffness`: N m/rad (7,), stiffness of its position servo.
    """

    position: Array
    velocity: Array
    effort: Array
    external_effort: Array
    stiffness: Array

    def measure(self) -> None: ...

    def command(self, mode: Literal["brake", "torque", "position"], values: Array, rates: Array) -> None: ...

    def tell_payload(self, mass: float, com: Array) -> None: ...


class PandaController:
    """The controller of one robot; `tick` is called each millisecond of its time, after the physics.

    Attributes:
        mode, generator, controller: as reported in the robot's state.
        motion: the desired joint motion.
        tau_d: N m (7,), the external controller's last torques.
        errors: (41,), the present errors. reflex_reason: the errors that ended the last motion.
        outcome: how the last motion ended, until `take_outcome`.
        contact, collision: (7,), 1 where the external torque is above its threshold; likewise (6,) `cartesian_...`.
        touching: (2, 13), all four: the lower thresholds, then the upper ones; joints, then axes.
        external: N m (7,), external torques, filtered.
        wrench: (6,) N, N m, acting on the robot at frame K, base axes.
        torque: N m (7,), the last torques requested from the drives, gravity excluded.
        pose, desired_pose: (4, 4), the end effector in the base frame, measured and desired.
        revision: number of changes of the settings.
        ticks: ms of the robot's time.
    """

    def __init__(
        self, arm: Arm, robot: str, tool: Payload | None = None, stopped: Callable[[], bool] = lambda: False
    ) -> None:
        """
        Args:
            arm: the arm that it drives.
            robot: `panda` or `fr3`.
            tool: the end effector set in the robot's web interface: kg, centre in the flange's frame.
            stopped: returns whether the user stop is pressed now.
        """
        self.arm, self.robot = arm, robot
        self.tool = tool or Payload()
        self.limits = limits_of(robot)
        self.settings = Settings()
        self.reception = Reception()
        self.motion = JointGenerator(self.limits, np.clip(arm.position, self.limits.lower, self.limits.upper))
        self.mode, self.generator, self.controller = RobotMode.IDLE, Generator.IDLE, Controller.OTHER
        self.tau_d = np.zeros(7)
        self.errors: NDArray[np.bool_] = np.zeros(len(ERRORS), np.bool_)
        self.reflex_reason = self.errors.copy()
        self.outcome: Status | None = None
        self._felt = Felt(FR3 if robot == "fr3" else PANDA)
        self.touching, self.external, self.wrench = self._felt.touching, self._felt.external, self._felt.wrench
        self.contact, self.cartesian_contact = self.touching[0, :7], self.touching[0, 7:]
        self.collision, self.cartesian_collision = self.touching[1, :7], self.touching[1, 7:]
        limits = self.limits
        slowest, fastest = limits.velocities(arm.position)
        spare = np.concatenate((np.full(7, BEYOND), OVERSPEED * limits.velocity))
        self._least = np.concatenate((limits.lower, slowest)) - spare
        self._most = np.concatenate((limits.upper, fastest)) + spare
        self._watch_in_c = undone
        if limits.velocity_offset is None:  # else the limits change with the posture
            self._watch_in_c = bind_or_python(
                "panda-watch", arm.position, arm.velocity, self._least, self._most, self.touching
            )
        self.torque = np.zeros(7)
        self.pose, self.desired_pose = self._felt.pose, np.eye(4)
        self.revision = 0
        self.ticks = 0
        self.reflexes = 0
        self._stopped = stopped
        self._started: int | None = None  # tick at which a motion started, until its first packet
        self._recovered_at: int | None = None
        self._desired_at = b""  # bytes of the desired position to which `desired_pose` belongs
        self._carried()
        self._know()
        self._sense()
        self._drive()

    # -- a client's requests

    def move(self, command: Move) -> Status:
        """Starts a motion; returns MOTION_STARTED or the reason for the refusal.

        Cartesian generators and Cartesian impedance aren't simulated: they return NOT_POSSIBLE.
        """
        if self.mode is not RobotMode.IDLE:
            return Status.NOT_POSSIBLE
        highest = Generator.NONE if self.robot == "fr3" else Generator.CARTESIAN_VELOCITY
        if command.controller > Controller.EXTERNAL or command.generator + 1 > highest:
            return Status.INVALID_ARGUMENT
        generator, controller = Generator(command.generator + 1), Controller(command.controller)
        deviations = (*command.path_deviation, *command.goal_deviation, *command.max_velocity)
        if not all(0 <= value < np.inf for value in deviations):
            return Status.INVALID_ARGUMENT
        if generator is Generator.NONE and controller is not Controller.EXTERNAL:
            return Status.INVALID_ARGUMENT
        if controller is Controller.CARTESIAN_IMPEDANCE or generator not in (*_JOINT, Generator.NONE):
            return Status.NOT_POSSIBLE
        self.mode, self.generator, self.controller = RobotMode.MOVE, generator, controller
        self.reflex_reason[:] = False
        self.tau_d[:] = 0.0
        self.reception.begin()
        self.motion.begin()
        self.outcome = None
        self._started = self.ticks
        return Status.MOTION_STARTED

    def stop_move(self) -> Status:
        """Ends a motion at once; its Move is answered with PREEMPTED."""
        if self.mode in (RobotMode.USER_STOPPED, RobotMode.AUTOMATIC_ERROR_RECOVERY):
            return Status.NOT_POSSIBLE
        if self.mode is RobotMode.MOVE:
            self._end(Status.PREEMPTED)
        return Status.SUCCESS

    def recover(self) -> Status | None:
        """Starts automatic error recovery; returns None if it has started, else the reason for the refusal."""
        if self.mode in (RobotMode.USER_STOPPED, RobotMode.MOVE):
            return Status.NOT_POSSIBLE
        if any(self._beyond()[:7]):
            return Status.MANUAL_RECOVERY
        self.mode = RobotMode.AUTOMATIC_ERROR_RECOVERY
        self._recovered_at = self.ticks + RECOVERY
        return None

    def apply(self, command: Body) -> Status:
        """Carries out a setter; returns its status."""
        if self.mode not in (RobotMode.IDLE, RobotMode.GUIDING):
            return Status.NOT_POSSIBLE
        if not self.settings.apply(command):
            return Status.INVALID_ARGUMENT
        self.revision += 1
        self._know()
        if isinstance(command, SetLoad):
            carried = self._carried()
            self.arm.tell_payload(carried.mass, np.array(carried.com))
        return Status.SUCCESS

    def disconnect(self) -> None:
        """Called when the client has disconnected: its motion stops because packets are missing."""
        if self.mode is RobotMode.MOVE:
            self._reflex("communication_constraints_violation")
            self._drive()
        self.outcome = None

    def take_outcome(self) -> Status | None:
        """Returns how the last motion ended, once only."""
        outcome, self.outcome = self.outcome, None
        return outcome

    # -- one millisecond

    def tick(self, setpoint: Setpoint | None, counts: bool = True) -> None:
        """Advances the robot by 1 ms.

        Args:
            setpoint: the newest one that arrived in time; None: it was lost.
            counts: False if the missing setpoint isn't the client's fault.
        """
        self.ticks += 1
        self._sense()
        if self._stopped():
            self._user_stop()
        elif self.mode is RobotMode.USER_STOPPED:
            self._end(None)
        elif self.mode is RobotMode.AUTOMATIC_ERROR_RECOVERY and self.ticks >= (self._recovered_at or 0):
            self.errors[:] = False
            self._end(None)
        if self.mode is RobotMode.MOVE:
            self._watch()
        if self.mode is RobotMode.MOVE:
            self._follow(setpoint, counts)
        if self.mode not in (RobotMode.MOVE, RobotMode.USER_STOPPED):
            self.motion.brake()
        if (at := self.motion.q.tobytes()) != self._desired_at:
            self._desired_at = at
            pin.framesForwardKinematics(self._model, self._desired, self.motion.q)
            self.desired_pose = self._desired.oMf[self._flange].homogeneous @ self._ee
        self._drive()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the present errors."""
        return error_names(self.errors.tobytes())

    def wait(self) -> bool:
        """Whether a motion has had its first packet and now waits for the next."""
        return self.mode is RobotMode.MOVE and self._started is None

    def _follow(self, setpoint: Setpoint | None, counts: bool) -> None:
        if setpoint is None:
            self._missed(counts)
            return
        self._started = None
        self.reception.count(True)
        # The last packet only marks the end: clients fill it with zeros.
        if setpoint.finished:
            self._end(Status.SUCCESS)
            return
        torque = self.controller is Controller.EXTERNAL
        error = self.motion.take(setpoint, self.generator) if self.generator in _JOINT else ""
        if not error and torque:
            error = torque_error(self.tau_d, setpoint.tau)
        if error:
            self._reflex(error)
        elif torque:
            self.tau_d[:] = setpoint.tau

    def _missed(self, counts: bool) -> None:
        if not counts:
            return  # the motion stands still together with the program that serves the robot
        if self._started is None or self.ticks - self._started > START:
            self.reception.count(False)
        if self.reception.lost >= LOST_IN_A_ROW:
            self._reflex("communication_constraints_violation")
        elif self.generator in _JOINT:
            self.motion.extrapolate()

    def _sense(self) -> None:
        self.arm.measure()
        self._felt.update(self.arm.position, self.arm.external_effort, any(self.motion.ddq.tolist()))

    def _watch(self) -> None:
        """Checks for the errors that end a motion whatever its setpoints are."""
        if self._watch_in_c(0.0) == 0:  # native/panda.c: nothing is wrong
            return
        outside = self._beyond()
        found = []
        if any(outside[:7]):
            found.append("joint_position_limits_violation")
        if any(outside[7:]):
            found.append("joint_velocity_violation")
        collisions = self.touching[1].tolist()
        if any(collisions[:7]):
            found.append("joint_reflex")
        if any(collisions[7:]):
            found.append("cartesian_reflex")
        if found:
            self._reflex(*found)

    def _beyond(self) -> list[bool]:
        """For each joint, whether its position is outside its limits; then the same for its velocity."""
        arm, limits = self.arm, self.limits
        if limits.velocity_offset is not None:
            spare = OVERSPEED * limits.velocity
            slowest, fastest = limits.velocities(arm.position)
            self._least[7:], self._most[7:] = slowest - spare, fastest + spare
        moving = np.concatenate((arm.position, arm.velocity))
        found: list[bool] = ((moving < self._least) | (moving > self._most)).tolist()
        return found

    def _reflex(self, *names: str) -> None:
        for name in names:
            self.errors[ERRORS.index(name)] = True
        self.reflex_reason[:] = self.errors
        self.reflexes += 1
        self._hold()
        self._end(Status.REFLEX_ABORTED)
        self.mode = RobotMode.REFLEX

    def _user_stop(self) -> None:
        if self.mode is RobotMode.MOVE:
            self.outcome = Status.EMERGENCY_ABORTED
        self.mode, self.generator, self.controller = RobotMode.USER_STOPPED, Generator.IDLE, Controller.OTHER
        self._recovered_at = None
        self.tau_d[:] = 0.0
        self._hold()

    def _end(self, outcome: Status | None) -> None:
        """Ends any motion and holds the position."""
        if outcome is not None:
            self.outcome = outcome
        if self.controller is Controller.EXTERNAL or self.mode is not RobotMode.MOVE:
            self._hold()
        self.mode, self.generator, self.controller = RobotMode.IDLE, Generator.IDLE, Controller.OTHER
        if self.errors.any() and outcome is None:
            self.mode = RobotMode.REFLEX
        self._recovered_at = None
        self.tau_d[:] = 0.0

    def _hold(self) -> None:
        limits = self.limits
        slack = 1e-3  # rad, distance from the joint limits at which a motion may start
        self.motion.place(np.clip(self.arm.position, limits.lower + slack, limits.upper - slack), self.arm.velocity)

    def _drive(self) -> None:
        arm, motion, stiffness = self.arm, self.motion, self.settings.stiffness
        if self.mode is RobotMode.USER_STOPPED:
            self.torque.fill(0.0)
            arm.command("brake", self.torque, self.torque)
        elif self.mode is RobotMode.MOVE and self.controller is Controller.EXTERNAL:
            self.torque[:] = self.tau_d
            arm.command("torque", self.torque, self.torque)
        elif np.array_equal(stiffness, arm.stiffness):
            # The drives apply the same spring, so it is stable at any rate at which the controller is served.
            np.multiply(stiffness, motion.q - arm.position, out=self.torque)
            arm.command("position", motion.q, motion.dq)
        else:
            self.torque[:] = self._impedance()
            arm.command("torque", self.torque, self.torque)

    def _know(self) -> None:
        """Prepares what follows from the settings alone."""
        self._felt.know(self.settings)
        self._ee = self.settings.F_T_EE
        self._desired_at = b""

    def _carried(self) -> Payload:
        """Adds tool and load together and puts them into the model."""
        tool, settings = self.tool, self.settings
        mass = tool.mass + settings.load_mass
        moment = tool.mass * np.array(tool.com) + settings.load_mass * settings.load_centre
        x, y, z = (moment / mass).tolist() if mass else (0.0, 0.0, 0.0)
        carried = Payload(mass, (x, y, z))
        self._model = pinocchio_model(FR3 if self.robot == "fr3" else PANDA, payload=carried, rotors=True)
        self._work, self._desired = self._model.createData(), self._model.createData()
        self._flange = self._model.getFrameId(FLANGE)
        return carried

    def _impedance(self) -> Array:
        """N m (7,): the torques of a spring and a damper to the desired motion, from values predicted one step ahead.

        With the prediction, a stiff spring on a light joint stays stable (stable PD, Tan, Liu and Turk 2011). The
        predicted step also depends on the external torques: without them the spring would yield more.
        """
        M = pin.crba(self._model, self._work, self.arm.position, pin.Convention.WORLD)
        K = self.settings.stiffness
        D = 2 * DAMPING * np.sqrt(K * M.diagonal())
        motion, q, dq, outer = self.motion, self.arm.position, self.arm.velocity, self.external
        effective = M.copy()
        effective.flat[::8] += DT * D + DT * DT * K
        push = K * (motion.q - q - DT * dq) + D * (motion.dq - dq) + M @ motion.ddq
        return M @ np.linalg.solve(effective, push + outer) - outer
