"""An arm's options in the profile, and the addresses of its controller's three ports."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar, Final, Literal, NamedTuple, Self
from urllib.parse import parse_qsl, urlsplit

from pydantic import Field, field_validator, model_validator

from srl.runtime.contracts.driver import DeviceConfig
from srl.runtime.contracts.per_element import Finite, PerElement
from srl.runtime.contracts.terms import POINT

RTDE: Final = 30004
DASHBOARD: Final = 29999
SCRIPT: Final = 30002  # secondary interface, accepts programs; of the three interfaces, it and 30001 send the least


class Address(NamedTuple):
    """A controller's host and ports; `spy` is the log file for RTDE's bytes, "" for none."""

    host: str
    rtde: int
    dashboard: int
    script: int
    spy: str = ""

    @property
    def url(self) -> str:
        """The URL of the RTDE link."""
        plain = f"tcp://{self.host}:{self.rtde}"
        return f"spy:{self.spy}:{plain}" if self.spy else plain


def address(port: str) -> Address:
    """Parses `tcp://HOST`, `tcp://HOST:RTDE`, with `?dashboard=PORT&script=PORT`, with `spy:FILE:` in front.

    Raises:
        ValueError: the text has none of these forms.
    """
    spy = ""
    if port.startswith("spy:"):
        spy, _, inner = port.removeprefix("spy:").partition(":")
    else:
        inner = port
    wrong = f"'{port}' isn't tcp://HOST, tcp://HOST:PORT or tcp://HOST:PORT?dashboard=PORT&script=PORT"
    try:
        parts = urlsplit(inner)
        host, rtde = parts.hostname, parts.port
        others = {key: int(value) for key, value in parse_qsl(parts.query, strict_parsing=bool(parts.query))}
    except ValueError:
        raise ValueError(wrong) from None
    if parts.scheme != "tcp" or not host or parts.path or others.keys() - {"dashboard", "script"}:
        raise ValueError(wrong)
    if not all(0 < number < 65536 for number in others.values()):
        raise ValueError(wrong)
    return Address(host, rtde or RTDE, others.get("dashboard", DASHBOARD), others.get("script", SCRIPT), spy)


class UrConfig(DeviceConfig):
    """Options of an arm."""

    gone: ClassVar[Mapping[str, str]] = {"frame": "the frame of an arm's base has the device's name"}

    port: str = Field(description="tcp://HOST of the controller; tcp://HOST:RTDE?dashboard=PORT&script=PORT if moved")
    model: Literal["UR3e", "UR5e", "UR10e", "UR16e"] = "UR16e"
    serial: str | None = Field(None, description="the controller's serial number, to refuse any other arm")
    interface: Literal["velocity", "position", "none"] = Field(
        "velocity", description="what the joints are commanded in; none: the arm is only read, and no program is sent"
    )
    power_on: bool = Field(False, description="switch the arm on and release its brakes when it is opened")
    timeout: float = Field(0.05, ge=0.006, le=0.5, description="s without a command after which the arm stops itself")
    acceleration: float = Field(10.0, gt=0, le=40, description="rad/s^2, of the joint that changes most; velocity only")
    deceleration: float = Field(5.0, gt=0, le=40, description="rad/s^2, of the controller's own stop")
    lookahead: float = Field(0.1, ge=0.03, le=0.2, description="s, smooths position commands")
    gain: float = Field(300.0, ge=100, le=2000, description="stiffness of following position commands")
    effort: Literal["target", "measured"] = Field(
        "target", description="torque by the controller's model, or from motor currents (PolyScope 5.23 on)"
    )
    payload: float | None = Field(None, ge=0, le=30, description="kg at the flange; None: as set at the pendant")
    payload_cog: Annotated[tuple[Finite, Finite, Finite], PerElement(POINT)] = Field(
        (0.0, 0.0, 0.0), description="m, its centre in the flange's frame"
    )
    tcp: Annotated[tuple[Finite, ...], PerElement(("x", "y", "z", "rx", "ry", "rz"))] | None = Field(
        None,
        description="m and rotation vector (rad): the tool's centre in the flange's frame; None: as at the pendant",
    )
    buttons: dict[str, int] = Field({}, description="name: number of the digital input (0 to 17)")

    @field_validator("port")
    @classmethod
    def _is_address(cls, port: str) -> str:
        address(port)
        return port

    @field_validator("buttons")
    @classmethod
    def _are_inputs(cls, buttons: dict[str, int]) -> dict[str, int]:
        for name, number in buttons.items():
            if not 0 <= number <= 17:
                raise ValueError(f"{name}: a digital input is 0 to 7, configurable 8 to 15, tool 16 or 17")
        return buttons

    @model_validator(mode="after")
    def _cog_has_mass(self) -> Self:
        if self.payload is None and any(self.payload_cog):
            raise ValueError("payload_cog without payload")
        if any(abs(x) > 1 for x in self.payload_cog):
            raise ValueError("payload_cog is in m, at most 1 either way")
        if self.tcp is not None and any(abs(x) > 2 for x in self.tcp[:3]):
            raise ValueError("tcp is in m, at most 2 either way")
        return self
