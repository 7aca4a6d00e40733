"""The options of an MTi in the profile, and what it is asked to send."""

from __future__ import annotations

from math import ceil
from typing import Final, Literal, Self

from pydantic import Field, model_validator

from srl.drivers.serial_imu import SerialImuConfig
from srl.drivers.xsens_mti import data
from srl.drivers.xsens_mti.protocol import EVERY
from srl.runtime.contracts.errors import OptionError

Baudrate = Literal[9600, 19200, 38400, 57600, 115200, 230400, 460800, 921600, 2000000]
MESSAGE: Final = 73  # bytes of a message with all items
PERIODS: Final = 2  # messages that `hold` must reach over: one may come late
LINE: Final = 0.9  # share of the line that may be used


class XsensMtiConfig(SerialImuConfig):
    """Options of the sensor."""

    baudrate: Baudrate = Field(115200, description="bit/s that the sensor is set to; nothing here changes it")
    rate: int = Field(100, ge=10, le=400, description="Hz, messages it is asked for")
    device: str | None = Field(
        None,
        pattern="^[0-9A-Fa-f]{8}([0-9A-Fa-f]{8})?$",
        description="its id in hex, 8 or 16 digits, as on its label: another sensor at this port is refused",
    )
    configure: bool = Field(
        True, description="ask for the wanted output if it sends something else; it keeps that. false: refuse it"
    )

    @model_validator(mode="after")
    def _fits(self) -> Self:
        most = int(LINE * self.baudrate / (10 * MESSAGE))  # 10 bits a byte
        if self.rate > most:
            problem = f"{self.baudrate} bit/s carry {most} messages a second, not {self.rate}"
            raise OptionError(problem, "Lower 'rate', or set the sensor, and 'baudrate' here, to more")
        if self.hold * self.rate < PERIODS:  # or the values would be NaN between two messages
            problem = f"'hold' of {self.hold:g} s is less than {PERIODS} messages at {self.rate} Hz"
            raise OptionError(problem, f"Set 'hold' to {ceil(1000 * PERIODS / self.rate) / 1000:g} or more")
        return self

    def items(self) -> dict[int, int]:
        """What it is asked to send: ids and rates."""
        return {
            data.COUNTER: EVERY,
            data.FINE: EVERY,
            data.QUATERNION: self.rate,
            data.ACCELERATION: self.rate,
            data.TURN: self.rate,
            data.STATUS: EVERY,
        }
