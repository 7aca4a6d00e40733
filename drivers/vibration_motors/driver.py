"""Vibration motors by the PWM of an Arduino board with StandardFirmata.

Firmata acknowledges nothing, and has neither a checksum nor a watchdog. So the board is asked after each frame what its
pins are doing, and what it doesn't confirm is sent again, whole. A sample is a confirmation: a board that takes
commands and isn't heard, or that restarts unnoticed, becomes stale. What lowers a duty waits for no answer.
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
REPEAT: Final = 50_000_000  # ns after which the same duties are sent and asked for again
ANSWER: Final = 150_000_000  # ns without an answer after which it counts as lost on the way
REFUSALS: Final = 5  # answers in a row that aren't what was sent, after which the board counts as lost
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
        self._link: Transport | None = None
        self._was_lost = False
        self._firmware = ""
        self._forget()

    def _forget(self) -> None:
        self._decoder = Decoder()
        self._now = self._asked = self._since = 0  # ns; of the newest frame; of the oldest one that isn't answered
        self._commanded: list[tuple[int, int]] = [_OFF] * len(self._motors)  # mode and state of each pin, newest frame
        self._reported: dict[int, tuple[int, int]] = {}  # by pin, since the newest frame
        self._pending = 0  # answers that are still to come
        self._confirmed = True  # the newest answers were what was commanded
        self._driving = False  # the pins were given duties since they were off
        self._refused = 0  # answers in a row that were others
        self._wrong = 0  # answers that were others

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
            if self._pending and now - self._since > ANSWER:
                self._pending, self._confirmed = 0, False
            if not self._driving and now - self._asked >= REPEAT:
                self._send(link, b"" if self._confirmed else self._off, [_OFF] * len(self._motors))
        except DeviceLostError:
            self.health.connected, self._was_lost = False, True
            with contextlib.suppress(DeviceError):
                link.write(self._off)
            raise
        decoder = self._decoder
        self.health.frames, self.health.resyncs = decoder.frames, decoder.resyncs
        self.health.errors = decoder.errors + self._wrong

    def write(self, now: int) -> None:
        """Sends duties that have changed, or weren't confirmed, at once, others every 50 ms."""
        link = self._opened()
        values = self.command_arrays[COMMAND].tolist()
        wanted = [(int(Mode.PWM), motor.duty_of(value)) for motor, value in zip(self._motors, values, strict=True)]
        changed, due = wanted != self._commanded, now - self._asked >= REPEAT
        lowers = not any(duty for _, duty in wanted) or any(
            duty < before for (_, duty), (_, before) in zip(wanted, self._commanded, strict=True)
        )
        # A frame waits for the answer to the one before; what lowers a duty doesn't.
        if not (changed or due or not self._confirmed) or (self._pending and not (lowers and (changed or due))):
            link.write(b"")  # the rest of a frame that the kernel took in part
            return
        frame = b"" if self._driving and self._confirmed else protocol.END_SYSEX + self._modes
        frame += b"".join(
            protocol.analog_write(motor.pin, duty) for motor, (_, duty) in zip(self._motors, wanted, strict=True)
        )
        self.health.unsent = len(frame)
        if self._send(link, frame, wanted):
            self._driving, self.health.unsent = True, 0
            self.sent_arrays[COMMAND][:] = np.clip(np.nan_to_num(values), 0.0, 1.0)

    def stop(self, category: Stop) -> None:
        """Off, again and again for as long as it is called."""
        if self._link is not None and (self._driving or self._now - self._asked >= REPEAT):
            with contextlib.suppress(DeviceError):  # the next read reports a lost link
                if self._send(self._link, self._off, [_OFF] * len(self._motors)):
                    self._driving = False

    def close(self) -> None:
        """Off."""
        link, self._link = self._link, None
        self.health.connected = False
        if link is not None:
            with contextlib.suppress(DeviceError):
                link.write_all(self._off, 0.2)
            link.close()

    @classmethod
    def who_is_at(cls, port: str) -> str:
        """Opening the port restarts most boards."""
        return who(port)

    def fileno(self) -> int | None:
        return self._link.fileno() if self._link is not None else None

    def stop_frames(self, category: Stop) -> tuple[bytes, ...]:
        return (self._off,)

    def metrics(self) -> dict[str, object]:
        """The firmware's name, the duties (of 255) by motor sent last, how many answers were others."""
        duties = dict(zip(self.config.motors, [duty for _, duty in self._commanded], strict=True))
        return {"firmware": self._firmware, "duties": duties, "unconfirmed": self._wrong}

    def _send(self, link: Transport, frame: bytes, states: list[tuple[int, int]]) -> bool:
        """Sends a frame and asks what the pins are doing, which should be `states`; False if the link takes nothing."""
        if not link.write(frame + self._queries):
            return False
        if not self._pending:
            self._since = self._now
        self._commanded, self._asked = states, self._now
        self._pending += len(states)
        self._reported.clear()
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
        elif isinstance(message, PinState) and self._pending:
            self._pending -= 1
            self._reported[message.pin] = (message.mode, message.state)
            if not self._pending:  # those of the frame before would tell of the frame before
                self._judge()

    def _judge(self) -> None:
        """All answers to the newest frame are there."""
        self._confirmed = [self._reported.get(motor.pin) for motor in self._motors] == self._commanded
        if self._confirmed:
            self.health.stamp, self._refused = self._now, 0
            return
        self._wrong, self._refused = self._wrong + 1, self._refused + 1
        if self._refused >= REFUSALS:
            raise DeviceLostError(
                self.name,
                f"the board's pins don't do what they are commanded: they have {self._reported}, not {self._commanded}",
                "Check its cable; end other programs that use the board",
            )

    def _opened(self) -> Transport:
        if self._link is None:
            raise DeviceLostError(self.name, "the board isn't open", "Open it first")
        return self._link
