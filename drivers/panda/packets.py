"""FCI's datagrams: the robot's state at 1 kHz and the command that answers it. No I/O.

Little-endian, packed. Source: protocol sheet franka-fci, section 4. Both are numpy records, so that a reader
takes just the fields it needs from the received bytes:

    state = decode_state(10, data); state["q"]         # (7,) rad
    command = command_record(5); command["tau_J_d"] = 0.1; data = command.tobytes()

Matrices are 4x4 homogeneous transforms (16,) or 3x3 inertias (9,), column by column. Units: m, rad, s, kg, N, N m.
"""

from __future__ import annotations

from enum import IntEnum
from functools import cache

import numpy as np

ROOM = 297, 47  # doubles that hold a state and a command of any version: their bytes, for C (native/panda.c)
VERSIONS = (5, 10)  # protocol versions: 5 is the last of the Panda (FER), 10 the FR3 from system 5.9
JOINTS = 7


class Generator(IntEnum):
    """The kind of a motion, as a state reports it; `Move` uses the same number minus one."""

    IDLE = 0
    JOINT_POSITION = 1
    JOINT_VELOCITY = 2
    CARTESIAN_POSITION = 3
    CARTESIAN_VELOCITY = 4
    NONE = 5  # torque alone; from protocol 7


class Controller(IntEnum):
    """The controller that turns the motion into torques."""

    JOINT_IMPEDANCE = 0
    CARTESIAN_IMPEDANCE = 1
    EXTERNAL = 2  # the client's torques
    OTHER = 3


class RobotMode(IntEnum):
    """The robot's operating mode."""

    OTHER = 0
    IDLE = 1
    MOVE = 2
    GUIDING = 3
    REFLEX = 4
    USER_STOPPED = 5
    AUTOMATIC_ERROR_RECOVERY = 6


# The bits of `errors` and `reflex_reason`, in wire order (sheet, section 7).
ERRORS = (
    "joint_position_limits_violation",
    "cartesian_position_limits_violation",
    "self_collision_avoidance_violation",
    "joint_velocity_violation",
    "cartesian_velocity_violation",
    "force_control_safety_violation",
    "joint_reflex",
    "cartesian_reflex",
    "max_goal_pose_deviation_violation",
    "max_path_pose_deviation_violation",
    "cartesian_velocity_profile_safety_violation",
    "joint_position_motion_generator_start_pose_invalid",
    "joint_motion_generator_position_limits_violation",
    "joint_motion_generator_velocity_limits_violation",
    "joint_motion_generator_velocity_discontinuity",
    "joint_motion_generator_acceleration_discontinuity",
    "cartesian_position_motion_generator_start_pose_invalid",
    "cartesian_motion_generator_elbow_limit_violation",
    "cartesian_motion_generator_velocity_limits_violation",
    "cartesian_motion_generator_velocity_discontinuity",
    "cartesian_motion_generator_acceleration_discontinuity",
    "cartesian_motion_generator_elbow_sign_inconsistent",
    "cartesian_motion_generator_start_elbow_invalid",
    "force_controller_desired_force_tolerance_violation",
    "start_elbow_sign_inconsistent",
    "communication_constraints_violation",
    "power_limit_violation",
    "cartesian_motion_generator_joint_position_limits_violation",
    "cartesian_motion_generator_joint_velocity_limits_violation",
    "cartesian_motion_generator_joint_velocity_discontinuity",
    "cartesian_motion_generator_joint_acceleration_discontinuity",
    "cartesian_position_motion_generator_invalid_frame",
    "controller_torque_discontinuity",
    "joint_p2p_insufficient_torque_for_planning",
    "tau_j_range_violation",
    "instability_detected",
    "joint_move_in_wrong_direction",
    "cartesian_spline_motion_generator_violation",
    "joint_via_motion_generator_planning_joint_limit_violation",
    "base_acceleration_initialization_timeout",
    "base_acceleration_invalid_reading",
)

