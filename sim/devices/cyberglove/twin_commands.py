"""A CyberGlove's command interpreter: its answer to each byte, and the format of its records. No I/O.

Source: protocol sheet cyberglove, §2 and §3; its golden vectors (§8) are this module's tests. The sheet leaves
some choices open (bit order of masks, unit of the time stamp, text answers). docs/twins.md lists what is chosen
here.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from typing import Final, Protocol

TICK: Final = Fraction(10**9, 115200)  # ns; the sample period is the product of two words, in this unit
FASTEST: Final = Fraction(10**9, 150)  # ns between samples, "as fast as possible"
_NOT_KNOWN: Final = b"e?\0"
_SIZES: Final = {  # bytes after a command's letter
    **dict.fromkeys(b"GS", 0),
    **dict.fromkeys(b"NDUFQWLJB", 1),
    **dict.fromkeys(b"MP", 3),
    ord("T"): 4,
}
_KEPT: Final = {  # settings that are stored and can be queried, but change nothing else
    "F": b"\0",
    "Q": b"\0",
    "L": b"\0",
    "J": b"\0",
    "B": b"\1",
    "P": b"",
    "A": bytes(6),
}


class Sensors(Protocol):
    """What the interpreter uses of the glove."""

    period: Fraction  # ns between samples; set by `T`

    @property
    def count(self) -> int: ...

    @property
    def right(self) -> bool: ...

    def newest(self) -> bytes:
        """The newest sample, one byte of 1..255 for each sensor."""

    def plugged(self) -> bool: ...

    def switch(self) -> bool: ...

    def set_switch(self, on: bool) -> None: ...

    def milliseconds(self) -> int:
        """The glove's own clock, ms."""


