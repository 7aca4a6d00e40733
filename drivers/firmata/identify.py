"""Identifies the device at a port, and brings a Firmata board into its state after power-up."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from srl.drivers.firmata import protocol
from srl.drivers.firmata.protocol import Decoder, Message, Mode, Version
from srl.drivers.timeout import remaining
from srl.drivers.transport import Transport, open_transport
from srl.runtime.contracts.errors import DeviceError

BOOT = 5.0  # s, from opening the port (which resets most boards) to the first message
LAST_CALL = 1.5  # s, for the answer after a reset by message
ANSWER = 2.0  # s, for the capabilities

FLASH = "Flash 'StandardFirmata' 2.5 or later (Arduino IDE: File > Examples > Firmata)"


@dataclass(frozen=True)
class Board:
    """An identified board."""

    firmware: str
    pins: tuple[dict[int, int], ...]  # modes by pin, as in `Capabilities`


def identify(link: Transport, decoder: Decoder, place: str) -> Board:
    """Waits for the board's boot, resets its pins (servos detached, reports off) and identifies it.

    Blocks up to 8.5 s.

    Raises:
        DeviceError: no answer, another device, or a firmware that lacks the capability query.
    """
    link.flush_input()
    heard = bytearray()
    # A board that doesn't reset at opening answers this at once; a board that boots answers later or not at all.
    link.write_all(protocol.END_SYSEX + protocol.VERSION_QUERY, 1.0)
    version = _version(listen(link, decoder, BOOT, heard))
    if version is None:
        link.write_all(protocol.END_SYSEX + protocol.RESET + protocol.VERSION_QUERY, 1.0)
        version = _version(listen(link, decoder, LAST_CALL, heard))
    if version is None:
        raise _unknown(link.url, bytes(heard), place)
    if version.major != 2:
        raise DeviceError(place, f"{link.url} speaks Firmata {version.major}.{version.minor}, this driver 2.x", FLASH)
    # This ends all settings of an earlier run or another program. The answers come in order, so when the
    # capabilities arrive, no boot message is still on its way.
    link.write_all(protocol.RESET + protocol.FIRMWARE_QUERY + protocol.CAPABILITY_QUERY, 1.0)
    name = "an unnamed firmware"
    for message in listen(link, decoder, ANSWER):
        if isinstance(message, protocol.Firmware):
            name = f"'{message.name}' {message.major}.{message.minor}"
        elif isinstance(message, protocol.Capabilities):
            return Board(name, message.pins)
    raise DeviceError(place, f"{name} at {link.url} doesn't say what its pins can do", FLASH)


def who(port: str) -> str:
    """See `Driver.who_is_at`: the firmware's name and version. Pins stay as they are."""
    link = open_transport(port, place=port, baudrate=protocol.BAUDRATE)
    try:
        link.flush_input()
        link.write_all(protocol.END_SYSEX + protocol.FIRMWARE_QUERY, 1.0)
        heard = bytearray()
        for message in listen(link, Decoder(), BOOT, heard):
            if isinstance(message, protocol.Firmware):
                return f"the firmware '{message.name}' {message.major}.{message.minor}"
        raise _unknown(link.url, bytes(heard), port)
    finally:
        link.close()


_CAN = {
    Mode.SERVO: "drive a servo", Mode.PULL_UP: "pull up an input", Mode.INPUT: "be an input",
    Mode.ANALOG: "read a voltage", Mode.PWM: "drive a motor",
}  # fmt: skip


def require(board: Board, pin: int, mode: Mode, part: str, place: str) -> None:
    """Raises DeviceError unless the board offers the mode on the pin."""
    if pin < len(board.pins) and mode in board.pins[pin]:
        return
    able = [str(i) for i, modes in enumerate(board.pins) if mode in modes]
    what = _CAN[mode]
    problem = f"pin {pin} ({part}) can't {what} with {board.firmware}"
    if able:
        raise DeviceError(place, problem, f"Pins that can: {', '.join(able)}")
    if mode is Mode.PULL_UP:
        raise DeviceError(
            place,
            f"{problem}: it has no pull-ups",
            f"{FLASH}, or wire a resistor to 5 V and set 'pull_up: false'",
        )
    raise DeviceError(place, problem, FLASH)


def listen(link: Transport, decoder: Decoder, seconds: float, heard: bytearray | None = None) -> Iterator[Message]:
    """Yields the messages of the next `seconds`, as they come; `heard` collects the raw bytes. Blocks."""
    for left in remaining(seconds):
        data = link.read_wait(left)
        if heard is not None:
            heard += data
        yield from decoder.feed(data)


def _version(messages: Iterator[Message]) -> Version | None:
    return next((message for message in messages if isinstance(message, Version)), None)


def _unknown(url: str, heard: bytes, place: str) -> DeviceError:
    if heard:
        bytes_text = heard[:16].hex(" ")
        return DeviceError(
            place,
            f"what answers at {url} with {protocol.BAUDRATE} baud isn't a Firmata board: it said {bytes_text}",
            f"Check that 'port' names the board, not another device. If it does: {FLASH}",
        )
    return DeviceError(
        place,
        f"nothing at {url} answered Firmata's version query within {BOOT + LAST_CALL:g} s",
        f"Check that 'port' names the board, and its cable. If they are right: {FLASH}",
    )
