"""The CyberGlove's serial protocol, 8-bit records (sheet cyberglove, §2, §3, §5). No I/O."""

from __future__ import annotations

import re
from typing import Final, NamedTuple

BAUDRATE: Final = 115200
START: Final = b"S"
STOP: Final = b"^c\x03"  # the sheet doesn't know which of the two notations is the official one, so both are sent
SAMPLE: Final = b"G"

LABELS_22: Final = (
    *("thumb_roll", "thumb_mpj", "thumb_ij", "thumb_abduction"),
    *("index_mpj", "index_pij", "index_dij"),
    *("middle_mpj", "middle_pij", "middle_dij", "middle_index_abduction"),
    *("ring_mpj", "ring_pij", "ring_dij", "ring_middle_abduction"),
    *("pinkie_mpj", "pinkie_pij", "pinkie_dij", "pinkie_ring_abduction"),
    *("palm_arch", "wrist_pitch", "wrist_yaw"),
)
"""Sensor names in the record's order (§5)."""

LABELS: Final = {
    22: LABELS_22,
    18: tuple(label for label in LABELS_22 if label[-3:] != "dij"),
}
"""Sensor names by number of sensors."""

_PLUGGED, _SWITCH, _LIGHT = 1, 2, 4
_HEADS = frozenset(b"SG")
_BEGINNING = re.compile(rb"\0(?=[SG]|\Z)")  # a record may begin here, after the end of another
_QUERY_SIZES = {ord("K"): 3, ord("M"): 3, ord("T"): 4, ord("P"): 3, ord("A"): 6} | dict.fromkeys(b"GSNDUFQRWLJB", 1)
_SET_REPLIES = frozenset(b"MNDUFQTWLJYPBA")
_MORE, _WRONG = 0, -1  # returned instead of a message's end: incomplete; not a message


def query(letter: str) -> bytes:
    """Requests a parameter: `?` and its letter."""
    return b"?" + letter.encode("ascii")


def assign(letter: str, *values: int) -> bytes:
    """Sets a parameter: its letter, then bytes 0..255."""
    return letter.encode("ascii") + bytes(values)


class Record(NamedTuple):
    """One sample.

    Attributes:
        sensors: a byte of 1..255 for each sensor, in the order of LABELS.
        status: the status byte; None if the glove doesn't send it.
        time_stamp: the four bytes b0..b3 as received (their unit and order aren't known); None if not sent.
        streamed: True for a record of the stream, False for the answer to one `G`.
        slow: the glove reports that it couldn't keep its sampling rate.
        unplugged: the glove reports that it isn't plugged into its interface.
    """

    sensors: bytes
    status: int | None = None
    time_stamp: bytes | None = None
    streamed: bool = True
    slow: bool = False
    unplugged: bool = False

    @property
    def switch(self) -> bool:
        """The wrist switch; False if the status byte isn't sent."""
        return bool((self.status or 0) & _SWITCH)

    @property
    def light(self) -> bool:
        """The wrist light; False if the status byte isn't sent."""
        return bool((self.status or 0) & _LIGHT)


class Reply(NamedTuple):
    """The answer to a command: `?X` with its value, `X` or `^X` with none, or `e?` (command unknown)."""

    command: bytes
    value: bytes = b""


