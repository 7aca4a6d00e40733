"""A Vicon system as a device: each cycle takes the newest frame, stamped by the server's own frame count."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Final

from srl.drivers.capture.view import GIVES, View, signals
from srl.drivers.devicetime import DeviceTime
from srl.drivers.linked import Addressed
from srl.drivers.pause import Pause
from srl.drivers.vicon.config import ViconConfig
from srl.drivers.vicon.datastream import DataStream
from srl.drivers.vicon.object_stream import ObjectStream
from srl.drivers.vicon.source import Frame, Source
from srl.runtime.contracts.driver import Sensor
from srl.runtime.contracts.errors import DeviceLostError
from srl.runtime.contracts.signals import Array

_BITS: Final = 32  # of the frame number
_GAP: Final = 10_000  # frames; after a longer gap the count has begun anew
_LATE: Final = 2  # frames by which a datagram may be late


class Vicon(Addressed, Sensor):
    """Poses of segments and positions of markers, in the server's origin, z up.

    States, those that the profile requests, k rows in the profile's order:
        `pose` (k, 7): x, y, z (m), qw, qx, qy, qz of segments; `<name>.pose` (7,): the same of one segment, for
        `frames:`. `visible` (k,): 1 or 0. `markers` (k, 3), m, and `marker_visible` (k,). `unlabelled` (k, 3), m, and
        `unlabelled_visible` (k,): the first k, in no lasting order.

    An occluded row keeps its last pose with `visible` 0. A frame isn't a sample if nothing wanted is visible, or
    something `required` isn't: `health.stamp` stays, and the device becomes stale after its `max_age`.

    A sample's stamp is the time of its frame's exposure. The frame number counts time, and the smallest delay seen
    fixes its offset; the latency that the server reports is subtracted. A frame that waited anywhere gets its true
    age. (Sheet vicon_datastream.)
    """

    Config = ViconConfig
    summary = "Vicon motion capture (DataStream, Tracker's UDP objects): segment poses, markers"
    gives = GIVES
    max_age = 0.1

    def __init__(self, name: str, config: ViconConfig) -> None:
        super().__init__(name, config)
        self.states = signals(config)
        self._view = View(config)
        self._source: Source = (
            ObjectStream(config, self._place) if config.objects_only else DataStream(config, self._place)
        )
        self._time = DeviceTime(self._source.period, _BITS)
        self._pause = Pause()
        self._period = self._source.period
        self._number: int | None = None
        self._is_open = False
        self._taken = 0  # the source's frame count at the newest frame
        self._missed = self._repeated = self._hidden = 0

    def bind(self, states: Mapping[str, Array], commands: Mapping[str, Array]) -> None:
        super().bind(states, commands)
        self._view.bind(states)

    def open(self) -> None:
        self.close()
        try:
            self._source.open()
        finally:
            self._count()
        self._new_time(self._source.period)
        self._is_open = True
        self.health.opened()

    def read(self, now: int) -> None:
        if not self._is_open:
            raise self._not_open()
        try:
            frame = self._source.read(now)
        except DeviceLostError as error:
            self.health.lost(error.problem)
            raise
        finally:
            self._count()
        if frame is not None:
            self._take(frame, now)

    def close(self) -> None:
        self._is_open = False
        self.health.connected = False
        self._source.close()

    def metrics(self) -> dict[str, object]:
        """Returns frames that never came, repeated frames, frames without anything wanted; the frame rate, Hz."""
        return {
            "missed_frames": self._missed,
            "repeated_frames": self._repeated,
            "hidden_frames": self._hidden,
            "frame_rate": float(Fraction(10**9) / self._period),
        }

    # -- cycle

    def _take(self, frame: Frame, now: int) -> None:
        if self._source.period != self._period:
            self._new_time(self._source.period)
        if self._number is not None:
            step = (frame.number - self._number + (1 << _BITS - 1)) % (1 << _BITS) - (1 << _BITS - 1)
            if -_LATE <= step <= 0:  # a paused server repeats its frame, or another datagram overtook this one
                self._repeated += 1
                return
            if step > 0:
                self._missed += min(max(step - (self._source.frames - self._taken), 0), _GAP)
        self._number, self._taken = frame.number, self._source.frames
        exposed = now - frame.latency  # for a frame that took no longer than the fastest one
        stamp = self._time.stamp(frame.number, exposed)
        if self._pause.over(self._time.delay, now):
            self._time.restart()
            stamp = self._time.stamp(frame.number, exposed)
        self._view.show(frame, stamp, round(self.max_age * 1e9))
        if self._view.seen:
            self.health.stamp = stamp
        else:
            self._hidden += 1

    def _new_time(self, period: Fraction) -> None:
        self._period = period
        self._time = DeviceTime(period, _BITS)
        self._pause = Pause()
        self._number = None

    def _count(self) -> None:
        health, source = self.health, self._source
        health.frames, health.errors, health.resyncs = source.frames, source.errors, source.resyncs
        health.message = source.remark
