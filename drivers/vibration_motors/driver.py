"""Vibration motors by the PWM of an Arduino board with StandardFirmata.

Firmata acknowledges nothing, and has neither a checksum nor a watchdog. So the board is asked what its pins are doing,
one question at a time, and what it doesn't confirm is sent again, whole. A question ends with a query of a pin that no
board has: the board says that pin's number again, so each answer is matched to its question, however late. A sample is
a confirmation, and as old as its question: a board that isn't heard, or restarts unnoticed, becomes stale. A new duty
waits for no answer.
"""

from __future__ import annotations

import contextlib
from typing import Final

import numpy as np

from srl.drivers.firmata import protocol
from srl.drivers.firmata.identify import identify, require, who
from srl.drivers.firmata.protocol import Decoder, Mode, PinState
from srl.drivers.transport import Transport, open_transport
from srl.drivers.vibration_motors.config import VibrationMotorsConfig
from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.runtime.contracts.signals import Command, Kind, Limits, Stop

COMMAND: Final = "intensity_command"
REPEAT: Final = 50_000_000  # ns after which the same duties are sent again
ANSWER: Final = 100_000_000  # ns after which the next question is asked, whether the one before was answered or not
AT_DEATH: Final = 3  # times that off is sent where nobody asks for an answer: one damaged byte could undo it
WRONG: Final = 300_000_000  # ns in which all answers are others than what was sent, after which the board is lost
_OFF: Final = (int(Mode.OUTPUT), 0)


