"""Finds and checks the ODrives of a bus, and arms their watchdogs. Nothing moves and no axis gets torque."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable
from typing import Final

import can

from srl.drivers.canbus import CanLink
from srl.drivers.odrive import protocol, words
from srl.drivers.odrive.config import Endpoints, OdriveAxis, OdriveConfig
from srl.drivers.odrive.protocol import Command
from srl.drivers.odrive.units import Scale
from srl.drivers.timeout import remaining
from srl.runtime.contracts.errors import DeviceError

LISTEN: Final = 0.4  # s; a heartbeat comes every 0.1 s
SETTLE: Final = 2.0  # s for which an axis of an earlier run may need to coast
SAME: Final = 0.01  # share by which two torque constants may differ
_TRIES: Final = 3
Question = Callable[..., list[bytes]]


def listen(link: CanLink, seconds: float) -> dict[int, dict[int, bytes]]:
    """The newest data of each message by node and command, without requests."""
    found: dict[int, dict[int, bytes]] = {}
    for left in remaining(seconds):
        for message in link.read_wait(left):
            if not message.is_extended_id and not message.is_remote_frame:
                node, command = protocol.split(message.arbitration_id)
                found.setdefault(node, {})[command] = bytes(message.data)
    return found


def find(link: CanLink, config: OdriveConfig, place: str) -> dict[int, dict[int, bytes]]:
    """Waits until all axes of the profile are heard, idle. Raises DeviceError if one isn't."""
    heard = _wait(link, config, place)
    deadline = time.monotonic() + SETTLE
    while (busy := _busy(heard, config)) and time.monotonic() < deadline:
        for node, found in listen(link, 0.15).items():
            heard.setdefault(node, {}).update(found)
    if busy:
        name, node, state = busy
        raise DeviceError(
            place,
            f"'{name}' (node {node}) is in {words.state(state)}, not idle",
            "Another program commands it, or an earlier run left it so. Hold the limb: idle lets it go. End the other "
            "program, then request state 1 with the maker's tool or switch the ODrive off and on",
        )
    return heard


def _wait(link: CanLink, config: OdriveConfig, place: str) -> dict[int, dict[int, bytes]]:
    heard: dict[int, dict[int, bytes]] = {}
    wanted = {axis.node for axis in config.axes.values()}

    def complete() -> bool:
        return all({Command.HEARTBEAT, Command.ESTIMATES} <= heard.get(node, {}).keys() for node in wanted)

    deadline = time.monotonic() + LISTEN
    while True:
        for node, found in listen(link, 0.02).items():
            heard.setdefault(node, {}).update(found)
        if complete() or time.monotonic() >= deadline:
            break
    beating = sorted(node for node, found in heard.items() if Command.HEARTBEAT in found)
    for name, axis in config.axes.items():
        if Command.HEARTBEAT not in heard.get(axis.node, {}):
            if not beating:
                raise DeviceError(
                    place,
                    f"no ODrive is heard on {config.port}",
                    "Check the bit rate (250 kbit/s as delivered), the terminators (120 ohm at both ends), the supply, "
                    "and that heartbeats are on (heartbeat_rate_ms = 100)",
                )
            raise DeviceError(
                place,
                f"'{name}' (node {axis.node}) isn't heard; heard are nodes {', '.join(map(str, beating))}",
                "Check its cable and supply, or correct 'node'",
            )
        if Command.ESTIMATES not in heard[axis.node]:
            raise DeviceError(
                place,
                f"'{name}' (node {axis.node}) doesn't send its position",
                "Set encoder_msg_rate_ms = 10 (0.5: encoder_rate_ms) with the maker's tool, or less on a fast bus, and "
                "check its encoder",
            )
    return heard


def _busy(heard: dict[int, dict[int, bytes]], config: OdriveConfig) -> tuple[str, int, int] | None:
    for name, axis in config.axes.items():
        beat = protocol.heartbeat(heard[axis.node][Command.HEARTBEAT], config.firmware)
        if beat is None or beat.state != protocol.IDLE:
            return name, axis.node, -1 if beat is None else beat.state
    return None


def check(link: CanLink, config: OdriveConfig, place: str, question: Question) -> str:
    """Refuses another firmware, another ODrive, two with one node id; arms the watchdogs. Returns a remark."""
    versions = []
    endpoints = config.numbers()
    for name, axis in config.axes.items():
        who = f"'{name}' (node {axis.node})"
        found = _version(link, axis, question, config.firmware)
        if config.firmware == "0.5":
            if found is not None:
                raise _other(place, who, f"has firmware {found.firmware}", config.firmware)
            continue
        if found is None:
            raise _other(place, who, "doesn't tell its version, as firmware 0.6 does", config.firmware)
        if not found.firmware.startswith("0.6."):
            raise _other(place, who, f"has firmware {found.firmware}", config.firmware)
        _identity(link, axis, place, who, question)
        assert endpoints is not None
        if (found.firmware, found.hardware) != (endpoints.firmware, endpoints.hardware):
            raise DeviceError(
                place,
                f"{who} has firmware {found.firmware} on hardware {found.hardware}; 'endpoints' is for "
                f"{endpoints.firmware} on {endpoints.hardware}",
                "Get the file for this firmware and hardware from the maker: with another, a write hits another "
                "parameter",
            )
        _compare(link, axis, endpoints, place, who, question)
        _arm(link, axis, config.watchdog, endpoints, place, who, question)
        versions.append(found.firmware)
    if not versions:
        return f"firmware 0.5; its watchdog, {config.watchdog:g} s by the profile, can't be read on CAN"
    return f"firmware {', '.join(sorted(set(versions)))}; watchdog {config.watchdog:g} s"


