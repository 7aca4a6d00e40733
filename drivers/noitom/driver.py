"""A Perception Neuron suit as a device: the newest pose of one avatar."""

from __future__ import annotations

import time
from math import degrees
from typing import Final

from srl.drivers.datagram import Datagrams, open_datagrams
from srl.drivers.linked import Linked
from srl.drivers.noitom.config import NoitomConfig, signals
from srl.drivers.noitom.floor import Floor
from srl.drivers.noitom.pose import Pose
from srl.drivers.noitom.protocol import BinaryParser, Frame, Parser, TextParser
from srl.drivers.noitom.skeleton import Skeleton
from srl.drivers.streamtime import Lateness, StreamTime, measured_rate
from srl.drivers.transport import Transport, open_transport
from srl.runtime.contracts.driver import Sensor

FIRST: Final = 3.0  # s for the first frame
MEASURE: Final = 0.5  # s of frames from which the rate is first measured
ENOUGH: Final = 10  # readings with a frame for that measurement: one of them may have been held up
LONGEST: Final = 1.5  # s that the measurement may take, where that many don't come
USELESS: Final = 65536  # bytes without a frame after which the form of the stream is detected anew
NEW_HEADER: Final = "Tick 'BVH', 'use old header format', and binary or string, in the software's broadcast settings"


