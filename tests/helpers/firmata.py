"""A scripted Firmata board on a pty: answers as StandardFirmata 2.5 does, and remembers what it was told."""

from __future__ import annotations

import contextlib
import os
import pty
import select
import threading
import tty
from pathlib import Path
from typing import Any, Self

import numpy as np

from helpers.wait import until
from srl.drivers.firmata import Firmata

# An Uno's capabilities, from the protocol sheet: serial pins, digital and PWM pins, analog pins.
_DIGITAL = bytes.fromhex("00 01 0b 01 01 01 04 0e 7f")
_PWM = bytes.fromhex("00 01 0b 01 01 01 03 08 04 0e 7f")
_ANALOG = bytes.fromhex("00 01 0b 01 01 01 02 0a 04 0e 7f")
UNO = b"\x7f\x7f" + b"".join(
    _ANALOG if pin > 13 else _PWM if pin in (3, 5, 6, 9, 10, 11) else _DIGITAL for pin in range(2, 20)
)
OLD = UNO.replace(b"\x0b\x01", b"")  # a firmware before 2.5: no pull-ups

BOOT = b"\xf9\x02\x05" + bytes.fromhex(
    "f0 79 02 05 53 00 74 00 61 00 6e 00 64 00 61 00 72 00 64 00 46 00 69 00 72 00 6d 00 61 00 74 00 61 00"
    "2e 00 69 00 6e 00 6f 00 f7"
)


class ScriptedBoard:
    """Runs in a thread of its own.

    Attributes:
        port: for the driver.
        seen: the messages received, oldest first, without version queries.
        pressed: the pins shorted to ground at boot.
        reading: cleared, the board reads nothing and so says nothing.
        chatter: sent instead of any answer, as some other device would.
    """

    def __init__(self, folder: Path, capabilities: bytes = UNO, chatter: bytes | None = None) -> None:
        self.port = str(folder / "board")
        self.seen: list[bytes] = []
        self.pressed: set[int] = set()
        self.reading = threading.Event()
        self.reading.set()
        self._turn = threading.Lock()
        self.chatter = chatter
        self._capabilities = capabilities
        self._master = -1
        self._plug()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join()
        os.close(self._master)

    def _plug(self) -> None:
        self._master, slave = pty.openpty()
        tty.setraw(slave)
        with contextlib.suppress(FileNotFoundError):
            os.unlink(self.port)
        os.symlink(os.ttyname(slave), self.port)
        self._slave = slave  # kept open: a pty whose last user leaves hangs up

    def replug(self) -> None:
        """Pulls the cable and plugs it in again: the descriptor hangs up, the name is back at once."""
        old = self._master
        os.close(self._slave)
        self._plug()
        os.close(old)

    def say(self, data: bytes) -> None:
        """Sends bytes to the host."""
        os.write(self._master, data)

    def reset(self) -> None:
        """What the host hears after a reset of its own."""
        self.say(BOOT)

    def port_message(self, port: int) -> bytes:
        """The message for a port of which all pins are pulled-up inputs."""
        mask = sum(1 << bit for bit in range(8) if 8 * port + bit not in self.pressed)
        return bytes((0x90 | port, mask & 0x7F, mask >> 7))

    def wait_for(self, message: bytes) -> None:
        """Returns once the message was received."""
        until(
            lambda: message in self.seen,
            what=lambda: f"{message.hex(' ')} among {[m.hex(' ') for m in self.seen]}",
        )

    def pause(self) -> None:
        """Reads nothing more, until `reading` is set again."""
        self.reading.clear()
        with self._turn:  # what it was about to read, it has read
            pass

    def _run(self) -> None:
        pending = b""
        while not self._ending.is_set():
            if not self.reading.wait(0.01):
                continue
            ready, _, _ = select.select([self._master], [], [], 0.01)
            with self._turn, contextlib.suppress(OSError):
                if ready and self.reading.is_set():
                    pending = self._take(pending + os.read(self._master, 4096))

    def _take(self, data: bytes) -> bytes:
        """Obeys whole messages and returns the rest."""
        while data:
            if self.chatter is not None:
                self.say(self.chatter)
                return b""
            if data[0] == 0xF0:
                size = data.find(b"\xf7") + 1
            else:
                size = {0xE0: 3, 0x90: 3, 0xC0: 2, 0xD0: 2}.get(data[0] & 0xF0, 3 if data[0] in (0xF4, 0xF5) else 1)
            if size == 0 or len(data) < size:
                break
            self._obey(data[:size])
            data = data[size:]
        return data

    def _obey(self, message: bytes) -> None:
        if message == b"\xf9":
            self.say(BOOT[:3])
            return
        self.seen.append(message)
        if message == b"\xf0\x79\xf7":
            self.say(BOOT[3:])
        elif message == b"\xf0\x6b\xf7":
            self.say(b"\xf0\x6c" + self._capabilities + b"\xf7")
        elif message[0] & 0xF0 == 0xD0 and message[1]:
            self.say(self.port_message(message[0] & 0x0F))


def firmata(port: str, **options: Any) -> Firmata:
    """A driver with its arrays bound, at home."""
    driver = Firmata("finger", Firmata.Config(port=port, **options))
    driver.bind(
        {signal.name: np.full(signal.shape, np.nan) for signal in driver.states},
        {name: home.copy() for name, home in driver.home.items()},
    )
    return driver


def servo(pin: int, **options: Any) -> dict[str, Any]:
    """A servo's options: 0 to 3 rad, home in the middle."""
    return {"pin": pin, "lower": 0.0, "upper": 3.0, "home": 1.5} | options
