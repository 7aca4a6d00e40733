"""The functions of URScript that take no time, and those that this twin refuses.

Source of what they mean: protocol sheet ur-rtde, section 5.2; the URScript manual. A controller ends a program whose
function fails ("runtime exception"), and so does the twin.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import atan2, ceil, cos, degrees, floor, hypot, radians, sin, sqrt, tan
from typing import Any, Final

import numpy as np

from srl.drivers.ur.models import REACH
from srl.drivers.ur.registers import CYCLE
from srl.runtime.contracts.signals import Array
from srl.sim.devices.ur.controller import UrController
from srl.sim.devices.ur.kinematics import bounded, placement, vector
from srl.sim.devices.ur.twin_expressions import Pose, ScriptError
from srl.sim.devices.ur.twin_registers import Registers

_ORIGIN: Final = (0.0,) * 6
_REFUSED: Final = {
    "movec": "it has no circular moves",
    "set_gravity": "gravity is the simulated world's",
    "ft_rtde_input_enable": "it has no external force sensor",
    "enable_external_ft_sensor": "it has no external force sensor",
    "set_analog_out": "clients set analog outputs by RTDE",
    "set_tool_voltage": "its tool has no supply",
    "direct_torque": "controllers of version 5.11 have none",
    "socket_open": "its programs open no sockets",
    "conveyor_pulse_decode": "it has no conveyor",
    "path_offset_enable": "it has no path offset",
}


class Refusals:
    """Counts what the twin refuses.

    Attributes:
        counts: how often, by the function's or command's name.
    """

    def __init__(self) -> None:
        self.counts: dict[str, int] = {}

    def note(self, name: str) -> None:
        """Counts one more."""
        self.counts[name] = self.counts.get(name, 0) + 1

    def refuse(self, name: str, why: str) -> ScriptError:
        """Counts one more; returns the error that ends the program."""
        self.note(name)
        return ScriptError(f"{name} is refused by this twin: {why}")


def near_angles(controller: UrController, pose: Sequence[float] | Array, near: Array, *errors: float) -> list[float]:
    """get_inverse_kin: six angles, rad. Raises ScriptError: there is no solution."""
    found = controller.kinematics.inverse(placement(pose), near, *errors)
    if found is None:
        at = ", ".join(f"{value:.3f}" for value in pose)
        raise ScriptError(f"get_inverse_kin: no joint angles reach p[{at}]")
    return _list(found)


def functions(
    controller: UrController, registers: Registers, refusals: Refusals, say: Callable[..., None]
) -> dict[str, Callable[..., Any]]:
    """All functions that take no time, by name; what fails raises ScriptError or ValueError."""
    return {
        **_arithmetic(),
        **_kinematics(controller),
        **_state(controller),
        **_settings(controller, refusals),
        **_io(controller, registers),
        "textmsg": say,
        "popup": lambda text, *_given, **_named: say(text),
        **{name: _refusal(refusals, name, why) for name, why in _REFUSED.items()},
    }


def _list(values: Array) -> list[float]:
    return [float(value) for value in values]


def _refusal(refusals: Refusals, name: str, why: str) -> Callable[..., Any]:
    def refuse(*_given: Any, **_named: Any) -> None:
        raise refusals.refuse(name, why)

    return refuse


def _arithmetic() -> dict[str, Callable[..., Any]]:
    def pose(place: Any) -> Pose:
        return Pose(vector(place).tolist())

    def pose_sub(a: list[float], b: list[float]) -> Pose:
        one, two = placement(a), placement(b)
        return Pose([*(one.translation - two.translation), *vector(two.inverse() * one)[3:]])

    def pose_add(a: list[float], b: list[float]) -> Pose:
        one, two = placement(a), placement(b)
        return Pose([*(one.translation + two.translation), *vector(one * two)[3:]])

    def interpolate_pose(a: list[float], b: list[float], share: float) -> Pose:
        one, two = placement(a), placement(b)
        turn = share * vector(one.inverse() * two)[3:]
        way = (1 - share) * one.translation + share * two.translation
        return Pose([*way, *vector(one * placement([0.0, 0.0, 0.0, *turn]))[3:]])

    return {
        "norm": lambda of: hypot(*of) if isinstance(of, list) else abs(of),
        "pose_trans": lambda a, b: pose(placement(a) * placement(b)),
        "pose_inv": lambda a: pose(placement(a).inverse()),
        "pose_sub": pose_sub,
        "pose_add": pose_add,
        "pose_dist": lambda a, b: float(np.linalg.norm(vector(placement(a).inverse() * placement(b))[:3])),
        "interpolate_pose": interpolate_pose,
        "d2r": radians, "r2d": degrees, "sin": sin, "cos": cos, "tan": tan, "atan2": atan2, "sqrt": sqrt,
        "floor": floor, "ceil": ceil, "length": len,
    }  # fmt: skip


def _kinematics(controller: UrController) -> dict[str, Callable[..., Any]]:
    kinematics, motion = controller.kinematics, controller.motion

    def get_inverse_kin(
        x: list[float], qnear: list[float] | None = None, maxPositionError: float = 1e-10,
        maxOrientationError: float = 1e-10, tcp: list[float] | None = None,
    ) -> list[float]:  # fmt: skip
        goal = placement(x) if tcp is None else placement(x) * placement(tcp).inverse() * kinematics.tcp
        if qnear is not None and not bounded(qnear):
            raise ValueError("joint angles are finite")
        near = motion.q if qnear is None else np.array(qnear, dtype=float)
        return near_angles(controller, vector(goal), near, maxPositionError, maxOrientationError)

    def has_solution(*given: Any, **named: Any) -> bool:
        try:
            get_inverse_kin(*given, **named)
        except ScriptError:
            return False
        return True

    def get_forward_kin(q: list[float] | None = None, tcp: list[float] | None = None) -> Pose:
        place = kinematics.forward(motion.q if q is None else q, None if tcp is None else placement(tcp))
        return Pose(vector(place).tolist())

    def is_within_safety_limits(where: list[float]) -> bool:
        if isinstance(where, Pose):
            return has_solution(where)
        return max(map(abs, where)) <= REACH

    return {
        "get_inverse_kin": get_inverse_kin,
        "get_inverse_kin_has_solution": has_solution,
        "get_forward_kin": get_forward_kin,
        "is_within_safety_limits": is_within_safety_limits,
        "get_target_waypoint": lambda: Pose(vector(motion.waypoint()).tolist()),
    }


def _state(controller: UrController) -> dict[str, Callable[..., Any]]:
    def target_speed() -> list[float]:
        q, qd = controller.target()
        return _list(controller.kinematics.jacobian(q) @ qd)

    def tool_contact(direction: Sequence[float] = _ORIGIN) -> int:
        if not bounded(direction):
            raise ValueError("a direction is finite")
        return controller.contact(np.array(direction[:3], dtype=float))

    arm = controller.arm
    return {
        "get_actual_joint_positions": lambda: _list(arm.position),
        "get_actual_joint_speeds": lambda: _list(arm.velocity),
        "get_actual_joint_positions_history": lambda steps=0: _list(controller.past(int(steps))),
        "get_target_joint_positions": lambda: _list(controller.target()[0]),
        "get_target_joint_speeds": lambda: _list(controller.target()[1]),
        "get_joint_torques": lambda: _list(arm.effort - arm.gravity()),
        "get_actual_tcp_pose": lambda: Pose(controller.tool().tolist()),
        "get_target_tcp_pose": lambda: Pose(vector(controller.kinematics.forward(controller.target()[0])).tolist()),
        "get_actual_tcp_speed": lambda: _list(controller.tool_twist()),
        "get_target_tcp_speed": target_speed,
        "get_actual_tool_flange_pose": lambda: Pose(controller.flange().tolist()),
        "get_tcp_force": lambda: _list(controller.wrench),
        "force": lambda: float(np.linalg.norm(controller.wrench[:3])),
        "tool_contact": tool_contact,
        "is_steady": controller.steady,
        "get_steptime": lambda: CYCLE,
        "get_freedrive_status": lambda: 0,
    }


def _settings(controller: UrController, refusals: Refusals) -> dict[str, Callable[..., Any]]:
    motion, force = controller.motion, controller.force

    def force_mode(frame: Any, selection: Any, wrench: Any, kind: int, limits: Any) -> None:
        if kind in (1, 3):
            raise refusals.refuse("force_mode", f"its force frame can't follow the TCP (type {kind})")
        force.set(frame, selection, wrench, int(kind), limits)

    def freedrive_mode(freeAxes: Sequence[float] = (1,) * 6, feature: Sequence[float] = _ORIGIN) -> None:
        if not all(freeAxes):
            raise refusals.refuse("freedrive_mode", "all axes are free, or none")
        motion.free()

    def end_freedrive_mode() -> None:
        if motion.doing == "free":
            motion.halt(controller.arm.position)

    def set_target_payload(
        mass: float, cog: Sequence[float] = (0.0, 0.0, 0.0), inertia: Sequence[float] = _ORIGIN, *_given: Any
    ) -> None:
        if any(inertia):
            raise refusals.refuse("set_target_payload", "it reckons with a payload's mass only, not its inertia")
        controller.set_payload(mass, (cog[0], cog[1], cog[2]))

    def share(name: str, most: float) -> Callable[[float], None]:
        def change(value: float) -> None:
            if not 0 <= value <= most:
                raise ValueError(f"{name} of force mode is 0 to {most:g}")
            setattr(force, name, float(value))

        return change

    return {
        "set_tcp": controller.set_tcp,
        "get_tcp_offset": lambda: Pose(vector(controller.kinematics.tcp).tolist()),
        "set_payload": lambda mass, cog=(0.0, 0.0, 0.0): controller.set_payload(mass, tuple(cog)),
        "set_target_payload": set_target_payload,
        "get_target_payload": lambda: controller.payload[0],
        "get_target_payload_cog": lambda: list(controller.payload[1]),
        "get_target_payload_inertia": lambda: list(_ORIGIN),
        "zero_ftsensor": controller.zero_sensor,
        "force_mode": force_mode,
        "end_force_mode": controller.end_force_mode,
        "force_mode_set_damping": share("damping", 1.0),
        "force_mode_set_gain_scaling": share("gain", 2.0),
        "freedrive_mode": freedrive_mode,
        "end_freedrive_mode": end_freedrive_mode,
        "teach_mode": freedrive_mode,
        "end_teach_mode": end_freedrive_mode,
        "protective_stop": lambda: controller.protective_stop("a program asked for it"),
    }


def _io(controller: UrController, registers: Registers) -> dict[str, Callable[..., Any]]:
    inputs, outputs = registers.inputs, registers.outputs

    def set_digital(number: int, on: bool, first: int = 0, count: int = 18) -> None:
        if not 0 <= number < count:
            raise ValueError(f"there is no digital output {number}")
        bit = 1 << first + number
        controller.outputs = controller.outputs | bit if on else controller.outputs & ~bit

    return {
        "read_input_integer_register": inputs.ints.__getitem__,
        "read_input_float_register": inputs.doubles.__getitem__,
        "read_input_boolean_register": inputs.bits.__getitem__,
        "write_output_integer_register": registers.write_int,
        "write_output_float_register": lambda number, value: outputs.doubles.__setitem__(number, float(value)),
        "write_output_boolean_register": lambda number, value: outputs.bits.__setitem__(number, bool(value)),
        "rtde_set_watchdog": registers.watch,
        "set_digital_out": set_digital,
        "set_standard_digital_out": lambda number, on: set_digital(number, on, 0, 8),
        "set_configurable_digital_out": lambda number, on: set_digital(number, on, 8, 8),
        "set_tool_digital_out": lambda number, on: set_digital(number, on, 16, 2),
        "get_standard_digital_in": lambda number: bool(controller.inputs >> number & 1),
    }
