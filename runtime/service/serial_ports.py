"""The serial ports of this machine: what each probably is, whether this user may open it, and who holds it.

Nothing is opened and nothing is sent: opening a port restarts most Arduino boards, and servos then lose their pulses.
"""

from __future__ import annotations

import contextlib
import glob
import grp
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from srl.runtime.contracts import registry
from srl.runtime.contracts.errors import SrlError
from srl.runtime.profile.ports import local_path

BY_ID, BY_PATH = "/dev/serial/by-id", "/dev/serial/by-path"
LOCKS = Path("/proc/locks")  # of every process
_OWN = 5  # letters of a serial number, at least, that is a device's own: adapters of a kind may all be 0001


class Obstacle(NamedTuple):
    """Why a port can't be opened; `command` is what to type, where that mends it."""

    problem: str
    remedy: str
    command: str = ""


@dataclass(frozen=True)
class Guess:
    """A driver whose device may be at a port.

    Attributes:
        driver, summary: its name, and what it says of itself.
        exact: whether vendor and product are those that the driver names; else only the vendor is.
    """

    driver: str
    summary: str
    exact: bool


@dataclass(frozen=True)
class SerialPort:
    """A serial port.

    Attributes:
        device: its path, which another order of plugging in may change.
        by_id: the path that stays with the device; None where it has none. The link of an adapter without a serial
            number of its own is none: another one of its kind would get it.
        by_path: the path that stays with the USB socket; None where there is none.
        usb: vendor and product, "2341:0043"; None if it isn't on USB.
        maker, product, serial: what the device says of itself; None where it says nothing.
        guesses: what it may be, the likeliest first; none if it is unknown.
        obstacle: why this user can't open it; None if they may.
        holder: the process that has it open, as far as this user may know.
    """

    device: str
    by_id: str | None
    by_path: str | None
    usb: str | None
    maker: str | None
    product: str | None
    serial: str | None
    guesses: tuple[Guess, ...]
    obstacle: Obstacle | None
    holder: str | None

    @property
    def path(self) -> str:
        """The path for a profile: one that stays, if there is one."""
        return self.by_id or self.by_path or self.device


def ports() -> list[SerialPort]:
    """The serial ports, sorted by device."""
    from serial.tools import list_ports

    by_id, by_path = _links(BY_ID), _links(BY_PATH)
    known = usb_numbers()
    there = sorted(list_ports.comports(), key=lambda p: p.device)
    numbers = [(port.vid, port.pid, port.serial_number) for port in there]
    found = []
    for port, number in zip(there, numbers, strict=True):
        usb = None if port.vid is None else f"{port.vid:04x}:{port.pid or 0:04x}"
        node, own = os.path.realpath(port.device), len(port.serial_number or "") >= _OWN and numbers.count(number) == 1
        found.append(
            SerialPort(
                port.device, by_id.get(node) if own else None, by_path.get(node), usb, port.manufacturer or None,
                port.product or None, port.serial_number or None, guesses(usb, known), obstacle(port.device),
                holder(port.device),
            )
        )  # fmt: skip
    return found


def usb_numbers() -> dict[str, tuple[str, tuple[str, ...]]]:
    """Summary and USB numbers of each driver that has any. A driver that can't be imported is left out."""
    found = {}
    for name in registry.names("drivers"):
        with contextlib.suppress(SrlError):
            described = registry.describe("drivers", name, ("summary", "usb"))
            if described["usb"]:
                found[name] = (described["summary"], described["usb"])
    return found


def guesses(usb: str | None, known: dict[str, tuple[str, tuple[str, ...]]]) -> tuple[Guess, ...]:
    """The drivers that name these USB numbers, those that name the product first."""
    if usb is None:
        return ()
    vendor = usb.partition(":")[0]
    found = [Guess(name, text, usb in ids) for name, (text, ids) in known.items() if usb in ids or vendor in ids]
    return tuple(sorted(found, key=lambda guess: (not guess.exact, guess.driver)))


def obstacle(port: str) -> Obstacle | None:
    """Why this user can't open a port; None if they may, or if it is no path of this machine (`local_path`)."""
    path = local_path(port)
    if path is None or os.access(path, os.R_OK | os.W_OK):
        return None
    try:
        group = os.stat(path).st_gid
    except OSError:  # it may have gone just now
        there = sorted(glob.glob("/dev/ttyUSB*") + glob.glob("/dev/ttyACM*"))
        listed = f"There are: {', '.join(there)}" if there else "No USB serial port is there: check cable and power"
        return Obstacle(f"{path} isn't there", listed)
    try:
        owner = grp.getgrgid(group).gr_name
    except KeyError:
        owner = "dialout"
    if owner == "root":  # joining it would give far more than the port
        return Obstacle(f"{path} may not be opened", "Install deploy/99-srl.rules, which gives it to the group dialout")
    command = f"sudo usermod -aG {owner} $USER"
    return Obstacle(f"{path} may not be opened", f"{command}, then log in again", command)


def holder(port: str) -> str | None:
    """The process that has a port open, "srl (1234)"; None if none is seen.

    Of other users' processes only those that locked the port are seen, as srl does.
    """
    pid = next(_openers(port), None) or next(_lockers(port), None)
    if pid is None:
        return None
    try:
        return f"{Path(f'/proc/{pid}/comm').read_text().strip()} ({pid})"
    except OSError:
        return f"process {pid}"


def _links(folder: str) -> dict[str, str]:
    """The links of a folder by what they lead to."""
    return {os.path.realpath(link): link for link in sorted(glob.glob(f"{folder}/*"))}


def _openers(port: str) -> Iterator[int]:
    device = os.path.realpath(port)
    for folder in glob.iglob("/proc/[0-9]*/fd"):
        with contextlib.suppress(OSError):  # another user's, or it has just ended
            if any(_leads(entry.path, device) for entry in os.scandir(folder)):
                yield int(folder.split("/")[2])


def _leads(link: str, device: str) -> bool:
    try:
        return os.readlink(link) == device
    except OSError:
        return False


def _lockers(port: str) -> Iterator[int]:
    try:
        about = os.stat(port)
        locks = LOCKS.read_text().splitlines()
    except OSError:
        return
    at = f"{os.major(about.st_dev):02x}:{os.minor(about.st_dev):02x}:{about.st_ino}"
    for line in locks:
        words = line.split()
        if at in words and (pid := int(words[words.index(at) - 1])) > 0:
            yield pid
