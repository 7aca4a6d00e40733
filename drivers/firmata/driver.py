"""An Arduino board with StandardFirmata: servos that follow angles, buttons that report.

Firmata has neither a heartbeat nor a watchdog: if the host dies, the board continues with its last pulses. So a
version query follows each command; its answer shows that the board has taken the command. The next command waits
for that answer, so a stalled link never holds more than one command.
"""

from __future__ import annotations

import contextlib
import math

import numpy as np

from srl.drivers.firmata import protocol
from srl.drivers.firmata.analog import Analog
from srl.drivers.firmata.buttons import Buttons
from srl.drivers.firmata.config import ButtonConfig, Calibration, FirmataConfig
from srl.drivers.firmata.identify import FLASH, identify, listen, require, who
from srl.drivers.firmata.protocol import Decoder, Mode
from srl.drivers.transport import Transport, open_transport
from srl.runtime.contracts import servo_record
from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.runtime.contracts.signals import Array, Command, Kind, Limits, Signal, Stop

COMMAND = "position_command"
PERIOD = 0.05  # s: a command waits for the answer to the one before, over USB with a latency timer of 16 ms
ASK_ACTIVE = 400_000_000  # ns between version queries while `write` is called
ASK_IDLE = 500_000_000  # ns between version queries otherwise

# The board's own limits are a second safeguard. The Servo library stores them as one signed byte in units of 4 µs
# from 544 and from 2400. So narrower limits than these would wrap around and have no effect. In any case the driver
# keeps each pulse within the servo's own limits.
LARGEST_MIN_US = 1056
SMALLEST_MAX_US = 1892


