"""CANSimple, the protocol of ODrive on CAN, without I/O. Source: protocol sheet can_actuators, section 4.

An identifier is the node times 32 plus a command, 11 bits. All numbers are little-endian. A request is a remote frame.
Position and velocity are turns and turns/s of the encoder that the ODrive closes its loop with, torque is N m at the
motor. Firmware 0.5 and 0.6 differ; no frame that sets a node id, a position, a trajectory, or reboots can be made here.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import Final, Literal

import can

Firmware = Literal["0.5", "0.6"]
BROADCAST: Final = 63  # nobody's node: an ODrive without an address has it


class Command(IntEnum):
    """The low five bits of an identifier. Names are those of firmware 0.6."""

    VERSION = 0x00
    HEARTBEAT = 0x01
    ESTOP = 0x02
    ERROR = 0x03  # 0.5: errors of the motor
    RX_SDO = 0x04  # 0.5: errors of the encoder
    TX_SDO = 0x05
    ADDRESS = 0x06  # asked for with a remote frame only: with data it would set the node id
    SET_STATE = 0x07
    ESTIMATES = 0x09
    SET_MODE = 0x0B
    INPUT_POSITION = 0x0C
    INPUT_VELOCITY = 0x0D
    INPUT_TORQUE = 0x0E
    SET_LIMITS = 0x0F
    IQ = 0x14
    TEMPERATURE = 0x15
    BUS = 0x17
    CLEAR = 0x18
    VELOCITY_GAINS = 0x1B
    TORQUES = 0x1C
    CONTROLLER_ERROR = 0x1D  # 0.5 only


# What only a host sends, with data. Seen from another node, somebody else commands the drive.
COMMANDS: Final = frozenset({0x02, 0x04, 0x06, 0x07, 0x0B, 0x0C, 0x0D, 0x0E, 0x0F, 0x11, 0x12, 0x13, 0x16, 0x18, 0x19,
                             0x1A, 0x1B})  # fmt: skip
EMPTY: Final = frozenset({0x02, 0x16, 0x18})  # commands of those that need no data
IDLE: Final = 1
CLOSED_LOOP: Final = 8
STATES: Final = {
    0: "undefined", 1: "idle", 2: "startup sequence", 3: "full calibration", 4: "motor calibration",
    6: "encoder index search", 7: "encoder offset calibration", 8: "closed loop control", 9: "lock-in spin",
    10: "encoder direction find", 11: "homing", 12: "hall polarity calibration", 13: "hall phase calibration",
    14: "anticogging calibration",
}  # fmt: skip
MODES: Final = {"torque": 1, "velocity": 2, "position": 3}
PASSTHROUGH: Final = 1


def identifier(node: int, command: int) -> int:
    """The identifier of a node's frame."""
    return node << 5 | command


def split(identifier: int) -> tuple[int, int]:
    """Node and command of an identifier."""
    return identifier >> 5, identifier & 0x1F


def message(node: int, command: int, data: bytes) -> can.Message:
    """A frame with data."""
    return can.Message(arbitration_id=identifier(node, command), data=data, is_extended_id=False)


def request(node: int, command: int) -> can.Message:
    """Asks for a message."""
    return can.Message(arbitration_id=identifier(node, command), is_remote_frame=True, is_extended_id=False)


def set_state(node: int, state: int) -> can.Message:
    """Requests IDLE or CLOSED_LOOP; nothing else can be requested: a calibration or a homing moves the axis."""
    if state not in (IDLE, CLOSED_LOOP):
        raise ValueError(f"state {state} would move the axis")
    return message(node, Command.SET_STATE, struct.pack("<I", state) + bytes(4))


def set_mode(node: int, mode: str) -> can.Message:
    """Chooses "torque", "velocity" or "position", with the input passed through."""
    return message(node, Command.SET_MODE, struct.pack("<II", MODES[mode], PASSTHROUGH))


def input_position(node: int, turns: float, velocity: float = 0.0, torque: float = 0.0) -> can.Message:
    """Turns; feedforward in turns/s and N m, in steps of 0.001, bounded to 32.767."""
    forward = (_thousandths(velocity), _thousandths(torque))
    return message(node, Command.INPUT_POSITION, struct.pack("<fhh", turns, *forward))


