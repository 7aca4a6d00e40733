"""The scale from counts to N and N m, from the sensor's page or its TCP port (sheet ati_ft, 1.3, 1.4). No I/O."""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final
from xml.etree import ElementTree

TCP_PORT: Final = 49151
HTTP_PORT: Final = 80
PAGE: Final = "/netftapi2.xml"
LONGEST: Final = 65536  # bytes of the page

_POUND: Final = 4.4482216152605  # N
_INCH: Final = 0.0254  # m
_KILOPOND: Final = 9.80665  # N
FORCE_UNITS: Final = {  # N
    "lbf": _POUND, "n": 1.0, "klbf": 1000 * _POUND, "kn": 1000.0, "kgf": _KILOPOND, "gf": _KILOPOND / 1000,
}  # fmt: skip
TORQUE_UNITS: Final = {  # N m, spelt without separators
    "lbfin": _POUND * _INCH, "lbin": _POUND * _INCH, "inlb": _POUND * _INCH, "inlbf": _POUND * _INCH,
    "lbfft": _POUND * 12 * _INCH, "lbft": _POUND * 12 * _INCH, "ftlb": _POUND * 12 * _INCH,
    "ftlbf": _POUND * 12 * _INCH, "nm": 1.0, "nmm": 0.001, "knm": 1000.0,
    "kgcm": _KILOPOND / 100, "kgfcm": _KILOPOND / 100,
}  # fmt: skip
_FORCE_CODES: Final = {1: "lbf", 2: "N", 3: "klbf", 4: "kN", 5: "kgf", 6: "gf"}
_TORQUE_CODES: Final = {1: "lbf-in", 2: "lbf-ft", 3: "Nm", 4: "Nmm", 5: "kgf-cm", 6: "kNm"}

READ_CALIBRATION: Final = b"\x01" + bytes(19)
_CALIBRATION: Final = struct.Struct(">HBBII6H")
CALIBRATION_SIZE: Final = _CALIBRATION.size


@dataclass(frozen=True)
class Settings:
    """The active configuration.

    Attributes:
        product: the product's name; "" if the sensor doesn't report it.
        force: N per count. torque: N m per count.
        range: (6,) N and N m, the ratings; empty if unknown.
        sample_rate: Hz of the sensor's own sample counter; None if unknown.
        record_rate: Hz of records; None if unknown.
        transform: its tool transform, three ways and three turns in the units that are set there; () if unknown.
    """

    product: str
    force: float
    torque: float
    range: tuple[float, ...] = ()
    sample_rate: float | None = None
    record_rate: float | None = None
    transform: tuple[float, ...] = ()


def scale(counts: float, unit: str, known: dict[str, float], what: str) -> float:
    """Returns SI units per count.

    Raises:
        ValueError: the unit is unknown, or the counts are impossible; the message says which.
    """
    key = _key(unit)
    if key not in known:
        raise ValueError(f"its {what} unit '{unit}' isn't known")
    if not (math.isfinite(counts) and counts > 0 and math.isfinite(known[key] / counts)):
        raise ValueError(f"its counts per {what} are {counts:g}")
    return known[key] / counts


def parse_page(page: bytes) -> Settings:
    """Parses the sensor's page netftapi2.xml. Only counts and units are always there.

    Raises:
        ValueError: it isn't such a page, or lacks one of these; the message says which.
    """
    if len(page) > LONGEST or b"<!DOCTYPE" in page or b"<!ENTITY" in page:
        raise ValueError("the page isn't a Net F/T's")  # and its entities could expand without bound
    try:
        root = ElementTree.fromstring(page)
    except (ElementTree.ParseError, ValueError, LookupError):
        raise ValueError("the page isn't XML") from None
    if root.tag != "netft":
        raise ValueError(f"the page's root is <{root.tag}>, expected <netft>")
    texts = {child.tag: (child.text or "").strip() for child in root}
    for tag in ("cfgcpf", "cfgcpt", "scfgfu", "scfgtu"):
        if not texts.get(tag):
            raise ValueError(f"the page has no <{tag}>")
    force_unit, torque_unit = texts["scfgfu"], texts["scfgtu"]
    force = scale(_number(texts["cfgcpf"]), force_unit, FORCE_UNITS, "force")
    torque = scale(_number(texts["cfgcpt"]), torque_unit, TORQUE_UNITS, "torque")
    ratings = [_number(item) for item in texts.get("cfgmr", "").split(";") if item.strip()]
    si = [FORCE_UNITS[_key(force_unit)]] * 3 + [TORQUE_UNITS[_key(torque_unit)]] * 3
    known = len(ratings) == 6 and all(math.isfinite(r) and r > 0 for r in ratings)
    return Settings(
        product=texts.get("prodname", ""),
        force=force,
        torque=torque,
        range=tuple(r * unit for r, unit in zip(ratings, si, strict=True)) if known else (),
        sample_rate=_rate(texts.get("runrate")),
        record_rate=_rate(texts.get("comrdtrate")),
        transform=tuple(_number(item) for item in re.split("[;,]", texts.get("cfgtfx", "")) if item.strip()),
    )


def parse_calibration(answer: bytes) -> Settings:
    """Parses the 24-byte answer to READ_CALIBRATION; counts are those of RDT, without the TCP records' scale.

    Raises:
        ValueError: it isn't such an answer; the message says why.
    """
    if len(answer) != CALIBRATION_SIZE:
        raise ValueError(f"its answer has {len(answer)} bytes, expected {CALIBRATION_SIZE}")
    head, force_code, torque_code, per_force, per_torque, *_ = _CALIBRATION.unpack(answer)
    if head != 0x1234:
        raise ValueError(f"its answer begins with {head:04x}, expected 1234")
    force = scale(per_force, _FORCE_CODES.get(force_code, f"code {force_code}"), FORCE_UNITS, "force")
    torque = scale(per_torque, _TORQUE_CODES.get(torque_code, f"code {torque_code}"), TORQUE_UNITS, "torque")
    return Settings(product="", force=force, torque=torque)


def calibration(per_force: int, per_torque: int, factors: Sequence[int]) -> bytes:
    """Returns the answer to READ_CALIBRATION of a sensor set to N and N m.

    Args:
        per_force, per_torque: counts per N and N m.
        factors: the six scale factors of the TCP records.
    """
    return _CALIBRATION.pack(0x1234, 2, 3, per_force, per_torque, *factors)


def _key(unit: str) -> str:
    return re.sub(r"[^a-z]", "", unit.lower())


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _rate(text: str | None) -> float | None:
    value = _number(text or "")
    return value if math.isfinite(value) and value > 0 else None
