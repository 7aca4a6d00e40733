"""An OptiTrack system as a device: each cycle takes the newest frame, stamped by the server's own clock."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Final

from srl.drivers.capture.names import Subject
from srl.drivers.capture.selection import refuse
from srl.drivers.capture.view import GIVES, View, signals
from srl.drivers.devicetime import DeviceTime
from srl.drivers.linked import Addressed
from srl.drivers.natnet.client import Client
from srl.drivers.natnet.config import NatNetConfig
from srl.drivers.natnet.frame import EDITED, KNOWN, MODEL_CHANGED, MotiveFrame
from srl.drivers.natnet.scene import Scene
from srl.drivers.pause import Pause
from srl.runtime.contracts.driver import Sensor
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.runtime.contracts.signals import Array

_MOST: Final = 1.0  # s; a longer way from exposure to sending isn't one
_SLOWER: Final = 0.99  # of the profile's rate


class NatNet(Addressed, Sensor):
    """Rigid bodies, skeletons and labelled markers from Motive, in its origin, z up.

    States: those of a Vicon (`srl.drivers.vicon.Vicon`), which the profile requests.

    A body, bone or marker that isn't tracked keeps its last pose with `visible` 0; a marker that Motive puts where its
    model has it isn't measured, and counts as hidden. A frame in which nothing wanted is visible, or something
    `required` isn't, is no sample. Neither are the frames of a take that Motive plays (edit mode), nor a skeleton that
    hasn't been seen upright since the device was opened: that would be the wrong `up`.

    A sample's stamp is the time of exposure: the server's send time counts, the smallest delay seen fixes its offset,
    and the way from exposure to sending, which the server knows, is subtracted. (Sheet optitrack_natnet.)
    """

    Config = NatNetConfig
    summary = "OptiTrack motion capture (Motive, NatNet 3.x and 4.x): rigid bodies, skeletons, markers"
    gives = GIVES
    max_age = 0.1

    def __init__(self, name: str, config: NatNetConfig) -> None:
        super().__init__(name, config)
        self.states = signals(config)
        self._config = config
        self._view = View(config)
        self._client = Client(config.port, self._place)
        self._scene = Scene(config)
        self._is_open = False
        self._number: int | None = None
        self._missed = self._hidden = self._played = self._taken = 0
        self._frequency = 1
        self._new_time(1)

    def bind(self, states: Mapping[str, Array], commands: Mapping[str, Array]) -> None:
        super().bind(states, commands)
        self._view.bind(states)

    def open(self) -> None:
        """Blocks up to 7 s."""
        self.close()
        client, config = self._client, self._config
        try:
            client.open()
            self._select()
            if client.rate is not None and client.rate < config.rate * _SLOWER:
                raise self._error(
                    f"Motive captures {client.rate:g} frames a second, the profile needs {config.rate:g}",
                    "Raise its frame rate, or set 'rate'",
                )
        except DeviceError:
            self.close()
            raise
        finally:
            self._count()
        self._scene.forget()
        self._select()
        assert client.info is not None
        self._new_time(client.info.frequency)
        self._is_open = True
        self.health.opened()

    def read(self, now: int) -> None:
        if not self._is_open:
            raise self._not_open()
        client = self._client
        try:
            frame = client.read(now)
        except DeviceLostError as error:
            self.health.lost(error.problem)
            raise
        finally:
            self._count()
        if client.order.restarts != self.health.resyncs:  # another Motive, perhaps with another axis up
            self.health.resyncs = client.order.restarts
            self._scene.forget()
        if client.renamed:
            self._subjects()
        if client.info is not None and client.info.frequency != self._frequency:
            self._new_time(client.info.frequency)
        if frame is not None:
            self._take(frame, now)

    def close(self) -> None:
        self._is_open = False
        self.health.connected = False
        self._client.close()

    def metrics(self) -> dict[str, object]:
        """Frames that never came, that came behind newer ones, that showed nothing wanted, of a take; of others."""
        client = self._client
        return {
            "natnet": str(client.info.version) if client.info else "",
            "missed_frames": self._missed,
            "late_frames": client.order.late,
            "hidden_frames": self._hidden,
            "played_frames": self._played,
            "restarts": client.order.restarts,
            "foreign": client.foreign,
        }

    # -- names

    def _select(self) -> None:
        subjects = self._subjects()
        if self._scene.missing:
            raise refuse(self._config, subjects, self._scene.missing[0], self._place)

    def _subjects(self) -> list[Subject]:
        """Takes the newest names. What isn't there any more is hidden from now on; what came anew is back."""
        model = self._client.model
        assert model is not None
        self._client.renamed = False
        try:
            return self._scene.take(model)
        except ValueError as error:
            raise self._lost(str(error), "Give each asset its own in Motive") from None

    # -- cycle

    def _take(self, frame: MotiveFrame, now: int) -> None:
        client, period = self._client, self._frequency
        if frame.flags & MODEL_CHANGED:
            client.names_again()
        if self._number is not None:
            self._missed += max(frame.number - self._number - (client.frames - self._taken), 0)
        self._number, self._taken = frame.number, client.frames
        latency = self._latency(frame, period)
        sent = self._time.stamp(frame.sent, now)
        if self._pause.over(self._time.delay, now):
            self._time.restart()
            sent = self._time.stamp(frame.sent, now)
        if frame.flags & EDITED and not self._config.takes:
            self._played += 1
            self.health.message = "Motive plays a take; go live"
            return
        shown = self._scene.show(frame)
        stamp = sent - latency
        self._view.show(shown, stamp, round(self.max_age * 1e9))
        self.health.message = self._scene.remark or self._unknown()
        if self._view.seen:
            self.health.stamp = stamp
        else:
            self._hidden += 1

    def _latency(self, frame: MotiveFrame, frequency: int) -> int:
        """ns from exposure to sending."""
        begin, extra = (frame.exposed, 0.0) if frame.exposed else (frame.received, self._config.latency)
        passed = (frame.sent - begin) / frequency if begin else 0.0
        return round((min(max(passed, 0.0), _MOST) + extra) * 1e9)

    def _unknown(self) -> str:
        info = self._client.info
        if info is None or info.version <= KNOWN:
            return ""
        return f"NatNet {info.version} is newer than this driver knows; it is read as {KNOWN}"

    def _new_time(self, frequency: int) -> None:
        self._frequency = frequency
        self._time = DeviceTime(Fraction(10**9, frequency))
        self._pause = Pause()
        self._number = None

    def _count(self) -> None:
        self.health.frames, self.health.errors = self._client.frames, self._client.errors
