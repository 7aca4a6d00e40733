"""A UR e-Series arm as a device: states at 500 Hz by RTDE, commands by registers to our own program on the arm.

Each command has a number. The program sends the number back once it has taken the command, so a stalled link never
holds more than two commands. Each command also says for how long it is valid. If no other command follows in that
time, the arm stops itself.
"""

from __future__ import annotations

import contextlib
import time
from math import isfinite
from typing import Final, TypeVar

from srl.drivers.devicetime import DeviceTime
from srl.drivers.linked import Linked
from srl.drivers.transport import Transport, open_transport
from srl.drivers.ur import registers, rtde, sample
from srl.drivers.ur.bring_up import PROTECTIVE, Controller, Identity, resolve
from srl.drivers.ur.config import UrConfig, address
from srl.drivers.ur.declaration import FORCE, commands, limits, measured, remark, states
from srl.drivers.ur.declaration import fault as fault_of
from srl.drivers.ur.handshake import Handshake
from srl.drivers.ur.numbering import REST, Numbering
from srl.drivers.ur.registers import CYCLE, Mode, ScriptState
from srl.drivers.ur.rtde import Kind, Parser
from srl.drivers.ur.sample import Sample, Words
from srl.drivers.ur.script import program
from srl.drivers.ur.status import RobotBits, RobotMode, RuntimeState, SafetyBits, safety_words
from srl.drivers.ur.steps import Steps, pause, until
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.runtime.contracts.signals import Stop

RATE: Final = 500.0  # Hz
UNANSWERED: Final = 2  # commands on their way: the one that the program is answering, and one behind it
SILENCE: Final = 2_000_000_000  # ns without data after which the controller counts as lost
KEEP_ALIVE: Final = 1_000_000_000  # ns between STAY commands while no other command is sent
SETTLE: Final = 5.0  # s for a stop to be released
OTHER: Final = 2.0  # s for an earlier program of ours to end by itself
T = TypeVar("T")