def input_velocity(node: int, velocity: float, torque: float = 0.0) -> can.Message:
    """Turns/s; feedforward in N m."""
    return message(node, Command.INPUT_VELOCITY, struct.pack("<ff", velocity, torque))


def input_torque(node: int, torque: float) -> can.Message:
    """N m at the motor."""
    return message(node, Command.INPUT_TORQUE, struct.pack("<f", torque) + bytes(4))


def set_limits(node: int, velocity: float, current: float) -> can.Message:
    """Turns/s and A; a reboot forgets them."""
    return message(node, Command.SET_LIMITS, struct.pack("<ff", velocity, current))


def velocity_gains(node: int, gain: float, integrator: float) -> can.Message:
    """N m/(turn/s) and N m/turn at the motor; a reboot forgets them."""
    return message(node, Command.VELOCITY_GAINS, struct.pack("<ff", gain, integrator))


def clear(node: int, firmware: Firmware) -> can.Message:
    """Clears the errors. With firmware 0.5 those of all axes of the board; with 0.6 a byte says: don't blink."""
    return message(node, Command.CLEAR, b"" if firmware == "0.5" else b"\0")


def read_endpoint(node: int, endpoint: int) -> can.Message:
    """Asks for a parameter (0.6)."""
    return message(node, Command.RX_SDO, struct.pack("<BHB", 0, endpoint, 0))


def write_endpoint(node: int, endpoint: int, value: bytes) -> can.Message:
    """Writes a parameter (0.6), of at most 4 bytes."""
    if len(value) > 4:
        raise ValueError("a parameter of more than 4 bytes doesn't fit into a frame")
    return message(node, Command.RX_SDO, struct.pack("<BHB", 1, endpoint, 0) + value)


def endpoint_value(data: bytes, endpoint: int, size: int) -> bytes | None:
    """The value in a TxSdo of this endpoint, `size` bytes; None if it is another's."""
    if len(data) < 4 + size or struct.unpack_from("<H", data, 1)[0] != endpoint:
        return None
    return data[4 : 4 + size]


@dataclass(frozen=True)
class Version:
    """Hardware and firmware (0.6)."""

    protocol: int
    hardware: str
    firmware: str


def version(data: bytes) -> Version | None:
    """Takes a Get_Version."""
    if len(data) != 8:
        return None
    return Version(data[0], "{}.{}.{}".format(*data[1:4]), "{}.{}.{}".format(*data[4:7]))


def serial_number(data: bytes) -> str | None:
    """The serial number in an Address (0.6), twelve hexadecimal digits, as the maker's tools show it."""
    return f"{int.from_bytes(data[1:7], 'little'):012X}" if len(data) >= 7 else None


@dataclass(frozen=True)
class Heartbeat:
    """Error bits, state, and the procedure's result (0.6); 0.5: bits of motor, encoder, controller errors."""

    error: int
    state: int
    procedure: int
    elsewhere: int


def heartbeat(data: bytes, firmware: Firmware) -> Heartbeat | None:
    """Takes a heartbeat. Early versions of 0.5 send fewer bytes behind the state than later ones."""
    if len(data) != 8:
        return None
    error, state, *rest = struct.unpack("<IBBBB", data)
    if firmware == "0.6":
        return Heartbeat(error, state, rest[0], 0)
    return Heartbeat(error, state, 0, (rest[0] & 1) | (rest[1] & 1) << 1 | (rest[2] & 1) << 2)


def pair(data: bytes) -> tuple[float, float] | None:
    """Two numbers: estimates, torques, temperatures, Iq, bus. None if they aren't there, or aren't finite."""
    if len(data) != 8:
        return None
    first, second = struct.unpack("<ff", data)
    finite = abs(first) < 1e9 and abs(second) < 1e9  # false for NaN, too
    return (first, second) if finite else None


def bits(data: bytes) -> int:
    """Error bits of a reply, little-endian, of any length."""
    return int.from_bytes(data, "little")


def errors(data: bytes) -> tuple[int, int] | None:
    """Active errors and the reason for which the axis was disarmed (0.6)."""
    if len(data) != 8:
        return None
    active, reason = struct.unpack("<II", data)
    return int(active), int(reason)


def _thousandths(value: float) -> int:
    return max(-32767, min(32767, round(value * 1000)))
