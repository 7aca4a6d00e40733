"""The servos' registers: address, size, access, range and default (sheet dynamixel, §4 and §5)."""

from __future__ import annotations

from typing import Final

from srl.drivers.dynamixel.models import Model
from srl.drivers.servo_bus.register import Register


def _r(address: int, size: int, signed: bool = False) -> Register:
    return Register(address, size, writable=False, signed=signed)


def _e(address: int, size: int, default: int, low: int, high: int, signed: bool = False) -> Register:
    return Register(address, size, eeprom=True, default=default, low=low, high=high, signed=signed)


def _w(address: int, size: int, default: int = 0, low: int = 0, high: int | None = None) -> Register:
    return Register(address, size, default=default, low=low, high=high, signed=low < 0)


Table = dict[str, Register]

TURNS: Final = 1_048_575  # counts in either direction in extended position mode
MULTI_TURN: Final = 28_672  # counts in either direction in multi-turn mode, protocol 1

# The numbers of the operating modes in the control table of protocol 2.
CURRENT, VELOCITY, POSITION, EXTENDED, CURRENT_POSITION, PWM = 0, 1, 3, 4, 5, 16


def table2(model: Model) -> Table:
    """Returns the registers of firmware of protocol 2."""
    series, gains = model.series, model.gains
    (lowest, highest), fastest = series.voltage_range, series.velocity_range
    table = {
        "model_number": _r(0, 2),
        "model_information": _r(2, 4),
        "firmware_version": _r(6, 1),
        "id": _e(7, 1, 1, 0, 252),
        "baud_rate": _e(8, 1, 1, 0, series.bauds),
        "return_delay_time": _e(9, 1, 250, 0, 254),
        "drive_mode": _e(10, 1, 0, 0, 7),
        "operating_mode": _e(11, 1, POSITION, 0, 16),
        "secondary_id": _e(12, 1, 255, 0, 255),
        "protocol_type": _e(13, 1, 2, 1, 2),
        "homing_offset": _e(20, 4, 0, -1_044_479, 1_044_479, signed=True),
        "moving_threshold": _e(24, 4, 10, 0, 1023),
        "temperature_limit": _e(31, 1, series.temperature, 0, 100),
        "max_voltage_limit": _e(32, 2, series.voltages[1], lowest, highest),
        "min_voltage_limit": _e(34, 2, series.voltages[0], lowest, highest),
        "pwm_limit": _e(36, 2, 885, 0, 885),
        "velocity_limit": _e(44, 4, model.velocity_limit, 0, fastest),
        "max_position_limit": _e(48, 4, 4095, 0, 4095),
        "min_position_limit": _e(52, 4, 0, 0, 4095),
        "shutdown": _e(63, 1, series.shutdown, 0, 0x3D),
        "torque_enable": _w(64, 1, high=1),
        "status_return_level": _w(68, 1, 2, high=2),
        "registered_instruction": _r(69, 1),
        "hardware_error_status": _r(70, 1),
        "velocity_i_gain": _w(76, 2, gains.velocity_i, high=16383),
        "velocity_p_gain": _w(78, 2, gains.velocity_p, high=16383),
        "position_d_gain": _w(80, 2, gains.position_d, high=16383),
        "position_i_gain": _w(82, 2, gains.position_i, high=16383),
        "position_p_gain": _w(84, 2, gains.position_p, high=16383),
        "feedforward_2nd_gain": _w(88, 2, 0, high=16383),
        "feedforward_1st_gain": _w(90, 2, 0, high=16383),
        "bus_watchdog": _w(98, 1, 0, -1, 127),
        "goal_pwm": _w(100, 2, 885, -885, 885),
        "goal_velocity": _w(104, 4, 0, -fastest, fastest),
        "profile_acceleration": _w(108, 4, 0, high=32767),
        "profile_velocity": _w(112, 4, 0, high=32767),
        "goal_position": _w(116, 4, 0, -TURNS, TURNS),
        "realtime_tick": _r(120, 2),
        "moving": _r(122, 1),
        "moving_status": _r(123, 1),
        "present_pwm": _r(124, 2, signed=True),
        "present_velocity": _r(128, 4, signed=True),
        "present_position": _r(132, 4, signed=True),
        "velocity_trajectory": _r(136, 4, signed=True),
        "position_trajectory": _r(140, 4, signed=True),
        "present_input_voltage": _r(144, 2),
        "present_temperature": _r(146, 1),
    }
    if model.senses_current:
        limit = model.current_limit
        table["current_limit"] = _e(38, 2, limit, 0, limit)
        table["goal_current"] = _w(102, 2, limit, -limit, limit)
        table["present_current"] = _r(126, 2, signed=True)
    else:
        table["present_load"] = _r(126, 2, signed=True)
    if series.acceleration_limit:
        table["acceleration_limit"] = _e(40, 4, 32767, 0, 32767)
    if series.led:
        table["led"] = _w(65, 1, high=1)
    if series.slope:
        table["pwm_slope"] = _e(62, 1, series.slope, 1, 255)
    if series.ports:
        for k in range(3):
            table[f"external_port_mode_{k + 1}"] = _e(56 + k, 1, 3, 0, 3)
            table[f"external_port_data_{k + 1}"] = _w(152 + 2 * k, 2)
    end = max(data + count for _, data, count in series.indirect) - 1
    number = 0
    for addresses, data, count in series.indirect:
        for k in range(count):
            number += 1
            # By default, as in a new servo, an indirect address refers to its own indirect data.
            table[f"indirect_address_{number}"] = _w(addresses + 2 * k, 2, data + k, 64, end)
            table[f"indirect_data_{number}"] = _w(data + k, 1)
    return table


