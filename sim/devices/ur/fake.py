"""A UR arm in the cell: the controller's cycles run inside the world; the fake shows them as the driver would."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from typing import Final, Literal

import numpy as np
from pydantic import Field

from srl.drivers.ur import Ur, UrConfig
from srl.drivers.ur.declaration import fault as fault_of
from srl.drivers.ur.declaration import measured, remark
from srl.drivers.ur.registers import CYCLE, ScriptState
from srl.drivers.ur.sample import Words, fill_pose
from srl.drivers.ur.status import RobotBits, RobotMode, SafetyMode
from srl.runtime.contracts.errors import DeviceError, WiringError
from srl.runtime.contracts.signals import Array, Stop
from srl.runtime.contracts.world import World
from srl.sim.devices.shared.sensor import SampledFake, SensorOptions
from srl.sim.devices.shared.windows import Windows, inside
from srl.sim.devices.ur.controller import UrController
from srl.sim.parts.robots.arm import ArmPart

# A sample holds the measured values, the controller's targets, and the controller's memory. So a restored world
# restores the controller, too.
Q, QD, EFFORT, TORQUE = slice(0, 6), slice(6, 12), slice(12, 18), slice(18, 24)
WRENCH, TOOL, TWIST = slice(24, 30), slice(30, 36), slice(36, 42)
MEASURED: Final = 42
TARGET_Q, TARGET_QD, TARGET_QDD = slice(42, 48), slice(48, 54), slice(54, 60)
SCALING, ROBOT, SAFETY, BITS, RUNTIME, INPUTS = range(60, 66)
STATE, SILENT, LOCKED, FOLLOWS = range(66, 70)
GOAL = slice(70, 76)
SIZE: Final = 76
_NOISE: Final = np.repeat((1e-5, 1e-3, 0.0, 0.5, 0.0, 0.0, 0.0), 6)  # rad, rad/s, N m, N m, then wrench and tool
_NOISE[24:30] = (0.5, 0.5, 0.5, 0.03, 0.03, 0.03)
_OURS: Final = 1  # the fake's own nonce


class FakeUrConfig(SensorOptions):
    """Options of the fake."""

    rate: Literal[500] = 500
    noise: float = Field(default=1.0, ge=0, description="multiplies 1e-5 rad, 1e-3 rad/s, 0.5 N m, 0.5 N, 0.03 N m")
    delay: float = Field(default=0.001, ge=0, le=0.5, description="s, from the controller's cycle to its arrival")
    slider: float = Field(default=1.0, gt=0, le=1, description="the pendant's speed slider")
    force_limit: float = Field(default=250.0, gt=0, description="N at the flange that stop the arm protectively")
    start: Literal["running", "power-off"] = "running"
    host: str = Field(default="127.0.0.1", description="loopback address that the twin listens on")
    standard_ports: bool = Field(default=False, description="the twin listens at the real controller's ports")
    emergency: Windows = Field(default=(), description="s, [from, to] pairs: the emergency stop is pressed")
    safeguard: Windows = Field(default=(), description="s, [from, to] pairs: somebody is in the guarded area")
    protective: tuple[float, ...] = Field(default=(), description="s, times at which the arm stops protectively")
    presses: dict[str, Windows] = Field(default={}, description="s, by button: [from, to] pairs: its input is on")


class _Stream:
    """What the driver's control script does, for the fake; see drivers/ur/script."""

    name = "srl_control"

    def __init__(self, controller: UrController, config: UrConfig) -> None:
        self._controller, self._config = controller, config
        self._cycles = max(1, round(config.timeout / CYCLE))
        self.goal: list[float] | None = None  # None: hold still
        self.silent = 0
        self.state = ScriptState.READY

    def follow(self, goal: list[float]) -> None:
        self.goal, self.silent = goal, -1

    def stay(self) -> None:
        self.goal, self.silent = None, -1

    def cycle(self) -> bool:
        self.silent += 1
        config, motion = self._config, self._controller.motion
        if self.goal is not None and self.silent >= self._cycles:
            self.state = ScriptState.TIMED_OUT
            motion.stop(config.deceleration)
            return False
        if self.goal is None:
            if self.state is ScriptState.FOLLOWING:
                motion.stop(config.deceleration)
            self.state = ScriptState.READY
        else:
            self.state = ScriptState.FOLLOWING
            if config.interface == "velocity":
                motion.speed(self.goal, config.acceleration)
            else:
                motion.servo(self.goal, config.lookahead, config.gain)
        return True


