"""Converts one data message to the arm's states: in one pass, into existing arrays; in C where it can be."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from srl.drivers.ur.registers import OUTPUTS
from srl.runtime.contracts import rotation
from srl.runtime.contracts.compiled import Step, bind_or_python, undone
from srl.runtime.contracts.signals import Array

_EFFORT: Final = {"target": "target_moment", "measured": "actual_current_as_torque"}
_WORDS: Final = struct.Struct(">iIIIiiiQ")
_DOUBLES: Final = 32
ABSURD: Final = 1e12  # of no quantity here; the sines of such numbers mean nothing, and their squares overflow
_BIG: Final = np.dtype(">f8")
_INTEGERS: Final = 1 + 8 * _DOUBLES  # byte of a body at which they begin
BODY: Final = _INTEGERS + _WORDS.size
_STATES: Final = ("position", "velocity", "effort", "wrench", "pose", "speed_scaling")


def names(effort: str) -> tuple[str, ...]:
    """Returns the requested variables in the order that `Sample` expects; `effort` as in the profile."""
    return (
        "timestamp", "actual_q", "actual_qd", _EFFORT[effort], "actual_TCP_force", "actual_TCP_pose", "speed_scaling",
        "robot_mode", "safety_status_bits", "robot_status_bits", "runtime_state", *OUTPUTS,
        "actual_digital_input_bits",
    )  # fmt: skip


TYPES: Final = (
    "DOUBLE", *["VECTOR6D"] * 5, "DOUBLE", "INT32", "UINT32", "UINT32", "UINT32", "INT32", "INT32", "INT32", "UINT64",
)  # fmt: skip


class Words(NamedTuple):
    """The integers of a message: status, and the control program's registers."""

    robot_mode: int = -1
    safety_bits: int = 0
    robot_bits: int = 0
    runtime_state: int = 0
    nonce: int = 0
    state: int = 0
    taken: int = 0  # number of the newest command that the program took
    inputs: int = 0  # digital inputs, one per bit


class Sample:
    """The values of the newest message.

    Attributes:
        position, velocity, effort: (6,) rad, rad/s, N m.
        wrench: (6,) N, N m, at the tool centre point, axes of the controller's base.
        tool: (6,) m and rotation vector, rad, of the tool centre point in the controller's base.
        words: the integers.
    """

    def __init__(self) -> None:
        self._values = np.zeros(_DOUBLES)
        self.position, self.velocity = self._values[1:7], self._values[7:13]
        self.effort, self.wrench, self.tool = self._values[13:19], self._values[19:25], self._values[25:31]
        self.words = Words()
        self._integers = b""  # the words, as they came
        body = bytearray(-(-BODY // 8) * 8)
        self._body = memoryview(body)[:BODY]
        self._take = bind_or_python("ur-take", np.frombuffer(body), self._values)
        self._filled: Mapping[str, Array] | None = None  # what `_fill` writes into
        self._fill: Step = undone

    def take(self, body: bytes) -> bool:
        """Takes a data message's body. Returns False and changes nothing if a value isn't finite, or absurd."""
        self._body[:] = body
        if self._take(0.0) < 0:
            values = np.frombuffer(body, _BIG, _DOUBLES, 1)
            if not np.abs(values).max() < ABSURD:  # nor NaN
                return False
            self._values[:] = values
        integers = body[_INTEGERS:]
        if integers != self._integers:
            self._integers, self.words = integers, Words(*_WORDS.unpack(integers))
        return True

    @property
    def timestamp(self) -> float:
        """s since the controller's start."""
        return float(self._values[0])

    @property
    def speed_scaling(self) -> float:
        """0 to 1, the factor by which the controller slows the program."""
        return float(self._values[31])

    def fill(self, arrays: Mapping[str, Array], inputs: Sequence[int]) -> None:
        """Writes the driver's states into `arrays`; `inputs`: numbers of the digital inputs that are `buttons`."""
        if arrays is not self._filled:
            self._filled = arrays
            self._fill = bind_or_python("ur-fill", self._values, *(arrays[name] for name in _STATES))
        if self._fill(0.0) < 0:
            arrays["position"][:] = self.position
            arrays["velocity"][:] = self.velocity
            arrays["effort"][:] = self.effort
            arrays["wrench"][:] = self.wrench
            fill_pose(self.tool.tolist(), arrays["pose"])
            arrays["speed_scaling"][0] = self.speed_scaling
        for i, number in enumerate(inputs):
            arrays["buttons"][i] = self.words.inputs >> number & 1


def fill_pose(tool: list[float], out: Array) -> None:
    """Writes (x, y, z, qw, qx, qy, qz), m, of a position and a rotation vector into `out` (7,).

    Of the two possible quaternions it takes the one nearer to the value in `out`, so that a sequence doesn't jump.
    """
    w, x, y, z = out[3:].tolist()
    out[:] = (*tool[:3], *rotation.nearer(_quaternion(tool), (w, x, y, z)))


def _quaternion(tool: list[float]) -> rotation.Quaternion:
    """With w >= 0, which is how a sequence begins."""
    return rotation.nearer(rotation.exp(*tool[3:]), (1.0, 0.0, 0.0, 0.0))