def table1(model: Model) -> Table:
    """Returns the registers of protocol 1. Speeds, loads and torques have their sign in bit 10, set for clockwise."""
    table = {
        "model_number": _r(0, 2),
        "firmware_version": _r(2, 1),
        "id": _e(3, 1, 1, 0, 252),
        "baud_rate": _e(4, 1, 34, 0, 252),
        "return_delay_time": _e(5, 1, 250, 0, 254),
        "cw_angle_limit": _e(6, 2, 0, 0, 4095),
        "ccw_angle_limit": _e(8, 2, 4095, 0, 4095),
        **({"drive_mode": _e(10, 1, 0, 0, 3)} if model.name == "MX-106" else {}),
        "temperature_limit": _e(11, 1, 80, 0, 99),
        "min_voltage_limit": _e(12, 1, 60, 50, 250),
        "max_voltage_limit": _e(13, 1, 160, 50, 250),
        "max_torque": _e(14, 2, 1023, 0, 1023),
        "status_return_level": _e(16, 1, 2, 0, 2),
        "alarm_led": _e(17, 1, 36, 0, 127),
        "shutdown": _e(18, 1, 36, 0, 127),
        "multi_turn_offset": _e(20, 2, 0, -26_624, 26_624, signed=True),
        "resolution_divider": _e(22, 1, 1, 1, 4),
        "torque_enable": _w(24, 1, high=1),
        "led": _w(25, 1, high=1),
        "position_d_gain": _w(26, 1, 0, high=254),
        "position_i_gain": _w(27, 1, 0, high=254),
        "position_p_gain": _w(28, 1, 32, high=254),
        "goal_position": _w(30, 2, 0, -MULTI_TURN, MULTI_TURN),
        "moving_speed": _w(32, 2, 0, high=2047),
        "torque_limit": _w(34, 2, 1023, high=1023),
        "present_position": _r(36, 2, signed=True),
        "present_speed": _r(38, 2),
        "present_load": _r(40, 2),
        "present_voltage": _r(42, 1),
        "present_temperature": _r(43, 1),
        "registered": _r(44, 1),
        "moving": _r(46, 1),
        "lock": _w(47, 1, high=1),
        "punch": _w(48, 2, 0, high=1023),
        "realtime_tick": _r(50, 2),
        "goal_acceleration": _w(73, 1, 0, high=254),
    }
    if model.senses_current:
        table["current"] = _r(68, 2)
        table["torque_control_mode"] = _w(70, 1, high=1)
        table["goal_torque"] = _w(71, 2, high=2047)
    return table


def table(model: Model, protocol: int) -> Table:
    """Returns the registers of a model with firmware of a protocol, by the vendor's names as slugs."""
    return table1(model) if protocol == 1 else table2(model)


BAUDS2: Final = (9600, 57600, 115200, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000)
_BAUDS1: Final = {250: 2_250_000, 251: 2_500_000, 252: 3_000_000}


def baudrate(code: int, protocol: int) -> int:
    """Returns the bit/s for a register's code; 0 for a code without meaning."""
    if protocol == 2:
        return BAUDS2[code] if code < len(BAUDS2) else 0
    return _BAUDS1.get(code, 2_000_000 // (code + 1))


def baud_code(rate: int, protocol: int) -> int | None:
    """Returns the code whose rate a UART at `rate` bit/s still understands (within 2 %); None if there is none."""
    codes = range(len(BAUDS2)) if protocol == 2 else range(253)
    near = min(codes, key=lambda code: abs(baudrate(code, protocol) - rate))
    return near if abs(baudrate(near, protocol) / rate - 1) < 0.02 else None
