"""Options of an ATI Net F/T or Ethernet Axia sensor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal
from urllib.parse import parse_qsl, urlsplit

from pydantic import Field

from srl.drivers.ati_netft.protocol import PORT
from srl.drivers.ati_netft.settings import HTTP_PORT, TCP_PORT
from srl.drivers.counts import CountsConfig
from srl.runtime.contracts.driver import DeviceConfig
from srl.runtime.contracts.errors import DeviceError


class AtiNetFtConfig(DeviceConfig):
    """Options in the profile."""

    port: str = Field(description="udp://HOST, udp://HOST:49152?http=80&tcp=49151")
    product: str | None = Field(None, description="refuse a sensor whose product name hasn't this in it")
    family: Literal["net-box", "axia"] | None = Field(None, description="status table; None: by the product's name")
    counts: CountsConfig | None = Field(None, description="None: as the sensor's own page or TCP port says")
    rate: int | None = Field(None, ge=1, le=7000, description="Hz of records, set over HTTP; None: as it is")
    sample_rate: float | None = Field(
        None, gt=0, le=100_000, description="Hz of the sensor's sample counter; None: as its page says"
    )
    bias: bool = Field(False, description="zero at the present load when it is first opened")
    reset_latch: bool = Field(False, description="reset the latch of the monitor conditions at opening")
    frame: str = Field("sensor", description="frame of the wrench")
    transformed: bool = Field(
        False, description="the tool transform that is set in the sensor is meant: `frame` is there"
    )


@dataclass(frozen=True)
class Address:
    """The sensor's addresses."""

    host: str
    rdt: int
    http: int
    tcp: int

    @property
    def url(self) -> str:
        """The URL of the datagrams."""
        return f"udp://{self.host}:{self.rdt}"


def address(url: str, place: str) -> Address:
    """Parses the `port` option.

    Raises:
        DeviceError: it isn't udp://HOST[:PORT][?http=PORT&tcp=PORT].
    """
    try:
        parts = urlsplit(url)
        host, port = parts.hostname or "", parts.port or PORT
        extra = {key: int(value) for key, value in parse_qsl(parts.query, strict_parsing=bool(parts.query))}
    except ValueError:
        parts, host, port, extra = urlsplit(""), "", PORT, {}
    right = parts.scheme == "udp" and host and not parts.path and extra.keys() <= {"http", "tcp"}
    if not right or not all(0 < number < 65536 for number in extra.values()):
        raise DeviceError(place, f"'{url}' isn't udp://HOST[:PORT][?http=PORT&tcp=PORT]", "E.g. udp://192.168.1.1")
    return Address(host, port, extra.get("http", HTTP_PORT), extra.get("tcp", TCP_PORT))
