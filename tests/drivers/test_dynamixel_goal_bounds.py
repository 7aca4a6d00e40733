"""No goal on the wire is beyond the servo's own bounds, and what is reported as sent is what was."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.dynamixel import Rig, config, make_twin
from hypothesis import given
from hypothesis import strategies as st

from srl.drivers.dynamixel.family import Family, family
from srl.drivers.servo_bus.models import CENTRE, PER_COUNT
from srl.runtime.contracts.signals import Array

LOW, HIGH = 1024, 3072  # counts: a quarter of a turn to each side
MOTORS: dict[str, dict[str, Any]] = {"shoulder": {"model": "MX-106"}, "elbow": {"model": "MX-64", "reversed": True}}
# The registers that bound each mode's goals, and the largest goal; of protocol 1's speeds and torques it is fixed.
MODES = {
    (2, "position"): ({"min_position_limit": LOW, "max_position_limit": HIGH}, (LOW, HIGH)),
    (1, "position"): ({"cw_angle_limit": LOW, "ccw_angle_limit": HIGH}, (LOW, HIGH)),
    (2, "extended"): ({}, (-1_048_575, 1_048_575)),
    (1, "extended"): ({}, (-28_672, 28_672)),
    (2, "velocity"): ({"velocity_limit": 100}, (-100, 100)),
    (1, "velocity"): ({}, (-1023, 1023)),
    (2, "effort"): ({"current_limit": 200}, (-200, 200)),
    (1, "effort"): ({}, (-1023, 1023)),
}
ALL = pytest.mark.parametrize(("protocol", "mode"), MODES)
commands = st.one_of(st.floats(-20, 20), st.floats(-1e5, 1e5), st.floats(-1e300, 1e300))


def servos(protocol: int, mode: str) -> Family:
    """Two servos, the second reversed, whose own registers bound the goals."""
    made = family(config(MOTORS, protocol=protocol, mode=mode))
    registers, _ = MODES[protocol, mode]
    memories = []
    for table in made.tables:
        memory = bytearray(1024)
        for name, register in table.items():
            memory[register.address : register.end] = register.encode(registers.get(name, register.default))
        memories.append(bytes(memory))
    made.set_limits(memories)
    return made


def on_the_wire(made: Family, packet: bytes) -> list[int]:
    """The goals of a packet, in its order, as the servos understand them."""
    parser: Any = made.parser()
    (instruction,) = parser.instructions(packet)
    size, head = made.goal.size, 2 * (2 if made.protocol == 2 else 1)
    body, goals = instruction.data[head:], []
    for at in range(0, len(body), 1 + size):
        raw = int.from_bytes(body[at + 1 : at + 1 + size], "little", signed=made.goal.signed)
        if made.protocol == 1 and made.mode in ("velocity", "effort"):
            raw = -(raw & 0x3FF) if raw & 0x400 else raw
        goals.append(raw)
    return goals


@ALL
@pytest.mark.parametrize("much", [20.0, 1e4, 1e12, 1e300, 1.7e308])
@pytest.mark.parametrize("way", [1, -1])
def test_a_command_beyond_them_is_the_bound_itself(protocol: int, mode: str, much: float, way: int) -> None:
    made = servos(protocol, mode)
    low, high = MODES[protocol, mode][1]
    far = max(much, 1e4) if mode == "extended" else much
    goals = on_the_wire(made, made.encode(np.full(2, way * far)))
    assert goals == ([high, low] if way > 0 else [low, high])


@ALL
@given(pairs=st.lists(st.tuples(commands, commands), min_size=1, max_size=3))
def test_what_counts_as_sent_is_the_goal_on_the_wire(
    protocol: int, mode: str, pairs: list[tuple[float, float]]
) -> None:
    made = servos(protocol, mode)
    low, high = MODES[protocol, mode][1]
    positions = mode in ("position", "extended")
    zero, unit = (CENTRE, PER_COUNT * np.array([1.0, -1.0])) if positions else (0, made.unit)
    for pair in pairs:
        command = np.array(pair)
        goals, sent = np.array(on_the_wire(made, made.encode(command))), made.bounded(command)
        assert ((low <= goals) & (goals <= high)).all()
        assert (np.abs((goals - zero) * unit - sent) <= 0.51 * np.abs(unit)).all()


@pytest.mark.parametrize("protocol", [1, 2])
def test_a_driver_that_is_told_too_much_says_what_it_sent(protocol: int) -> None:
    twin = make_twin(MOTORS, protocol=protocol)
    for servo in twin.servos:
        for name, value in MODES[protocol, "position"][0].items():
            servo.put(name, value)
    with Rig(twin) as rig:
        rig.hold()
        sent: Array = rig.driver.sent_arrays["position_command"]
        for far, end in ((9.0, np.pi / 2), (-9.0, -np.pi / 2)):
            rig.run(3, [far, far])
            assert sent == pytest.approx([end, end], abs=PER_COUNT)
