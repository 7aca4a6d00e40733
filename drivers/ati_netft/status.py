"""The status bits of a record, in words (sheet ati_ft, 1.5). The two families' tables contradict each other."""

from __future__ import annotations

from typing import Final

LATCHED: Final = 1 << 16  # a monitor condition (threshold) was met; in both families
_SUMMARY: Final = 1 << 31

NET_BOX: Final = {
    30: "CPU or RAM error",
    29: "digital board error",
    28: "analog board error",
    27: "serial link error",
    26: "program memory error",
    25: "halted by configuration errors",
    24: "settings aren't valid",
    23: "configuration doesn't fit the calibration",
    22: "network failure",
    21: "CAN failure",
    20: "RDT failure",
    19: "EtherNet/IP failure",
    18: "DeviceNet failure",
    17: "transducer saturated or A/D error",
    14: "watchdog error",
    13: "stack error",
    12: "EEPROM error",
    11: "flash error",
    10: "analog watchdog error",
    9: "excitation too high",
    8: "excitation too low",
    7: "artificial ground out of range",
    6: "supply too high",
    5: "supply too low",
    4: "no data from the transducer's link",
    3: "reference voltage error",
    2: "internal temperature out of range",
    1: "HTTP failure",
}
AXIA: Final = {
    30: "force or torque out of range",
    29: "calibration checksum error",
    27: "gage out of range",
    7: "calibration isn't accessible",
    5: "sensor error",
    2: "broken gage",
    1: "supply outside 12 to 32 V",
    0: "temperature outside -5 to 70 degrees Celsius",
}
SATURATED: Final = {"net-box": 1 << 17, "axia": 1 << 30 | 1 << 27}
_HARMLESS: Final = {"net-box": LATCHED, "axia": LATCHED | 1 << 3 | 1 << 28}  # latch; busy; the test bit


def family(product: str) -> str:
    """Returns "axia" or "net-box", from the product's name."""
    return "axia" if "axia" in product.lower() else "net-box"


def errors(status: int, kind: str) -> tuple[str, ...]:
    """Returns why the record is unusable, in words; empty for a good record.

    The summary bit alone means that something is wrong. Next to harmless bits only, it belongs to them.

    Args:
        status: the record's word.
        kind: see `family`.
    """
    serious = status & ~_HARMLESS[kind]
    if serious == 0 or (serious == _SUMMARY and status & _HARMLESS[kind]):
        return ()
    table = AXIA if kind == "axia" else NET_BOX
    words = tuple(table.get(bit, f"status bit {bit}") for bit in range(30, -1, -1) if serious >> bit & 1)
    return words or ("an error it doesn't name",)
