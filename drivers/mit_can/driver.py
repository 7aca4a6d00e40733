"""MIT-mode actuators on one CAN bus: a command and a reply each a cycle, without blocking."""

from __future__ import annotations

import contextlib
from math import inf, isfinite
from typing import Final

import can
import numpy as np

from srl.drivers.canbus import CanLink, frame_bits, open_can, shared_bus
from srl.drivers.linked import Addressed
from srl.drivers.mit_can import declare, protocol
from srl.drivers.mit_can.axes import Axes
from srl.drivers.mit_can.checks import same_place, stoppable
from srl.drivers.mit_can.config import MitCanConfig
from srl.drivers.mit_can.declare import COMMANDS, KINDS, PERIOD, STATES
from srl.drivers.mit_can.faults import MitFaults, warnings
from srl.drivers.mit_can.line import Line, command_ids
from srl.drivers.mit_can.motor import Motor, Stage
from srl.drivers.mit_can.opening import Opening
from srl.drivers.mit_can.protocol import Impedance, State
from srl.drivers.mit_can.replies import Replies
from srl.runtime.contracts.driver import Traffic
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.runtime.contracts.signals import Kind, Stop

UNANSWERED: Final = 3  # frames without a reply, and
SILENT: Final = 10_000_000  # ns without one, after which a motor is silent
STATUS: Final = 100_000_000  # ns, the same of a V3, which may send its status at a slow rate of its own
LOST: Final = 500_000_000  # ns without a word from any motor
AGAIN: Final = 20_000_000  # ns between two attempts to enable a motor
ASLEEP: Final = 500_000_000  # ns after which a motor that doesn't enable is a fault
HOLDS: Final = 0.05  # s, up to which a position is near to where a CubeMars that let go after 25 ms has come
CLEARED: Final = 50_000_000  # ns: a drive packs its reply before it obeys
UNHEARD: Final = 40_000_000  # ns without a status, after which a V3 may have started anew
JUMP: Final = 0.3  # rad of the shaft between two replies that no motion explains


