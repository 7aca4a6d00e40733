"""Robots as they are drawn, against MuJoCo's bodies of the simulated world: another model, made another way."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from srl.runtime.contracts.linkage import Link, Linkage, Solid
from srl.runtime.contracts.signals import Array
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.profile import profile, wiring
from srl.runtime.profile.graph import Graph
from srl.runtime.recording.link_capsules import link_capsules
from srl.runtime.recording.robots import FixedRobots
from srl.runtime.recording.solids import Solids


def moved(name: str, seconds: float, *overrides: str) -> Graph:
    """A simulated run's graph at its end."""
    graph = wiring.build(*profile.load(name, overrides), [])
    run = Lockstep(graph)
    for _ in range(round(seconds * float(graph.profile.rate))):
        run.sense()
        run.act()
    return graph


def drawn(graph: Graph) -> dict[str, Array]:
    """(3,) m by DEVICE/LINK."""
    standing = FixedRobots(graph.layout)
    placed = zip(standing.robots, standing.of(graph.row.words), strict=True)
    return {f"{r.name}/{link.name}": T[:3, 3] for r, t in placed for link, T in zip(r.linkage.links, t, strict=True)}


def body(graph: Graph, name: str) -> Array:
    world: Any = graph.world
    place: Array = world.data.body(name).xpos
    return place


def test_a_finger_that_follows_the_forearm_is_where_it_is_worn() -> None:
    graph = moved("ikns-finger", 0.5)
    places = drawn(graph)
    for joint in ("abduction", "flexion_1", "flexion_3"):
        assert places[f"finger/{joint}"] == pytest.approx(body(graph, f"finger/{joint}"), abs=4e-3), joint
    nodes = graph.row.views["arm.nodes"]
    assert nodes[2] == pytest.approx(body(graph, "wearer/right_forearm"), abs=4e-3)


@pytest.mark.slow
def test_a_worn_arm_hangs_on_the_wearer() -> None:
    graph = moved("human-srl", 4.0, "sim.parts.wearer.script=t-pose")
    places = drawn(graph)
    for joint in ("J1", "J4", "J7", "tip"):
        assert places[f"arm/{joint}"] == pytest.approx(body(graph, f"arm/{joint}"), abs=5e-3), joint
    assert np.abs(graph.row.views["arm.position"]).max() > 0.05


@pytest.mark.slow
def test_each_of_two_arms_is_its_own() -> None:
    graph = moved("human-srl-two", 1.0, "sim.parts.wearer.script=t-pose")
    places = drawn(graph)
    for side in ("right", "left"):
        assert places[f"{side}/J4"] == pytest.approx(body(graph, f"{side}/J4"), abs=5e-3), side
    assert places["left/J4"][1] > places["right/J4"][1] + 0.1  # y is to the left


def test_the_hand_closes_as_the_empty_one_does() -> None:
    graph = wiring.build(*profile.load("hand-jog"), [])
    world: Any = graph.world
    world.parts["hand"].command_position(1.0)
    run = Lockstep(graph)
    for _ in range(60):
        world.parts["hand"].command_position(1.0)
        run.sense()
    places = drawn(graph)
    assert graph.row.views["hand.position"][0] > 0.4
    for joint in ("thumb_abduction", "thumb_outer_2", "index_inner_2", "index_outer_2", "little_outer_2"):
        assert places[f"hand/{joint}"] == pytest.approx(body(graph, f"hand/{joint}"), abs=6e-3), joint


def test_what_hangs_on_a_flange_moves_with_it() -> None:
    graph = moved("kairos-man", 0.02)
    places = drawn(graph)
    assert places["hand/base"] == pytest.approx(places["arm/flange"], abs=1e-9)
    assert places["hand/palm"] == pytest.approx(body(graph, "hand/palm"), abs=3e-3)


def test_a_chain_of_axes_is_drawn_as_the_profile_says(tmp_path: Path) -> None:
    graph = moved("servo-jog", 0.1)
    assert drawn(graph)["finger/tip"] == pytest.approx(body(graph, "finger/tip"), abs=1e-3)
    warnings = wiring.build(*profile.load("servo-jog", ["devices.finger.robot.axes={mcp: {}}"])).warnings
    assert any("the joints of `axes` aren't those of 'finger' (proximal, distal)" in text for text in warnings)


def test_a_link_that_is_not_drawn_carries_nothing_and_is_told() -> None:
    graph = wiring.build(*profile.load("kairos-man", ["devices.hand.robot.at=arm/flnge"]))
    assert [robot["name"] for robot in graph.layout.meta["robots"]] == ["arm", "base"]
    assert any("no robot that is drawn has a link arm/flnge" in text for text in graph.warnings)


def test_pictures_without_meshes_have_the_robot_too() -> None:
    graph = moved("servo-jog", 0.1)
    solids = Solids(graph.layout)
    assert [thing.name for thing in solids.things][-1] == "finger"
    capsules = solids.of(graph.row.words)[-1]
    tip = capsules[-1]
    assert tip[:3] == pytest.approx(body(graph, "finger/tip"), abs=1e-3)


@pytest.mark.parametrize(
    ("solid", "reach"),
    [
        (Solid("box", (0.3, 0.2, 0.1)), (0.3, 0.2, 0.1)),
        (Solid("cylinder", (0.1, 0.03)), (0.1, 0.1, 0.03)),
        (Solid("cylinder", (0.02, 0.2)), (0.02, 0.02, 0.2)),
        (Solid("capsule", (0.02, 0.2)), (0.02, 0.02, 0.22)),
        (Solid("sphere", (0.05,)), (0.05, 0.05, 0.05)),
    ],
)
def test_capsules_fill_a_shape_and_do_not_leave_it(solid: Solid, reach: tuple[float, ...]) -> None:
    numbers, rows = link_capsules(Linkage((Link("a", -1, solids=(solid,)),)))
    assert set(numbers) == {0}
    ends = np.concatenate([np.abs(rows[:, :3]), np.abs(rows[:, 3:6])]).max(axis=0)
    assert ends + rows[:, 6].max() == pytest.approx(reach, rel=0.05)  # a disk is a little less round
