"""The pages and the TCP commands of a simulated Net F/T (sheet ati_ft, 1.3, 1.4). No I/O."""

from __future__ import annotations

import struct
from typing import Final, Protocol
from urllib.parse import parse_qsl, urlsplit
from xml.etree.ElementTree import Element, SubElement, tostring

from srl.drivers.ati_netft import settings
from srl.runtime.contracts.signals import Array

COMMAND: Final = 20  # bytes of each TCP request
_LONGEST: Final = 8192  # bytes of a request's header
_READ_FT: Final = struct.Struct(">HH6h")


class Sensor(Protocol):
    """What the pages show and set."""

    product: str
    counts: int
    sample_rate: float
    record_rate: float
    transform: tuple[float, ...]
    buffered: int
    range: Array

    def status(self) -> int: ...

    def counts_now(self) -> list[int]: ...

    def bias(self) -> None: ...

    def reset_latch(self) -> None: ...


def page(sensor: Sensor) -> bytes:
    """Returns the page netftapi2.xml."""
    root = Element("netft")
    entries: dict[str, object] = {
        "prodname": sensor.product,
        "runstat": f"{sensor.status():08x}",
        "runft": ";".join(str(count) for count in sensor.counts_now()),
        "runrate": f"{sensor.sample_rate:g}",
        "cfgcpf": sensor.counts,
        "cfgcpt": sensor.counts,
        "scfgfu": "N",
        "scfgtu": "Nm",
        "cfgmr": ";".join(f"{value:g}" for value in sensor.range),
        "cfgtfx": ";".join(f"{value:g}" for value in sensor.transform),
        "setcfgsel": 0,
        "comrdte": "Enabled",
        "comrdtrate": f"{sensor.record_rate:g}",
        "comrdtbsiz": sensor.buffered,
    }
    for tag, value in entries.items():
        SubElement(root, tag).text = str(value)
    return tostring(root)


class Pages:
    """One HTTP connection: one GET request, its answer, then the end of the connection."""

    def __init__(self, sensor: Sensor) -> None:
        self._sensor = sensor
        self._head = b""

    def feed(self, data: bytes) -> bytes | None:
        """Returns the answer, after which the connection ends; None until the request is complete."""
        self._head += data[:_LONGEST]
        if b"\r\n\r\n" not in self._head and b"\n\n" not in self._head:
            return _answer("400 Bad Request") if len(self._head) >= _LONGEST else None
        words = self._head.split(b"\n", 1)[0].decode("latin-1").split()
        if len(words) < 2 or words[0] != "GET":
            return _answer("501 Not Implemented")
        try:
            target = urlsplit(words[1])
        except ValueError:
            return _answer("400 Bad Request")
        if target.path == settings.PAGE:
            return _answer("200 OK", page(self._sensor), "text/xml")
        if target.path == "/comm.cgi":
            return _answer("200 OK" if self._communicate(dict(parse_qsl(target.query))) else "400 Bad Request")
        if target.path in ("/setting.cgi", "/config.cgi", "/moncon.cgi"):
            return _answer("200 OK")
        return _answer("404 Not Found")

    def _communicate(self, values: dict[str, str]) -> bool:
        for key, low, high in (("comrdtrate", 1, 7000), ("comrdtbsiz", 1, 40)):
            text = values.get(key)
            if text is None:
                continue
            if not text.isdecimal() or len(text) > 5 or not low <= int(text) <= high:
                return False
            if key == "comrdtrate":
                self._sensor.record_rate = min(float(text), self._sensor.sample_rate)
            else:
                self._sensor.buffered = int(text)
        return True


class Commands:
    """One TCP connection with requests of 20 bytes; counts `unknown` requests."""

    def __init__(self, sensor: Sensor) -> None:
        self.unknown = 0
        self._sensor = sensor
        self._rest = b""

    def feed(self, data: bytes) -> bytes:
        """Returns the answers to the requests that `data` completes."""
        data = self._rest + data
        answers = [self._obey(data[at : at + COMMAND]) for at in range(0, len(data) - COMMAND + 1, COMMAND)]
        self._rest = data[len(answers) * COMMAND :]
        return b"".join(answers)

    def _obey(self, request: bytes) -> bytes:
        factors = self.factors()
        if request[0] == 0:
            if request[19] & 1:
                self._sensor.bias()
            if request[19] & 2:
                self._sensor.reset_latch()
            values = [
                max(-32768, min(32767, round(count / factor)))
                for count, factor in zip(self._sensor.counts_now(), factors, strict=True)
            ]
            return _READ_FT.pack(0x1234, self._sensor.status() >> 16, *values)
        if request[0] == 1:
            return settings.calibration(self._sensor.counts, self._sensor.counts, factors)
        self.unknown += 1
        return b""

    def factors(self) -> list[int]:
        """The scale factors with which the whole range fits into 16 bits."""
        return [max(1, -(-int(limit * self._sensor.counts) // 32767)) for limit in self._sensor.range]


def _answer(state: str, body: bytes = b"", kind: str = "text/html") -> bytes:
    head = f"HTTP/1.0 {state}\r\nContent-Type: {kind}\r\nContent-Length: {len(body)}\r\nConnection: close\r\n\r\n"
    return head.encode("ascii") + body
