"""CubeMars AK actuators in servo mode as a device: heard at open, commanded each cycle, watched by their status."""

from __future__ import annotations

import time
from collections.abc import Sequence
from math import inf, radians
from typing import Final

import can

from srl.drivers.can_axes.driver import CanAxes
from srl.drivers.canbus import CanLink, frame_bits
from srl.drivers.cubemars_servo import protocol
from srl.drivers.cubemars_servo.config import DEGREES, CubemarsServoConfig, ServoAxis
from srl.drivers.cubemars_servo.protocol import STATUS, Mode
from srl.runtime.contracts.driver import EXTENDED
from srl.runtime.contracts.errors import DeviceError
from srl.runtime.contracts.signals import Stop

LISTEN: Final = 1.2  # s: the slowest status comes once a second
WARM: Final = 70  # degC of the drive from which on a person is told
_SURE: Final = 0.8  # of its time limit, in which it surely still holds
STILL: Final = 0.2  # A: below this a drive counts as without torque


class Scale:
    """One axis: axis = ±(shaft - zero)."""

    def __init__(self, axis: ServoAxis) -> None:
        self.axis, self.sign = axis, axis.sign
        self.erpm = axis.facts.erpm

    def position(self, degrees: float) -> float:
        """rad of the axis."""
        return self.sign * (radians(degrees) - self.axis.zero)

    def degrees(self, position: float) -> float:
        """Degrees of the shaft."""
        return (self.sign * position + self.axis.zero) * DEGREES

    def velocity(self, erpm: float) -> float:
        """rad/s of the axis."""
        return self.sign * erpm / self.erpm

    def effort(self, current: float) -> float:
        """N m of the axis."""
        return self.sign * current * self.axis.torque_constant