@dataclass
class Commands:
    """One glove's settings; `feed` carries out commands and answers.

    Attributes:
        streaming: whether records are sent without a request.
        slow: a period shorter than the glove's shortest was requested; the records report it.
        seen: numbers of commands by letter, for tests.
        unknown: number of bytes that belong to no command.
    """

    glove: Sensors
    streaming: bool = False
    slow: bool = False
    seen: dict[str, int] = field(default_factory=dict)
    unknown: int = 0

    def __post_init__(self) -> None:
        self._initial = self.glove.period
        self.restart()

    def restart(self) -> None:
        """Sets the state after power-up."""
        n = self.glove.count
        self.streaming = self.slow = False
        self.glove.period = self._initial
        self._words = (max(1, round(self._initial / TICK)), 1)
        self._sampled = n
        self._mask = self._hardware = ((1 << n) - 1).to_bytes(3, "little")
        self._stamp = self._status = False
        self._kept = dict(_KEPT)
        self._offsets, self._gains = bytearray(b"\x80" * n), bytearray(b"\x80" * n)
        self._buffer = bytearray()

    def feed(self, data: bytes) -> bytes:
        """Carries out all complete commands and returns the answers."""
        self._buffer += data
        answer = bytearray()
        while self._buffer and (size := self._size(self._buffer)) <= len(self._buffer):
            command = bytes(self._buffer[:size])
            del self._buffer[:size]
            answer += self._obey(command)
        return bytes(answer)

    def record(self, head: bytes, sensors: bytes) -> bytes:
        """A sample as it is sent (§3), with what D and U have enabled."""
        parts = [head, sensors[: self._sampled]]
        if self._stamp:
            stamp = (self.glove.milliseconds() & 0xFFFFFFFF).to_bytes(4, "big")
            parts += [bytes((sum(1 << i for i, byte in enumerate(stamp) if byte == 0),)), stamp]
        if self._status:
            parts.append(bytes((self._status_byte(),)))
        if self.slow:
            parts.append(b"es")
        if not self.glove.plugged():
            parts.append(b"eg")
        return b"".join((*parts, b"\0"))

    def _size(self, buffer: bytearray) -> int:
        """Bytes of the command at the start of the buffer; more than the buffer holds while it is unknown."""
        head, many = buffer[0], len(buffer) + 1
        if head in b"?^":
            return 2
        if head in b"tu":
            end = buffer.find(b"\r") + 1
            return end or (many if len(buffer) < 32 else 1)
        if head == ord("C"):
            sizes = {ord("A"): 2 + 2 * self.glove.count, ord("O"): 4, ord("G"): 4}
            return many if len(buffer) < 2 else sizes.get(buffer[1], 2)
        if head == ord("A"):
            return many if len(buffer) < 2 else 8 if buffer[1] == 0xFF else 2 + 2 * min(buffer[1], 6)
        return 1 + _SIZES.get(head, 0)

    def _obey(self, command: bytes) -> bytes:
        head = chr(command[0])
        if command in (b"\x03", b"^c"):
            self._note("^c")
            self.streaming = False
            return b""
        if head == "^":
            return self._control(command)
        if head == "?":
            return self._query(command)
        if head in "tu":
            return self._text(command)
        if command[0] not in _SIZES and head not in "CA":
            return self._refuse()
        self._note(head)
        if head == "G":
            return self.record(b"G", self.glove.newest())
        if head == "S":
            self.streaming = True
            return b""
        if head == "C":
            return self._calibrate(command)
        self._set(head, command[1:])
        return head.encode() + b"\0"

    def _set(self, head: str, value: bytes) -> None:
        match head:
            case "N":
                self._sampled = min(max(value[0], 1), self.glove.count)
            case "M":
                self._mask = value
            case "D":
                self._stamp = value[0] != 0
            case "U":
                self._status = value[0] != 0
            case "W":
                self.glove.set_switch(value[0] != 0)
            case "T":
                self._pace(int.from_bytes(value[:2], "big"), int.from_bytes(value[2:], "big"))
            case "A":
                self._vibrate(value)
            case "P":
                pass  # which of these flags a client may set isn't known; they are reported, but not set
            case _:
                self._kept[head] = value

    def _pace(self, one: int, two: int) -> None:
        self._words = (one, two)
        wanted = one * two * TICK
        self.slow = 0 < wanted < FASTEST
        self.glove.period = max(wanted, FASTEST)

    def _vibrate(self, value: bytes) -> None:
        strengths = bytearray(self._kept["A"])
        if value[0] == 0xFF:
            strengths[:] = value[1:]
        else:
            for index, strength in zip(value[1::2], value[2::2], strict=True):
                if index < 6:
                    strengths[index] = strength
        self._kept["A"] = bytes(strengths)

    def _calibrate(self, command: bytes) -> bytes:
        what, value, n = command[1:2], command[2:], self.glove.count
        if what == b"A":
            self._offsets[:], self._gains[:] = value[:n], value[n:]
        elif what in (b"O", b"G"):
            if value[0] < n:
                (self._offsets if what == b"O" else self._gains)[value[0]] = value[1]
        else:
            return self._refuse()
        return b"C" + what + b"\0"

    def _control(self, command: bytes) -> bytes:
        if command not in (b"^I", b"^R"):
            return self._refuse()
        self._note(command.decode())
        rest = bytes(self._buffer)
        self.restart()
        self._buffer += rest
        return command + b"\r\n\0"

    def _query(self, command: bytes) -> bytes:
        values = {
            "G": bytes((1 | 2 * self.glove.plugged(),)),
            "S": bytes((self.glove.count,)),
            "K": self._hardware,
            "M": self._mask,
            "N": bytes((self._sampled,)),
            "D": bytes((self._stamp,)),
            "U": bytes((self._status,)),
            "R": bytes((self.glove.right,)),
            "T": b"".join(word.to_bytes(2, "big") for word in self._words),
            "V": b"\x02\x01\x01\x03",
            "W": bytes((self.glove.switch(),)),
            "C": bytes(self._offsets + self._gains),
            "P": self._flags(),
            "i": b"CyberGlove twin, srl",
        }
        letter = chr(command[1])
        value = values.get(letter, self._kept.get(letter))
        if value is None:
            return self._refuse()
        self._note(f"?{letter}")
        return command + value + b"\0"

    def _text(self, command: bytes) -> bytes:
        """Carries out `t WORD WORD` or `u FLAG`, decimal, up to a CR.

        The form of the answer isn't known; it is like the answer to ^I.
        """
        head, *words = command.decode("ascii", "replace").split()
        limits = {"t": (0xFFFF, 0xFFFF), "u": (1,)}
        values = [int(word) for word in words if word.isdecimal()]
        if (
            head not in limits
            or len(values) != len(words)
            or len(values) != len(limits[head])
            or any(value > most for value, most in zip(values, limits[head], strict=True))
        ):
            return self._refuse()
        self._note(head)
        if head == "t":
            self._pace(values[0], values[1])
        else:
            self._status = values[0] == 1
        return head.encode() + b"\r\n\0"

    def _status_byte(self) -> int:
        return self.glove.plugged() | self.glove.switch() << 1 | self._light() << 2

    def _light(self) -> bool:
        """The wrist light shows the switch, unless the host controls it (J) and sets it (L)."""
        return self._kept["L"] != b"\0" if self._kept["J"] != b"\0" else self.glove.switch()

    def _flags(self) -> bytes:
        """The parameter flags (§2): what is connected and what is enabled."""
        on = {name: int(self._kept[name] != b"\0") for name in "FQJ"}
        second = self._status << 2 | on["J"] << 3 | on["F"] << 4 | self._stamp << 5 | self.glove.right << 6
        return bytes((self._status_byte(), second | 1 << 7, on["Q"]))

    def _refuse(self) -> bytes:
        self.unknown += 1
        return _NOT_KNOWN

    def _note(self, name: str) -> None:
        self.seen[name] = self.seen.get(name, 0) + 1
