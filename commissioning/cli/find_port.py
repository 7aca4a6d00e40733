"""`srl find-port`: lists the serial ports, names the one that comes or goes as a device is plugged, asks who is there.

Only `--ask` opens a port: opening restarts most Arduino boards, and what is there gets bytes of the driver's protocol.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict

from srl.commissioning.cli import COMMANDS
from srl.runtime.cli import add_command, options
from srl.runtime.contracts import registry
from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.errors import DeviceError, RequestError, SrlError
from srl.runtime.contracts.printable import printable
from srl.runtime.service import serial_ports
from srl.runtime.service.fitness import serial
from srl.runtime.service.serial_ports import SerialPort

_PERIOD = 0.1  # s between two looks: what takes a port away again (brltty does) leaves it for half a second
_STEADY = 10  # looks in a row that see the same: by then udev has made the links and rights of a new port


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Registers the command."""
    parser = add_command(subparsers, "find-port", "srl find-port --wait", COMMANDS)
    parser.add_argument(
        "--wait", action="store_true", help="wait until a device is plugged in or out, and name its port"
    )
    parser.add_argument(
        "--ask",
        metavar="DRIVER",
        help="open the ports that may be this driver's (or --port) and ask who is there; nothing is set or moved, but "
        "opening a port restarts most Arduino boards",
    )
    parser.add_argument("--port", metavar="PORT", help="with --ask: this port alone, whatever it may be")
    options.as_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Prints the ports and returns 0; with `--wait`, those that came or went. With `--ask`, 1 if nobody answered."""
    if args.ask is not None:
        return _ask(args)
    if args.port is not None:
        raise RequestError("--port", "goes with --ask DRIVER", f"E.g. `srl find-port --ask feetech --port {args.port}`")
    if not args.wait:
        found = serial_ports.ports()
        print(json.dumps({"ports": [_plain(port) for port in found]}) if args.json else "\n".join(listed(found)))
        return 0
    print("Plug the device in, or pull it out if it is in. Ctrl-C ends this.", file=sys.stderr, flush=True)
    came, went = changed(serial_ports.ports, time.sleep)
    if args.json:
        print(json.dumps({"came": [_plain(port) for port in came], "went": [_plain(port) for port in went]}))
        return 0
    for what, found in (("came", came), ("went", went)):
        for port in found:
            print("\n".join([f"{what}: {port.path}", *described(port, there=what == "came")]))
    return 0


def _ask(args: argparse.Namespace) -> int:
    if args.wait:
        raise RequestError("--ask", "doesn't go with --wait", "First --wait for the port, then --ask who is there")
    driver = registry.load("drivers", args.ask, "--ask")
    if not _can_ask(driver):
        able = ", ".join(name for name in registry.names("drivers") if _can_ask(_driver(name)))
        raise RequestError("--ask", f"driver '{args.ask}' can't ask who is at a port", f"These can: {able}")
    ports = [args.port] if args.port is not None else [
        port.path for port in serial_ports.ports() if args.ask in (guess.driver for guess in port.guesses)
    ]  # fmt: skip
    if not ports:
        raise RequestError("--ask", f"no port here may be {args.ask}'s by its USB numbers", "Name one with --port PORT")
    answers: dict[str, str | None] = {}
    for port in ports:
        try:
            answers[port] = printable(driver.who_is_at(port))
        except DeviceError as error:
            answers[port] = None
            print(error, file=sys.stderr)
        if not args.json and answers[port] is not None:
            print(f"{port}: {answers[port]}")
    if args.json:
        print(json.dumps({"driver": args.ask, "answers": answers}))
    return 0 if any(answers.values()) else 1


def _can_ask(driver: type[Driver] | None) -> bool:
    return driver is not None and "who_is_at" in vars(driver)


def _driver(name: str) -> type[Driver] | None:
    with contextlib.suppress(SrlError):  # one that can't be imported
        found: type[Driver] = registry.load("drivers", name, "--ask")
        return found
    return None


def changed(
    look: Callable[[], list[SerialPort]], pause: Callable[[float], object]
) -> tuple[list[SerialPort], list[SerialPort]]:
    """Waits until the ports have changed and stay as they are for a while.

    Returns:
        The ports that came, and those that went; one that came and went is in both.
    """
    now = look()
    known = {_key(port): port for port in now}
    came: dict[tuple[str, str | None, str | None], SerialPort] = {}
    went: dict[tuple[str, str | None, str | None], SerialPort] = {}
    steady = 0
    while True:
        pause(_PERIOD)
        last, now = now, look()
        there = {_key(port): port for port in now}
        came |= {key: port for key, port in there.items() if key not in known}
        went |= {key: port for key, port in (known | came).items() if key not in there}
        # Of a new port, rights and the link by id come a moment after the port itself.
        steady = steady + 1 if _state(now) == _state(last) else 0
        if (came or went) and steady >= _STEADY:
            return list(came.values()), list(went.values())


def _state(ports: Sequence[SerialPort]) -> list[tuple[object, ...]]:
    return [(_key(port), port.path, port.obstacle) for port in ports]


def listed(found: Sequence[SerialPort]) -> list[str]:
    """The lines for some ports."""
    if not found:
        nothing = "no serial port is there: check the cable (some only charge) and the device's supply"
        return [nothing, *(finding.found for finding in serial.brltty())]
    return [line for port in found for line in (port.path, *described(port))]


def described(port: SerialPort, there: bool = True) -> list[str]:
    """What is known of a port, below its path. `there`: False for one that went."""
    lines = [f"  {likely(port)}"]
    usb_text = " ".join(filter(None, (port.maker, port.product)))
    serial = f", serial number {port.serial}" if port.serial else ""
    if port.usb is not None:
        lines.append(f"  USB {port.usb}{f' {usb_text}' * bool(usb_text)}{serial}")
    if port.path != port.device:
        lines.append(f"  now {port.device}: another order of plugging in changes that")
    if port.usb is not None and port.by_id is None:
        if port.by_path is not None:
            lines.append("  this name is the USB socket's, as the device has none for sure: always plug it in there")
        else:
            lines.append("  it has no name that stays with the device: deploy/99-srl.rules says how to give it one")
    if there and port.obstacle is not None:
        lines.append(f"  you can't open it: {port.obstacle.problem}. {port.obstacle.remedy}")
    elif there:
        lines.append("  you may open it" + (f", but {port.holder} has it open" if port.holder else ""))
    return [printable(line) for line in lines]


def likely(port: SerialPort) -> str:
    """What is probably at a port: the adapter's USB numbers don't tell what hangs on it."""
    sure = [f"{guess.driver} ({guess.summary})" for guess in port.guesses if guess.exact]
    rest = [f"{guess.driver} ({guess.summary})" for guess in port.guesses if not guess.exact]
    words = [f"probably {' or '.join(sure)}"] * bool(sure)
    words += [f"perhaps {' or '.join(rest)}"] * bool(rest)
    return ", ".join(words) or "unknown"


def _key(port: SerialPort) -> tuple[str, str | None, str | None]:
    return port.device, port.usb, port.serial


def _plain(port: SerialPort) -> dict[str, object]:
    plain = asdict(port)
    plain["obstacle"] = None if port.obstacle is None else port.obstacle._asdict()
    return plain | {"path": port.path}
