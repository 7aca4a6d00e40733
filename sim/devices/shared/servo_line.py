"""What the twins of servo buses share: a half-duplex line with several servos on it."""

from __future__ import annotations

import fcntl
import sys
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, Final

from srl.drivers.servo_bus.packets import Instruction
from srl.sim.devices.shared.serial import SerialTwin
from srl.sim.devices.shared.servo_fake import FakeServos

_RATES_AGREE: Final = 0.02  # share by which the two ends of a line may differ
_TCGETS2: Final = 0x802C542A  # of Linux: termios with the rates as numbers, also those that have no name
_OSPEED: Final = slice(40, 44)


class ServoLine(SerialTwin):
    """Servos obey packets addressed to them and answer some time later, one after another.

    Each servo understands a client at its own baud rate only; those of a bus may differ.
    A packet that comes while an answer is being sent collides with it: both are lost.

    Attributes:
        absent: ids of servos that are unplugged.
        plugged: numbers of the servos, in the profile's order, that are on the line; None: all.
        twice: ids shared by two servos, whose answers arrive garbled.
        corrupt: number of following status packets that are damaged in transit.
        echo: the adapter returns the host's own bytes.
        collisions: number of packets lost in collisions.
        seen: number of instructions, by name.
        wrong_rate: bytes at a rate that no servo understands.
    """

    _parser: Any

    def __init__(self, fake: FakeServos) -> None:
        super().__init__(fake)
        self.bus = fake
        self.absent: set[int] = set()
        self.plugged: set[int] | None = None
        self.twice: set[int] = set()
        self.corrupt = 0
        self.echo = False
        self.collisions = 0
        self.seen: dict[str, int] = {}
        self.wrong_rate = 0
        self._answers: list[tuple[int, bytes]] = []  # (due time in ns, packet)
        self._now = 0
        self._rate: int | None = None  # bit/s of the client's newest bytes
        self._begin_with(())

    def _begin_with(self, servos: Sequence[Any]) -> None:
        """Puts servos on the line. Each has `get`, `restart`, `tick`, `instruction_taken` and `now`."""
        self._stations: Sequence[Any] = servos
        self._deaf_until = [-1] * len(servos)
        self._restarting = [False] * len(servos)

    @abstractmethod
    def _rate_of(self, servo: Any) -> int:
        """The baud rate of a servo, bit/s."""

    @abstractmethod
    def _obey(self, instruction: Instruction) -> None:
        """Carries out an instruction, on all servos that it is for."""

    def _named(self, instruction: Instruction, names: Mapping[int, str]) -> str:
        """The name of an instruction, which is counted."""
        name = names.get(instruction.code, f"{instruction.code:#04x}")
        self.seen[name] = self.seen.get(name, 0) + 1
        return name

    def metrics(self) -> dict[str, object]:
        """Adds to the serial twin's figures: instructions by name, lost packets, refused writes, the torque.

        Lost packets are those damaged, collided or sent at a wrong baud rate. The torque is given for each motor.
        """
        motors = self.bus.chain.motors
        return super().metrics() | {
            "instructions": dict(self.seen),
            "damaged": self._parser.errors,
            "collisions": self.collisions,
            "wrong_rate": self.wrong_rate,
            "refused": {f"{s.get('id')}.{what}": n for s in self._stations for what, n in s.refused.items()},
            "torque": [bool(motors.torque[i]) for i in self.bus.numbers],
        }

    # -- the line

    def receive(self, data: bytes, now: int) -> bytes:
        self._begin(now)
        self._rate = self._client_rate()
        if not any(map(self._understands, self._stations)):
            self.wrong_rate += len(data)
            return b""
        for instruction in self._parser.instructions(data):
            if self._answers and self._answers[-1][0] > now:
                self.collisions += 1
                self._answers.clear()
                continue
            for servo in self._awake():
                servo.instruction_taken()
            self._obey(instruction)
        return (data if self.echo else b"") + self._due(now)

    def work(self, now: int) -> bytes:
        self._begin(now)
        for k, servo in enumerate(self._stations):
            if self._restarting[k] and now >= self._deaf_until[k]:
                self._restarting[k] = False
                servo.restart()
            servo.tick()
        return self._due(now)

    def _begin(self, now: int) -> None:
        self._now = now
        self.bus.chain.measure()
        for servo in self._stations:
            servo.now = now

    def _due(self, now: int) -> bytes:
        out = b""
        while self._answers and self._answers[0][0] <= now:
            out += self._answers.pop(0)[1]
        return out

    def _client_rate(self) -> int | None:
        """The baud rate (bit/s) that the client has set on its end of the pty; None if it is unknown."""
        try:
            found = fcntl.ioctl(getattr(self.door, "_fd", -1), _TCGETS2, bytes(44))
        except (OSError, ValueError):  # a socket, or closed
            return None
        return int.from_bytes(found[_OSPEED], sys.byteorder) or None

    def _awake(self) -> list[Any]:
        return [
            servo
            for k, servo in enumerate(self._stations)
            if not self._restarting[k] and self._on_line(k, servo) and self._understands(servo)
        ]

    def _on_line(self, k: int, servo: Any) -> bool:
        return servo.get("id") not in self.absent and (self.plugged is None or k in self.plugged)

    def _understands(self, servo: Any) -> bool:
        """Whether a servo's baud rate is that of the client; unknown rates are right."""
        if self._rate is None:
            return True
        return abs(self._rate_of(servo) / self._rate - 1) < _RATES_AGREE

    def _in_transit(self, id: int, packet: bytes) -> bytes:
        """What arrives of a servo's packet."""
        if id in self.twice:
            return bytes(a & b for a, b in zip(packet, packet[3:] + packet[:3], strict=True))
        if self.corrupt:
            self.corrupt -= 1
            return packet[:-3] + bytes((packet[-3] ^ 0x10,)) + packet[-2:]
        return packet

    def _send(self, packet: bytes, delay: int) -> None:
        before = self._answers[-1][0] if self._answers else self._now
        self._answers.append((max(before, self._now) + delay, packet))
