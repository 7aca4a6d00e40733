"""The MTi as a device: asked once what it sends, then listened to."""

from __future__ import annotations

from math import degrees, isfinite
from typing import Final

from srl.drivers.devicetime import DeviceTime
from srl.drivers.gravity_check import GravityCheck
from srl.drivers.serial_imu import SerialImu
from srl.drivers.streamtime import Lateness
from srl.drivers.transport import Transport, open_transport
from srl.drivers.xsens_mti.config import XsensMtiConfig
from srl.drivers.xsens_mti.data import CLIPPED, FILTER_VALID, TICK, TICK_BITS, Sample, decode
from srl.drivers.xsens_mti.opening import Session, begin, identify
from srl.drivers.xsens_mti.protocol import Id, Message, Parser, encode
from srl.runtime.contracts.rotation import normalised
from srl.runtime.contracts.signals import Signal
from srl.runtime.contracts.terms import POINT, QUATERNION

_WRAP: Final = 1 << 16  # of the packet counter
_OFF: Final = 0.1  # by which a quaternion's length may be off 1

__all__ = ["XsensMti", "XsensMtiConfig"]


class XsensMti(SerialImu[Message]):
    """An Xsens MTi (Movella) with an orientation filter, by Xbus and MTData2.

    States: `orientation` (4,), w x y z, of the option's frame in a reference whose z is up (ENU; that of an NED or NWU
    sensor is turned into it). `acceleration` (3,), m/s^2, the specific force, and `turn` (3,), rad/s, in the
    sensor's own axes. All are NaN before the first sample, when the newest is older than `hold`, and while
    the sensor says that its orientation isn't valid.

    A sample's time follows from the sensor's own clock. Opening writes nothing but the output configuration, and
    that only if it differs. A sensor that was switched off and on goes on by itself; its yaw may have begun anew.
    """

    Config = XsensMtiConfig
    summary = "Xsens MTi inertial sensor: orientation, acceleration, rate of turn (Xbus)"
    gives = ("orientation", "acceleration", "turn")
    max_age = 0.2
    usb = ("2639",)
    frames = "messages"
    remedy = "Check its cable and its supply"

    def __init__(self, name: str, config: XsensMtiConfig) -> None:
        super().__init__(name, config)
        self._config = config
        self.states = (
            Signal(name="orientation", shape=(4,), unit="1", of=config.frame, labels=QUATERNION),
            Signal(name="acceleration", shape=(3,), unit="m/s^2", frame=config.frame, labels=POINT),
            Signal(name="turn", shape=(3,), unit="rad/s", frame=config.frame, labels=POINT),
        )
        self._gaps = self._restarts = self._clipped = self._invalid = 0
        self._id = ""
        self._begin()

    def _begin(self) -> None:
        super()._begin()
        self._parser = Parser()
        self._clock, self._late = DeviceTime(TICK, TICK_BITS), Lateness()
        self._gravity = GravityCheck(self._config.rate)
        self._counter = -1

    # -- lifecycle

    def connect(self) -> Transport:
        return open_transport(self._config.port, place=self._place, baudrate=self._config.baudrate)

    def _set_up(self, link: Transport) -> None:
        """Blocks up to some seconds."""
        self._begin()
        self._id = begin(Session(link, self._place), self._config, self._place)
        self.health.stamp = -1

    @classmethod
    def who_is_at(cls, port: str) -> str:
        """At 115200 bit/s, as they are delivered. Measuring pauses while it is asked."""
        link = open_transport(port, place=port, baudrate=115200)
        try:
            session = Session(link, port)
            found = identify(session)
            session.ask(encode(Message(Id.GO_TO_MEASUREMENT, b"")), Id.MEASURING)
            return f"an MTi, id {found}"
        finally:
            link.close()

    def metrics(self) -> dict[str, object]:
        """Returns its id, messages that never came, restarts, clipped samples, and samples that it called invalid."""
        return {
            "id": self._id,
            "gaps": self._gaps,
            "restarts": self._restarts,
            "clipped": self._clipped,
            "invalid": self._invalid,
        }

    # -- cycle

    def _take(self, message: Message, now: int) -> None:
        if message.id == Id.WAKEUP:
            self._restart()
            return
        sample = decode(message.data) if message.id == Id.DATA else None
        if sample is None:
            self.health.errors += message.id == Id.DATA
            return
        self.health.frames += 1
        if sample.counter is not None and not self._count(sample.counter):
            return
        if None not in (sample.fine, sample.orientation, sample.acceleration, sample.turn):
            self._use(sample, now)

    def _count(self, counter: int) -> bool:
        """Counts what is missing; False: an old message. A counter that goes back is a sensor that began anew."""
        step = (counter - self._counter) % _WRAP if self._counter >= 0 else 1
        if step == 0:
            self.health.message = "its packet counter stands still"
            return False
        if step >= _WRAP // 2:
            self._restart()
        else:
            self._gaps += step - 1
        self._counter = counter
        return True

    def _restart(self) -> None:
        self._restarts += 1
        self._counter = -1
        self._clock.restart()
        self._gravity = GravityCheck(self._config.rate)

    def _use(self, sample: Sample, now: int) -> None:
        health, states = self.health, self.state_arrays
        fine, orientation, force, turn = sample.fine, sample.orientation, sample.acceleration, sample.turn
        assert fine is not None and orientation is not None and force is not None and turn is not None  # noqa: PT018
        stamp = self._clock.stamp(fine, now)
        self._late.check(self._clock.delay, now, self._place, health)
        length = sum(v * v for v in orientation) ** 0.5
        if not (abs(length - 1.0) < _OFF and all(map(isfinite, (*force, *turn)))):
            health.errors += 1
            health.message = "its values are none: no unit quaternion, or not numbers"
            return
        if sample.status is not None and not sample.status & FILTER_VALID:
            self._invalid += 1
            health.message = "it says that its orientation isn't valid yet: keep it still"
            return
        if self._frozen((orientation, force, turn), stamp):
            return
        clipped = sample.status is not None and bool(sample.status & CLIPPED)
        self._clipped += clipped
        if not self._gravity.agree(normalised(orientation), force):
            off = degrees(self._gravity.disagrees)
            health.message = f"orientation and acceleration disagree by {off:.0f} degrees: reset its alignment"
            return
        states["orientation"][:] = normalised(orientation)
        states["acceleration"][:] = force
        states["turn"][:] = turn
        health.stamp = stamp
        health.message = "its acceleration or rate is beyond its range" if clipped else ""
