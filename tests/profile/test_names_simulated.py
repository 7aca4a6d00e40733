"""Wiring by name, simulated: the joint that moves is the one that is named, whatever stands where."""

from __future__ import annotations

import re

import numpy as np
import pytest

from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.header import DEVICE, LINK_CONNECTED, State
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.profile import profile, wiring
from srl.testing import Simulated, simulate

SERVOS = ("abduction", "flexion_1", "flexion_2", "flexion_3")
COMMAND = "finger.position_command"


def servo_lines(text: str) -> dict[str, str]:
    return {name: re.findall(rf"      {name}: \{{pin.*\n", text)[0] for name in SERVOS}


def by_name(run: Simulated, signal: str) -> dict[str, Array]:
    return dict(zip(run.layout.fields[signal].labels, run.value(signal).T, strict=True))


@pytest.fixture(scope="module")
def usual() -> dict[str, Array]:
    """How the finger's joints move in the shipped profile."""
    moved = by_name(simulate(profile.find("sixth-finger")[1], 3), "world.finger_position")
    assert min(np.ptp(moved[name]) for name in SERVOS[1:]) > 0.1
    return moved


@pytest.mark.parametrize("order", [(3, 2, 1, 0), (1, 2, 3, 0), (0, 2, 1, 3)])
def test_a_finger_moves_the_same_whatever_the_order_of_its_servos(order: list[int], usual: dict[str, Array]) -> None:
    text = profile.find("sixth-finger")[1]
    lines = servo_lines(text)
    run = simulate(text.replace("".join(lines.values()), "".join(lines[SERVOS[i]] for i in order)), 3)
    assert run.layout.fields[COMMAND].labels == tuple(SERVOS[i] for i in order)
    for name, moved in by_name(run, "world.finger_position").items():
        np.testing.assert_array_equal(moved, usual[name], name)


TWO_BOARDS = """\
  wrist:
    driver: firmata
    port: /dev/ttyACM0
    servos:
{flexion_2}{abduction}
  tip:
    driver: firmata
    port: /dev/ttyACM1
    servos:
{flexion_3}{flexion_1}
controllers:
"""
GUARD = """\
guard:
  wrist.position_command: {velocity: 4.0, acceleration: 40.0, lower: {abduction: -1.047, flexion_2: -1.571}}
  tip.position_command: {velocity: 4.0, acceleration: 40.0}
stop: {wrist: hold, tip: hold}
"""


def test_a_finger_on_two_boards_moves_as_on_one(usual: dict[str, Array]) -> None:
    text = profile.find("sixth-finger")[1]
    text = re.sub(r"  finger:\n(?s:.*?)controllers:\n", TWO_BOARDS.format(**servo_lines(text)), text, count=1)
    text = re.sub(r"guard:\n(?s:.*?)stop: .*\n", GUARD, text, count=1)
    text = text.replace(
        "{q: finger.position_command, q_velocity: finger.position_command.velocity}",
        "{q: {to: [wrist.position_command, tip.position_command]},\n"
        "          q_velocity: {to: [wrist.position_command.velocity, tip.position_command.velocity]}}",
    )
    run = simulate(text, 3)
    assert run.layout.fields["tip.position_command"].labels == ("flexion_3", "flexion_1")
    for name, moved in by_name(run, "world.finger_position").items():
        np.testing.assert_array_equal(moved, usual[name], name)


@pytest.mark.parametrize("names", [("P", "G", "M", "A"), ("stop", "go", "left", "right")])
def test_a_button_switches_the_mode_it_is_meant_for(names: tuple[str, ...]) -> None:
    text = profile.find("moca-man")[1]
    pins = dict(zip(("A", "M", "G", "P"), (2, 3, 4, 5), strict=True))
    meant = {"stop": "A", "go": "M", "left": "G", "right": "P"}
    own = {meant.get(name, name): name for name in names}
    buttons = ", ".join(f"{name}: {{pin: {pins[meant.get(name, name)]}}}" for name in names)
    text = re.sub(r"    buttons: .*\n", f"    buttons: {{{buttons}}}\n", text)
    if "stop" in names:
        listed = ", ".join(f"{button}: {name}" for button, name in own.items())
        text = text.replace("{buttons: panel.buttons}", f"{{buttons: {{from: panel.buttons, map: {{{listed}}}}}}}")
    # The person isn't needed: the button is pressed by the clock.
    text = re.sub(r"      plan:\n(?s:.*?)  devices:\n", "      plan: [{do: wait, seconds: 1.0}]\n  devices:\n", text)
    text = text.replace("panel: {person: person}", f"panel: {{presses: {{{own['G']}: [[0.2, 0.4]]}}}}")
    run = simulate(text, 0.6)
    last = {name: values[-1] for name, values in by_name(run, "keys.modes").items()}
    assert last == {"admittance": 0, "rotation": 0, "gripper_closed": 1, "locomotion": 0}


UR = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")


@pytest.mark.parametrize("whose", ["labels", "axes"])
def test_the_joint_that_a_client_names_is_the_one_that_turns(whose: str) -> None:
    text, listed = profile.find("ur-jog")[1], f"[{', '.join(UR)}]"
    assert f"{whose}: {listed}" in text
    text = text.replace(f"{whose}: {listed}", f"{whose}: [{', '.join(UR[1:] + UR[:1])}]")
    lockstep = Lockstep(wiring.build(*profile.parse("profile.yaml", text), []))
    row, layout = lockstep.graph.row, lockstep.graph.layout
    client = row.devices[layout.devices.index("client")]
    before = row.views["world.arm_position"].copy()
    for k in range(200):
        lockstep.sense()
        client[DEVICE.stamp], client[DEVICE.link] = (
            lockstep.count * lockstep.period,
            client[DEVICE.link] | LINK_CONNECTED,
        )
        row.views["client.velocity"][:] = (
            0.0 if k < 20 else [0.2 * (name == "elbow") for name in layout.fields["client.velocity"].labels]
        )
        if lockstep.act() is State.ACTIVE and k < 20:
            before = row.views["world.arm_position"].copy()
    turned = dict(
        zip(layout.fields["world.arm_position"].labels, row.views["world.arm_position"] - before, strict=True)
    )
    assert turned.pop("elbow") > 0.02
    assert max(map(abs, turned.values())) < 0.002
