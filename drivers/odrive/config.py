"""Options of ODrives in the profile."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final, Literal, Self

from pydantic import Field, field_validator, model_validator

from srl.drivers.can_axes.config import CanAxesConfig, CanAxis, Finite, Positive
from srl.drivers.odrive.protocol import Firmware
from srl.runtime.contracts.checksummed import opened
from srl.runtime.contracts.files import FileOption, KeptFile

PATHS: Final = {
    "axis0.config.watchdog_timeout": "float",
    "axis0.config.enable_watchdog": "bool",
    "axis0.config.motor.torque_constant": "float",
}
_WHERE: Final = "Get flat_endpoints.json of exactly your firmware and hardware version from the maker"


@dataclass(frozen=True)
class Endpoints:
    """The numbers of the parameters that the driver writes or compares, for one firmware on one hardware."""

    firmware: str
    hardware: str
    timeout: int
    enable: int
    torque_constant: int


class OdriveAxis(CanAxis):
    """One axis and its ODrive."""

    node: int = Field(ge=0, le=62, description="node id")
    serial: str | None = Field(None, description="twelve hexadecimal digits; another ODrive is refused (firmware 0.6)")
    gear: Positive = Field(1.0, description="turns of the motor for one turn of the axis")
    encoder: Literal["motor", "axis"] = Field(
        "motor",
        description="what the ODrive takes its position from: 'motor' counts from 0 where it is switched on, 'axis' is "
        "absolute within a turn of the axis",
    )
    parked: Finite | None = Field(
        None, description="rad, with `encoder: motor`: where the axis stands when the ODrive is switched on"
    )
    zero: Finite | None = Field(
        None, description="rad, with `encoder: axis`: the encoder's angle where the axis is at 0"
    )
    current: Positive = Field(description="A, most current of the motor; the ODrive is given it as its limit")
    torque_constant: Positive = Field(description="N m/A of the motor, as in the ODrive's own configuration")
    damping: Positive | None = Field(
        None, description="N m s/rad of the axis, with `mode: torque`: how the ODrive itself damps when the host dies"
    )

    @field_validator("serial")
    @classmethod
    def _hexadecimal(cls, value: str | None) -> str | None:
        if value is not None and (len(value) != 12 or set(value.upper()) - set("0123456789ABCDEF")):
            raise ValueError("must be twelve hexadecimal digits in quotes, as the maker's tools show it")
        return value.upper() if value is not None else None

    @model_validator(mode="after")
    def _knows_where(self) -> Self:
        if self.encoder == "motor":
            if self.parked is None:
                raise ValueError("`encoder: motor` needs 'parked': the axis' angle (rad) where it is switched on")
            if self.zero is not None:
                raise ValueError("'zero' is for `encoder: axis`; with `encoder: motor` give 'parked'")
        else:
            if self.parked is not None:
                raise ValueError("'parked' is for `encoder: motor`; with `encoder: axis` give 'zero'")
            if self.lower is None or self.upper is None or self.upper - self.lower >= 6.28:
                raise ValueError(
                    "`encoder: axis` needs 'lower' and 'upper', less than a turn apart: the encoder can't tell turns"
                )
        return self

    @property
    def number(self) -> int:
        return self.node

    @property
    def most_torque(self) -> float:
        return self.current * self.torque_constant * self.gear

    @property
    def place(self) -> float | None:
        return self.parked

    @property
    def ratio(self) -> float:
        """Turns of the encoder for one turn of the axis."""
        return self.gear if self.encoder == "motor" else 1.0


class OdriveConfig(CanAxesConfig):
    """ODrives on one CAN bus."""

    bitrate: float = Field(
        250_000, gt=0, description="bit/s of the bus, for what it can carry; it isn't set. 250000 as delivered"
    )
    firmware: Firmware = Field(description="of all ODrives: 0.5 (v3.x boards) or 0.6 (S1, Pro, Micro)")
    watchdog: float = Field(
        0.5, ge=0.05, le=5.0, description="s without a frame after which an ODrive lets its axis go (coast)"
    )
    endpoints: Annotated[KeptFile, FileOption(_WHERE)] | None = Field(
        None, description="flat_endpoints.json of the maker, for firmware 0.6: the watchdog is armed with it"
    )
    watchdog_set: bool = Field(
        False, description="firmware 0.5: you have set the watchdog with odrivetool, as nothing on CAN can"
    )
    axes: dict[str, OdriveAxis] = Field(min_length=1, description="axes by name")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        self.check_axes()
        if self.firmware == "0.5":
            if self.endpoints is not None:
                raise ValueError("'endpoints' is for firmware 0.6")
            if named := next((name for name, axis in self.axes.items() if axis.serial), None):
                raise ValueError(f"{named}: firmware 0.5 doesn't tell its serial number on CAN; leave 'serial' out")
            if not self.watchdog_set:
                raise ValueError(
                    f"firmware 0.5 has a watchdog that nothing on CAN can arm. With odrivetool set axisN.config."
                    f"watchdog_timeout = {self.watchdog:g} and axisN.config.enable_watchdog = True on each axis, "
                    "save, and say 'watchdog_set: true'"
                )
        else:
            if self.watchdog_set:
                raise ValueError("'watchdog_set' is for firmware 0.5; with 0.6 the driver arms the watchdog itself")
            if self.endpoints is None:
                raise ValueError(f"firmware 0.6 needs 'endpoints', to arm the watchdog. {_WHERE}")
            self.numbers()
        if self.mode == "torque":
            missing = next((name for name, axis in self.axes.items() if axis.damping is None), None)
            if missing is not None:
                raise ValueError(f"{missing}: `mode: torque` needs 'damping' (N m s/rad), for when the host dies")
        return self

    @property
    def all_axes(self) -> dict[str, OdriveAxis]:
        return self.axes

    def numbers(self) -> Endpoints | None:
        """The endpoints' numbers; None without a file. Raises ValueError for a file that hasn't them."""
        if self.endpoints is None:
            return None
        try:
            data = opened(self.endpoints.text)
            found = {path: data["endpoints"][path] for path in PATHS}
            ids = {path: entry["id"] for path, entry in found.items()}
            if not all(type(id) is int for id in ids.values()):
                raise ValueError("an id is no whole number")
            firmware, hardware = str(data["fw_version"]).partition("-")[0], str(data["hw_version"])
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            raise ValueError(
                f"{self.endpoints.path.name} isn't a flat_endpoints.json with {', '.join(PATHS)} ({error}). {_WHERE}"
            ) from None
        for path, kind in PATHS.items():
            if found[path].get("type") != kind or not 0 <= ids[path] < 1 << 16:
                raise ValueError(f"{self.endpoints.path.name}: {path} isn't a {kind} with a number. {_WHERE}")
        return Endpoints(firmware, hardware, *(ids[path] for path in PATHS))