class VibrationMotors(Driver):
    """Command `intensity_command`, shape (n,), 0 to 1: the motors in the profile's order.

    Every stop, and closing, switches them off. Source: Firmata protocol 2.5 (protocol.md).
    """

    Config = VibrationMotorsConfig
    summary = "vibration motors on the wearer, by an Arduino with StandardFirmata (USB serial)"
    usb = ("2341", "2a03", "1a86")  # Arduino twice, and the CH340 of many boards like it
    takes = (COMMAND,)
    max_age = 0.5

    def __init__(self, name: str, config: VibrationMotorsConfig) -> None:
        super().__init__(name, config)
        self.config: VibrationMotorsConfig = config
        self._motors = tuple(config.motors.values())
        n = len(self._motors)
        self.commands = (
            Command(
                name=COMMAND, shape=(n,), unit="1", labels=tuple(config.motors), kind=Kind.INTENSITY, stops=(Stop.OFF,),
                period=0.1, resolution=tuple(1 / motor.span for motor in self._motors),
            ),
        )  # fmt: skip
        self.limits[COMMAND] = Limits(
            level=np.ones(n),
            on_time=np.array([motor.on_time for motor in self._motors]),
            duty=np.array([motor.duty for motor in self._motors]),
        )
        pins = [motor.pin for motor in self._motors]
        self._queries = b"".join(map(protocol.pin_state_query, pins))
        self._modes = b"".join(protocol.set_pin_mode(pin, Mode.PWM) for pin in pins)
        # F7 in front ends a message that was cut short. A pin whose mode changes in a pulse could stay high.
        self._off = protocol.END_SYSEX + b"".join(
            protocol.set_pin_mode(pin, Mode.OUTPUT) + protocol.digital_pin_write(pin, False) for pin in pins
        )
        self._low = [_OFF] * len(self._motors)
        self._link: Transport | None = None
        self._was_lost = False
        self._firmware = ""
        self._forget()

    def _forget(self) -> None:
        self._decoder = Decoder()
        self._now = self._sent_at = self._asked_at = 0  # ns; of this cycle, of the newest frame and question
        self._commanded: list[tuple[int, int]] = self._low  # mode and state of each pin, newest frame
        self._asked: dict[int, tuple[list[tuple[int, int]], int]] = {}  # by mark: what the pins should do; when
        self._questions = 0
        self._waiting = False  # for the answer to the newest question
        self._reported: dict[int, tuple[int, int]] = {}  # by pin, since the last mark
        self._confirmed = True  # the newest frame is
        self._doubtful = False  # an answer was wrong or is missing: pins may have lost their modes
        self._wrong_since = -1  # ns, of the first of the answers in a row that were others; -1: the newest was right
        self._wrong = 0  # answers that were others, or damaged

    def open(self) -> None:
        """Blocks up to 9 s, mostly for the board's boot. The motors are off."""
        self.close()
        link = open_transport(self.config.port, place=self.name, baudrate=protocol.BAUDRATE)
        try:
            self._decoder = Decoder()
            board = identify(link, self._decoder, self.name)
            for name, motor in self.config.motors.items():
                require(board, motor.pin, Mode.PWM, name, self.name)
            link.write_all(self._off, 1.0)
        except BaseException:
            link.close()
            raise
        self._forget()
        self._link, self._firmware = link, board.firmware
        self.health.connected, self.health.message = True, board.firmware
        self.health.reconnects += self._was_lost
        self._was_lost = False

    def read(self, now: int) -> None:
        """A board that has reset itself, or doesn't do what it is commanded, counts as lost."""
        link, self._now = self._opened(), now
        try:
            for message in self._decoder.feed(link.read()):
                self._take(message)
            if self._waiting and now - self._asked_at >= ANSWER:
                self._waiting, self._doubtful = False, True
            if self._commanded == self._low and now - self._sent_at >= REPEAT:
                self._send(link, b"" if self._confirmed and not self._doubtful else self._off, self._low)
        except DeviceLostError:
            self.health.connected, self._was_lost = False, True
            with contextlib.suppress(DeviceError):
                link.write(self._off)
            raise
        decoder = self._decoder
        self.health.frames, self.health.resyncs = decoder.frames, decoder.resyncs
        self.health.errors = decoder.errors + self._wrong

    def write(self, now: int) -> None:
        """Sends duties that have changed at once, and others every 50 ms, or until they are confirmed."""
        link = self._opened()
        values = self.command_arrays[COMMAND].tolist()
        wanted = [(int(Mode.PWM), motor.duty_of(value)) for motor, value in zip(self._motors, values, strict=True)]
        unsure = self._doubtful or not self._confirmed
        if wanted == self._commanded and now - self._sent_at < REPEAT and (self._waiting or not unsure):
            link.write(b"")  # the rest of a frame that the kernel took in part
            return
        frame = b"" if self._commanded != self._low and not self._doubtful else protocol.END_SYSEX + self._modes
        frame += b"".join(
            protocol.analog_write(motor.pin, duty) for motor, (_, duty) in zip(self._motors, wanted, strict=True)
        )
        self.health.unsent = len(frame)
        if self._send(link, frame, wanted):
            self.health.unsent = 0
            self.sent_arrays[COMMAND][:] = np.clip(np.nan_to_num(values), 0.0, 1.0)

    def stop(self, category: Stop) -> None:
        """Off, again and again for as long as it is called."""
        if self._link is not None and (self._commanded != self._low or self._now - self._sent_at >= REPEAT):
            with contextlib.suppress(DeviceError):  # the next read reports a lost link
                self._send(self._link, self._off, self._low)

    def close(self) -> None:
        """Off."""
        link, self._link = self._link, None
        self.health.connected = False
        if link is not None:
            with contextlib.suppress(DeviceError):
                link.write_all(AT_DEATH * self._off, 0.2)
            link.close()

    @classmethod
    def who_is_at(cls, port: str) -> str:
        """Opening the port restarts most boards."""
        return who(port)

    def fileno(self) -> int | None:
        return self._link.fileno() if self._link is not None else None

    def stop_frames(self, category: Stop) -> tuple[bytes, ...]:
        return (AT_DEATH * self._off,)

    def metrics(self) -> dict[str, object]:
        """The firmware's name, the duties (of 255) by motor sent last, how many answers were others."""
        duties = dict(zip(self.config.motors, [duty for _, duty in self._commanded], strict=True))
        return {"firmware": self._firmware, "duties": duties, "unconfirmed": self._wrong}

    def _send(self, link: Transport, frame: bytes, states: list[tuple[int, int]]) -> bool:
        """Sends a frame that makes the pins `states`, and asks unless it waits; False if the link takes nothing."""
        mark = protocol.NO_PINS[self._questions % len(protocol.NO_PINS)]
        if not link.write(frame if self._waiting else frame + self._queries + protocol.pin_state_query(mark)):
            return False
        self._confirmed = self._confirmed and states == self._commanded
        self._commanded, self._sent_at = states, self._now
        if not self._waiting:
            self._asked[mark] = states, self._now
            self._questions, self._asked_at, self._waiting, self._doubtful = self._questions + 1, self._now, True, False
        return True

    def _take(self, message: protocol.Message) -> None:
        if isinstance(message, protocol.Firmware):
            raise DeviceLostError(
                self.name,
                "the board has restarted by itself; its motors are off",
                "Give the motors a supply of their own with a common ground: a dip of the board's is the usual cause",
            )
        if isinstance(message, protocol.Text):
            self.health.message = message.text
        elif isinstance(message, PinState):
            if (asked := self._asked.pop(message.pin, None)) is not None:
                self._judge(*asked)
            else:
                self._reported[message.pin] = message.mode, message.state

    def _judge(self, states: list[tuple[int, int]], asked_at: int) -> None:
        """The answers to a question are there, asked at `asked_at` (ns) about pins that should be `states`."""
        found, self._reported = [self._reported.get(motor.pin) for motor in self._motors], {}
        if asked_at == self._asked_at:
            self._waiting = False
        if found == states:
            self.health.stamp, self._wrong_since = max(self.health.stamp, asked_at), -1
            self._confirmed = states == self._commanded
            return
        self._wrong, self._doubtful = self._wrong + 1, True
        if None in found:  # damaged on the way
            return
        self._wrong_since = self._wrong_since if self._wrong_since >= 0 else self._now
        if self._now - self._wrong_since > WRONG:
            raise DeviceLostError(
                self.name,
                f"the board's pins don't do what they are commanded: they have {found}, not {states} (mode, duty)",
                "Check its cable; end other programs that use the board",
            )

    def _opened(self) -> Transport:
        if self._link is None:
            raise DeviceLostError(self.name, "the board isn't open", "Open it first")
        return self._link
