"""A table, an object, and a finger on an ideally carried hand that doesn't grasp: what the finger itself can do."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from srl.runtime.loop.lockstep import Lockstep
from srl.sim.parts.hand.ycb import YCB
from srl.studies.ikns.grasp import Carried, Task
from srl.studies.simulated import lockstep

START: Final = (0.0, -0.15)  # m, as the table's marks
GOAL: Final = (0.0, 0.15)
SERVO: Final = {"stall_torque": 0.22, "no_load_speed": 13.0, "stiffness": 4.7, "damping": 0.08}
"""A micro servo with metal gears, as MG90S at 6 V: 2.2 kg cm, 0.08 s for 60 degrees. The gains of its position loop
are the standard servo's, scaled with the torque."""

_PROFILE: Final = """
name: finger-grasp
summary: a finger closes an object against a hand
rate: 100
devices:
  finger:
    driver: firmata
    port: /dev/null
    servos:
      abduction: {pin: 9, lower: -1.571, upper: 1.571, home: 0.0}
      flexion_1: {pin: 10, lower: -1.571, upper: 1.571, home: -0.3}
      flexion_2: {pin: 11, lower: -1.571, upper: 1.571, home: 0.0}
      flexion_3: {pin: 6, lower: -1.571, upper: 1.571, home: 0.0}
setpoints:
  client.c: {shape: [1], unit: "1", max_age: 0.5}
  client.c_rate: {shape: [1], unit: "1/s", max_age: 0.5}
controllers:
  - use: finger-closure
    name: closure
    open: {abduction: 0.0, flexion_1: -0.3, flexion_2: 0.0, flexion_3: 0.0}
    closed: {abduction: 0.0, flexion_1: 1.2, flexion_2: 1.2, flexion_3: 1.0}
    in: {c: client.c, c_rate: client.c_rate}
    out: {q: finger.position_command, q_velocity: finger.position_command.velocity}
guard:
  finger.position_command:
    lower: {abduction: -1.047, flexion_1: -1.571, flexion_2: -1.571, flexion_3: -1.571}
    upper: {abduction: 1.047, flexion_1: 1.571, flexion_2: 1.571, flexion_3: 1.571}
    velocity: 4.0
    acceleration: 40.0
stop: {finger: hold}
faults: {bus-loss: hold}
sim:
  world: cell
  parts:
    table: {part: table}
    arm: {part: carrier, at: {position: [-0.3, -0.4, 0.15], quaternion: [0.5, 0.5, 0.5, -0.5]}}
    hand: {part: passive-hand, at: arm/body}
    finger:
      part: robotic-finger
      at: {parent: hand/base, position: [0.0, -0.020, -0.030], quaternion: [0.5, -0.5, 0.5, 0.5]}
"""
"""A finger that follows the setpoint `client.c`."""


def carried_cell(
    code: str,
    *,
    seed: int = 1,
    servo: Mapping[str, Any] = SERVO,
    thing: Mapping[str, Any] | None = None,
    hand: Mapping[str, Any] | None = None,
    **task: Any,
) -> tuple[Lockstep, Carried, Task]:
    """The running cell, who grasps in it, and what is to be done.

    Args:
        code: of the object.
        servo, thing, hand: options of the finger's servos, of the object and of the passive hand.
        task: what differs in the task.
    """
    # The object stands a little above the table, so that it doesn't begin inside it.
    at = {"position": [*START, YCB[code].height / 2 + 1e-4]}
    values = {
        "seed": seed,
        "sim.parts.thing": {"part": "object", "shape": "ycb", "code": code, "at": at, **(thing or {})},
        "sim.parts.finger.servo": dict(servo),
        **{f"sim.parts.hand.{key}": value for key, value in (hand or {}).items()},
    }
    made = lockstep(_PROFILE, values)
    return made, Carried(made, "arm", "client.c"), Task(START, GOAL, **task)