def _other(place: str, who: str, what: str, wanted: str) -> DeviceError:
    return DeviceError(place, f"{who} {what}; the profile says {wanted}", "Correct 'firmware', or the node ids")


def _version(link: CanLink, axis: OdriveAxis, question: Question, firmware: str) -> protocol.Version | None:
    answer = protocol.identifier(axis.node, Command.VERSION)
    for _ in range(_TRIES if firmware == "0.6" else 1):
        request = protocol.request(axis.node, Command.VERSION)
        for data in question(link, request, answer, 0.2 if firmware == "0.6" else 0.05):
            if found := protocol.version(data):
                return found
    return None


def _identity(link: CanLink, axis: OdriveAxis, place: str, who: str, question: Question) -> None:
    """Compares serial numbers. Two ODrives with one node id both answer."""
    answer = protocol.identifier(axis.node, Command.ADDRESS)
    serials: set[str] = set()
    for _ in range(_TRIES):
        for data in question(link, protocol.request(axis.node, Command.ADDRESS), answer):
            if found := protocol.serial_number(data):
                serials.add(found)
        for message in link.read_wait(0.02):  # a second one answers right behind the first
            if message.arbitration_id == answer and (found := protocol.serial_number(bytes(message.data))):
                serials.add(found)
        if serials:
            break
    if len(serials) > 1:
        raise DeviceError(
            place,
            f"{who}: several ODrives have this node id, {' and '.join(sorted(serials))}",
            "Give each its own with the maker's tool",
        )
    if axis.serial is not None and serials != {axis.serial}:
        serial_text = f"has the serial number {serials.pop()}" if serials else "doesn't tell its serial number"
        raise DeviceError(
            place,
            f"{who} {serial_text}; the profile says {axis.serial}",
            "Node ids are swapped, or the ODrive was exchanged: correct 'node' or 'serial'",
        )


def _compare(link: CanLink, axis: OdriveAxis, numbers: Endpoints, place: str, who: str, question: Question) -> None:
    """Refuses an ODrive that takes the motor's torque constant for another: torques and their limits would be wrong."""
    answer = protocol.identifier(axis.node, Command.TX_SDO)
    for _ in range(_TRIES):
        for data in question(link, protocol.read_endpoint(axis.node, numbers.torque_constant), answer):
            value = protocol.endpoint_value(data, numbers.torque_constant, 4)
            if value is None:
                continue
            (found,) = struct.unpack("<f", value)
            if not abs(found - axis.torque_constant) <= SAME * axis.torque_constant:
                raise DeviceError(
                    place,
                    f"{who} has a torque constant of {found:.4g} N m/A; the profile says {axis.torque_constant:g}",
                    "Set axis0.config.motor.torque_constant with the maker's tool, or correct 'torque_constant'",
                )
            return
    raise DeviceError(
        place, f"{who} doesn't tell its torque constant", "Check that 'endpoints' is the file of this firmware"
    )


def _arm(
    link: CanLink, axis: OdriveAxis, timeout: float, numbers: Endpoints, place: str, who: str, question: Question
) -> None:
    """Sets the watchdog's time, switches it on, and reads both back. A reboot forgets them."""
    wanted = ((numbers.timeout, struct.pack("<f", timeout)), (numbers.enable, b"\1"))
    for endpoint, value in wanted:
        for _ in range(_TRIES):
            link.write(protocol.write_endpoint(axis.node, endpoint, value))
            time.sleep(0.005)  # from 0.6.11 on a write is confirmed, which must not pass for the read's answer
            answers = question(
                link,
                protocol.read_endpoint(axis.node, endpoint),
                protocol.identifier(axis.node, Command.TX_SDO),
            )
            if any(protocol.endpoint_value(data, endpoint, len(value)) == value for data in answers):
                break
        else:
            raise DeviceError(
                place,
                f"{who} doesn't keep its watchdog's setting",
                "Without a watchdog a drive goes on when the host dies. Check that 'endpoints' is the file of this "
                "firmware",
            )


def limits(config: OdriveConfig) -> list[can.Message]:
    """Frames that set each ODrive's own limits, and in mode torque its damping; a reboot forgets them."""
    found = []
    for axis in config.axes.values():
        scale = Scale(axis)
        found.append(protocol.set_limits(axis.node, abs(scale.turns_velocity(axis.velocity)), axis.current))
        if config.mode == "torque":
            found.append(protocol.velocity_gains(axis.node, scale.gain, 0.0))
    return found
