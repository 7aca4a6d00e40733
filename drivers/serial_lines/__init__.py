"""Any sensor that sends numbers over a serial line: lines of text, or binary frames."""

from srl.drivers.serial_lines.config import SerialLinesConfig
from srl.drivers.serial_lines.driver import SerialLines

__all__ = ["SerialLines", "SerialLinesConfig"]