class MitCan(Addressed):
    """Axes driven by actuators in MIT mode.

    States, all (n,) in the profile's order of motors: `position` (rad; m of a prismatic axis), `velocity`, `effort`
    (N m, N: from the current, without friction), `temperature` (degC, the hottest that the drive tells). One command,
    by `interface`: `position_command`, `velocity_command` or `effort_command`. The drive itself does
    torque = kp (p - q) + kd (v - dq) + t, with the profile's gains. A stamp is when the oldest of the motors' newest
    replies arrived. Source: protocol sheet can_actuators, sections 1 and 2.
    """

    Config = MitCanConfig
    summary = "MIT-mode actuators on CAN: CubeMars AK (V1 to V3) and Damiao"
    gives = STATES
    takes = COMMANDS
    max_age = 0.05
    timeout = 1.0  # of the opening, for whoever answers slower or at once

    def __init__(self, name: str, config: MitCanConfig) -> None:
        super().__init__(name, config)
        self.config: MitCanConfig = config
        motors = list(config.motors.values())
        self._v3, self._damiao = config.generation == "v3", config.maker == "damiao"
        self._kind = KINDS[config.interface]
        self.states = declare.states(config)
        self.commands = (declare.command(config),)
        self._name = self.commands[0].name
        bits = 2.0 * frame_bits(8, self._v3) * len(motors)
        self.traffic = Traffic(shared_bus(config.port), config.bitrate, bits, 0.0, *declare.identifiers(config))
        if all(motor.home is not None for motor in motors):
            self.home[self._name] = np.array([motor.home for motor in motors])
        self._axes = Axes(config, [motor.span(config.generation) for motor in motors], [0.0] * len(motors))
        self.limits[self._name] = declare.limits(config, self._axes.spans)
        self._faults = MitFaults(config.motors)
        self._replies = Replies(config, command_ids(config))
        self._line: Line | None = None
        self._refused = 0
        self._forget()

    def _forget(self) -> None:
        self._motors: list[Motor] = []
        self._started = False  # all were armed since the last stop
        self._cleared = -1  # ns, until which replies may still show errors that were cleared
        self._writing = self._moved = False
        self._rest = Stop.DAMP  # what an enabled motor without a command does
        self._damped: tuple[bytes, ...] = ()  # stop frames
        self._limp: tuple[bytes, ...] = ()
        self._frames: tuple[tuple[bytes, ...], tuple[bytes, ...]] = (), ()  # the held commands, and their frames

    # -- life cycle

    def open(self) -> None:
        """Blocks some 10 ms a motor, up to a second if one is missing.

        A Damiao stays as it is. A CubeMars V1 or V2 is enabled with damping alone, if the profile lets it.
        """
        self.close()
        link = self.connect()
        try:
            stoppable(link, self.config, self._place)
            found = Opening(link, self.config, self._place, self.timeout).find()
            if self.health.was_open:
                stood = [motor.position + self._axes.offset[motor.number] for motor in self._motors]
                same_place(found, stood, self.config, self._place)
        except BaseException:
            link.close()
            raise
        self._forget()
        axes = self._axes = Axes(self.config, found.spans, found.offset)
        self._replies.spans = found.spans
        self.limits = {self._name: declare.limits(self.config, found.spans)}
        self._faults.clear()
        for i, (motor, state) in enumerate(zip(self.config.motors.values(), found.states, strict=True)):
            damp, slack = axes.encode(i, Impedance(kd=motor.damping)), axes.encode(i, Impedance())
            self._motors.append(Motor(i, motor, damp, slack, state.position, on=not self._damiao))
            axes.fill(self.state_arrays, i, state)
            self._judge(self._motors[i], state, -1)
        line = self._line = Line(link, self.config, self._place)
        self._damped = line.stop_frames([motor.damp for motor in self._motors], off=False)
        self._limp = line.stop_frames([motor.slack for motor in self._motors], off=True)
        self.health.opened()
        self.health.fault = self._faults.text()
        self._words = found.words
        if link.stop_fileno() is None:
            own = f"only their own watchdog ({self.config.watchdog:g} s)" if self._damiao else "nothing"
            self._words += f"; over {link.interface} {own} stops them if this program dies"
        self.health.message = self._words

    def connect(self) -> CanLink:
        """Opens the bus."""
        return open_can(self.config.port, place=self._place)

    def read(self, now: int) -> None:
        line = self._open_line()
        try:
            for motor in self._motors:
                motor.heard = now if motor.heard < 0 else motor.heard
            for message in line.link.read():
                self._take(line, message, line.link.stamp(message, now))
            self.health.errors = self._replies.strange
            self._look(line, now)
            if not self._writing:
                for motor in self._motors:
                    self._damp_or_ask(line, motor, now)
        except DeviceLostError as error:
            self.health.lost(error.problem)
            raise
        self._writing = False
        self.health.fault = self._faults.text()

    def write(self, now: int) -> None:
        """A motor is enabled with damping alone first; then its stiffness rises within `ramp`.

        Until all are armed, none goes on from its first command; a torque is given at once. Each motor has a frame of
        its own, so of a bus that takes some of them those count as sent.
        """
        line = self._open_line()
        self._writing = self._moved = True
        try:
            for motor, value in zip(self._motors, self.command_arrays[self._name].tolist(), strict=True):
                if motor.armed or (isfinite(value) and self._arm(line, motor, value, now)):
                    self._command(line, motor, value, now)
        except DeviceLostError as error:
            self.health.lost(error.problem)
            raise
        self._started = self._started or all(motor.armed for motor in self._motors)

    def stop(self, category: Stop) -> None:
        """DAMP: damping alone, again in each call. LIMP: no torque; a Damiao is disabled, too."""
        line = self._line
        if line is None or category not in (Stop.DAMP, Stop.LIMP):
            return
        self._rest, self._writing, self._started = category, True, False
        with contextlib.suppress(DeviceError):  # the next read reports a lost link
            for motor in self._motors:
                motor.disarm()
            for motor in self._motors:
                if self._damiao and not motor.on:
                    line.ask(motor.number)
                    continue
                line.send(motor.number, motor.damp if category is Stop.DAMP else motor.slack)
                if category is Stop.LIMP and self._damiao:
                    line.tell(motor.number, protocol.DISABLE)

    def close(self) -> None:
        """A position command stays with the drive; a velocity or a torque becomes damping. A Damiao lets go when its
        watchdog has expired; a CubeMars that was never moved is let go here.
        """
        line, self._line = self._line, None
        if line is None:
            return
        if self.health.connected:
            with contextlib.suppress(DeviceError):
                for motor in self._motors:
                    if self._kind is not Kind.POSITION and motor.armed:
                        line.send(motor.number, motor.damp)
                    if not self._damiao and not self._moved:
                        line.send(motor.number, motor.slack)
                        line.tell(motor.number, protocol.DISABLE)
        self._refused += line.refused
        self.health.connected = False
        line.link.close()

    def fileno(self) -> int | None:
        return self._line.link.stop_fileno() if self._line is not None else None

    def stop_frames(self, category: Stop) -> tuple[bytes, ...]:
        """One for each motor.

        HOLD repeats the last positions at rest; without a loop a velocity or a torque can only be damped. LIMP takes
        the torque away, then disables (an AK V3 has no frame for that).
        """
        if category is Stop.LIMP:
            return self._limp
        armed = any(motor.armed for motor in self._motors)
        if category is Stop.DAMP or self._kind is not Kind.POSITION or not armed:
            return self._damped
        held = tuple([motor.held for motor in self._motors])
        if self._frames[0] != held and self._line is not None:
            self._frames = held, self._line.stop_frames(held, off=False)
        return self._frames[1]

    def frames_good_for(self, category: Stop) -> float:
        """A CubeMars may let go in silence, and come alive where it was held before."""
        holds = category not in (Stop.DAMP, Stop.LIMP) and self._kind is Kind.POSITION
        return HOLDS if holds and not self._damiao else inf

    def recover(self, now: int) -> None:
        """Clears a Damiao's errors. Motors that may stand elsewhere are opened anew."""
        line, faults = self._line, self._faults
        if line is None:
            return
        if faults.doubtful or (faults.errors and not self._damiao):
            raise DeviceLostError(self._place, f"it is looked at anew: {faults.text()}", "Wait until it is open again")
        self._cleared = now + CLEARED
        for i in list(faults.errors):
            line.tell(i, protocol.CLEAR)
            self._motors[i].on = False
            self._motors[i].disarm()
        faults.clear()
        self.health.fault = ""

    def metrics(self) -> dict[str, object]:
        """Replies taken, and frames for which the bus had no room."""
        return {"replies": self.health.frames, "refused": self._refused + (self._line.refused if self._line else 0)}

    # -- commands

    def _command(self, line: Line, motor: Motor, value: float, now: int) -> None:
        """Sends an armed motor its command, in the axis' unit; what leaves, counts as sent."""
        i = motor.number
        if self._may_have_let_go(line, motor, now):
            line.send(i, motor.damp, now)
            return
        if not isfinite(value):
            line.send(i, motor.last or motor.damp, now)
            return
        if not self._started and self._kind is not Kind.TORQUE:
            value = motor.first
        value = self._axes.clear(i, value)
        held = motor.damp
        if self._kind is Kind.POSITION:
            wanted = self._position(motor, value, now)
            held = self._axes.encode(i, Impedance(wanted.position, 0.0, wanted.kp, wanted.kd))
        elif self._kind is Kind.VELOCITY:
            wanted = Impedance(velocity=value / self._axes.scale[i], kd=motor.config.kd)
        else:
            wanted = Impedance(kd=motor.config.kd, torque=value * self._axes.scale[i])
        frame = self._axes.encode(i, wanted)
        if line.send(i, frame, now):
            motor.left(frame, value, held, now)
            self.sent_arrays[self._name][i] = value

    def _position(self, motor: Motor, value: float, now: int) -> Impedance:
        """The drive's command for a position of the axis, with the speed since the one that left before."""
        config, scale, dt = motor.config, self._axes.scale[motor.number], (now - motor.at) * 1e-9
        speed = (value - motor.value) / dt / scale if motor.last and 0 < dt < PERIOD * 5 else 0.0
        ramp = self.config.ramp * 1e9
        share = min(1.0, (now - motor.since) / ramp) if ramp > 0 else 1.0
        return Impedance(self._axes.shaft(motor.number, value), speed, config.kp * share, config.kd)

    def _arm(self, line: Line, motor: Motor, value: float, now: int) -> bool:
        """Brings a motor to the point from which it may get commands; True once it is there. Sends for it till then."""
        faults, i = self._faults, motor.number
        if motor.stage is Stage.OFF:
            away = abs(value - self.state_arrays["position"].item(i)) if self._kind is Kind.POSITION else 0.0
            if away > self.config.start_tolerance * abs(self._axes.scale[i]):
                faults.far[i] = away
            if faults.concerns(i):
                self._damp_or_ask(line, motor, now)
                return False
            motor.wake(now, -AGAIN)
        if motor.on:
            motor.arm(now, value if self._kind is Kind.POSITION else 0.0)
            self._rest = Stop.DAMP
            return True
        if now - motor.since > ASLEEP:
            faults.asleep.add(i)
        if now - motor.asked >= AGAIN and i not in faults.asleep:
            motor.asked = now
            line.tell(i, protocol.ENABLE)
        line.send(i, motor.damp, now)  # at once: an enabled drive may act on an older command
        return False

    def _damp_or_ask(self, line: Line, motor: Motor, now: int) -> None:
        # After a device fault the loop sends no commands: a limb that held its position must not sink then.
        if self._v3 and not self.config.enable_at_open and not self._moved:
            return  # its status comes by itself
        if self._damiao and not motor.on:
            line.ask(motor.number)
            return
        held = motor.damp if self._may_have_let_go(line, motor, now) else motor.held
        line.send(motor.number, motor.slack if self._rest is Stop.LIMP else held, now)

    def _may_have_let_go(self, line: Line, motor: Motor, now: int) -> bool:
        """Whether a CubeMars by position is to be damped, since it may have let go; see `SilentRelease`."""
        if self._damiao or not motor.armed or self._kind is not Kind.POSITION:
            return False
        i, turn, most = motor.number, motor.config.turn, self.config.start_tolerance
        silent = line.pending[i] >= UNANSWERED and now - motor.heard > (UNHEARD if self._v3 else SILENT)
        most = min(most, turn / 4 if turn is not None else JUMP)
        if not motor.release.look(now, line.left[i], motor.heard, silent, motor.position, most):
            return False
        if (away := motor.release.moved) is not None:
            self._faults.jumped.setdefault(i, away)
            motor.disarm()
        return True

    # -- replies

    def _take(self, line: Line, message: can.Message, now: int) -> None:
        reply = self._replies.of(message)
        if reply is None:
            return
        i = reply.motor
        if reply.state is None:
            self._faults.foreign.add(i)
            return
        self.health.frames += 1
        self._motors[i].heard = now
        if line.doubled(i, now):
            self._faults.doubled.add(i)
        self._judge(self._motors[i], reply.state, now)
        self._axes.fill(self.state_arrays, i, reply.state)

    def _judge(self, motor: Motor, state: State, now: int) -> None:
        """Takes what a reply says of the motor's well-being."""
        faults, config, i = self._faults, self.config, motor.number
        if (words := protocol.in_words(state.code, self._damiao)) and now >= self._cleared:
            faults.errors[i] = words
        if self._damiao:
            if state.code == 1:
                motor.on = True
            elif motor.on:
                motor.on = False
                if motor.armed:
                    motor.disarm()
                    if state.code == 0:
                        faults.limp.add(i)
            faults.judge(i, state.hottest, config.hot, now)
        by = state.position - motor.position
        motor.position = state.position
        motor.plausible.take(by, state.velocity, now)
        if abs(by) > JUMP + abs(state.velocity) * 0.1 and i not in faults.jumped:
            faults.jumped[i] = by
            motor.disarm()  # its next command would drive it back by as much

    def _look(self, line: Line, now: int) -> None:
        """Who is silent, who is warm."""
        faults = self._faults
        heard = [motor.heard for motor in self._motors]
        for i, at in enumerate(heard):
            if line.pending[i] >= UNANSWERED and now - at > (STATUS if self._v3 else SILENT):
                faults.silent.add(i)
        if now - max(heard) > LOST:
            raise self._lost(
                f"no motor has answered for {LOST / 1e9:g} s", "Check the bus' cable and the motors' power"
            )
        self.health.stamp = min(heard)
        plausible = [motor.plausible for motor in self._motors]
        self.health.message = "; ".join(
            [self._words, *warnings(self.config, self.state_arrays["temperature"], plausible)]
        )

    def _open_line(self) -> Line:
        if self._line is None:
            raise self._not_open()
        return self._line