class CubemarsServo(CanAxes):
    """Axes with CubeMars AK actuators in servo mode.

    States, in the order of the profile's axes: `position` (rad, in steps of 0.1 degree), `velocity` (rad/s), `effort`
    (N m: the current times the torque constant), `temperature` (degC, of the drive). The command is `position_command`,
    `velocity_command` or `torque_command`, by `mode`. A sample's stamp is the time at which the oldest axis' newest
    status arrived. Source: protocol sheet can_actuators, section 3.
    """

    Config = CubemarsServoConfig
    summary = "CubeMars AK actuators in servo mode (CAN, extended identifiers)"
    gives = NAMES = ("position", "velocity", "effort", "temperature")
    takes = ("position_command", "velocity_command", "torque_command")
    max_age = 0.1

    def __init__(self, name: str, config: CubemarsServoConfig) -> None:
        self.options = config
        self._scales = [Scale(axis) for axis in config.axes.values()]
        self._ids = [axis.id for axis in config.axes.values()]
        self._still = [-1] * len(self._ids)  # ns, when a status last showed no current
        super().__init__(name, config)

    # -- opening

    def identify(self, link: CanLink) -> str:
        """Only listens."""
        found, others, plain = dict[int, protocol.Status](), set[int](), set[int]()
        deadline = time.monotonic() + LISTEN
        while len(found) < len(self._ids) and (left := deadline - time.monotonic()) > 0:
            for message in link.read_wait(left):
                before, drive = protocol.split(message.arbitration_id)
                if not message.is_extended_id:
                    plain.add(message.arbitration_id)
                elif before == STATUS and (status := protocol.status(bytes(message.data))):
                    if drive in self._of:
                        found[self._of[drive]] = status
                    else:
                        others.add(drive)
        for i, name in enumerate(self.labels):
            if i not in found:
                raise self._missing(name, self._ids[i], {self._ids[k] for k in found} | others, plain)
        for i, status in found.items():
            self.drives[i].begin(self._scales[i].position(status.degrees))
            self._fill(i, status, -1)
        return f"drives let go after {self.options.timeout:g} s of silence, by the profile"

    def _missing(self, name: str, drive: int, heard: set[int], plain: set[int]) -> DeviceError:
        if heard:
            return DeviceError(
                self.name,
                f"'{name}' (id {drive}) isn't heard; heard are ids {', '.join(map(str, sorted(heard)))}",
                "Check its cable and supply, correct 'id', or switch its periodic status on with the maker's program",
            )
        if plain:
            return DeviceError(
                self.name,
                f"there are frames on {self.config.port}, but none of an actuator in servo mode",
                "It may be in MIT mode, or its status is off: choose servo mode and a periodic status of 100 Hz with "
                "the maker's program",
            )
        return DeviceError(
            self.name,
            f"no actuator is heard on {self.config.port}",
            "Check the bit rate (1 Mbit/s), the terminators (120 ohm at both ends), the supply, and that the periodic "
            "status is on (maker's program, 100 Hz)",
        )

    # -- a cycle

    def hear(self, message: can.Message, now: int) -> None:
        if not message.is_extended_id:
            return
        before, number = protocol.split(message.arbitration_id)
        i = self._of.get(number)
        if i is None:
            return
        if before in Mode.__members__.values():
            self.strange(f"{Mode(before).name.lower().replace('_', ' ')} for {self.labels[i]}")
        elif before == STATUS:
            status = protocol.status(bytes(message.data))
            if status is None:
                self._counts[1] += 1
                return
            self._counts[0] += 1
            self.drives[i].heard = now
            self.drives[i].move(self._scales[i].position(status.degrees), now)
            self._fill(i, status, now)

    def _fill(self, i: int, status: protocol.Status, now: int) -> None:
        drive, scale = self.drives[i], self._scales[i]
        drive.velocity = scale.velocity(status.erpm)
        drive.effort = scale.effort(status.current)
        drive.temperature = float(status.temperature)
        drive.error = protocol.in_words(status.error)
        if drive.error and drive.woken >= 0:
            drive.dropped = drive.error
        if abs(status.degrees) > protocol.MOST_DEGREES:
            drive.lost = drive.lost or "is at the end of what its status can say: its position can't be trusted"
        self._still[i] = now if abs(status.current) < STILL else -1

    def ask(self, link: CanLink, now: int) -> None:
        """Nothing is asked for; a status comes by itself."""
        warm = [f"{d.name} is at {d.temperature:.0f} degC" for d in self.drives if d.temperature >= WARM]
        if warm:
            self.health.message = f"{self._message}; {', '.join(warm)}"

    # -- commands

    def resolution(self) -> tuple[float, ...]:
        steps = {
            "position": [radians(1e-4)] * len(self._scales),
            "velocity": [1 / scale.erpm for scale in self._scales],
            "torque": [1e-3 * scale.axis.torque_constant for scale in self._scales],
        }
        return tuple(steps[self.options.mode])

    def bits(self) -> tuple[float, float]:
        n, full = len(self._ids), frame_bits(8, extended=True)
        return n * full, n * full * self.options.status_rate

    def identifiers(self) -> dict[int, str]:
        """Every mode's commands, also those that are never sent from here, and the status."""
        found = dict[int, str]()
        for name, drive in zip(self.labels, self._ids, strict=True):
            modes = (EXTENDED | protocol.identifier(mode, drive) for mode in range(16))
            found |= dict.fromkeys(modes, f"commands for '{name}'")
            found[EXTENDED | protocol.identifier(STATUS, drive)] = f"the status of '{name}'"
        return found

    def waking(self, i: int, value: float) -> Sequence[can.Message]:
        """There is no enabling: the first command is obeyed at once."""
        return [self.input(i, value if self.options.mode == "position" else 0.0)]

    def obeys(self, i: int) -> bool:
        """A drive doesn't say whether it obeys."""
        return True

    def input(self, i: int, value: float) -> can.Message:
        """A position comes with the drive's own speed and ramp: without, it goes there at full speed."""
        scale, drive = self._scales[i], self._ids[i]
        match self.options.mode:
            case "position":
                axis = scale.axis
                ramp = axis.velocity * scale.erpm, axis.acceleration * scale.erpm
                return protocol.position(drive, scale.degrees(value), *ramp)
            case "velocity":
                return protocol.speed(drive, scale.sign * value * scale.erpm)
            case _:
                most = scale.axis.current
                amperes = scale.sign * value / scale.axis.torque_constant
                return protocol.current(drive, max(-most, min(most, amperes)))

    def limp(self, i: int) -> can.Message:
        return protocol.current(self._ids[i], 0.0)

    def limp_at(self, i: int) -> int:
        return self._still[i]

    def halt(self, i: int) -> Sequence[can.Message]:
        """The position again; a speed and a torque become a brake current."""
        if self.options.mode == "position":
            held = self.held(i)
            return [held] if held is not None else []
        return [protocol.brake(self._ids[i], self._scales[i].axis.current)]

    def frames_good_for(self, category: Stop) -> float:
        """After its time limit it has let go, and obeys the next frame."""
        if category is Stop.LIMP or self.options.mode != "position":
            return inf
        return self.options.timeout * _SURE

    def clearing(self, i: int) -> Sequence[can.Message]:
        """Nothing clears an error on the bus; it ends with its cause, or with the supply."""
        return [self.limp(i)]
