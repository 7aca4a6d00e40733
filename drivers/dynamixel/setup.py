"""Brings the servos found into the state that the driver needs, without moving them or switching torque off."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import Final

from srl.drivers.dynamixel.config import MotorConfig
from srl.drivers.dynamixel.family import RETURN_DELAY, WATCHDOG, Family2
from srl.drivers.dynamixel.session import Session, find
from srl.drivers.servo_bus.register import Register
from srl.runtime.contracts.errors import DeviceError
from srl.runtime.contracts.signals import Limits

SLAVE: Final = 2  # bit of the drive mode
NO_ID: Final = 255  # of a secondary id
_WIZARD: Final = "Set it with the vendor's DYNAMIXEL Wizard"
_SIZES: Final = {1: 74, 2: 147}  # bytes from address 0 on that are read


@dataclass(frozen=True)
class Bus:
    """The result of setting up the bus.

    Attributes:
        firmware: version by motor.
        limits: the command's limits.
        powered: by motor: its torque is on, from an earlier run.
        errors: by motor: hardware error bits (protocol 2), error bits (protocol 1).
        torque: by motor: the register max_torque (protocol 1), which restores a torque limit that fell to 0.
    """

    firmware: tuple[int, ...]
    limits: Limits
    powered: tuple[bool, ...]
    errors: tuple[int, ...]
    torque: tuple[int, ...]


def set_up(session: Session, scan: bool) -> Bus:
    """Identifies, checks and configures all motors, and arms their watchdogs (protocol 2).

    Raises:
        DeviceError: with the problem, the motor, and the remedy.
    """
    family, config = session.family, session.family.config
    found = find(session, scan)
    memories, errors = [], []
    for i, (name, motor) in enumerate(config.motors.items()):
        memory, error = _look(session, i, name, motor.id)
        table = family.tables[i]
        _check(session, name, motor, table, memory)
        if isinstance(family, Family2):
            error = table["hardware_error_status"].decode(memory)
            wanted = {"operating_mode": family.MODES[config.mode]}
        else:
            wanted = _limits1(session, name, motor.id, table, memory)
        powered = bool(table["torque_enable"].decode(memory))
        if config.return_delay is not None and not powered:
            wanted["return_delay_time"] = round(config.return_delay / RETURN_DELAY)
        memory = _settle(session, name, motor.id, table, memory, wanted)
        low, high = family.own_range(i, memory)
        if not low < high:
            raise DeviceError(
                session.place,
                f"the position limits of '{name}' (id {motor.id}), {low:g} to {high:g}, leave no room",
                _WIZARD,
            )
        _volatile(session, name, motor.id, table, memory)
        family.take_up_turns(i, table["present_position"].decode(memory))
        memories.append(memory)
        errors.append(error)
    registers = family.tables
    return Bus(
        tuple(firmware for _, firmware in found),
        family.set_limits(memories),
        tuple(bool(t["torque_enable"].decode(m)) for t, m in zip(registers, memories, strict=True)),
        tuple(errors),
        tuple(t["max_torque"].decode(m) if "max_torque" in t else 0 for t, m in zip(registers, memories, strict=True)),
    )


def watchdog_code(seconds: float) -> int:
    """Returns the watchdog register's value for at least this time."""
    return min(max(ceil(seconds / WATCHDOG - 1e-9), 1), 127)


def _look(session: Session, i: int, name: str, id: int) -> tuple[bytes, int]:
    """Returns a motor's registers from address 0 on, and the error bits of its answer."""
    family = session.family
    size = _SIZES[family.protocol]
    frame = family.wire.read(id, 0, size)
    status = session.ask(frame, id, size)
    if status is None:
        # It answers pings only: its status return level is 0.
        level = family.tables[i]["status_return_level"]
        session.tell(family.wire.write(id, level.address, b"\2"))
        status = session.ask(frame, id, size)
    if status is None or len(status.data) != size:
        raise DeviceError(
            session.place,
            f"'{name}' (id {id}) answers pings, but not when its registers are read",
            f"Its status return level must be 2. {_WIZARD}; else check the bus' cables",
        )
    return status.data, status.error


