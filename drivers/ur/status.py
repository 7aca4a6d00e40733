"""The controller's status, as numbers and in words. Source: protocol sheet ur-rtde, sections 3, 4."""

from __future__ import annotations

from enum import IntEnum, IntFlag
from typing import Final


class RobotMode(IntEnum):
    """RTDE `robot_mode`; with the dashboard's names."""

    NO_CONTROLLER = -1
    DISCONNECTED = 0
    CONFIRM_SAFETY = 1
    BOOTING = 2
    POWER_OFF = 3
    POWER_ON = 4
    IDLE = 5
    BACKDRIVE = 6
    RUNNING = 7
    UPDATING_FIRMWARE = 8


class SafetyMode(IntEnum):
    """RTDE `safety_mode` and, from 12 on, `safety_status`; with the dashboard's names."""

    NORMAL = 1
    REDUCED = 2
    PROTECTIVE_STOP = 3
    RECOVERY = 4
    SAFEGUARD_STOP = 5
    SYSTEM_EMERGENCY_STOP = 6
    ROBOT_EMERGENCY_STOP = 7
    VIOLATION = 8
    FAULT = 9
    VALIDATE_JOINT_ID = 10
    UNDEFINED = 11
    AUTOMATIC_MODE_SAFEGUARD_STOP = 12
    SYSTEM_THREE_POSITION_ENABLING_STOP = 13


class SafetyBits(IntFlag):
    """RTDE `safety_status_bits`."""

    NORMAL = 1 << 0
    REDUCED = 1 << 1
    PROTECTIVE_STOP = 1 << 2
    RECOVERY = 1 << 3
    SAFEGUARD_STOP = 1 << 4
    SYSTEM_EMERGENCY_STOP = 1 << 5
    ROBOT_EMERGENCY_STOP = 1 << 6
    EMERGENCY_STOP = 1 << 7
    VIOLATION = 1 << 8
    FAULT = 1 << 9
    STOPPED = 1 << 10
    THREE_POSITION_ENABLING = 1 << 11


class RobotBits(IntFlag):
    """RTDE `robot_status_bits`."""

    POWER_ON = 1 << 0
    PROGRAM_RUNNING = 1 << 1
    TEACH_BUTTON = 1 << 2
    POWER_BUTTON = 1 << 3


class RuntimeState(IntEnum):
    """RTDE `runtime_state`: the state of the program."""

    STOPPING = 0
    STOPPED = 1
    PLAYING = 2
    PAUSING = 3
    PAUSED = 4
    RESUMING = 5


_EMERGENCY: Final = (
    SafetyBits.EMERGENCY_STOP | SafetyBits.ROBOT_EMERGENCY_STOP | SafetyBits.SYSTEM_EMERGENCY_STOP
)  # fmt: skip
_WORDS: Final = (  # the most serious first
    (SafetyBits.FAULT, "fault: restart the safety system at the pendant"),
    (SafetyBits.VIOLATION, "safety violation: restart the safety system at the pendant"),
    (_EMERGENCY, "emergency stop: release the button, then switch the arm on"),
    (SafetyBits.PROTECTIVE_STOP, "protective stop: find out what the arm hit, then reset"),
    (SafetyBits.SAFEGUARD_STOP, "safeguard stop: clear the guarded area"),
    (SafetyBits.THREE_POSITION_ENABLING, "three-position switch: hold it in its middle position"),
    (SafetyBits.RECOVERY, "recovery: bring the arm back within its safety limits at the pendant"),
    (SafetyBits.STOPPED, "stopped by the safety system"),
)


def safety_words(bits: int) -> str:
    """Returns why the safety system keeps the arm from moving and what the user can do; "" if it doesn't."""
    if not bits & ~(SafetyBits.NORMAL | SafetyBits.REDUCED):
        return ""
    for bit, words in _WORDS:
        if bits & bit:
            return words
    return ""


def name_of(kind: type[IntEnum], number: int) -> str:
    """Returns the name of a mode, or its number if it has none."""
    return kind(number).name if number in kind._value2member_map_ else str(number)
