"""A listener to Tracker's UDP object stream."""

from __future__ import annotations

import time
from fractions import Fraction
from math import isfinite
from typing import Final

from srl.drivers.capture.names import Segment, Subject
from srl.drivers.capture.reach import FARTHEST
from srl.drivers.capture.selection import refuse, select
from srl.drivers.datagram import Datagrams, open_datagrams
from srl.drivers.vicon import geometry, objects
from srl.drivers.vicon.blocks import MalformedError
from srl.drivers.vicon.config import ViconConfig
from srl.drivers.vicon.objects import ObjectFrame
from srl.drivers.vicon.source import Frame
from srl.runtime.contracts.errors import DeviceError

LISTEN: Final = 2.0  # s to wait until everything wanted has been seen
SPAN: Final = 0.5  # s over which the frame rate is measured
HELD: Final = 0.1  # s for which a pose may stay bit-identical; a pose from cameras never does
RESYNC: Final = 10  # consecutive frames older than the newest, after which the count has begun anew
_LATE: Final = 2  # frames by which a datagram may be late; the driver recognises these itself
_OFF: Final = 0.2  # relative tolerance of the measured rate to the profile's
_WRAP: Final = 1 << 32
_REMEDY: Final = (
    "In Tracker's Local Vicon System, UDP Object Stream: enable it, and give this computer's address and port"
)


class ObjectStream:
    """See `Source`. An object that is missing, zero, or frozen is occluded (B.2)."""

    def __init__(self, config: ViconConfig, place: str) -> None:
        self.period = Fraction(10**9) / Fraction(config.rate)
        self.frames = self.errors = self.resyncs = 0
        self.remark = ""
        self._config, self._place = config, place
        self._rows: dict[str, list[int]] = {}
        for row, name in enumerate(config.segments.values()):
            self._rows.setdefault(name, []).append(row)
        self._held = max(int(HELD * config.rate), 2)  # frames
        self._last: dict[str, tuple[int, tuple[float, ...]]] = {}  # the frame in which a pose last changed
        self._link: Datagrams | None = None
        self._number: int | None = None  # number of the newest frame
        self._behind = 0  # consecutive frames that are older

    def open(self) -> None:
        self.close()
        self._last = {}
        self._number, self._behind = None, 0
        link = self._link = open_datagrams(self._config.port, place=self._place, listen=True)
        try:
            self._identify(link)
        except DeviceError:
            self.close()
            raise

    def read(self, now: int) -> Frame | None:
        assert self._link is not None
        newest = None
        for datagram in self._link.read():
            frame = self._decoded(datagram)
            if frame is not None and (newest is None or _after(frame.number, newest.number)):
                newest = frame
        return None if newest is None or self._overtaken(newest.number) else self._frame(newest)

    def close(self) -> None:
        link, self._link = self._link, None
        if link is not None:
            link.close()

    def _overtaken(self, number: int) -> bool:
        """Returns whether a datagram was delayed on its way: an old frame must not be taken for a restarted count."""
        late = 0 if self._number is None else (self._number - number) % _WRAP
        if _LATE < late <= _WRAP // 2 and self._behind < RESYNC:
            self._behind += 1
            self.errors += 1
            return True
        if self._number is None or late > _LATE:  # newer, or a restarted count
            self._number = number
        self._behind = 0
        return False

    def _decoded(self, datagram: bytes) -> ObjectFrame | None:
        try:
            frame = objects.decode(datagram)
        except MalformedError:
            self.errors += 1
            return None
        self.frames += 1
        return frame

    def _frame(self, found: ObjectFrame) -> Frame:
        frame = Frame(found.number)
        for name, pose in found.objects:
            rows = self._rows.get(name)
            if rows is None or not self._live(name, pose, found.number):
                continue
            q = geometry.from_euler_xyz(*pose[3:])
            if q is None:
                continue
            p = (pose[0] * 1e-3, pose[1] * 1e-3, pose[2] * 1e-3)
            frame.segments += [(row, p, q) for row in rows]
        return frame

    def _live(self, name: str, pose: tuple[float, ...], number: int) -> bool:
        if not any(pose) or not all(map(isfinite, pose)) or max(map(abs, pose[:3])) >= 1e3 * FARTHEST:
            return False
        last = self._last.get(name)
        if last is None or last[1] != pose:
            self._last[name] = (number, pose)
            return True
        return (number - last[0]) % _WRAP <= self._held

    def _identify(self, link: Datagrams) -> None:
        """Listens until every object has been seen and the frame rate is known."""
        heard, names = b"", dict[str, None]()
        first: tuple[float, int] | None = None
        newest: tuple[float, int] | None = None
        start = time.monotonic()
        while (left := start + LISTEN - time.monotonic()) > 0:
            for datagram in link.read_wait(left):
                heard = heard or datagram
                frame = self._decoded(datagram)
                if frame is None:
                    continue
                names |= dict.fromkeys(found.name for found in frame.objects)
                newest = (time.monotonic(), frame.number)
                first = first or newest
            if first and newest and newest[0] - first[0] >= SPAN and names.keys() >= self._rows.keys():
                break
        if first is None or newest is None:
            shown = f"{len(heard)} bytes that aren't: {heard[:12].hex(' ')}" if heard else "nothing"
            raise DeviceError(self._place, f"expected Tracker's object stream, got {shown}", _REMEDY)
        there = [Subject(i, name, (Segment(1, name, 0),), ()) for i, name in enumerate(names, 1)]
        if missing := select(self._config, there).missing:
            raise refuse(self._config, there, missing[0], self._place)
        self._check_rate(*first, *newest)

    def _check_rate(self, begin: float, first: int, end: float, last: int) -> None:
        if end - begin < SPAN / 2:
            raise DeviceError(self._place, "only a few frames came", "Go live in Tracker, and check the network")
        rate, wanted = ((last - first) % _WRAP) / (end - begin), self._config.rate
        if not (1 - _OFF) * wanted <= rate <= (1 + _OFF) * wanted:
            raise DeviceError(
                self._place,
                f"Tracker counts about {rate:.0f} frames a second, the profile says {wanted:.4g}",
                f"Set 'rate' to Tracker's frame rate (about {rate:.0f})",
            )


def _after(number: int, other: int) -> bool:
    return 0 < (number - other) % _WRAP < _WRAP // 2