class Noitom(Linked[Transport | Datagrams], Sensor):
    """A Perception Neuron suit: the poses of 59 joints.

    States: `rotation` (59, 4), unit quaternions w x y z, of each joint relative to its parent;
    `translation` (59, 3) m, of each joint in its parent's frame; both of the hips in the software's world,
    y up, z forward in the T-pose, x to the left. A quaternion may change its sign from frame to frame.

    The driver detects from the stream whether it is text or binary, with displacement or without. Without
    displacement, all joints but the hips keep the default body's offsets, scaled. Frames are numbered in binary,
    counted in text; their time is that number divided by the measured rate. Over TCP, and in binary, no frame is lost
    unseen: late frames stay as old as they are, and after 5 s of them the link is opened anew. A suit that isn't
    calibrated sends the T-pose; the stream doesn't show this.
    """

    Config = NoitomConfig
    summary = "Noitom Perception Neuron suit, 59 joints (Axis Neuron, Axis Studio)"
    gives = ("rotation", "translation")
    calibrated = "suit"
    max_age = 0.1

    def __init__(self, name: str, config: NoitomConfig) -> None:
        super().__init__(name, config)
        self._config = config
        self.skeleton = Skeleton(config.skeleton)
        self.states = signals(self.skeleton)
        self._pose = Pose(config, self.skeleton)  # here, so that `srl check` refuses what a run would
        made = self._pose.calibration
        self.simulated = "calibration" if made is not None and made.simulated else ""
        self._note = "" if made is None else f", heading turned back by {degrees(made.heading):.1f} degrees"
        self._floor = Floor(self.skeleton, config.order)
        self._parser: Parser = BinaryParser()
        self._clock = StreamTime(100.0)
        self._useless = 0  # bytes since the newest frame
        self._number = -1
        self._late = Lateness()
        self._gaps = 0
        self._seen = (0, 0, 0)

    # -- lifecycle

    def connect(self) -> Transport | Datagrams:
        port = self._config.port
        if port.startswith("udp://"):
            return open_datagrams(port, place=self._place, listen=True)
        return open_transport(port, place=self._place)

    def _receive(self, link: Transport | Datagrams, now: int) -> None:
        data = _joined(link.read())
        if not data:
            return
        before = self._parser.frames
        frame = self._parser.feed(data)
        came = self._parser.frames - before
        self._count()
        if frame is not None:
            self._useless = 0
            self._fill(frame, came, now)
            return
        self._useless += len(data)
        if self._useless > USELESS:
            raise self._lost("what comes is no frame any more", "It is looked at anew")

    def metrics(self) -> dict[str, object]:
        """Returns the measured frame rate, frames that were never received, frames of other avatars."""
        return {"rate_hz": round(self._clock.rate, 2), "gaps": self._gaps, "others": self._parser.others}

    # -- cycle

    def _count(self) -> None:
        health, parser = self.health, self._parser
        counts = (parser.frames, parser.errors, parser.resyncs)
        health.frames += counts[0] - self._seen[0]
        health.errors += counts[1] - self._seen[1]
        health.resyncs += counts[2] - self._seen[2]
        self._seen = counts

    def _fill(self, frame: Frame, came: int, now: int) -> None:
        self._pose.fill(frame, self.state_arrays)
        if warning := self._floor.warning(frame.split()[1], self.state_arrays["translation"]):
            self.health.message = warning
        number = frame.number if frame.number >= 0 else self._parser.frames
        if frame.number >= 0 and self._number >= 0:
            self._gaps += max(frame.number - self._number - came, 0)
        self._number = frame.number
        self.health.stamp = self._clock.stamp(number, now)
        self._late.check(self._clock.delay, now, self._place, self.health)

    # -- opening

    def _set_up(self, link: Transport | Datagrams) -> None:
        """Detects which of the two forms the stream has, and measures its rate."""
        avatar = self._config.avatar
        parsers: tuple[Parser, ...] = (BinaryParser(avatar), TextParser(avatar))
        heard, times, numbers = b"", list[float](), list[int]()
        until = time.monotonic() + FIRST
        while (left := until - time.monotonic()) > 0:
            data = _joined(link.read_wait(left))
            came = time.monotonic()
            heard = (heard + data)[:256]
            for parser in parsers:
                frame = parser.feed(data)
                if frame is None:
                    continue
                parsers = (parser,)
                if not times:
                    until = came + LONGEST
                times.append(came)
                numbers.append(frame.number if frame.number >= 0 else parser.frames)
                break
            if len(times) >= ENOUGH and came - times[0] > MEASURE:
                break
        if not times:
            raise self._error(*self._refusal(heard, parsers))
        mean = (numbers[-1] - numbers[0]) / (times[-1] - times[0]) if times[-1] > times[0] else 0.0
        if not 5 < mean < 1000:
            raise self._error(
                f"its frames come {mean:.1f} times a second", "Set the broadcast's frequency to 60 Hz or more"
            )
        self._parser = parsers[0]
        unseen = self._config.port.startswith("udp://") and isinstance(self._parser, TextParser)
        rate = measured_rate(times, numbers)
        self._clock = StreamTime(rate, learn=True, lossless=not unseen)
        self._useless, self._number, self._late = 0, -1, Lateness()
        self._seen = (self._parser.frames, self._parser.errors, self._parser.resyncs)
        kind = "binary" if isinstance(self._parser, BinaryParser) else "text"
        self.health.message = f"{kind} frames, about {rate:.0f} Hz{self._note}"

    def _refusal(self, heard: bytes, parsers: tuple[Parser, ...]) -> tuple[str, str]:
        others = sum(parser.others for parser in parsers)
        if others:
            return f"no frame of avatar {self._config.avatar} came, {others} of others", "Correct 'avatar'"
        if not heard:
            what = "nothing came" if self._config.port.startswith("udp") else "it is connected, and nothing came"
            return (
                f"{what} within {FIRST:g} s",
                "Tick 'BVH' in the software's broadcast settings, and check its address",
            )
        if b"," in heard:
            return "its numbers have decimal commas", "Set a decimal point in the settings of the PC region"
        words = heard.split(b"||")[-1].split()
        if heard[:1].isdigit() and len(words) > 2 and b"." not in words[2]:
            return "the avatar's name has a space in it", "Give the avatar a name of one word in the software"
        shown = heard[:40].decode("ascii", "replace") if heard[:20].isascii() else heard[:16].hex(" ")
        return f"expected BVH frames of 59 joints, got '{shown}'", NEW_HEADER


def _joined(data: bytes | list[bytes]) -> bytes:
    return data if isinstance(data, bytes) else b"".join(data)