class Ur(Linked[Transport]):
    """A Universal Robots e-Series arm, driven over RTDE.

    States at 500 Hz, all of one instant: `position`, `velocity`, `effort` (6,); `wrench` (6,), N and N m, at the tool
    centre point in axes of the controller's base, payload compensated; `pose` (7,) of the tool centre point in that
    base, m and quaternion w x y z; `speed_scaling` (1,), 0 to 1; `buttons` (m,), digital inputs.

    Command: `velocity_command` (6,), rad/s, or `position_command` (6,), rad, selected by `interface`. With `interface:
    none` the arm is only read: no input is claimed, no program sent, nothing switched. Source: protocol sheet ur-rtde.
    """

    Config = UrConfig
    summary = "Universal Robots e-Series arm, joint velocity or position at 500 Hz (RTDE)"
    gives = ("position", "velocity", "effort", "wrench", "pose", "speed_scaling", "buttons")
    takes = ("velocity_command", "position_command")
    links = ("flange",)
    pictured_as = "{model}"
    max_age = 0.04

    def __init__(self, name: str, config: UrConfig) -> None:
        super().__init__(name, config)
        self.config: UrConfig = config
        self.states = states(config, name)
        self.ranges["wrench"] = -FORCE, FORCE
        self.commands = commands(config)
        self.limits = {c.name: limits(config) for c in self.commands}
        self._command = f"{config.interface}_command"
        self._cycles = max(1, round(config.timeout / CYCLE))  # for which a command is valid
        self._inputs = tuple(config.buttons.values())
        self._parser = Parser(rtde.ANSWERS)
        self._controller: Controller | None = None
        self._identity: Identity | None = None
        self._sample = Sample()
        self._time = DeviceTime(1)
        self._now = 0
        self._heard = -1  # ns, time of the newest data
        self._numbers = Numbering(0, self._cycles)
        self._sent = -1  # ns, time of the newest command of any kind
        self._follows = False  # the newest command that was sent moves the arm
        self._moves = False  # the newest command that moves the arm is still in force
        self._stay = False  # a STAY command waits for the link
        self._held_back = 0
        self._steps: Steps[None] | None = None  # a recovery that is running
        self._failed = ""  # why the last recovery failed
        self._diagnosed: tuple[object, ...] = ()
        self._stopped_at = 0  # ns, when the present protective stop was first seen
        self._scaling = 1.0

    # -- lifecycle

    def connect(self) -> Transport:
        where = address(self.config.port)
        host = resolve(where.host, self._place)
        self._now = time.monotonic_ns()
        self._controller = Controller(self.config, where, host, self._place, self._clock)
        self._identity = self._finish(self._controller.identify())
        return open_transport(where.url, place=self.name)

    def _set_up(self, link: Transport) -> None:
        """Blocks up to about 15 s, and 80 s more with `power_on`. The arm stays still.

        If the arm is in a protective stop, it is opened all the same, with `health.fault` set.
        """
        self._join(link)
        self._time.restart()
        self._heard = self._sent = -1  # the loop's clock may differ from the clock used in `open`

    def _receive(self, link: Transport, now: int) -> None:
        self._now = now
        if self._heard < 0:
            self._heard = self._sent = now
        data = link.read()
        if data and self._take(data):
            self._heard = now
            self._fill(now)
        elif now - self._heard > SILENCE:
            raise self._lost("the controller sends no data any more", "Check the controller")
        if self._steps is not None:
            self._recovering()
        self._tend(link, now)
        if now - self._sent > self.config.timeout * 1e9:
            self._publish_rest()

    def write(self, now: int) -> None:
        """Sends nothing while `health.fault` is set."""
        link = self._open_link()
        if self.health.fault or not self.commands:
            return
        values = self.command_arrays[self._command].tolist()
        if not isfinite(sum(values)):
            return
        try:
            if self._pending() >= UNANSWERED or not self._send(link, Mode.FOLLOW, values, now):
                self._held_back += 1
            else:
                self.sent_arrays[self._command][:] = values
                self._moves = True
            self.health.unsent = registers.SIZE
        except DeviceLostError:
            self.health.connected = False
            raise

    def stop(self, category: Stop) -> None:
        """The program decelerates the arm with `deceleration` and holds it there."""
        if self._link is None or not self.commands:
            return
        self._stay = True
        with contextlib.suppress(DeviceError):  # the next read reports a lost link
            self._tend(self._link, self._now)

    def close(self) -> None:
        """The program ends; the arm stays switched on and stands still."""
        if self._steps is not None:
            self._steps.close()
            self._steps = None
        super().close()
        self.health.fault = ""

    def _end(self, link: Transport) -> None:
        if self.health.connected and self._numbers.nonce:
            link.write_all(self._numbers.next(Mode.END), 0.2)

    def recover(self, now: int) -> None:
        """Ends a protective stop (no sooner than 5 s after it began), switches the arm on if `power_on` is set, and
        loads the control program again.
        """
        self._now = now
        if self._steps is None and self._link is not None and self.commands:
            self._failed = ""
            self._steps = self._recovery()

    def fileno(self) -> int | None:
        """The socket of RTDE."""
        return self._link.fileno() if self._link is not None else None

    def stop_frames(self, category: Stop) -> tuple[bytes, ...]:
        """The STAY command.

        After an incomplete frame it is garbage, which ends the connection. Then the newest command's time runs out,
        and this stops the arm.
        """
        return self._numbers.stop_frames

    def metrics(self) -> dict[str, object]:
        """Returns the arm's identity and software, and the commands not sent because earlier ones were unanswered."""
        return {"identity": str(self._identity or ""), "held_back": self._held_back}

    # -- cycle

    def _take(self, data: bytes) -> bool:
        """Takes the newest sample; returns whether one came."""
        parser, health = self._parser, self.health
        newest = parser.sole(data)
        if newest is None:
            for message in parser.feed(data):
                if message.kind == Kind.DATA:
                    newest = message.body
                elif message.kind == Kind.TEXT and (remark := rtde.text(message.body)):
                    health.message = remark.text
        health.frames, health.errors, health.resyncs = parser.frames, parser.errors, parser.resyncs
        return newest is not None and self._sample.take(newest)

    def _fill(self, now: int) -> None:
        found = self._sample
        self._diagnose(found.words)
        if not self.commands and not measured(found.words.robot_mode):
            return  # without a new stamp, so that it becomes stale: angles that nobody measures count for nothing
        found.fill(self.state_arrays, self._inputs)
        self.health.stamp = self._time.stamp(round(found.timestamp * 1e9), now)
        self.health.unsent = registers.SIZE if self.commands and self._pending() else 0
        if self.commands and abs(found.speed_scaling - self._scaling) > 0.005:
            self._scaling = found.speed_scaling
            slowed = self._scaling < 0.995
            self.health.message = f"speed scaled to {self._scaling:.0%}" if slowed else str(self._identity)

    def _diagnose(self, words: Words) -> None:
        """Updates `health.fault` if anything that it depends on has changed."""
        key = (*words[:6], self._numbers.nonce, self._failed, self._steps is None)
        if key == self._diagnosed:
            return
        self._diagnosed = key
        if not words.safety_bits & SafetyBits.PROTECTIVE_STOP:
            self._stopped_at = 0
        elif not self._stopped_at:
            self._stopped_at = self._now
        if not self.commands:  # what keeps it from moving keeps nobody from reading it
            self.health.message = remark(words) or f"{self._identity}, only read"
            return
        fault = fault_of(words, self._numbers.nonce, self.config.timeout)
        if self._steps is not None:
            fault = f"recovering: {fault}" if fault else "recovering"
        elif fault and self._failed:
            fault = f"{fault} ({self._failed})"
        if fault and not self.health.fault:
            self._stay = True  # a program that was only paused must not continue with its last command
        self.health.fault = fault

    def _tend(self, link: Transport, now: int) -> None:
        """Sends STAY if it was requested, or if it is due because no other command is sent."""
        if self._stay or (not self._follows and self._numbers.nonce and now - self._sent > KEEP_ALIVE):
            self._stay = not self._send(link, Mode.STAY, REST, now)

    def _send(self, link: Transport, mode: Mode, values: list[float] | tuple[float, ...], now: int) -> bool:
        if not link.write(self._numbers.next(mode, values)):
            self._numbers.take_back()
            return False
        self._sent = now
        self._follows = mode is Mode.FOLLOW
        if not self._follows:
            self._publish_rest()
        self._stay = self._stay and not self._follows
        return True

    def _publish_rest(self) -> None:
        """Reports that no velocity is in force any more: STAY was sent, or the newest command's time has run out."""
        if self._moves and self.config.interface == "velocity":
            self.sent_arrays[self._command][:] = 0.0
        self._moves = False

    def _pending(self) -> int:
        """Returns the number of commands that were sent and that the program hasn't answered."""
        return self._numbers.unanswered(self._sample.words.taken)

    # -- opening and recovery

    def _join(self, link: Transport) -> None:
        handshake = Handshake(link, self._place)
        handshake.greet()
        handshake.require(self.config.effort)
        outputs = handshake.outputs(RATE, sample.names(self.config.effort), sample.TYPES)
        recipe = handshake.inputs(registers.INPUTS, registers.INPUT_TYPES)[0] if self.commands else 0
        first = handshake.start(*outputs)
        self._parser = handshake.parser
        self._sample = Sample()  # what an earlier connection reported about the arm is no longer true
        if not self._sample.take(first.body):
            raise self._error("the controller's first sample isn't finite", "Restart the controller")
        self.health.message = handshake.text or str(self._identity)
        self._failed, self._diagnosed, self._stopped_at = "", (), 0
        self._numbers = Numbering(recipe, self._cycles)
        if not self.commands:
            return
        if safety_words(self._sample.words.safety_bits):
            self._new_nonce()  # the user has to act first, and the diagnosis reports this
            return
        self._dismiss(link)
        if not self._finish(until(lambda: not self._program_runs(), self._clock, OTHER)):
            raise self._error(
                "another program runs on the controller",
                "Stop it at the pendant, or end the other client that drives this arm",
            )
        self._finish(self._load())

    def _dismiss(self, link: Transport) -> None:
        """Ends a program of ours that still waits for a driver that is gone: the inputs belong to this driver now."""
        words = self._sample.words
        if self._program_runs() and words.state in (ScriptState.READY, ScriptState.FOLLOWING):
            self._numbers.adopt(words.nonce, words.taken)
            self._send(link, Mode.END, REST, self._now)

    def _load(self) -> Steps[None]:
        """Sends a new control program and waits until it obeys this driver."""
        controller, link = self._controller, self._open_link()
        assert controller is not None
        nonce = self._new_nonce()
        # Before anything else the registers must hold our number and a STAY command.
        yield from until(lambda: self._send(link, Mode.STAY, REST, self._now), self._clock, 1.0)

        def runs() -> bool:
            words = self._sample.words
            return (
                words.nonce == nonce
                and words.state == ScriptState.READY
                and words.runtime_state == RuntimeState.PLAYING
                and words.taken == self._numbers.sequence
            )

        yield from controller.upload(program(self.config, nonce), runs)

    def _recovery(self) -> Steps[None]:
        clock, controller = self._clock, self._controller
        assert controller is not None
        bits = self._sample.words.safety_bits
        if bits & SafetyBits.PROTECTIVE_STOP:
            yield from pause(clock, max(0.0, PROTECTIVE - (self._now - self._stopped_at) * 1e-9))
            yield from controller.unlock()
            yield from until(lambda: not self._sample.words.safety_bits & SafetyBits.PROTECTIVE_STOP, clock, SETTLE)
        if words := safety_words(self._sample.words.safety_bits):
            raise self._error(words, "Reset again afterwards")
        yield from controller.power()
        if not (yield from until(lambda: self._sample.words.robot_mode == RobotMode.RUNNING, clock, SETTLE)):
            raise self._error("the arm doesn't come to run", "See the pendant")
        yield from self._load()

    def _recovering(self) -> None:
        assert self._steps is not None
        try:
            next(self._steps)
            return
        except StopIteration:
            self._failed = ""
        except DeviceLostError:
            raise
        except DeviceError as error:
            self._failed = f"recovery failed: {error.problem}"
            self.health.message = str(error)
        self._steps = None
        self._diagnose(self._sample.words)

    def _finish(self, steps: Steps[T]) -> T:
        """Runs steps to their end and reads data meanwhile. Blocks."""
        while True:
            self._now = time.monotonic_ns()
            try:
                next(steps)
            except StopIteration as end:
                result: T = end.value
                return result
            time.sleep(CYCLE / 2)
            if self._link is not None:
                self._take(self._link.read())

    def _new_nonce(self) -> int:
        self._follows = self._stay = False
        return self._numbers.renew()

    def _program_runs(self) -> bool:
        return bool(self._sample.words.robot_bits & RobotBits.PROGRAM_RUNNING)

    def _clock(self) -> int:
        return self._now
