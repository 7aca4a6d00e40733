"""A client of a DataStream server: greeting, subscription, and the newest frame in each cycle."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterable
from fractions import Fraction
from typing import Final

from srl.drivers.capture import axes
from srl.drivers.capture.names import Point, Subject
from srl.drivers.capture.reach import FARTHEST
from srl.drivers.capture.selection import Selection, refuse, select
from srl.drivers.timeout import remaining
from srl.drivers.transport import Transport, open_transport
from srl.drivers.vicon import blocks, geometry, protocol
from srl.drivers.vicon.blocks import MalformedError
from srl.drivers.vicon.config import ViconConfig
from srl.drivers.vicon.protocol import Block, Packet
from srl.drivers.vicon.source import Frame
from srl.runtime.contracts.errors import DeviceError

GREETING: Final = 2.0  # s for the server's first packet
FRAMES: Final = 3.0  # s for a frame that contains everything wanted
ASK_AGAIN: Final = 1_000_000_000  # ns without a frame after which frames are requested again
_MOST_LATENCY: Final = 1.0  # s; a greater value isn't a latency
_PERIODS: Final = range(protocol.CLOCK // 10_000, protocol.CLOCK + 1)  # 10 kHz to 1 Hz; 0 means unknown
_STATIC: Final = frozenset((Block.STREAM_INFO, Block.SUBJECT_INFO, Block.APPLICATION_INFO))
_REMEDY: Final = "Check that Nexus, Tracker or Shogun runs there, and the port of its DataStream server (801)"


class DataStream:
    """See `Source`. Blocks that a packet declares unchanged are remembered from earlier packets (A.3)."""

    def __init__(self, config: ViconConfig, place: str) -> None:
        self.period = Fraction(10**9) / Fraction(config.rate)
        self.remark = ""
        self.subjects: dict[int, Subject] = {}
        self.asked_again = 0
        self._config, self._place = config, place
        self._parser = protocol.Parser()
        self._link: Transport | None = None
        self._selection = Selection()
        self._wanted = _wanted(config)
        self._subscription = b""
        self._request = b""
        self._y_up = False  # the server's y axis points up
        self._ticks = 0  # the server's frame period; 0: unknown
        self._absent = ""  # what the profile names and the server no longer has
        self._unasked = False  # the next frame must still be requested
        self._early: list[Packet] = []  # packets that came with the greeting
        self._since = -1  # ns: the newest frame, or the newest request
        self._malformed = 0

    @property
    def frames(self) -> int:
        """Good packets."""
        return self._parser.frames

    @property
    def errors(self) -> int:
        """Bytes that were no packet, and packets that held less than they should."""
        return self._parser.errors + self._malformed

    @property
    def resyncs(self) -> int:
        """Number of times the parser had to search for the next packet."""
        return self._parser.resyncs

    def open(self) -> None:
        self.close()
        self._forget()
        link = self._link = open_transport(self._config.port, place=self._place)
        try:
            offered = self._greeting(link)
            if lacking := [kind.name for kind in sorted(self._needed() - offered)]:
                raise DeviceError(
                    self._place,
                    f"this server doesn't offer {', '.join(lacking)}",
                    "Use a later version of the server's program",
                )
            self._subscription = protocol.object_enums(self._wanted & offered)
            if self._config.mode == "push":
                self._request = protocol.request_frame(True)
            elif Block.REQUEST_NEXT_FRAME in offered:
                self._request = protocol.request_next_frame()
            else:
                self._request = protocol.request_frame(False)
            link.write_all(self._subscription + self._request, GREETING)
            self._identify(link)
        except DeviceError:
            self.close()
            raise

    def read(self, now: int) -> Frame | None:
        assert self._link is not None
        data = self._link.read()
        if self._since < 0:
            self._since = now
        newest = self._newest(self._parser.feed(data)) if data else None
        if newest is not None:
            self._since = now
            self._unasked = self._config.mode == "pull"
        elif now - self._since > ASK_AGAIN:
            self._since = now
            if self._link.write(self._subscription + self._request):
                self.asked_again += 1
                self._unasked = False
            self.remark = "no frames come; is the server live?"
        if self._unasked:
            self._unasked = not self._link.write(self._request)
        return None if newest is None else self._decoded(newest)

    def close(self) -> None:
        link, self._link = self._link, None
        if link is not None:
            with contextlib.suppress(DeviceError):
                if self._config.mode == "push":
                    link.write(protocol.request_frame(False))
            link.close()

    # -- packets

    def _newest(self, packets: Iterable[Packet]) -> Packet | None:
        """Remembers static blocks, and returns the newest packet that is a frame."""
        newest = None
        for packet in packets:
            try:
                self._keep(packet)
            except MalformedError:
                self._malformed += 1
                continue
            if any(item.type == Block.FRAME_INFO for item in packet):
                newest = packet
        return newest

    def _keep(self, packet: Packet) -> None:
        subjects: dict[int, Subject] = {}
        contents: memoryview | None = None
        static = False
        for kind, body in packet:
            if kind == Block.SUBJECT_INFO:
                subject = blocks.subject_info(body)
                subjects[subject.id] = subject
            elif kind == Block.STREAM_INFO:
                self._set_period(blocks.frame_period(body))
            elif kind == Block.APPLICATION_INFO:
                self._y_up = blocks.y_up(body)
            elif kind == Block.CONTENTS:
                contents = body
            static = static or kind in _STATIC
        # When static blocks come, those that neither come nor are declared unchanged are gone.
        if static and (subjects or contents is None or Block.SUBJECT_INFO not in blocks.contents(contents).unchanged):
            self.subjects = subjects
            self._selection = select(self._config, subjects.values())
            missing = ", ".join(self._selection.missing)
            self._absent = f"the server has no {missing} at present" if missing else ""

    def _set_period(self, ticks: int) -> None:
        if ticks in _PERIODS:
            self._ticks = ticks
            self.period = Fraction(ticks * 10**9, protocol.CLOCK)

    def _decoded(self, packet: Packet) -> Frame | None:
        try:
            frame = self._frame(packet)
        except MalformedError:
            self._malformed += 1
            return None
        self.remark = self._absent
        return frame

    def _frame(self, packet: Packet) -> Frame:
        frame, selection = Frame(-1), self._selection
        for kind, body in packet:
            if kind == Block.FRAME_INFO:
                frame.number = blocks.whole(body)
            elif kind == Block.LATENCY_INFO:
                latency = blocks.latency(body)
                frame.latency = round(latency * 1e9) if 0.0 <= latency <= _MOST_LATENCY else 0
            elif kind == Block.GLOBAL_SEGMENTS:
                rows = selection.segments.get(blocks.segments_of(body))
                if rows:
                    self._add_segments(frame, blocks.find_segments(body, rows))
            elif kind == Block.LABELED_RECONS and selection.markers:
                for row, point in blocks.find_labeled(body, selection.markers):
                    if (p := self._metres(point)) is not None:
                        frame.markers.append((row, p))
            elif kind == Block.UNLABELED_RECONS and self._config.unlabelled:
                points = map(self._metres, blocks.unlabeled(body, self._config.unlabelled))
                frame.unlabelled += [p for p in points if p is not None]
        return frame

    def _add_segments(self, frame: Frame, found: list[tuple[int, tuple[float, ...]]]) -> None:
        for row, values in found:
            q, p = geometry.from_matrix(values[3:]), self._metres(values)
            if q is None or p is None:
                continue
            frame.segments.append((row, p, axes.z_up_quaternion(q) if self._y_up else q))

    def _metres(self, millimetres: tuple[float, ...]) -> Point | None:
        x, y, z = millimetres[0] * 1e-3, millimetres[1] * 1e-3, millimetres[2] * 1e-3
        if not abs(x) + abs(y) + abs(z) < 3 * FARTHEST:  # nor NaN
            return None
        return (x, -z, y) if self._y_up else (x, y, z)

    # -- opening

    def _forget(self) -> None:
        """Forgets what an earlier connection reported: it doesn't hold for this one."""
        counts = self._parser
        self._parser = protocol.Parser()
        self._parser.frames, self._parser.errors, self._parser.resyncs = counts.frames, counts.errors, counts.resyncs
        self.subjects = {}
        self._selection = Selection()
        self._y_up = False
        self._ticks = 0
        self._unasked = False
        self._early = []
        self._since = -1
        self.remark = self._absent = ""

    def _needed(self) -> set[Block]:
        """Returns the blocks without which the states can't be filled."""
        return {
            kind for kind in self._wanted if kind not in (Block.CONTENTS, Block.LATENCY_INFO, Block.APPLICATION_INFO)
        }

    def _greeting(self, link: Transport) -> frozenset[int]:
        """Returns the types of blocks that the server offers."""
        heard, errors = b"", self._parser.errors
        for left in remaining(GREETING):
            data = link.read_wait(left)
            heard = heard or data[:64]
            self._early += self._parser.feed(data)
            for kind, body in (item for packet in self._early for item in packet):
                if kind == Block.OBJECT_ENUMS:
                    with contextlib.suppress(MalformedError):
                        return blocks.enums(body)
            if self._parser.errors > errors:
                break
        shown = f"the bytes {heard[:12].hex(' ')}" if heard else "nothing"
        raise DeviceError(self._place, f"expected a DataStream server's greeting, got {shown}", _REMEDY)

    def _identify(self, link: Transport) -> None:
        """Waits until a frame has come and everything wanted is known; raises DeviceError if something is missing."""
        deadline = time.monotonic() + FRAMES
        packets, self._early = self._early, []
        seen = False
        while True:
            if self._newest(packets) is not None:
                seen = True
                if self.subjects and self._ticks and not self._selection.missing:
                    break
                if self._config.mode == "pull":
                    link.write_all(self._request, GREETING)
            left = deadline - time.monotonic()
            if left <= 0:
                break
            packets = self._parser.feed(link.read_wait(left))
        if not seen:
            raise DeviceError(
                self._place, "the server answers but sends no frames", "Go live (Nexus, Shogun) or un-pause (Tracker)"
            )
        if self._selection.missing or ((self._config.segments or self._config.markers) and not self.subjects):
            missing = (self._selection.missing or [*self._config.segments, *self._config.markers])[0]
            raise refuse(self._config, list(self.subjects.values()), missing, self._place)
        if self._ticks and (rate := protocol.CLOCK / self._ticks) < self._config.rate * 0.999:
            raise DeviceError(
                self._place,
                f"the server captures {rate:.4g} frames a second, the profile needs {self._config.rate:.4g}",
                f"Raise the capture rate in the server, or set 'rate: {rate:.4g}'",
            )
        self._unasked = self._config.mode == "pull"


def _wanted(config: ViconConfig) -> set[Block]:
    wanted = {Block.STREAM_INFO, Block.FRAME_INFO, Block.LATENCY_INFO, Block.APPLICATION_INFO, Block.CONTENTS}
    if config.segments or config.markers:
        wanted.add(Block.SUBJECT_INFO)
    if config.segments:
        wanted.add(Block.GLOBAL_SEGMENTS)
    if config.markers:
        wanted.add(Block.LABELED_RECONS)
    if config.unlabelled:
        wanted.add(Block.UNLABELED_RECONS)
    return wanted