# Name and length of the state's real numbers, after the message id and in wire order.
_REALS = (
    ("O_T_EE", 16), ("O_T_EE_d", 16), ("F_T_EE", 16), ("EE_T_K", 16), ("F_T_NE", 16), ("NE_T_EE", 16),
    ("m_ee", 1), ("I_ee", 9), ("F_x_Cee", 3), ("m_load", 1), ("I_load", 9), ("F_x_Cload", 3),
    ("elbow", 2), ("elbow_d", 2), ("tau_J", 7), ("tau_J_d", 7), ("dtau_J", 7),
    ("q", 7), ("q_d", 7), ("dq", 7), ("dq_d", 7), ("ddq_d", 7),
    ("joint_contact", 7), ("cartesian_contact", 6), ("joint_collision", 7), ("cartesian_collision", 6),
    ("tau_ext_hat_filtered", 7), ("O_F_ext_hat_K", 6), ("K_F_ext_hat_K", 6),
    ("O_dP_EE_d", 6), ("O_ddP_O", 3), ("elbow_c", 2), ("delbow_c", 2), ("ddelbow_c", 2),
    ("O_T_EE_c", 16), ("O_dP_EE_c", 6), ("O_ddP_EE_c", 6), ("theta", 7), ("dtheta", 7),
)  # fmt: skip


@cache
def state_dtype(version: int) -> np.dtype[np.void]:
    """The layout of a RobotState: 2373 bytes in protocol 5 (float64), 1377 in 10 (float32)."""
    real = "<f8" if _known(version) == 5 else "<f4"
    fields: list[tuple[str, str, int]] = [("message_id", "<u8", 1)]
    fields += [(name, real, size) for name, size in _REALS]
    if version == 10:
        fields += [("accelerometer_top", real, 18), ("accelerometer_bottom", real, 18)]
    fields += [("motion_generator_mode", "u1", 1), ("controller_mode", "u1", 1)]
    fields += [("errors", "?", len(ERRORS)), ("reflex_reason", "?", len(ERRORS)), ("robot_mode", "u1", 1)]
    fields += [("control_command_success_rate", real, 1)]
    return _packed(fields)


@cache
def command_dtype(version: int) -> np.dtype[np.void]:
    """The layout of a RobotCommand: 370 bytes in protocol 5, 371 in 10. `message_id` is that of the state answered."""
    fields = [("message_id", "<u8", 1), ("q_c", "<f8", 7), ("dq_c", "<f8", 7), ("O_T_EE_c", "<f8", 16)]
    fields += [("O_dP_EE_c", "<f8", 6), ("elbow_c", "<f8", 2), ("valid_elbow", "?", 1)]
    fields += [("motion_generation_finished", "?", 1), ("tau_J_d", "<f8", 7)]
    if _known(version) == 10:
        fields += [("torque_command_finished", "?", 1)]
    return _packed(fields)


def state_record(version: int) -> np.ndarray[tuple[()], np.dtype[np.void]]:
    """Returns a RobotState full of zeros, shape (): set its fields by name, then call `tobytes()`."""
    return np.zeros((), state_dtype(version))


def command_record(version: int) -> np.ndarray[tuple[()], np.dtype[np.void]]:
    """Returns a RobotCommand full of zeros, shape (): set its fields by name, then call `tobytes()`."""
    return np.zeros((), command_dtype(version))


def decode_state(version: int, data: bytes) -> np.ndarray[tuple[()], np.dtype[np.void]] | None:
    """Returns a read-only view of a RobotState's bytes by field; None if it is too short.

    A longer one is accepted, as libfranka does: later systems append fields.
    """
    layout = state_dtype(version)
    return np.frombuffer(data, layout, 1).reshape(()) if len(data) >= layout.itemsize else None


def decode_command(version: int, data: bytes) -> np.ndarray[tuple[()], np.dtype[np.void]] | None:
    """Returns a read-only view of a RobotCommand's bytes by field; None if its size is wrong."""
    layout = command_dtype(version)
    return np.frombuffer(data, layout, 1).reshape(()) if len(data) == layout.itemsize else None


def error_names(bits: bytes) -> tuple[str, ...]:
    """The names of the set bits of `errors` or `reflex_reason` (41 bytes, 0 or 1)."""
    return tuple(name for name, bit in zip(ERRORS, bits, strict=False) if bit)


def error_bits(names: tuple[str, ...] | list[str]) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Returns the 41 bits for these names. Raises ValueError for an unknown one."""
    bits = np.zeros(len(ERRORS), np.bool_)
    bits[[ERRORS.index(name) for name in names]] = True
    return bits


def _packed(fields: list[tuple[str, str, int]]) -> np.dtype[np.void]:
    return np.dtype([(name, kind, (size,)) if size > 1 else (name, kind) for name, kind, size in fields])


def _known(version: int) -> int:
    if version not in VERSIONS:
        raise ValueError(f"FCI protocol {version} isn't one of {VERSIONS}")
    return version
