"""Where the simulated world would silently differ from what the laws know: refused, with what to write."""

from __future__ import annotations

import pytest

from srl.runtime.contracts.errors import ProfileError, WiringError
from srl.runtime.profile import profile, wiring
from srl.testing import simulate

TWO_BOARDS = """
name: two
rate: 100
devices:
  one: {driver: firmata, port: /dev/a, servos: {abduction: {pin: 9, lower: -1.5, upper: 1.5, home: 0}}}
  two: {driver: firmata, port: /dev/b, servos: {k: {pin: 9, lower: -1.5, upper: 1.5, home: 0}}}
setpoints: {client.q: {shape: [2], unit: rad, labels: [a, b], max_age: 1}}
controllers:
  - use: joint-setpoint
    name: jog
    joints: [a, b]
    in: {target: client.q}
    out: {q: {to: [one.position_command, two.position_command], map: {a: abduction, b: k}}}
guard: {one.position_command: {velocity: 1, acceleration: 5}, two.position_command: {velocity: 1, acceleration: 5}}
sim:
  world: cell
  parts: {hand: {part: human-hand}, finger: {part: robotic-finger, at: hand/base}}
  devices: {two: {joints: {k: abduction}}}
"""


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("moca-man", "sim.parts.arm.at={parent: base, position: [0.5, 0, 0.5]}", ["frames.arm", "off_by"]),
        ("moca-man", "sim.parts.sensor.at=tool", ["measures in 'handle'", "at: handle"]),
        ("moca-man", "frames.finger={parent: hand}", ["'hand' is a device that has no frame of its own", "hand: {"]),
        ("moca-man", "frames.tool.parent=arm/flnage", ["no link 'flnage'", "arm/flange"]),
        ("moca-man", "frames.base={parent: world}", ["'base' moves", "pose: base.pose"]),
        ("moca-man", "frames.base.position=[0, 0, 1]", ["own place would count again"]),
        ("moca-man", "devices.arm.frame=base", ["'frame' is gone", "the device's name"]),
        ("moca-man", "sim.parts.grip.at={xyz: [0, 0, 1]}", ["sim.parts.grip.at", "'position'"]),
        ("kairos-man", "controllers.4.force_feedback={axes: tool}", ["axes: sensor"]),
        ("kairos-man", "controllers.1.mount={position: [0, 0, 1]}", ["'mount' is gone", "frames:"]),
        ("kairos-man", "controllers.2.sensor_position=[0, 0, 1]", ["'sensor_position' is gone", "frames:"]),
        ("kairos-man", "sim.parts.arm.on=base/deck", ["'on' is gone", "at: PART/BODY"]),
        ("kairos-man", "frames.arm.xyz=[0, 0, 1]", ["'xyz' is gone", "'position'"]),
        ("sixth-finger", "sim.world=augmented-hand", ["made of parts", "robotic-finger"]),
        ("sixth-finger", "models={left: {kind: hand, side: left}}", ["left", "names none of them"]),
    ],
)
def test_what_is_said_twice_or_in_the_old_way_is_refused(name: str, change: str, words: list[str]) -> None:
    with pytest.raises((WiringError, ProfileError)) as caught:
        wiring.build(*profile.load(name, [change]), [])
    for word in words:
        assert word in str(caught.value)


def test_one_simulated_servo_is_turned_by_one_board() -> None:
    with pytest.raises(WiringError, match="'one' turns the world's servo 'abduction' already"):
        simulate(TWO_BOARDS, 0.1)