def _check(session: Session, name: str, motor: MotorConfig, table: dict[str, Register], memory: bytes) -> None:
    """Raises DeviceError for a servo whose memory gives a position, a goal or a limit another meaning."""
    config, who = session.family.config, f"'{name}' (id {motor.id})"
    found = {key: register.decode(memory) for key, register in table.items() if register.end <= len(memory)}
    if found.get("drive_mode", 0) & SLAVE:
        raise DeviceError(
            session.place, f"{who} is set up as the slave of another servo (drive mode {found['drive_mode']})", _WIZARD
        )
    meant = {"drive_mode": int(motor.reverse_mode), "multi_turn_offset": 0, "resolution_divider": 1}
    meant |= {"homing_offset": motor.offset}
    options = {"drive_mode": "reverse_mode: true", "homing_offset": f"offset: {found.get('homing_offset')}"}
    for key, wanted in meant.items():
        if (value := found.get(key, wanted)) == wanted:
            continue
        remedy = _WIZARD
        if key == "homing_offset" or (key == "drive_mode" and value in (0, 1)):
            remedy += f"; if it is meant, say '{options[key]}' and measure 'zero' and 'reversed' anew"
        problem = f"the {key.replace('_', ' ')} of {who} is {value}, the profile says {wanted}"
        raise DeviceError(session.place, problem, remedy)
    if found.get("secondary_id", NO_ID) in set(config.ids) - {motor.id}:
        problem = f"the secondary id of {who} is {found['secondary_id']}, another motor's id: it obeys that one's goals"
        raise DeviceError(session.place, problem, f"{_WIZARD} to {NO_ID}")
    for key in ("pwm_limit", "velocity_limit", "current_limit", "max_torque"):
        if found.get(key, 1) == 0:
            raise DeviceError(session.place, f"the {key.replace('_', ' ')} of {who} is 0: it couldn't move", _WIZARD)


def _limits1(session: Session, name: str, id: int, table: dict[str, Register], memory: bytes) -> dict[str, int]:
    """Returns the angle limits that protocol 1 needs for the mode.

    Protocol 1 has no operating mode: both angle limits 0 mean a wheel, both 4095 mean several turns.
    """
    low, high = table["cw_angle_limit"].decode(memory), table["ccw_angle_limit"].decode(memory)
    mode = session.family.config.mode
    joint = not low == high == 0 and not low == high == 4095
    if mode in ("position", "effort"):
        return {} if joint else {"cw_angle_limit": 0, "ccw_angle_limit": 4095}
    wanted = 0 if mode == "velocity" else 4095
    if joint and (low, high) != (0, 4095):
        raise DeviceError(
            session.place,
            f"'{name}' (id {id}) has angle limits {low} to {high}, which mode '{mode}' would overwrite with {wanted}",
            f"Set both limits to {wanted} with the vendor's DYNAMIXEL Wizard, if that is wanted",
        )
    return {"cw_angle_limit": wanted, "ccw_angle_limit": wanted}


def _settle(
    session: Session, name: str, id: int, table: dict[str, Register], memory: bytes, wanted: dict[str, int]
) -> bytes:
    """Writes non-volatile registers that differ; returns the registers afterwards."""
    for key, value in wanted.items():
        register = table[key]
        present = register.decode(memory)
        if present == value:
            continue
        what = key.replace("_", " ")
        if not session.family.config.configure:
            raise DeviceError(
                session.place,
                f"the {what} of '{name}' (id {id}) is {present}, the profile needs {value}",
                "Set 'configure: true', or set it with the vendor's DYNAMIXEL Wizard",
            )
        if table["torque_enable"].decode(memory):
            raise DeviceError(
                session.place,
                f"the {what} of '{name}' (id {id}) is {present}, the profile needs {value}, and its torque is on",
                "Support the limb, switch the servos' power off and on, then try again",
            )
        session.write(name, id, register, value, what)
        memory = memory[: register.address] + register.encode(value) + memory[register.end :]
    return memory


def _volatile(session: Session, name: str, id: int, table: dict[str, Register], memory: bytes) -> None:
    """Sets the volatile registers: answers to every packet, no motion profile of its own, the watchdog armed.

    A servo with torque on keeps its goal position, so it continues to hold; other goals become 0.
    """
    family, config = session.family, session.family.config
    if not isinstance(family, Family2):
        wanted = {"goal_acceleration": 0}
        if "torque_control_mode" in table:
            if config.mode == "effort":
                wanted["goal_torque"] = 0
            wanted["torque_control_mode"] = int(config.mode == "effort")
        wanted["moving_speed"] = 0
    else:
        i = config.ids.index(id)
        family.bound_effort(i, memory)
        wanted = family.volatile(i)
    level = table["status_return_level"]
    if level.decode(memory) != 2:
        session.tell(family.wire.write(id, level.address, level.encode(2)))
    for key, value in wanted.items():
        # The watchdog may trip in the meantime, so it is cleared whatever value was read. The same holds for goals.
        if key in ("bus_watchdog", "goal_velocity", "goal_current") or table[key].decode(memory) != value:
            session.write(name, id, table[key], value, key.replace("_", " "))
    if family.protocol == 2:
        register = table["bus_watchdog"]
        session.write(name, id, register, watchdog_code(config.watchdog), "bus watchdog")
