"""Linux input devices (sheet gamepad_f310_and_ring, part A)."""

from srl.drivers.evdev.records import RECORD, AxisInfo, Description, Event, Parser, encode
from srl.drivers.evdev.source import EventSource, discover, open_source

__all__ = [
    "RECORD",
    "AxisInfo",
    "Description",
    "Event",
    "EventSource",
    "Parser",
    "discover",
    "encode",
    "open_source",
]