class _Freedrive:
    """A person leads the arm by hand, from the pendant."""

    name = "freedrive"

    def __init__(self, controller: UrController) -> None:
        self._controller = controller

    def cycle(self) -> bool:
        self._controller.motion.free()
        return True


class FakeUr(SampledFake):
    """The arm of the cell's part `ur16e`, with the driver's states, commands, faults and recovery.

    Sample k is the controller's cycle k, at k / 500 s of world time. `controller` is the arm itself; a twin uses it,
    too.

    Attributes:
        controller: power, safety, motion.
        after_cycle: called at the end of each of the controller's cycles; set by a twin.
    """

    Options = FakeUrConfig
    real = Ur
    config: UrConfig
    options: FakeUrConfig
    noise_scale = np.concatenate([_NOISE, np.zeros(SIZE - MEASURED)])

    def __init__(self, name: str, config: UrConfig, world: World, options: FakeUrConfig) -> None:
        super().__init__(name, config, world, options)
        self._config, self._options = config, options
        arm = self.cell.part(ArmPart, name, options.part)
        if arm.n != 6:
            raise WiringError(f"sim.devices.{name}.part", f"'{arm.name}' has {arm.n} joints, a UR has 6", "Use a ur16e")
        if unknown := set(options.presses) - set(config.buttons):
            raise WiringError(
                f"sim.devices.{name}.presses", f"the arm has no button '{unknown.pop()}'", "Name one it has"
            )
        self.controller = UrController(arm, options.force_limit)
        self.controller.slider = self.controller.scaling = options.slider
        if config.payload is not None:
            self.controller.know_payload(config.payload, config.payload_cog)
        if config.tcp is not None:
            self.controller.set_tcp(config.tcp)
        if options.start == "power-off":
            self.controller.power_off()
        self._arm = arm
        self._program: _Stream | None = None
        self._command = f"{config.interface}_command"
        if arm.wearer is not None and not self.commands:
            self.controller.run(_Freedrive(self.controller))
        self._recovering = False
        self._failed = ""
        self._number = -1  # number of the newest cycle
        self.after_cycle: Callable[[], None] = lambda: None
        self._stops = [round(at / CYCLE) for at in options.protective]
        self.sampled(SIZE, self._cycle)

    # -- the driver's interface

    def open(self) -> None:
        """With `power_on` the arm is on at once."""
        super().open()
        self._recovering, self._failed = False, ""
        if not self.commands:
            return
        controller = self.controller
        if controller.robot_mode is not RobotMode.RUNNING:
            if not self._config.power_on or controller.emergency:
                self.health.connected = False
                raise DeviceError(
                    self.name,
                    f"the arm isn't ready to move (robot mode {controller.robot_mode.name})",
                    "Set 'power_on: true'; release the emergency stop",
                )
            controller.robot_mode = RobotMode.RUNNING
            controller.motion.halt(self._arm.position)
        self._load()

    def read(self, now: int) -> None:
        stamp = self.health.stamp
        super().read(now)
        if not self.commands:
            if not measured(self.controller.robot_mode):
                self.health.stamp = stamp  # as the driver, which takes no sample then
            self.health.message = remark(self._words()) or f"simulated {self._config.model}, only read"
            return
        if self._recovering:
            self._recover()
        words = self._words()
        fault = fault_of(words, _OURS, self._config.timeout)
        if self._recovering:
            fault = f"recovering: {fault}" if fault else "recovering"
        elif fault and self._failed:
            fault = f"{fault} ({self._failed})"
        if fault and self._program is not None:
            self._program.stay()
            self._publish_rest()
        self.health.fault = fault

    def fill(self, values: Array, number: int) -> None:
        arrays, config = self.state_arrays, self._config
        if not self.commands and not measured(int(values[ROBOT])):
            return
        arrays["position"][:] = values[Q]
        arrays["velocity"][:] = values[QD]
        arrays["effort"][:] = values[EFFORT if config.effort == "target" else TORQUE]
        arrays["wrench"][:] = values[WRENCH]
        fill_pose(values[TOOL].tolist(), arrays["pose"])
        arrays["speed_scaling"][0] = values[SCALING]
        if config.buttons:
            bits = int(values[INPUTS])
            arrays["buttons"][:] = [bits >> number & 1 for number in config.buttons.values()]

    def write(self, now: int) -> None:
        self.check_there()
        if self._program is None:
            return
        values = self.command_arrays[self._command].tolist()
        if not self.health.fault and isfinite(sum(values)):
            self._program.follow(values)
            self.sent_arrays[self._command][:] = values

    def stop(self, category: Stop) -> None:
        if self._program is not None:
            self._program.stay()
            self._publish_rest()

    def _publish_rest(self) -> None:
        if self._config.interface == "velocity":
            self.sent_arrays[self._command][:] = 0.0

    def close(self) -> None:
        super().close()
        self.health.fault = ""
        if self._program is not None:
            if self.controller.program is self._program:
                self.controller.end_program()
            self._program = None

    def recover(self, now: int) -> None:
        self._recovering, self._failed = bool(self.commands), ""

    # -- internals

    def _load(self) -> None:
        self._program = _Stream(self.controller, self._config)
        if not self.controller.run(self._program):
            self._program.state = ScriptState.NONE

    def _recover(self) -> None:
        controller = self.controller
        if controller.safety_mode is SafetyMode.PROTECTIVE_STOP and not controller.unlock():
            return  # the stop isn't 5 s old yet
        if controller.robot_mode is not RobotMode.RUNNING:
            if not self._config.power_on or controller.emergency:
                self._recovering, self._failed = False, "recovery failed: the arm isn't ready to move"
                return
            controller.power_on()
            controller.brake_release()
            return
        if controller.safety_mode is SafetyMode.SAFEGUARD_STOP:
            self._recovering, self._failed = False, "recovery failed: somebody is in the guarded area"
            return
        self._load()
        self._recovering = False

    def _words(self) -> Words:
        controller, program = self.controller, self._program
        state = ScriptState.NONE if program is None else program.state
        return Words(
            int(controller.robot_mode), int(controller.safety_bits), int(controller.robot_bits),
            int(controller.runtime_state), _OURS, int(state), 0, controller.inputs,
        )  # fmt: skip

    def _cycle(self) -> Array:
        """Runs one cycle of the controller; returns its sample, with the arm's values before the cycle takes effect."""
        controller, arm, motion = self.controller, self._arm, self.controller.motion
        if self._samples is not None and self._samples.taken != self._number + 1:
            self._restore(self._samples.taken - 1)
        self._number += 1
        self._events(self._number * CYCLE)
        controller.cycle()
        self.after_cycle()
        values = np.empty(SIZE)
        values[Q], values[QD] = arm.position, arm.velocity
        values[EFFORT], values[TORQUE] = arm.gravity(), arm.effort
        values[WRENCH], values[TOOL], values[TWIST] = controller.wrench, controller.tool(), controller.tool_twist()
        values[TARGET_Q], values[TARGET_QD] = controller.target()
        values[TARGET_QDD] = motion.qdd
        values[SCALING : INPUTS + 1] = (
            controller.scaling, controller.robot_mode, controller.safety_mode, controller.robot_bits,
            controller.runtime_state, controller.inputs,
        )  # fmt: skip
        program = self._program
        values[STATE:] = 0.0
        values[LOCKED] = controller.locked_until
        if program is not None:
            values[STATE], values[SILENT], values[FOLLOWS] = program.state, program.silent, program.goal is not None
            values[GOAL] = program.goal or 0.0
        return values

    def _events(self, at: float) -> None:
        options, controller = self._options, self.controller
        now = round(at * 1e9)
        controller.emergency, controller.safeguard = inside(options.emergency, now), inside(options.safeguard, now)
        for name, number in self._config.buttons.items():
            bit = 1 << number
            on = inside(options.presses.get(name, ()), now)
            controller.inputs = controller.inputs | bit if on else controller.inputs & ~bit
        if self._number in self._stops:
            controller.protective_stop("so the profile says")

    def _restore(self, number: int) -> None:
        """Restores the controller to its state at sample `number`, after the world was restored."""
        self._number = number
        if number < 0:
            return
        values, controller = self.samples[number], self.controller
        controller.cycles = number
        controller.robot_mode, controller.safety_mode = RobotMode(int(values[ROBOT])), SafetyMode(int(values[SAFETY]))
        controller.scaling, controller.locked_until = float(values[SCALING]), int(values[LOCKED])
        motion = controller.motion
        motion.q[:], motion.qd[:], motion.qdd[:] = values[TARGET_Q], values[TARGET_QD], values[TARGET_QDD]
        motion.stop(self._config.deceleration)
        controller.program = None
        if self._program is not None:
            self._program.state, self._program.silent = ScriptState(int(values[STATE])), int(values[SILENT])
            self._program.goal = values[GOAL].tolist() if values[FOLLOWS] else None
            if RobotBits(int(values[BITS])) & RobotBits.PROGRAM_RUNNING:
                controller.program = self._program