class Parser:
    """Cuts a byte stream into records and replies; the result doesn't depend on how the stream was split.

    A sensor byte may have any value but 0, also that of `S`, `G`, `?` or `e`. So the parser doesn't search for values.
    A record is a head, a known number of bytes, and a 0 at a known place. A record with head and 0 in place and a zero
    among its sensors is corrupt: it is dropped, and the stream continues after it.

    Anything else means that bytes were lost or added. Then the parser looks for a 0 followed by two whole, valid
    records, and drops the first of them. In a clean stream the beginning of a record can't be mistaken: from any other
    place, n non-zero sensor bytes would include the true record's final 0. The second record is needed for noise (a
    wrong baud rate, another device): noise at full rate looks like one record every quarter of an hour.

    Without a checksum no rule can detect a loss of exactly one record's length inside two records.

    Attributes:
        time_stamp, status: whether records carry them (parameters D and U); set by `reset`.
        frames: good records. errors: number of times bytes were discarded. resyncs: number of times sync was lost.
    """

    def __init__(self, sensors: int, *, time_stamp: bool = False, status: bool = False) -> None:
        self.sensors = sensors
        self.frames = 0
        self.errors = 0
        self.resyncs = 0
        self.reset(time_stamp=time_stamp, status=status)

    def reset(self, *, time_stamp: bool, status: bool) -> None:
        """Forgets a partly read message; the next byte begins a message. Counts stay."""
        self.time_stamp = time_stamp
        self.status = status
        self._body = 1 + self.sensors + 5 * time_stamp + status  # bytes before "es", "eg" and 0
        self._buffer = bytearray()
        self._lost = False

    def feed(self, data: bytes) -> list[Record | Reply]:
        """Returns the messages that `data` completes, in order. Keeps less than three records' bytes."""
        buffer = self._buffer
        buffer += data
        found: list[Record | Reply] = []
        at = 0
        while at < len(buffer):
            if self._lost:
                at = self._search(at)
                if self._lost:
                    break
                continue
            head = buffer[at]
            end = self._record_end(at) if head in _HEADS else self._reply_end(at)
            if end == _MORE:
                break
            if end == _WRONG:
                self.errors += 1
                self.resyncs += 1
                self._lost = True
                continue
            if head not in _HEADS:
                found.append(_reply(bytes(buffer[at : end - 1])))
            elif self._clean(at):
                self.frames += 1
                found.append(self._record(at, end))
            else:
                self.errors += 1
            at = end
        del buffer[:at]
        return found

    def _search(self, at: int) -> int:
        """Returns where the second of two valid records begins (then sync is regained), or where to search on."""
        buffer = self._buffer
        while True:
            found = _BEGINNING.search(buffer, at)
            if found is None:
                return len(buffer)
            zero = found.start()
            first = second = self._valid_end(zero + 1)
            if first > 0:
                second = self._valid_end(first)
                if second > 0:
                    self._lost = False
                    return first
            if _MORE in (first, second):
                return zero
            at = zero + 1

    def _valid_end(self, at: int) -> int:
        if at < len(self._buffer) and self._buffer[at] not in _HEADS:
            return _WRONG
        end = self._record_end(at)
        return end if end <= 0 or self._clean(at) else _WRONG

    def _clean(self, at: int) -> bool:
        return self._buffer.find(0, at + 1, at + 1 + self.sensors) < 0

    def _record_end(self, at: int) -> int:
        """Returns the index after the record's 0. "es" and "eg" may stand between its body and its 0."""
        buffer = self._buffer
        for end in (at + self._body, at + self._body + 2, at + self._body + 4):
            if end >= len(buffer):
                return _MORE
            if buffer[end] == 0:
                return end + 1
            if buffer[end] != ord("e"):
                return _WRONG
            if end + 1 >= len(buffer):
                return _MORE
            if buffer[end + 1] not in b"sg":
                return _WRONG
        return _WRONG

    def _reply_end(self, at: int) -> int:
        buffer = self._buffer
        if at + 1 >= len(buffer):
            return _MORE
        head, letter = buffer[at], buffer[at + 1]
        if head in _SET_REPLIES:
            return at + 2 if letter == 0 else _WRONG
        if head == ord("?"):
            if letter == ord("V"):  # its firmware cuts the answer at the first zero
                return buffer.find(0, at + 2) + 1 if 0 in buffer[at + 2 : at + 7] else self._short(at + 7)
            size = 2 * self.sensors if letter == ord("C") else _QUERY_SIZES.get(letter)
            return _WRONG if size is None else self._ends(at + 2 + size)
        if head == ord("C") and letter in b"AOG":
            return self._ends(at + 2)
        if head == ord("e") and letter == ord("?"):
            return self._ends(at + 2)
        if head == ord("^"):
            end = self._ends(at + 4)
            return end if end <= 0 or buffer[at + 2 : at + 4] == b"\r\n" else _WRONG
        return _WRONG

    def _ends(self, at: int) -> int:
        """Returns the index after a 0 that must be at `at`."""
        if at >= len(self._buffer):
            return _MORE
        return at + 1 if self._buffer[at] == 0 else _WRONG

    def _short(self, size: int) -> int:
        return _MORE if len(self._buffer) < size else _WRONG

    def _record(self, at: int, end: int) -> Record:
        buffer = self._buffer
        sensors = at + 1 + self.sensors
        flags = bytes(buffer[at + self._body : end - 1])[1::2]
        status = buffer[at + self._body - 1] if self.status else None
        return Record(
            bytes(buffer[at + 1 : sensors]),
            status,
            _time_stamp(buffer[sensors : sensors + 5]) if self.time_stamp else None,
            buffer[at] == ord("S"),
            b"s" in flags,
            b"g" in flags or (status is not None and not status & _PLUGGED),
        )


def _time_stamp(raw: bytearray) -> bytes:
    """Restores the zeros: bits 0-3 of the first byte tell which of the four bytes that follow are really zero."""
    return bytes(0 if raw[0] >> bit & 1 else raw[1 + bit] for bit in range(4))


def _reply(raw: bytes) -> Reply:
    if raw[:1] in (b"?", b"e", b"C"):
        return Reply(raw[:2], raw[2:])
    return Reply(raw[:2]) if raw[:1] == b"^" else Reply(raw[:1])
