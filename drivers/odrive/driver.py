"""ODrives as a device: identified at open, commanded each cycle, watched by their heartbeats."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import can

from srl.drivers.can_axes.driver import CanAxes
from srl.drivers.canbus import CanLink, frame_bits
from srl.drivers.odrive import opening, protocol, words
from srl.drivers.odrive.config import OdriveConfig
from srl.drivers.odrive.protocol import CLOSED_LOOP, IDLE, Command
from srl.drivers.odrive.units import Scale
from srl.runtime.contracts.errors import DeviceError

BEAT: Final = 500_000_000  # ns: a heartbeat that is older tells nothing about the axis
ASK: Final = 4_000_000  # ns between two requests
_SLOW: Final = {"0.6": (Command.TORQUES, Command.TEMPERATURE, Command.BUS), "0.5": (Command.IQ, Command.BUS)}
_DETAILS: Final = {
    "0.6": (Command.ERROR,),
    "0.5": (Command.ERROR, Command.RX_SDO, Command.CONTROLLER_ERROR),  # of motor, encoder, controller
}


@dataclass
class _Axis:
    """What only an ODrive has: its state, and what is to be asked for."""

    scale: Scale
    state: int = -1
    beat: int = -1  # ns, the newest heartbeat
    obeyed: bool = False  # closed loop was seen since it was woken
    expired: bool = False  # its watchdog ran out while nobody commanded it
    wanted: list[Command] = field(default_factory=list)


class Odrive(CanAxes):
    """Axes with ODrives.

    States, in the order of the profile's axes: `position` (rad), `velocity` (rad/s), `effort` (N m, without friction),
    `voltage` (V), with firmware 0.6 also `temperature` (degC, of the power stage). The command is `position_command`,
    `velocity_command` or `torque_command`, by `mode`. A sample's stamp is the time at which the oldest axis' newest
    estimate arrived. Source: protocol sheet can_actuators, section 4.
    """

    Config = OdriveConfig
    summary = "ODrive motor controllers (CANSimple: firmware 0.5 and 0.6)"
    gives = ("position", "velocity", "effort", "temperature", "voltage")
    takes = ("position_command", "velocity_command", "torque_command")
    max_age = 0.1

    def __init__(self, name: str, config: OdriveConfig) -> None:
        self.options = config
        if config.firmware == "0.5":  # it has no message for it
            self.NAMES = tuple(key for key in self.gives if key != "temperature")
        else:
            self.NAMES = self.gives
        self._axes = [_Axis(Scale(axis)) for axis in config.axes.values()]
        self._nodes = [axis.node for axis in config.axes.values()]
        super().__init__(name, config)
        slow = _SLOW[config.firmware]
        self._round = [(i, command) for command in slow for i in range(len(self._nodes))]
        self._next, self._asked = 0, -ASK

    # -- opening

    def identify(self, link: CanLink) -> str:
        config = self.options
        heard = opening.find(link, config, self.name)
        remark = opening.check(link, config, self.name, self.question)
        if not self._send(link, opening.limits(config)):
            raise DeviceError(self.name, "the bus takes no frames", "Check that another node acknowledges them")
        for i, node in enumerate(self._nodes):
            axis = self._axes[i] = _Axis(self._axes[i].scale)
            estimates = protocol.pair(heard[node][Command.ESTIMATES])
            if estimates is None:
                raise DeviceError(
                    self.name,
                    f"'{self.labels[i]}' (node {node}) has no valid position",
                    "Check its encoder; let it find its index and calibrate it with the maker's tool",
                )
            axis.scale.fold(estimates[0])
            self.drives[i].begin(axis.scale.position(estimates[0]))
            self._beat(i, heard[node][Command.HEARTBEAT], -1)
            for command in _SLOW[config.firmware]:
                for data in self.question(link, protocol.request(node, command), protocol.identifier(node, command)):
                    self._take(i, command, data, -1)
        self._asked = -ASK
        return remark

    # -- a cycle

    def hear(self, message: can.Message, now: int) -> None:
        if message.is_extended_id:
            return
        node, command = protocol.split(message.arbitration_id)
        i = self._of.get(node)
        if i is None or message.is_remote_frame:
            return
        data = bytes(message.data)
        if command in protocol.COMMANDS and (data or command in protocol.EMPTY) and not self._answers(command):
            self.strange(f"command {command:#04x} for {self.labels[i]}")
            return
        self._counts[0] += 1
        self.drives[i].heard = now
        if command == Command.HEARTBEAT:
            self._beat(i, data, now)
        else:
            self._take(i, command, data, now)

    def _answers(self, command: int) -> bool:
        """Whether an ODrive itself sends this, too: 0.5 its encoder's errors, 0.6 its address."""
        if self.options.firmware == "0.5":
            return command == Command.RX_SDO
        return command == Command.ADDRESS

    def _beat(self, i: int, data: bytes, now: int) -> None:
        axis, drive, firmware = self._axes[i], self.drives[i], self.options.firmware
        beat = protocol.heartbeat(data, firmware)
        if beat is None:
            self._counts[1] += 1
            return
        axis.beat, axis.state = now, beat.state
        watchdog = words.WATCHDOG[firmware]
        # It ran out while nothing was commanded: no fault. It is cleared when the axis is woken.
        unheeded = drive.woken < 0 or not axis.obeyed
        axis.expired = beat.error == watchdog and unheeded and not drive.dropped
        drive.error = "" if axis.expired else words.in_words(beat.error, firmware)
        if drive.error or beat.elsewhere:
            self._explain(i)
        if drive.woken < 0:
            return
        if beat.state == CLOSED_LOOP:
            axis.obeyed = True
        elif axis.obeyed or drive.error:
            reason = drive.error or f"fell out of closed loop control into {words.state(beat.state)}: it coasts"
            drive.dropped = reason
            self._explain(i)

    def _explain(self, i: int) -> None:
        axis, drive = self._axes[i], self.drives[i]
        if not drive.details and not axis.wanted:
            axis.wanted = list(_DETAILS[self.options.firmware])

    def _take(self, i: int, command: int, data: bytes, now: int) -> None:
        drive, scale = self.drives[i], self._axes[i].scale
        if command in (Command.ERROR, Command.RX_SDO, Command.CONTROLLER_ERROR):
            self._detail(i, command, data)
            return
        if command not in (Command.ESTIMATES, *_SLOW[self.options.firmware]):
            return
        values = protocol.pair(data)
        if values is None:
            self._counts[1] += 1
        elif command == Command.ESTIMATES:
            drive.move(scale.position(values[0]), now)
            drive.velocity = scale.velocity(values[1])
        elif command == Command.TORQUES:
            drive.effort = scale.torque(values[1])
        elif command == Command.IQ:
            drive.effort = scale.torque(values[1] * scale.axis.torque_constant)
        elif command == Command.TEMPERATURE:
            drive.temperature = values[0]
        else:
            drive.voltage = values[0]

    def _detail(self, i: int, command: int, data: bytes) -> None:
        drive, firmware = self.drives[i], self.options.firmware
        if firmware == "0.6":
            found = protocol.errors(data)
            text = words.in_words(found[1], firmware) if found is not None else ""
            text = f"was disarmed because it {text}" if text and not drive.error else ""
        else:
            table, of = {
                Command.ERROR: (words.MOTOR, "motor"),
                Command.RX_SDO: (words.ENCODER, "encoder"),
            }.get(Command(command), (words.CONTROLLER, "controller"))
            text = words.named(protocol.bits(data), table, of)
        if text and text not in drive.details:
            drive.details.append(text)

    def ask(self, link: CanLink, now: int) -> None:
        """One request at a time, so that the bus stays free for commands."""
        if now - self._asked < ASK:
            return
        self._asked = now
        for i, axis in enumerate(self._axes):
            if axis.wanted:
                link.write(protocol.request(self._nodes[i], axis.wanted.pop(0)))
                return
        i, command = self._round[self._next]
        self._next = (self._next + 1) % len(self._round)
        link.write(protocol.request(self._nodes[i], command))

    def _judge(self, now: int) -> None:
        super()._judge(now)
        if now < 0:
            return
        for i, drive in enumerate(self.drives):
            axis = self._axes[i]
            if axis.beat < 0:
                axis.beat = now
            drive.silent = drive.silent or now - axis.beat > BEAT

    # -- commands

    def resolution(self) -> tuple[float, ...]:
        return tuple(axis.scale.resolution[self.options.mode] for axis in self._axes)

    def bits(self) -> tuple[float, float]:
        """Heartbeats and estimates as delivered, and a request at a time."""
        n, full = len(self._nodes), frame_bits(8)
        return n * full, n * full * 110 + 1e9 / ASK * (frame_bits(0) + full)

    def identifiers(self) -> dict[int, str]:
        """All 32 of each node."""
        found = dict[int, str]()
        for name, node in zip(self.labels, self._nodes, strict=True):
            found |= dict.fromkeys(
                (protocol.identifier(node, k) for k in range(32)), f"frames of node {node} ('{name}')"
            )
        return found

    def waking(self, i: int, value: float) -> Sequence[can.Message]:
        """The input comes before the state: with an old one in it the axis would jump."""
        axis, node, mode = self._axes[i], self._nodes[i], self.options.mode
        axis.obeyed = False
        start = value if mode == "position" else 0.0
        found = [protocol.clear(node, self.options.firmware)] if axis.expired else []
        return [
            *found,
            protocol.set_mode(node, mode),
            self.input(i, start),
            protocol.set_state(node, CLOSED_LOOP),
        ]

    def obeys(self, i: int) -> bool:
        return self._axes[i].obeyed

    def input(self, i: int, value: float) -> can.Message:
        scale, node = self._axes[i].scale, self._nodes[i]
        match self.options.mode:
            case "position":
                return protocol.input_position(node, scale.turns(value))
            case "velocity":
                return protocol.input_velocity(node, scale.turns_velocity(value))
            case _:
                return protocol.input_torque(node, scale.motor_torque(value))

    def limp(self, i: int) -> can.Message:
        return protocol.set_state(self._nodes[i], IDLE)

    def limp_at(self, i: int) -> int:
        return self._axes[i].beat if self._axes[i].state == IDLE else -1

    def halt(self, i: int) -> Sequence[can.Message]:
        """A torque becomes a damping: the velocity loop at 0, with the gain that `open` set."""
        node = self._nodes[i]
        if self.options.mode == "position":
            held = self.held(i)
            return [held] if held is not None else []
        still = protocol.input_velocity(node, 0.0)
        return [still] if self.options.mode == "velocity" else [still, protocol.set_mode(node, "velocity")]

    def clearing(self, i: int) -> Sequence[can.Message]:
        node = self._nodes[i]
        self._axes[i].wanted.clear()
        self._axes[i].obeyed = False
        return [protocol.set_state(node, IDLE), protocol.clear(node, self.options.firmware)]

    def metrics(self) -> dict[str, object]:
        """Returns each axis' state in words."""
        return {"states": {name: words.state(axis.state) for name, axis in zip(self.labels, self._axes, strict=True)}}
