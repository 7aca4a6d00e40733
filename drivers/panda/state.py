"""Takes from a RobotState's bytes only what the driver needs, because this runs every millisecond.

In C where it can be (native/panda.c); the Python here is the specification.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from struct import Struct

import numpy as np

from srl.drivers.panda.packets import ROOM, RobotMode, error_names, state_dtype
from srl.runtime.contracts import rotation
from srl.runtime.contracts.compiled import Step, bind_or_python, numbers, undone
from srl.runtime.contracts.rotation import Quaternion
from srl.runtime.contracts.signals import Array

_ID = Struct("<Q")
# The driver's signals that are copied unchanged.
_COPIED = {
    "position": "q",
    "velocity": "dq",
    "effort": "tau_J",
    "desired_effort": "tau_J_d",
    "external_effort": "tau_ext_hat_filtered",
    "wrench": "O_F_ext_hat_K",
    "success_rate": "control_command_success_rate",
}


@dataclass(frozen=True, slots=True)
class Modes:
    """The modes and errors at the end of a state.

    Attributes:
        generator, controller: packets.Generator and packets.Controller, as numbers.
        mode: the robot's operating mode; OTHER for an unknown number.
        errors: the present errors, by name.
        reasons: the errors that ended the last motion, by name.
    """

    generator: int
    controller: int
    mode: RobotMode
    errors: tuple[str, ...]
    reasons: tuple[str, ...]


class StateReader:
    """Reads the fields of one protocol's states.

    Attributes:
        size: bytes of a state.
        single: whether its reals are float32, else float64.
        body: the bytes of the state that `hold` was given last, for C.
    """

    def __init__(self, version: int) -> None:
        layout = state_dtype(version)
        assert layout.fields is not None
        self.size = layout.itemsize
        self.single = layout["m_ee"].itemsize == 4
        code = "f" if self.single else "d"
        at = {name: int(place[1]) for name, place in layout.fields.items()}
        self._copied = [
            (signal, Struct(f"<{layout[name].shape[0] if layout[name].shape else 1}{code}"), at[name])
            for signal, name in _COPIED.items()
        ]
        self._pose_at, self._pose = at["O_T_EE"], Struct(f"<16{code}")
        self._seven = Struct(f"<7{code}")
        self._at = at
        self._tail = slice(at["motion_generator_mode"], at["robot_mode"] + 1)
        # The last one: of the two equivalent ones, the nearer is returned.
        self._quaternion = np.array([1.0, 0.0, 0.0, 0.0])
        self.body = np.zeros(ROOM[0])
        self._bytes = self.body.data.cast("B")[: self.size]
        self._held = b""
        self._filled: Mapping[str, Array] | None = None  # what `_fill` writes into
        self._fill: Step = undone

    def message_id(self, data: bytes) -> int:
        """The message id: ms of the robot's time."""
        return int(_ID.unpack_from(data)[0])

    def at(self, name: str) -> int:
        """Returns the byte of a state at which a field begins."""
        return self._at[name]

    def hold(self, data: bytes) -> None:
        """Puts a state's bytes into `body`."""
        if data is not self._held:
            self._bytes[:] = memoryview(data)[: self.size]
            self._held = data

    def joints(self, data: bytes, name: str) -> tuple[float, ...]:
        """Returns one of the fields with seven numbers."""
        return self._seven.unpack_from(data, self._at[name])

    def masses(self, data: bytes) -> tuple[float, float]:
        """Returns what the robot compensates: the mass of its end effector and of its load, kg."""
        one = Struct("<f" if self.single else "<d")
        return one.unpack_from(data, self._at["m_ee"])[0], one.unpack_from(data, self._at["m_load"])[0]

    def tail(self, data: bytes) -> bytes:
        """Returns the bytes that `modes` decodes: equal bytes mean equal modes."""
        return data[self._tail]

    def modes(self, tail: bytes) -> Modes:
        """Decodes `tail`."""
        try:
            mode = RobotMode(tail[-1])
        except ValueError:
            mode = RobotMode.OTHER
        return Modes(tail[0], tail[1], mode, error_names(tail[2:43]), error_names(tail[43:84]))

    def fill(self, data: bytes, arrays: Mapping[str, Array]) -> bool:
        """Copies a state into the driver's arrays. Returns False and copies nothing if a number isn't finite."""
        if arrays is not self._filled:
            self._filled = arrays
            places = numbers([at for _, _, at in self._copied], self._pose_at)
            states = (arrays[name] for name in (*_COPIED, "pose"))
            self._fill = bind_or_python("panda-fill", self.body, places, self._quaternion, *states)
        self.hold(data)
        if self._fill(0.0, self.single) >= 0:
            return True
        T = self._pose.unpack_from(data, self._pose_at)
        found = [form.unpack_from(data, at) for _, form, at in self._copied]
        if not isfinite(sum(T) + sum(map(sum, found))):
            return False
        for (signal, _, _), values in zip(self._copied, found, strict=True):
            arrays[signal][:] = values
        w, x, y, z = self._quaternion.tolist()
        self._quaternion[:] = found_q = quaternion(T, (w, x, y, z))
        arrays["pose"][:] = T[12:15] + found_q
        return True


def quaternion(T: tuple[float, ...], near: Quaternion) -> Quaternion:
    """Returns the unit quaternion (w, x, y, z) of a 4x4 transform's rotation, given column by column.

    Of the two equivalent ones it returns the one nearer to `near`; `near` itself if the transform isn't finite.
    """
    a, d, g, b, e, h, c, f, i = T[0], T[1], T[2], T[4], T[5], T[6], T[8], T[9], T[10]  # rows abc, def, ghi
    q = rotation.of_rows(a, b, c, d, e, f, g, h, i)
    return rotation.nearer(q, near) if isfinite(sum(q)) else near
