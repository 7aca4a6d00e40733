"""RTDE's variables: their types, and how a recipe packs them. Source: protocol sheet ur-rtde, sections 2, 3."""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence
from typing import Any, Final

NOT_FOUND: Final = "NOT_FOUND"
IN_USE: Final = "IN_USE"
FORMATS: Final = {
    "BOOL": "?",
    "UINT8": "B",
    "UINT32": "I",
    "INT32": "i",
    "UINT64": "Q",
    "DOUBLE": "d",
    "VECTOR3D": "3d",
    "VECTOR6D": "6d",
    "VECTOR6INT32": "6i",
    "VECTOR6UINT32": "6I",
}
_COUNTS: Final = {name: int(format[:-1]) if len(format) > 1 else 1 for name, format in FORMATS.items()}


class Recipe:
    """Variables packed one after another, as one data message carries them.

    Attributes:
        names, types: in the message's order.
        size: bytes of the values.
        message_size: bytes of a data message of version 2, including header and recipe number.
    """

    def __init__(self, names: Sequence[str], types: Sequence[str]) -> None:
        """Raises KeyError for an unknown type."""
        self.names, self.types = tuple(names), tuple(types)
        self._struct = struct.Struct(">" + "".join(FORMATS[kind] for kind in types))
        self._counts = [_COUNTS[kind] for kind in types]
        self.size = self._struct.size
        self.message_size = 4 + self.size

    def unpack(self, body: bytes, offset: int = 1) -> dict[str, Any]:
        """Returns the values by name; vectors as tuples.

        Args:
            body: body of a data message; its first byte is the recipe's number.
            offset: where the values begin.
        """
        flat = self._struct.unpack_from(body, offset)
        found: dict[str, Any] = {}
        at = 0
        for name, count in zip(self.names, self._counts, strict=True):
            found[name] = flat[at] if count == 1 else flat[at : at + count]
            at += count
        return found

    def pack(self, values: Sequence[Any]) -> bytes:
        """Returns the values' bytes; a vector is a sequence.

        Raises:
            struct.error: a value doesn't fit its type.
        """
        flat: list[Any] = []
        for value, count in zip(values, self._counts, strict=True):
            if count == 1:
                flat.append(value)
            else:
                flat.extend(value)
        return self._struct.pack(*flat)


OUTPUTS: Final = (
    {
        name: "DOUBLE"
        for name in (
            "timestamp", "actual_execution_time", "speed_scaling", "target_speed_fraction", "actual_momentum",
            "actual_main_voltage", "actual_robot_voltage", "actual_robot_current", "standard_analog_input0",
            "standard_analog_input1", "standard_analog_output0", "standard_analog_output1", "payload",
        )
    }
    | {
        name: "VECTOR6D"
        for name in (
            "target_q", "target_qd", "target_qdd", "target_current", "target_moment", "actual_q", "actual_qd",
            "actual_current", "joint_control_output", "actual_TCP_pose", "actual_TCP_speed", "actual_TCP_force",
            "target_TCP_pose", "target_TCP_speed", "joint_temperatures", "actual_joint_voltage", "ft_raw_wrench",
            "actual_current_as_torque", "payload_inertia",
        )
    }
    | {
        "actual_tool_accelerometer": "VECTOR3D", "payload_cog": "VECTOR3D", "joint_mode": "VECTOR6INT32",
        "robot_mode": "INT32", "safety_mode": "INT32", "safety_status": "INT32", "safety_status_bits": "UINT32",
        "robot_status_bits": "UINT32", "runtime_state": "UINT32", "actual_digital_input_bits": "UINT64",
        "actual_digital_output_bits": "UINT64",
    }
)  # fmt: skip
INPUTS: Final = {
    "speed_slider_mask": "UINT32", "speed_slider_fraction": "DOUBLE", "standard_digital_output_mask": "UINT8",
    "standard_digital_output": "UINT8", "configurable_digital_output_mask": "UINT8",
    "configurable_digital_output": "UINT8", "tool_digital_output_mask": "UINT8", "tool_digital_output": "UINT8",
    "standard_analog_output_mask": "UINT8", "standard_analog_output_type": "UINT8",
    "standard_analog_output_0": "DOUBLE", "standard_analog_output_1": "DOUBLE", "external_force_torque": "VECTOR6D",
}  # fmt: skip
_REGISTER: Final = re.compile(r"(input|output)_(int|double|bit)_register_(\d{1,3})")
_REGISTERS: Final = {"int": ("INT32", 48), "double": ("DOUBLE", 48), "bit": ("BOOL", 128)}


def register(name: str) -> tuple[str, str, int] | None:
    """Returns ("input" or "output", "int", "double" or "bit", number) of a register; None for other names."""
    found = _REGISTER.fullmatch(name)
    if found is None or int(found[3]) >= _REGISTERS[found[2]][1]:
        return None
    return found[1], found[2], int(found[3])


def output_type(name: str) -> str:
    """Returns the type of a variable the controller can send, else NOT_FOUND; its input registers are readable."""
    known = register(name)
    if known is not None:
        return _REGISTERS[known[1]][0]
    return OUTPUTS.get(name, NOT_FOUND)


def input_type(name: str) -> str:
    """Returns the type of a variable that a controller accepts as input, NOT_FOUND for others."""
    known = register(name)
    if known is not None:
        return _REGISTERS[known[1]][0] if known[0] == "input" else NOT_FOUND
    return INPUTS.get(name, NOT_FOUND)
