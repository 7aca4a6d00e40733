"""Checks the serial ports of a profile, the latency of USB adapters, and whether the udev rules are installed."""

from __future__ import annotations

import glob
import os
import re
from collections.abc import Iterator, Mapping
from fractions import Fraction
from pathlib import Path

from srl.runtime.profile.ports import local_path
from srl.runtime.service.fitness.finding import Finding, read
from srl.runtime.service.serial_ports import holder, obstacle, usb_numbers

_RULES = ("/etc/udev/rules.d", "/run/udev/rules.d", "/usr/lib/udev/rules.d", "/lib/udev/rules.d")
_INSTALL = (
    "sudo install -m 644 deploy/99-srl.rules /etc/udev/rules.d/ && "
    "sudo udevadm control --reload && sudo udevadm trigger"
)


def ports(wanted: Mapping[str, str]) -> Iterator[Finding]:
    """Each device's port, by the device's name."""
    for name, port in wanted.items():
        if (path := local_path(port)) is not None:
            yield _port(name, port, path)


def _port(name: str, port: str, path: str) -> Finding:
    what = f"port of {name}"
    lack = obstacle(port)
    if lack is None and (program := holder(path)) is not None:
        return Finding(
            what, "doubtful", f"{path}: {program} has it open", "End that program, if it isn't this run",
            f"fuser -v {path}",
        )  # fmt: skip
    if lack is None:
        return Finding(what, "good", f"{path} may be opened")
    if os.path.exists(path):
        return Finding(what, "bad", lack.problem, lack.remedy, lack.command or _INSTALL)
    return Finding(
        what, "bad", lack.problem, f"{lack.remedy}; set it with --set devices.{name}.port=...", "srl find-port"
    )


def latency(rate: Fraction) -> Iterator[Finding]:
    """How long each USB adapter keeps an answer back."""
    for path in sorted(glob.glob("/sys/bus/usb-serial/devices/*/latency_timer")):
        milliseconds = int(read(path) or 0)
        what = f"USB latency of {path.split('/')[-2]}"
        if milliseconds > 1 and milliseconds * 1e-3 > 0.2 / float(rate):
            yield Finding(
                what, "doubtful", f"{milliseconds} ms: each answer may wait that long",
                "Until it is plugged in again; the udev rules do it always", f"echo 1 | sudo tee {path}",
            )  # fmt: skip
        else:
            yield Finding(what, "good", f"{milliseconds} ms")


def brltty() -> Iterator[Finding]:
    """Rules by which brltty takes adapters away that devices of the drivers use."""
    files = {path.name: path for folder in reversed(_RULES) for path in Path(folder).glob("*brltty*.rules")}
    numbers = {number for _, ids in usb_numbers().values() for number in ids} | {"10c4:ea60"}
    for path in files.values():
        lines = [line for line in read(path).splitlines() if not line.lstrip().startswith("#")]
        named = {
            f"{int(a, 16):04x}:{int(b, 16):04x}"
            for line in lines
            for a, b in re.findall(r'PRODUCT\}=="([0-9a-fA-F]+)/([0-9a-fA-F]+)/', line)
        }
        if taken := sorted(named & numbers | {n for n in named if n[:4] in numbers}):
            yield Finding(
                "brltty",
                "doubtful",
                f"{path}: brltty takes {', '.join(taken)} for Braille displays, and their ports away",
                "Remove it, unless somebody reads Braille here",
                "sudo apt remove brltty",
            )


def rules(wanted: Mapping[str, str]) -> Iterator[Finding]:
    """Whether the udev rules are there, if a device has a serial port."""
    if not any(local_path(port) for port in wanted.values()):
        return
    yield from brltty()
    found = [path for folder in _RULES for path in sorted(Path(folder).glob("*-srl.rules"))]
    if found:
        yield Finding("udev rules", "good", str(found[0]))
    else:
        yield Finding(
            "udev rules", "doubtful", "no *-srl.rules in /etc/udev/rules.d: ports may belong to root, and be slow",
            "Install them, in the checkout", _INSTALL,
        )  # fmt: skip
