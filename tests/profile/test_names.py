"""Wiring by name: whatever the order of names at both ends, an element reaches the one that it is meant for."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import permutations
from typing import Any

import numpy as np
import pytest
from helpers.names import build, command, foreign, joints, named, read, write
from helpers.worn_arm import impedance, worn

from srl.runtime.contracts.errors import WiringError
from srl.runtime.contracts.signals import Kind, Signal
from srl.runtime.contracts.terms import PLANAR, PLANAR_TWIST
from srl.runtime.profile import library, profile, wiring
from srl.runtime.profile.connections import connections, untaken
from srl.runtime.profile.names import link
from srl.runtime.testing.lab import Lab

SERVOS = ("abduction", "flexion_1", "flexion_2", "flexion_3")
BUTTONS = ("A", "M", "G", "P")
IN, OUT = "in: {x: hand.x}", "out: {q: hand.goal}"
UR = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")


def sixth_finger(order: tuple[str, ...]) -> str:
    text = profile.find("sixth-finger")[1]
    lines = {name: re.search(rf"      {name}: \{{pin.*\n", text) for name in SERVOS}
    there = "".join(found[0] for found in lines.values() if found)
    return text.replace(there, "".join(found[0] for n in order if (found := lines[n])))


@pytest.mark.parametrize("order", [*permutations(SERVOS)], ids="-".join)
def test_the_servos_may_stand_in_any_order(order: tuple[str, ...]) -> None:
    graph = build(sixth_finger(order))
    wanted = {name: float(i) for i, name in enumerate(SERVOS)}
    write(graph, 1, q=wanted, q_velocity={name: -value for name, value in wanted.items()})
    assert named(graph.row, "finger.position_command") == wanted
    assert graph.layout.fields["finger.position_command"].labels == order
    assert named(graph.row, "finger.position_command.velocity") == {n: -v for n, v in wanted.items()}
    # What the guard let through is read back by the same names.
    graph.row.views["finger.position_command.applied"][:] = [10 * wanted[name] for name in order]
    read(graph, 1, "tips")
    assert graph.laws[1].controller.applied["q"].tolist() == [0.0, 10.0, 20.0, 30.0]
    shown = {c.start: c.elements for c in connections(graph)}["mapping.q"]
    assert bool(shown) == (order != SERVOS)
    assert all(a.partition("[")[2] == b.partition("[")[2] for a, b in shown)


@pytest.mark.parametrize("order", [*permutations(BUTTONS)], ids="-".join)
def test_the_buttons_may_stand_in_any_order(order: tuple[str, ...]) -> None:
    text = profile.find("moca-man")[1]
    line = re.search(r"    buttons: .*\n", text)
    assert line is not None
    pins = ", ".join(f"{name}: {{pin: {BUTTONS.index(name) + 2}}}" for name in order)
    graph = build(text.replace(line[0], f"    buttons: {{{pins}}}\n"))
    graph.row.views["panel.buttons"][:] = [ord(name) for name in order]
    assert read(graph, 0, "buttons") == {name: ord(name) for name in BUTTONS}


@pytest.mark.parametrize("order", [*permutations(("stop", "go", "left", "right"))], ids="-".join)
def test_the_e_stop_is_the_button_of_its_name(monkeypatch: pytest.MonkeyPatch, order: tuple[str, ...]) -> None:
    graph = foreign(
        monkeypatch,
        {"panel": ((joints("buttons", *order),), (command("goal", "k"),))},
        {"law": ((joints("x", "go"),), (joints("q", "k"),))},
        "in: {x: panel.buttons}, out: {q: panel.goal}",
        "emergency: [{signal: panel.buttons, element: stop}]\n"
        "reset: {inputs: [{signal: panel.buttons, element: left}]}",
    )
    graph.row.views["panel.buttons"][:] = [ord(name[0]) for name in order]
    found = [graph.element(entry).item() for entry in (*graph.profile.emergency, *graph.profile.reset.inputs)]
    assert found == [ord("s"), ord("l")]
    assert graph.layout.meta["emergency"] == ["panel.buttons[stop]"]
    assert untaken(graph) == ["panel.buttons[right]"]


@pytest.mark.parametrize("moved", range(6))
@pytest.mark.parametrize("to", range(6))
def test_a_clients_joints_may_stand_in_any_order(moved: int, to: int) -> None:
    text = profile.find("ur-jog")[1]
    order = [name for name in UR if name != UR[moved]]
    order.insert(to, UR[moved])
    listed = f"[{', '.join(UR)}]"
    assert text.count(listed) == 2
    first, second = (
        text.replace(listed, f"[{', '.join(order)}]", 1),
        text.replace(f"axes: {listed}", f"axes: [{', '.join(order)}]"),
    )
    for changed in (first, second):  # the client's order, the law's order
        graph = build(changed)
        given = dict(zip(graph.layout.fields["client.velocity"].labels, range(6), strict=True))
        graph.row.views["client.velocity"][:] = list(given.values())
        write(graph, 0, velocity=read(graph, 0, "target"))
        assert named(graph.row, "arm.velocity_command") == given


def test_every_order_of_six_joints_is_followed_or_is_a_view() -> None:
    own = joints("q", *UR)
    for order in permutations(UR):
        found = link(own, "law.q", {"arm.position": joints("position", *order)}, {}, "profile.yaml")
        rows = found.rows or tuple(("arm.position", i) for i in range(6))
        assert [order[row] for _, row in rows] == list(UR)
        assert (found.rows is None) == (order == UR)


@pytest.mark.slow
def test_names_that_agree_are_views_into_the_row() -> None:
    # A law of ikns-two takes one element of another's two, the one of suit-intention 19 of a suit's joints,
    # that of worn-arm the place of a pose.
    for name in set(library.shipped()) - {"ikns-two", "suit-intention", "third-thumb", "worn-arm"}:
        graph = wiring.build(*profile.load(name), [])
        assert not graph.reads
        for law in graph.laws:
            assert (law.reads, law.writes) == ([], [])
            for array in (*law.controller.input.values(), *law.controller.output.values()):
                assert np.shares_memory(array, graph.row.floats)


def test_a_device_with_names_of_its_own_needs_a_map_and_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    panel = joints("lamps", "green", "yellow", "red", "black", "grey")
    servos = command("goal", "knee", "hip")
    law = (
        (joints("keys", *BUTTONS),),
        (joints("q", "hip_joint", "knee_joint"), joints("v", "hip_joint", "knee_joint")),
    )
    law = (law[0], (law[1][0], replace(law[1][1], unit="rad/s")))
    graph = foreign(
        monkeypatch,
        {"panel": ((panel,), ()), "leg": ((), (servos,))},
        {"law": law},
        "in: {keys: {from: panel.lamps, map: {A: green, M: yellow, G: red, P: black}}}, "
        "out: {q: {to: leg.goal, map: {hip_joint: hip, knee_joint: knee}}, v: leg.goal.velocity}",
    )
    graph.row.views["panel.lamps"][:] = range(5)
    assert read(graph, 0, "keys") == {"A": 0, "M": 1, "G": 2, "P": 3}
    write(graph, 0, q={"hip_joint": 7, "knee_joint": 8}, v={"hip_joint": 0.7, "knee_joint": 0.8})
    assert named(graph.row, "leg.goal") == {"knee": 8, "hip": 7}
    assert graph.row.views["leg.goal.velocity"].tolist() == [0.8, 0.7]  # the map holds for the rate, too
    assert untaken(graph) == ["panel.lamps[grey]"]
    assert graph.actuators[0].home is not None


def test_two_arms_with_the_same_names_feed_one_law_and_are_fed_by_it(monkeypatch: pytest.MonkeyPatch) -> None:
    arm = ((joints("position", "joint1", "joint2"),), (command("goal", "joint2", "joint1", feedback="position"),))
    both = ("left.joint1", "left.joint2", "right.joint1", "right.joint2")
    graph = foreign(
        monkeypatch,
        {"left": arm, "right": arm},
        {"law": ((joints("q", *both),), (joints("goal", *both),))},
        "in: {q: {from: [left.position, right.position]}}, out: {goal: {to: [right.goal, left.goal]}}",
    )
    graph.row.views["left.position"][:], graph.row.views["right.position"][:] = (1, 2), (3, 4)
    found = read(graph, 0, "q")
    assert list(found.values()) == [1, 2, 3, 4]
    write(graph, 0, goal=found)
    assert named(graph.row, "left.goal") == {"joint1": 1, "joint2": 2}
    assert named(graph.row, "right.goal") == {"joint1": 3, "joint2": 4}
    # The guard sees what it measures in its command's order.
    for index, array in graph.reads:
        graph.row.floats.take(index, 0, array, "clip")
    assert [a.measured.tolist() for a in graph.actuators if a.measured is not None] == [[2, 1], [4, 3]]


def test_two_laws_may_write_one_command_together(monkeypatch: pytest.MonkeyPatch) -> None:
    device = {"hand": ((joints("x", "a"),), (command("goal", "wrist", "thumb", "index"),))}
    laws = {
        "one": ((joints("x", "a"),), (joints("q", "index", "thumb"),)),
        "two": ((joints("x", "a"),), (joints("q", "wrist"),)),
    }
    graph = foreign(
        monkeypatch, device, laws, "in: {x: hand.x}, out: {q: hand.goal}\nin: {x: hand.x}, out: {q: hand.goal}"
    )
    write(graph, 0, q={"index": 1, "thumb": 2})
    write(graph, 1, q={"wrist": 3})
    assert named(graph.row, "hand.goal") == {"wrist": 3, "thumb": 2, "index": 1}


POSE = Signal(name="x", shape=(2, 3), unit="rad", labels=("a", "b"), components=(("x", "y", "z"),))
TURNED = replace(POSE, components=(("y", "x", "z"),))
SLOTS = Signal(name="x", shape=(3,), unit="rad", slots=True)
BARE = Signal(name="x", shape=(2,), unit="rad")
A, AB, ABC = (joints("x", *"abc"[:n]) for n in (1, 2, 3))
KL = joints("q", "k", "l")
# state, input, output, the input's wire, what the error says
REFUSED: dict[str, tuple[Signal, Signal, Signal, str, str]] = {
    "other names": (AB, joints("x", "a", "c"), KL, "hand.x", "law.x has a, c; hand.x has a, b, no 'c'"),
    "map of nothing": (A, joints("x", "c"), KL, "{from: hand.x, map: {d: a}}", "its map names 'd', law.x has c"),
    "map to nothing": (AB, joints("x", "c"), KL, "{from: hand.x, map: {c: e}}", "hand.x has a, b, no 'e'"),
    "map onto one twice": (AB, joints("x", "c", "a"), KL, "{from: hand.x, map: {c: a}}", "'a' stands for two"),
    "output nobody takes": (A, A, joints("q", "k", "l", "m"), "hand.x", "hand.goal has k, l, no 'm'"),
    "half a command": (A, A, joints("q", "l"), "hand.x", r"no controller writes 'hand.goal\[k\]'; others of it: law.q"),
    "no names": (BARE, A, KL, "hand.x", "'hand.x' can't be wired by name: it has 2 rows"),
    "no names of a port": (A, BARE, KL, "hand.x", "'law.x' can't be wired by name"),
    "slots by name": (SLOTS, ABC, KL, "hand.x", "without names on both sides"),
    "names as slots": (ABC, SLOTS, KL, "hand.x", "without names on both sides"),
    "other components": (POSE, TURNED, KL, "hand.x", "components differ: hand.x has x, y, z, law.x has y, x, z"),
    "other shape": (POSE, AB, KL, "hand.x", "shapes differ: hand.x has 3, law.x has one number"),
    "a signal twice": (A, A, KL, "{from: [hand.x, hand.x]}", "each once"),
    "no signal": (A, A, KL, "{from: []}", "at least one"),
    "unknown key": (A, A, KL, "{form: hand.x}", "Did you mean 'from'"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_nothing_is_guessed(monkeypatch: pytest.MonkeyPatch, case: str) -> None:
    state, port, output, wire, said = REFUSED[case]
    device = {"hand": ((state,), (command("goal", "k", "l"),))}
    with pytest.raises((WiringError, profile.ProfileError), match=said) as caught:
        foreign(monkeypatch, device, {"law": ((port,), (output,))}, f"in: {{x: {wire}}}, {OUT}")
    assert "profile.yaml" in str(caught.value)


def test_an_element_has_one_writer(monkeypatch: pytest.MonkeyPatch) -> None:
    device = {"hand": ((joints("x", "a"),), (command("goal", "k", "l"),))}
    laws = {name: ((joints("x", "a"),), (joints("q", *labels),)) for name, labels in (("one", "kl"), ("two", "l"))}
    with pytest.raises(WiringError, match=r"'hand.goal\[l\]' has two writers: one.q and two.q"):
        foreign(monkeypatch, device, laws, f"{IN}, {OUT}\n{IN}, {OUT}")


def test_slots_go_as_a_whole_to_a_port_that_takes_slots(monkeypatch: pytest.MonkeyPatch) -> None:
    device = {"hand": ((SLOTS,), (command("goal", "k"),))}
    graph = foreign(monkeypatch, device, {"law": ((SLOTS,), (joints("q", "k"),))}, f"{IN}, {OUT}")
    assert np.shares_memory(graph.laws[0].controller.input["x"], graph.row.views["hand.x"])


@pytest.mark.parametrize(
    ("state", "given"),
    [
        (joints("position", "l", "k"), {"unit": "rad"}),
        (Signal(name="position", shape=(3,), unit="m, rad", labels=("yaw", "x", "y")),
         {"unit": "m/s, rad/s", "labels": PLANAR_TWIST, "shape": (3,), "kind": Kind.VELOCITY}),
    ],
)  # fmt: skip
def test_a_feedback_is_taken_by_name(monkeypatch: pytest.MonkeyPatch, state: Signal, given: dict[str, Any]) -> None:
    goal = command("goal", "k", "l", feedback="position", **given)
    law = Signal(name="q", shape=goal.shape, unit=goal.unit, labels=goal.labels)
    device = {"hand": ((joints("x", "a"), state), (goal,))}
    graph = foreign(monkeypatch, device, {"law": ((joints("x", "a"),), (law,))}, f"{IN}, {OUT}")
    graph.row.views["hand.position"][:] = range(state.size)
    for index, array in graph.reads:
        graph.row.floats.take(index, 0, array, "clip")
    (actuator,) = graph.actuators
    wanted = {"k": 1, "l": 0} | dict(zip(PLANAR_TWIST, (1, 2, 0), strict=True))
    assert actuator.measured is not None
    assert dict(zip(goal.labels, actuator.measured.tolist(), strict=True)) == {n: wanted[n] for n in goal.labels}
    assert set(PLANAR) == {"x", "y", "yaw"}


@pytest.mark.parametrize("what", ["position", "velocity"])
def test_a_feedback_or_rate_of_other_joints_is_refused(monkeypatch: pytest.MonkeyPatch, what: str) -> None:
    states = {"position": joints("position", "k", "l"), "velocity": joints("velocity", "k", "l")}
    states[what] = joints(what, "k", "m")
    device = {"hand": (tuple(states.values()), (command("goal", "k", "l", feedback="position"),))}
    with pytest.raises(WiringError, match=f"hand.goal has k, l; hand.{what} has k, m, no 'l'"):
        foreign(
            monkeypatch,
            device,
            {"law": ((joints("x", "k"),), (joints("q", "k", "l"),))},
            "in: {x: hand.position}, " + OUT,
        )


def test_a_command_that_is_listed_and_gets_no_element_has_no_writer(monkeypatch: pytest.MonkeyPatch) -> None:
    """It would stand at zero in the row, and the limb would go there."""
    goal = (command("goal", "k", "l"),)
    law = ((joints("x", "a"),), (joints("q", "k", "l"),))
    wires = "in: {x: left.x}, out: {q: {to: [left.goal, right.goal], map: {k: left.k, l: left.l}}}"
    with pytest.raises(WiringError, match=r"no controller writes 'right.goal\[k\]'"):
        foreign(monkeypatch, {"left": ((joints("x", "a"),), goal), "right": ((), goal)}, {"law": law}, wires)


def test_a_rate_that_is_listed_and_gets_no_element_has_no_writer(monkeypatch: pytest.MonkeyPatch) -> None:
    """The guard would follow a rate of zero."""
    goal = (command("goal", "k", "l"),)
    rate = replace(joints("v", "left.k", "left.l"), unit="rad/s")
    both = joints("q", "left.k", "left.l", "right.k", "right.l")
    wires = (
        "in: {x: left.x}, out: {q: {to: [left.goal, right.goal]}, v: {to: [left.goal.velocity, right.goal.velocity]}}"
    )
    with pytest.raises(WiringError, match=r"no controller writes 'right.goal.velocity\[k\]'"):
        foreign(
            monkeypatch,
            {"left": ((joints("x", "a"),), goal), "right": ((), goal)},
            {"law": ((joints("x", "a"),), (both, rate))},
            wires,
        )


def test_slots_beside_names_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    device = {"hand": ((A, replace(SLOTS, name="marks", shape=(1,))), (command("goal", "k"),))}
    wires = f"in: {{x: {{from: [hand.x, hand.marks]}}}}, {OUT}"
    with pytest.raises(WiringError, match="without names on both sides"):
        foreign(monkeypatch, device, {"law": ((A,), (joints("q", "k"),))}, wires)


@pytest.mark.parametrize("order", [("left", "right"), ("right", "left")], ids="-".join)
def test_a_rate_follows_its_commands_map_in_any_order_of_the_commands(
    monkeypatch: pytest.MonkeyPatch, order: tuple[str, ...]
) -> None:
    goal = (command("goal", "k"),)
    q = joints("q", "left.k", "right.k")
    rates = ", ".join(f"{device}.goal.velocity" for device in order)
    swap = "map: {left.k: right.k, right.k: left.k}"
    graph = foreign(
        monkeypatch,
        {"left": ((joints("x", "a"),), goal), "right": ((), goal)},
        {"law": ((joints("x", "a"),), (q, replace(q, name="v", unit="rad/s")))},
        f"in: {{x: left.x}}, out: {{q: {{to: [left.goal, right.goal], {swap}}}, v: {{to: [{rates}]}}}}",
    )
    write(graph, 0, q={"left.k": 1, "right.k": 2}, v={"left.k": 1, "right.k": 2})
    assert graph.row.views["right.goal"].tolist() == graph.row.views["right.goal.velocity"].tolist() == [1]
    assert graph.row.views["left.goal"].tolist() == graph.row.views["left.goal.velocity"].tolist() == [2]


def test_a_number_without_an_axis_is_listed_and_commanded(monkeypatch: pytest.MonkeyPatch) -> None:
    one = Signal(name="q", shape=(), unit="rad")
    device = {"hand": ((A, replace(one, name="load")), (command("goal", shape=()),))}
    graph = foreign(monkeypatch, device, {"law": ((A,), (one,))}, f"{IN}, {OUT}")
    assert untaken(graph) == ["hand.load"]


@pytest.mark.parametrize("to", ["left.goal, right.goal.gravity", "right.goal.gravity, left.goal"])
def test_an_output_goes_to_commands_or_to_what_is_beside_them(monkeypatch: pytest.MonkeyPatch, to: str) -> None:
    torque = {"kind": Kind.TORQUE, "unit": "N m"}
    devices = {"left": ((A,), (command("goal", "k", **torque),)), "right": ((), (command("goal", "l", **torque),))}
    law = ((A,), (replace(joints("q", "k", "l"), unit="N m"), replace(joints("p", "l"), unit="N m")))
    with pytest.raises(WiringError, match="are commands and what is beside them"):
        foreign(monkeypatch, devices, {"law": law}, f"in: {{x: left.x}}, out: {{q: {{to: [{to}]}}, p: right.goal}}")


def test_a_rate_of_some_of_the_joints_follows_the_map_of_all(monkeypatch: pytest.MonkeyPatch) -> None:
    devices = {"left": ((A,), (command("goal", "k", "l"),)), "right": ((), (command("goal", "m"),))}
    law = ((A,), (joints("q", "k", "l", "m"), replace(joints("v", "k", "l"), unit="rad/s")))
    wires = "in: {x: left.x}, out: {q: {to: [left.goal, right.goal], map: {k: l, l: k}}, v: left.goal.velocity}"
    graph = foreign(monkeypatch, devices, {"law": law}, wires)
    write(graph, 0, q={"k": 1, "l": 2, "m": 3}, v={"k": 1, "l": 2})
    assert named(graph.row, "left.goal") == named(graph.row, "left.goal.velocity") == {"k": 2, "l": 1}


@pytest.mark.slow
def test_a_worn_arm_moves_the_same_joints_whatever_the_order_of_its_motors() -> None:
    """The URDF's order, the motors', the guard's and the law's are four; the bits are one."""
    orders = [("yaw", "shoulder", "elbow", "wrist")] * 3
    assert _worn(orders) == _worn(
        [
            ("wrist", "elbow", "yaw", "shoulder"),
            ("elbow", "yaw", "wrist", "shoulder"),
            ("shoulder", "wrist", "yaw", "elbow"),
        ]
    )


def _worn(orders: list[tuple[str, ...]]) -> dict[str, dict[str, float]]:
    """Where the joints are after half a second and what they are sent, by name."""
    plain = worn()
    law, guard = impedance(plain), plain["guard"]["arm.effort_command"]
    for entry, key, order in (
        (plain["devices"]["arm"], "motors", orders[0]),
        (plain["sim"]["parts"]["arm"], "axes", orders[1]),
        (law, "stiffness", orders[2]),
        (law, "rotor_inertia", orders[1]),
        *((guard, key, orders[2]) for key in ("lower", "upper", "velocity", "effort", "inertia")),
    ):
        entry[key] = {name: entry[key][name] for name in order}
    with Lab(plain, ["seed=3"]) as lab:
        lab.until("ready")
        lab.start()
        lab.until("active")
        lab.run(0.5)
        assert lab.layout.fields["arm.position"].labels == orders[0]
        return {
            name: dict(zip(lab.layout.fields[name].labels, lab[name].tolist(), strict=True))
            for name in ("arm.position", "arm.effort_command.sent")
        }
