"""The BNO085 as a device: it only talks, so it is listened to."""

from __future__ import annotations

from typing import Final

from pydantic import Field

from srl.drivers.bno085.protocol import BAUDRATE, RATE, WRAP, Parser, Record
from srl.drivers.bno085.reading import AngleOrder, Reading
from srl.drivers.serial_imu import SerialImu, SerialImuConfig
from srl.drivers.streamtime import Lateness, StreamTime
from srl.drivers.timeout import remaining
from srl.drivers.transport import Transport, open_transport
from srl.runtime.contracts.signals import Signal
from srl.runtime.contracts.terms import POINT, QUATERNION

FIRST: Final = 1.0  # s for the first frame; a sensor that has just been switched on needs 0.1 s
_REMEDY: Final = "Check TX and ground, its supply, and that PS0 is high and PS1 low when it is switched on (UART-RVC)"


class Bno085Config(SerialImuConfig):
    """Options of the sensor."""

    order: AngleOrder = Field(
        "ZXY", description="axes of yaw, pitch and roll: ZXY, as it measures; ZYX, as its datasheet's words say"
    )
    hold: float = Field(0.1, gt=0, le=10, description="s, for which the last orientation stands for later ones")


class Bno085(SerialImu[Record]):
    """A Bosch BNO085 (CEVA BNO08X) in its UART-RVC mode.

    States: `orientation` (4,), w x y z, of the option's frame; z of its reference is up, its yaw begins at 0 when the
    sensor is switched on and drifts. `acceleration` (3,), m/s^2, the specific force in the sensor's own axes: at rest
    it points up. Both are NaN before the first frame and when the newest is older than `hold`, so that a law can fade
    out what it does with them; when it is older than `max_age`, that is a loss like any other.

    A sample's time follows from the frame's index. So none is lost unseen, and late frames stay as old as they are;
    after 5 s of them the port is opened anew. So it is where more than 1.2 s of frames are missing, or the sensor was
    switched off and on: its index says nothing of how long. Frames whose index or whose values stand still, or whose
    angles and acceleration disagree for seconds, aren't used.
    """

    Config = Bno085Config
    summary = "Bosch BNO085 inertial sensor: orientation and acceleration (UART-RVC, 100 Hz)"
    gives = ("orientation", "acceleration")
    max_age = 0.5
    remedy = _REMEDY

    def __init__(self, name: str, config: Bno085Config) -> None:
        super().__init__(name, config)
        self._config = config
        self.states = (
            Signal(name="orientation", shape=(4,), unit="1", of=config.frame, labels=QUATERNION),
            Signal(name="acceleration", shape=(3,), unit="m/s^2", frame=config.frame, labels=POINT),
        )
        self._gaps = self._stuck = self._restarts = 0
        self._begin()

    def _begin(self) -> None:
        super()._begin()
        self._parser = Parser()
        self._reading = Reading(self._config.order)
        self._clock, self._late = StreamTime(RATE, learn=True, lossless=True), Lateness()
        self._index, self._number = -1, 0

    # -- lifecycle

    def connect(self) -> Transport:
        return open_transport(self._config.port, place=self._place, baudrate=BAUDRATE)

    def _set_up(self, link: Transport) -> None:
        """Blocks up to 1 s."""
        self._begin()
        self._await_frame(link)
        self._parser = Parser()  # what came up to now isn't counted
        self.health.stamp = -1

    @classmethod
    def who_is_at(cls, port: str) -> str:
        """It can't be asked, so it is heard."""
        heard = cls(port, Bno085Config(port=port))
        link = open_transport(port, place=port, baudrate=BAUDRATE)
        try:
            heard._await_frame(link)
        finally:
            link.close()
        return "a BNO085 in UART-RVC mode, heard only"

    def metrics(self) -> dict[str, object]:
        """Returns its rate, frames that never came, frames with an old index, and how often the sensor began anew."""
        return {
            "rate_hz": round(self._clock.rate, 2),
            "gaps": self._gaps,
            "stuck": self._stuck,
            "restarts": self._restarts,
        }

    # -- cycle

    def _take(self, record: Record, now: int) -> None:
        self.health.frames += 1
        step = (record.number - self._index) % WRAP if self._index >= 0 else 1
        self._index = record.number
        if step == 0:
            self._stuck += 1
            self.health.message = "its index stands still"
            return
        if step >= WRAP // 2:  # it was switched off and on; its yaw began at 0 again
            self._restarts += 1
            step = 1
        self._gaps += step - 1
        self._number += step
        stamp = self._clock.stamp(self._number, now)
        if not self._frozen(record[1:], stamp):
            if self._reading.fill(record, self.state_arrays):
                self.health.stamp = stamp
                self.health.message = ""
            else:
                self.health.message = self._reading.trouble()
        self._late.check(self._clock.delay, now, self._place, self.health)

    # -- opening

    def _await_frame(self, link: Transport) -> None:
        heard = b""
        for left in remaining(FIRST):
            data = link.read_wait(left)
            heard += data[: 64 - min(len(heard), 64)]
            if self._parser.feed(data):
                return
        shown = f"the bytes {heard[:12].hex(' ')}" if heard else "nothing"
        raise self._error(f"expected frames of a BNO085, got {shown} in {FIRST:g} s", _REMEDY)