class Firmata(Driver):
    """Servos and buttons on one board.

    Command `position_command`, shape (n,), rad: the servos in the profile's order. State `buttons`, shape
    (m,): 1 pressed, 0 released, debounced. State `analog`, shape (k,): the analog inputs, in the profile's unit; with
    them the device is as old as the oldest of their readings. Source: Firmata protocol 2.5 (protocol.md).

    Attributes:
        home: by command name, the angles of the first command after `open` (rad).
    """

    Config = FirmataConfig
    summary = "Arduino with StandardFirmata: hobby servos, push buttons, analog inputs (USB serial)"
    usb = ("2341", "2a03", "1a86")  # Arduino twice, and the CH340 of many boards like it
    gives = ("buttons", "analog")
    takes = (COMMAND,)
    calibrated = servo_record.WHAT
    max_age = 1.2

    def __init__(self, name: str, config: FirmataConfig) -> None:
        super().__init__(name, config)
        self.config: FirmataConfig = config
        servos, buttons = config.joints, config.buttons
        self.simulated = servo_record.of_device(config.calibration, name)
        self.home: dict[str, Array] = {}
        if servos:
            self.commands = (
                Command(
                    name=COMMAND,
                    shape=(len(servos),),
                    unit="rad",
                    labels=tuple(servos),
                    kind=Kind.POSITION,
                    stops=(Stop.HOLD, Stop.RETRACT, Stop.LIMP),
                    period=PERIOD,
                    resolution=tuple(1 / abs(servo.calibration.us_per_rad) for servo in servos.values()),  # 1 us
                ),
            )
            self.home[COMMAND] = np.array([servo.home for servo in servos.values()])
        if buttons:
            self.states = (Signal(name="buttons", shape=(len(buttons),), unit="1", labels=tuple(buttons)),)
        if config.analog:
            unit = config.analog_unit
            signal = Signal(name="analog", shape=(len(config.analog),), unit=unit, labels=tuple(config.analog))
            self.states = (*self.states, signal)
            self.max_age = Analog(config.analog, config.analog_interval).max_age
        self._pins = [servo.pin for servo in servos.values()]
        self._calibrations = tuple(servo.calibration for servo in servos.values())
        if servos:
            self.limits[COMMAND] = Limits(
                lower=np.array([servo.lower for servo in self._calibrations]),
                upper=np.array([servo.upper for servo in self._calibrations]),
            )
        self._buttons = Buttons(
            [button.pin for button in buttons.values()], [button.debounce for button in buttons.values()]
        )
        self._analog = Analog(config.analog, config.analog_interval)
        self._decoder = Decoder()
        self._link: Transport | None = None
        self._was_lost = False
        self._firmware = ""
        self._sent: list[int | None] = []  # the last pulse of each servo, None while it is detached
        self._in_flight = 0  # bytes of the command that the board hasn't answered yet
        self._asked: int | None = None  # when the newest version query was sent
        self._waiting = False  # for the query's answer
        self._limp = False  # LIMP was requested and isn't sent yet
        self._was_limp = False  # LIMP has detached the servos since the board's last reset or command
        self._inputs_frame = b"".join(
            protocol.set_pin_mode(button.pin, _input_mode(button)) for button in buttons.values()
        ) + b"".join(protocol.report_digital(port, True) for port in self._buttons.ports)
        if config.analog:
            # The firmware's period is a millisecond longer than it is asked for.
            self._inputs_frame += protocol.sampling_interval(max(round(config.analog_interval * 1000) - 1, 1))
            self._inputs_frame += b"".join(
                protocol.set_pin_mode(entry.pin, Mode.ANALOG) for entry in config.analog.values()
            ) + b"".join(protocol.report_analog(channel, True) for channel in self._analog.channels)
        # If a pin is detached in the middle of a pulse, it would stay high. So a low is written after it.
        self._limp_frame = protocol.END_SYSEX + b"".join(
            protocol.set_pin_mode(pin, Mode.OUTPUT) + protocol.digital_pin_write(pin, False) for pin in self._pins
        )
        self._limp_frames = (self._limp_frame,)
        self._hold_frames: tuple[bytes, ...] | None = None
        self._forget()

    def open(self) -> None:
        """Blocks up to 10 s, mostly for the board's boot. Servos stay detached."""
        self.close()
        link = open_transport(self.config.port, place=self.name, baudrate=protocol.BAUDRATE)
        try:
            self._set_up(link)
        except BaseException:
            link.close()
            raise
        self._link = link
        self._forget()
        self._count()
        self.health.connected = True
        self.health.message = self._firmware
        self.health.reconnects += self._was_lost
        self._was_lost = False

    def read(self, now: int) -> None:
        """A board that has reset itself counts as lost: its servos are detached."""
        link = self._open_link()
        try:
            data = link.read()
            if data:
                for message in self._decoder.feed(data):
                    self._take(message, now)
                self._count()
            if self._limp:
                self._send_limp(link)
            if self._due(now, ASK_IDLE):
                self._ask(link, now, b"")
        except DeviceLostError:
            self._lose()
            raise
        self.health.unsent = self._in_flight
        if self.config.buttons:
            self._buttons.settle(now)
            self.state_arrays["buttons"][:] = self._buttons.pressed
        if self.config.analog:
            self.state_arrays["analog"][:] = self._analog.values
            self.health.stamp = self._analog.stamp
            if self._analog.problem:
                self.health.message, self._analog.problem = self._analog.problem, ""

    def write(self, now: int) -> None:
        """Writes only pulses that have changed; the first call attaches all servos."""
        link = self._open_link()
        if not self.commands:
            return
        self._limp = False
        angles = self.command_arrays[COMMAND].tolist()
        wanted = [
            calibration.pulse(angle) if math.isfinite(angle) else sent
            for calibration, angle, sent in zip(self._calibrations, angles, self._sent, strict=True)
        ]
        frame = b"" if wanted == self._sent else self._frame(wanted)
        try:
            if self._waiting:
                taken = False
                link.write(b"")  # sends the rest of a command that the kernel took in part
            elif frame:
                taken = self._ask(link, now, frame)
            else:
                taken = self._due(now, ASK_ACTIVE) and self._ask(link, now, b"")
        except DeviceLostError:
            self._lose()
            raise
        if frame and taken:
            self._publish(angles)
            self._sent = wanted
            self._was_limp = False
            self._hold_frames = None
        elif frame:
            self.health.unsent = len(frame)

    def stop(self, category: Stop) -> None:
        """HOLD sends nothing, because servos keep their last pulse. LIMP detaches them."""
        link = self._link
        if link is None:
            return
        with contextlib.suppress(DeviceError):  # the next read reports a lost link
            if category is Stop.LIMP:
                self._limp = any(pulse is not None for pulse in self._sent)
                self._send_limp(link)
            else:
                link.write(b"")  # sends the rest of a command that the kernel took in part

    def close(self) -> None:
        """Servos that aren't limp keep their last pulse."""
        link, self._link = self._link, None
        self.health.connected = False
        if link is None:
            return
        with contextlib.suppress(DeviceError):
            last = self._limp_frame if self._limp else b""
            last += b"".join(protocol.report_digital(port, False) for port in self._buttons.ports)
            last += b"".join(protocol.report_analog(channel, False) for channel in self._analog.channels)
            if last and not self._was_lost:
                link.write_all(last, 0.2)
        link.close()

    @classmethod
    def who_is_at(cls, port: str) -> str:
        """Opening the port restarts most boards."""
        return who(port)

    def fileno(self) -> int | None:
        """None for a board without servos."""
        return self._link.fileno() if self._link is not None and self.commands else None

    def stop_frames(self, category: Stop) -> tuple[bytes, ...]:
        """LIMP detaches; others repeat the last pulses of the attached servos.

        F7 in front ends a system-exclusive message that was cut short. A shorter message that was cut is dropped
        by the board at the next command byte.
        """
        if category is Stop.LIMP:
            return self._limp_frames
        if self._hold_frames is None:
            pulses = zip(self._pins, self._sent, strict=True)
            again = [protocol.analog_write(pin, pulse) for pin, pulse in pulses if pulse is not None]
            self._hold_frames = (protocol.END_SYSEX + b"".join(again),)
        return self._hold_frames

    @property
    def calibrations(self) -> tuple[Calibration, ...]:
        """The conversion from angle to pulse and back, for each servo in the profile's order."""
        return self._calibrations

    def metrics(self) -> dict[str, object]:
        """Returns the firmware's name, and the pulses last sent (µs, None while detached) by joint."""
        return {
            "firmware": self._firmware,
            "pulses_us": dict(zip(self.config.servos, self._sent, strict=True)),
        }

    def _publish(self, angles: list[float]) -> None:
        """Reports the angles whose pulses were sent, within the servos' reach; a non-finite one has no pulse."""
        sent = self.sent_arrays[COMMAND]
        for i, (angle, servo) in enumerate(zip(angles, self._calibrations, strict=True)):
            if math.isfinite(angle):
                sent[i] = min(max(angle, servo.lower), servo.upper)

    def _set_up(self, link: Transport) -> None:
        board = identify(link, self._decoder, self.name)
        for joint, servo in self.config.servos.items():
            require(board, servo.pin, Mode.SERVO, joint, self.name)
        for name, button in self.config.buttons.items():
            require(board, button.pin, _input_mode(button), name, self.name)
        for name, analog in self.config.analog.items():
            require(board, analog.pin, Mode.ANALOG, name, self.name)
        link.write_all(self._limp_frame + self._inputs_frame, 1.0)
        ports = self._buttons.ports
        masks: dict[int, int] = {}
        for message in listen(link, self._decoder, 1.0 if ports else 0.0):
            if isinstance(message, protocol.DigitalPort):
                masks[message.port] = message.mask
            if masks.keys() >= set(ports):
                break
        if missing := set(ports) - masks.keys():
            raise DeviceError(
                self.name, f"{board.firmware} reports no inputs of port {missing.pop()} when asked to", FLASH
            )
        self._buttons.start(masks)
        self._firmware = board.firmware

    def _take(self, message: protocol.Message, now: int) -> None:
        self.health.stamp = now
        match message:
            case protocol.AnalogValue(channel, value):
                self._analog.take(channel, value, now)
            case protocol.DigitalPort(port, mask):
                self._buttons.take(port, mask, now)
            case protocol.Version():
                self._waiting = False
                self._in_flight = 0
            case protocol.Text(text):
                self.health.message = text
            case protocol.Firmware():
                raise DeviceLostError(
                    self.name,
                    "the board has restarted by itself; its servos are without pulses",
                    "Give the servos a supply of their own with a common ground: a dip of the board's supply "
                    "is the usual cause",
                )

    def _count(self) -> None:
        health, decoder = self.health, self._decoder
        health.frames, health.errors, health.resyncs = decoder.frames, decoder.errors, decoder.resyncs

    def _due(self, now: int, period: int) -> bool:
        return self._asked is None or now - self._asked >= period

    def _ask(self, link: Transport, now: int, command: bytes) -> bool:
        """Sends the version query, after a command if there is one, if the link is free."""
        if not link.write(command + protocol.VERSION_QUERY):
            return False
        self._asked = now
        self._waiting = True
        self._in_flight = self._in_flight or len(command)
        return True

    def _frame(self, wanted: list[int | None]) -> bytes:
        """Returns the bytes that take the servos from the pulses last sent to the wanted ones."""
        parts = []
        if self._was_limp:
            # The firmware never reduces its count of attached servos: without a reset it refuses the thirteenth.
            parts += [protocol.RESET, self._inputs_frame]
        for pin, pulse, sent, servo in zip(self._pins, wanted, self._sent, self._calibrations, strict=True):
            if pulse is None or pulse == sent:
                continue
            if sent is None:
                # Once attached, a servo gets pulses of its last width or 1500 µs. So its new pulse must follow at once.
                low, high = min(servo.shortest, LARGEST_MIN_US), max(servo.longest, SMALLEST_MAX_US)
                parts.append(protocol.servo_config(pin, low, high))
            parts.append(protocol.analog_write(pin, pulse))
        return b"".join(parts)

    def _send_limp(self, link: Transport) -> None:
        if self._limp and link.write(self._limp_frame):
            self._limp = False
            self._was_limp = True
            self._sent = [None] * len(self._pins)
            self._hold_frames = None

    def _forget(self) -> None:
        self._analog = Analog(self.config.analog, self.config.analog_interval)
        self._sent = [None] * len(self._pins)
        self._hold_frames = None
        self._in_flight = 0
        self._asked = None
        self._waiting = False
        self._limp = self._was_limp = False

    def _open_link(self) -> Transport:
        if self._link is None:
            raise DeviceLostError(self.name, "the board isn't open", "Open it first")
        return self._link

    def _lose(self) -> None:
        self.health.connected = False
        self._was_lost = True


def _input_mode(button: ButtonConfig) -> Mode:
    return Mode.PULL_UP if button.pull_up else Mode.INPUT
