"""Errors of ODrives in words, with what to do. Source: protocol sheet can_actuators, section 4."""

from __future__ import annotations

from typing import Final

from srl.drivers.odrive.protocol import STATES, Firmware

WATCHDOG: Final = {"0.5": 0x800, "0.6": 1 << 24}
_RECALIBRATE: Final = "calibrate motor and encoder with the maker's tool"
ERRORS: Final[dict[Firmware, dict[int, tuple[str, str]]]] = {
    "0.6": {
        0x1: ("is still starting", "wait"),
        0x2: ("has a system error", "update its firmware, ask the maker"),
        0x4: ("missed its timing", "update its firmware, ask the maker"),
        0x8: ("has no estimate of its position", "check the encoder's cable, " + _RECALIBRATE),
        0x10: ("has a configuration that can't work", "correct it with the maker's tool"),
        0x20: ("has a fault of its gate driver", "check the motor's wires for a short circuit"),
        0x40: ("got no valid input", "see that nothing else commands it"),
        0x100: ("had too high a supply voltage", "a falling limb feeds back: fit a brake resistor"),
        0x200: ("had too low a supply voltage", "check supply and battery"),
        0x400: ("drew too much current from the supply", "lower 'current'"),
        0x800: ("fed too much current back", "fit a brake resistor, or allow more regeneration"),
        0x1000: ("exceeded its motor current", "check motor and gains"),
        0x2000: ("has a motor that is too hot", "let it cool; the limb may be too heavy for it"),
        0x4000: ("is too hot", "let it cool"),
        0x8000: ("turned faster than its limit", "see what pushed it; 'velocity' sets the limit"),
        0x10000: ("left its position limits", "bring it back by hand"),
        0x20000: ("was asked for more current than it may give", "lower the effort limit"),
        0x1000000: ("heard nothing for the watchdog's time and coasted", "see why the commands stopped"),
        0x2000000: ("got an emergency stop", "see who sent it"),
        0x4000000: ("doesn't find the motor where its encoder says", "a magnet or coupling slips: " + _RECALIBRATE),
        0x8000000: ("has lost its brake resistor", "check its wires"),
        0x10000000: ("has lost its thermistor", "check its wires"),
        0x40000000: ("failed its calibration", _RECALIBRATE),
    },
    "0.5": {
        0x1: ("can't go to the state asked for", _RECALIBRATE),
        0x40: ("has a fault of its motor", "see the details"),
        0x80: ("has a fault of its sensorless estimator", "see the details"),
        0x100: ("has a fault of its encoder", "check the encoder's cable"),
        0x200: ("has a fault of its controller", "see the details"),
        0x800: ("heard nothing for the watchdog's time and coasted", "see why the commands stopped"),
        0x1000: ("touched its lower end switch", "bring it back by hand"),
        0x2000: ("touched its upper end switch", "bring it back by hand"),
        0x4000: ("got an emergency stop", "see who sent it"),
        0x20000: ("has no end switch to home with", "set one up"),
        0x40000: ("is too hot", "let it cool"),
        0x80000: ("doesn't know its position", _RECALIBRATE),
    },
}
MOTOR: Final = {
    0x1: "phase resistance out of range", 0x2: "phase inductance out of range", 0x8: "gate driver",
    0x10: "control deadline missed", 0x80: "modulation", 0x400: "current sensing saturated",
    0x1000: "current limit exceeded", 0x20000: "motor too hot", 0x40000: "power stage too hot",
    0x400000: "supply current out of range", 0x800000: "brake resistor",
}  # fmt: skip
ENCODER: Final = {
    0x1: "unstable gain", 0x2: "counts and pole pairs don't fit", 0x4: "no response", 0x8: "unsupported mode",
    0x10: "illegal hall state", 0x20: "index not found yet", 0x40: "SPI timeout", 0x80: "SPI error",
    0x100: "SPI not ready", 0x200: "hall sensors not calibrated",
}  # fmt: skip
CONTROLLER: Final = {
    0x1: "too fast", 0x2: "invalid input mode", 0x4: "unstable gain", 0x10: "invalid load encoder",
    0x20: "invalid estimate", 0x80: "encoder and motor disagree",
}  # fmt: skip


def in_words(error: int, firmware: Firmware) -> str:
    """What error bits mean and what to do, for behind the axis' name; "" for none."""
    table = ERRORS[firmware]
    found = [f"{text} ({remedy})" for bit, (text, remedy) in table.items() if error & bit]
    if rest := error & ~sum(table):
        found.append(f"has error {rest:#x}, which this firmware's list doesn't name")
    return ", ".join(found)


def named(error: int, table: dict[int, str], of: str) -> str:
    """Details of firmware 0.5; "" for none."""
    found = [text for bit, text in table.items() if error & bit]
    if rest := error & ~sum(table):
        found.append(f"{rest:#x}")
    return f"{of}: {', '.join(found)}" if found else ""


def state(number: int) -> str:
    """A state in words."""
    return STATES.get(number, f"state {number}")
