"""Where parts stand: at frames, on bodies that move, beside what the profile says; and what is refused."""

from __future__ import annotations

from itertools import permutations
from typing import Any
from xml.etree.ElementTree import Element

import mujoco
import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from srl.runtime.contracts.errors import WiringError
from srl.runtime.contracts.frames import FrameEntry, Frames
from srl.sim.parts.robots.summit_xl import SummitXlPart
from srl.sim.parts.things.ft_sensor import FtSensorPart
from srl.sim.world.cell import Cell, CellConfig
from srl.sim.world.mjcf import add
from srl.sim.world.part import Mjcf, Part, PartConfig

HALF = float(np.sqrt(0.5))
LENGTH = 0.3


class Thing(Part):
    """Something rigid: the body `NAME/body`."""

    summary = "for tests"

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        body = mjcf.body(parent, f"{self.name}/body", **self.at())
        add(body, "geom", type="sphere", size=0.01, mass=0.1, contype=0)


class Rod(Part):
    """`NAME/base`, and on a hinge about its y axis `NAME/rod` along z, at whose end is `NAME/tip`."""

    summary = "for tests"

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        base = mjcf.body(parent, f"{self.name}/base", **self.at())
        rod = mjcf.body(base, f"{self.name}/rod")
        add(rod, "joint", name=f"{self.name}/hinge", axis="0 1 0")
        add(rod, "geom", type="capsule", fromto=(0.0, 0.0, 0.0, 0.0, 0.0, LENGTH), size=0.01, mass=1.0, contype=0)
        mjcf.body(rod, f"{self.name}/tip", pos=(0.0, 0.0, LENGTH))


class Loose(Thing):
    """A thing that nothing holds."""

    def build(self, mjcf: Mjcf, parent: Element) -> None:
        self.moves_freely(mjcf, parent)
        super().build(mjcf, parent)


KINDS: dict[str, type[Part]] = {
    "thing": Thing, "rod": Rod, "loose": Loose, "base": SummitXlPart, "sensor": FtSensorPart,
}  # fmt: skip


def cell(frames: dict[str, Any] | None = None, **parts: dict[str, Any]) -> Cell:
    """A cell of parts of those kinds; without one it is a thing."""
    made: dict[str, tuple[type[Part], PartConfig]] = {}
    for name, entry in parts.items():
        options = dict(entry)
        cls = KINDS[options.pop("part", "thing")]
        made[name] = cls, cls.Config.model_validate(options)
    tree = Frames({name: FrameEntry.model_validate(entry) for name, entry in (frames or {}).items()}, parts)
    return Cell(CellConfig.model_construct(parts=made), 1, tree)


def place(world: Cell, body: str) -> tuple[list[float], Rotation]:
    """Where a body is now: m, and its rotation."""
    mujoco.mj_kinematics(world.model, world.data)
    found = world.data.body(body)
    return found.xpos.tolist(), Rotation.from_quat(found.xquat, scalar_first=True)


def carrier(world: Cell, body: str) -> str:
    """The body on which one is mounted."""
    return str(world.model.body(world.model.body(body).parentid[0]).name)


def turn(world: Cell, rod: str, angle: float) -> None:
    world.data.joint(f"{rod}/hinge").qpos[:] = angle


def refused(words: str, frames: dict[str, Any] | None = None, **parts: dict[str, Any]) -> None:
    """These parts are refused with these words, in whatever order a profile lists them."""
    for order in permutations(parts):
        with pytest.raises(WiringError, match=words):
            cell(frames, **{name: parts[name] for name in order})


# -- in the world


def test_a_part_stands_at_the_frame_with_its_name_or_else_at_the_origin() -> None:
    world = cell(
        {"world": {}, "one": {"parent": "world", "position": [1, 2, 3], "rpy": [0, 0, np.pi / 2]}}, one={}, two={}
    )
    position, rotation = place(world, "one/body")
    np.testing.assert_allclose(position, [1, 2, 3])
    np.testing.assert_allclose(rotation.as_rotvec(), [0, 0, np.pi / 2], atol=1e-12)
    assert place(world, "two/body")[0] == [0, 0, 0]
    assert carrier(world, "one/body") == carrier(world, "two/body") == "world"


def test_a_place_is_given_by_name_or_in_a_frame_or_in_the_world() -> None:
    frames = {"shelf": {"position": [1, 0, 0], "quaternion": [HALF, 0, 0, HALF]}}
    world = cell(
        {"world": {}} | {name: {"parent": "world"} | entry for name, entry in frames.items()},
        named={"at": "shelf"},
        beside={"at": {"parent": "shelf", "position": [0.5, 0, 0], "rpy": [0, 0, -np.pi / 2]}},
        loose={"at": {"position": [0, 0, 4]}},
    )
    assert place(world, "named/body")[0] == [1, 0, 0]
    position, rotation = place(world, "beside/body")
    np.testing.assert_allclose(position, [1, 0.5, 0], atol=1e-12)  # along the frame's x
    assert rotation.magnitude() < 1e-12
    assert place(world, "loose/body")[0] == [0, 0, 4]


def test_a_part_whose_frame_the_profile_has_stands_nowhere_else() -> None:
    frames = {"own": {"position": [9, 9, 9]}}
    assert place(cell(frames, own={}), "own/body")[0] == [9, 9, 9]
    with pytest.raises(WiringError, match=r"frames\.own, and this says it again.*off_by"):
        cell(frames, own={"at": {"position": [0, 0, 4]}})


def test_any_chain_of_frames_puts_a_part_where_the_tree_says() -> None:
    rng = np.random.default_rng(0)
    frames: dict[str, Any] = {"f0": {"position": rng.normal(size=3).tolist()}}
    for k in range(1, 12):
        parent = f"f{rng.integers(k)}"
        frames[f"f{k}"] = {
            "parent": parent,
            "position": rng.normal(size=3).tolist(),
            "rpy": rng.normal(size=3).tolist(),
        }
    world = cell(frames, **{f"p{k}": {"at": f"f{k}"} for k in range(12)})
    root, start = np.array(frames["f0"]["position"]), world.frames
    for k in range(12):
        position, rotation = place(world, f"p{k}/body")
        pose = start.fixed(start.path("f0", f"f{k}"))
        np.testing.assert_allclose(position, root + pose[:3], atol=1e-9)
        assert (rotation.inv() * Rotation.from_quat(pose[3:], scalar_first=True)).magnitude() < 1e-9


# -- on what moves


HANGING = {
    "mount": {"parent": "arm/tip", "position": [0, 0, 0.1], "rpy": [np.pi / 2, 0, 0]},
    "bracket": {"parent": "mount", "position": [0.2, 0, 0]},
    "camera": {"parent": "bracket", "position": [0, 0.05, 0], "rpy": [0, 0, np.pi / 2]},
}


@pytest.mark.parametrize("angle", [0.0, 0.7, -2.0])
def test_a_frame_moves_with_the_body_on_which_it_hangs_through_others(angle: float) -> None:
    world = cell(HANGING, arm={"part": "rod", "at": {"position": [1, 0, 0.5]}}, camera={})
    assert carrier(world, "camera/body") == "arm/tip"
    turn(world, "arm", angle)
    about_y, about_x = Rotation.from_rotvec([0, angle, 0]), Rotation.from_rotvec([np.pi / 2, 0, 0])
    tip = np.array([1, 0, 0.5]) + about_y.apply([0, 0, LENGTH])
    position, rotation = place(world, "camera/body")
    np.testing.assert_allclose(position, tip + about_y.apply([0.2, 0, 0.1 + 0.05]), atol=1e-12)
    wanted = about_y * about_x * Rotation.from_rotvec([0, 0, np.pi / 2])
    assert (rotation.inv() * wanted).magnitude() < 1e-9


def test_what_hangs_on_a_parts_frame_moves_with_the_part() -> None:
    """The frame of the upper rod is its base, which stands on the lower rod's tip."""
    frames = {
        "upper": {"parent": "lower/tip", "position": [0, 0, 0.1]},
        "plate": {"parent": "upper", "position": [0.2, 0, 0]},
    }
    world = cell(frames, lower={"part": "rod"}, upper={"part": "rod"}, plate={}, flag={"at": "upper/tip"})
    assert [carrier(world, f"{name}/body") for name in ("plate", "flag")] == ["upper/base", "upper/tip"]
    turn(world, "lower", np.pi / 2)
    turn(world, "upper", np.pi / 2)
    np.testing.assert_allclose(place(world, "plate/body")[0], [LENGTH + 0.1, 0, -0.2], atol=1e-12)
    np.testing.assert_allclose(place(world, "flag/body")[0], [LENGTH + 0.1, 0, -LENGTH], atol=1e-12)


def test_a_base_carries_its_frame_on_the_ground_and_a_sensor_the_one_that_it_measures_in() -> None:
    frames = {
        "world": {},
        "base": {"parent": "world", "pose": "base.pose"},
        "gauge": {"parent": "base", "position": [0, 0, 1]},
        "tool": {"parent": "gauge", "position": [0, 0, 0.2]},
    }
    world = cell(frames, base={"part": "base"}, gauge={"part": "sensor"}, tool={})
    assert [carrier(world, name) for name in ("gauge/base", "tool/body")] == ["base/base", "gauge/tool"]
    world.data.joint("base/x").qpos[:] = 3.0
    np.testing.assert_allclose(place(world, "gauge/tool")[0], [3, 0, 1], atol=1e-12)
    np.testing.assert_allclose(place(world, "gauge/base")[0], [3, 0, 1 - 0.035], atol=1e-12)  # its height
    np.testing.assert_allclose(place(world, "tool/body")[0], [3, 0, 1.2], atol=1e-12)


def test_the_order_of_the_parts_does_not_matter() -> None:
    parts: dict[str, dict[str, Any]] = {
        "arm": {"part": "rod", "at": "stand/body"},
        "stand": {"at": {"position": [0, 0, 1]}},
        "camera": {},
        "lamp": {"at": {"parent": "camera", "position": [0, 0, 0.01]}},
    }
    seen = []
    for order in permutations(parts):
        world = cell(HANGING, **{name: parts[name] for name in order})
        turn(world, "arm", 0.4)
        seen.append([place(world, f"{name}/body")[0] for name in ("camera", "lamp")])
        assert [carrier(world, f"{name}/body") for name in ("camera", "lamp")] == ["arm/tip", "camera/body"]
    assert all(places == seen[0] for places in seen)


# -- not where the profile says


def test_off_by_displaces_a_part_and_what_hangs_on_its_frame_along_that_frames_axes() -> None:
    frames = {
        "world": {},
        "table": {"parent": "world", "position": [1, 0, 0], "rpy": [0, 0, np.pi / 2]},
        "cup": {"parent": "table", "position": [0, 0, 0.5]},
        "door": {"parent": "world", "position": [0, 5, 0]},
    }
    off = {"position": [0.1, 0, 0], "rpy": [0, 0, np.pi / 2]}
    world = cell(frames, table={"off_by": off}, cup={"off_by": {"position": [0, 0.2, 0]}}, door={})
    position, rotation = place(world, "table/body")
    np.testing.assert_allclose(position, [1, 0.1, 0], atol=1e-12)  # the table's x is the world's y
    assert rotation.magnitude() == pytest.approx(np.pi)
    np.testing.assert_allclose(place(world, "cup/body")[0], [1, 0.1 - 0.2, 0.5], atol=1e-12)
    assert place(world, "door/body")[0] == [0, 5, 0]


def test_off_by_displaces_a_sensors_measuring_frame() -> None:
    world = cell({"gauge": {"position": [0, 0, 1]}}, gauge={"part": "sensor", "off_by": {"rpy": [np.pi / 2, 0, 0]}})
    np.testing.assert_allclose(place(world, "gauge/tool")[0], [0, 0, 1], atol=1e-12)  # turned about itself
    np.testing.assert_allclose(place(world, "gauge/base")[0], [0, 0.035, 1], atol=1e-12)


# -- what is refused


def test_a_misspelt_frame_or_body_is_refused_with_the_nearest() -> None:
    arm = {"part": "rod"}
    refused(
        r"sim\.parts\.a\.at: no frame .* is called 'shlef'\. Did you mean 'shelf'",
        {"shelf": {}},
        arm=arm,
        a={"at": "shlef"},
    )
    refused(r"sim\.parts\.a\.at: .* 'arm/tpi'\. Did you mean 'arm/tip'", arm=arm, a={"at": "arm/tpi"})
    refused(r"sim\.parts\.a\.at: .* 'amr/tip'\. Did you mean 'arm/tip'", arm=arm, a={"at": {"parent": "amr/tip"}})
    on_it = {"camera": {"parent": "arm/tpi"}}
    refused(r"sim\.parts\.camera\.at: .* 'arm/tpi'\. Did you mean 'arm/tip'", on_it, arm=arm, camera={})
    # One that waits for such a part isn't blamed.
    refused(r"sim\.parts\.a\.at: .* 'arm/tpi'", arm=arm, a={"part": "rod", "at": "arm/tpi"}, b={"at": "a/tip"})


def test_a_measured_frame_needs_a_part_that_moves_so() -> None:
    frames = {
        "world": {},
        "cart": {"parent": "world", "position": [0, 0, 1], "pose": "mocap.cart"},
        "box": {"parent": "cart"},
    }
    refused(r"sim\.parts\.box\.at: the frame 'cart' moves: 'mocap\.cart' measures it.*'cart'", frames, box={}, other={})
    world = cell(frames, box={}, cart={"part": "rod"})  # it begins where it is measured as zero
    assert place(world, "cart/base")[0] == place(world, "box/body")[0] == [0, 0, 1]
    assert carrier(world, "box/body") == "cart/base"


def test_frames_that_nothing_connects_are_refused() -> None:
    frames: dict[str, Any] = {"world": {}, "lab": {}, "one": {"parent": "world"}, "two": {"parent": "lab"}}
    refused(
        r"sim\.parts\.(one|two)\.at: it stands in '(lab|world)'.*nothing connects.*`frames:`", frames, one={}, two={}
    )
    world = cell(frames | {"lab": {"parent": "world", "position": [0, 0, 2]}}, one={}, two={}, three={})
    assert place(world, "two/body")[0] == [0, 0, 2]
    cell(frames, arm={"part": "rod", "at": "world"}, a={"at": "arm/tip"}, b={"at": {"position": [1, 0, 0]}})


def test_parts_on_each_other_are_refused_and_only_they_are_named() -> None:
    a, b, c = {"at": "b/body"}, {"at": "a/body"}, {"at": "a/body"}
    refused(r"sim\.parts\.[ab]\.at: parts stand on each other: (a -> b -> a|b -> a -> b)\.", a=a, b=b, c=c, d={})
    through = {"f": {"parent": "b"}, "b": {"parent": "a/body"}}
    refused(r"stand on each other: (a -> b -> a|b -> a -> b)\.", through, a={"at": "f"}, b={})
    refused(r"sim\.parts\.a\.at: it stands on itself, at 'a/body'", a={"at": "a/body"}, b={"at": "a/body"})
    refused(r"sim\.parts\.a\.at: it stands on itself, at 'a/body'", {"a": {"parent": "a/body"}}, a={})


def test_what_moves_freely_stands_in_the_world_alone() -> None:
    world = cell({"start": {"position": [0, 0, 1]}}, ball={"part": "loose", "at": "start"})
    assert place(world, "ball/body")[0] == [0, 0, 1]
    words = r"sim\.parts\.ball\.at: 'ball' moves freely, and can't be mounted"
    refused(words, arm={"part": "rod"}, ball={"part": "loose", "at": "arm/tip"})
    refused(words, {"start": {"parent": "arm/tip"}}, arm={"part": "rod"}, ball={"part": "loose", "at": "start"})


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ({"on": "arm/flange"}, r"'on' is gone. Write `at: FRAME`, `at: PART/BODY`"),
        ({"position": [0, 0, 1]}, r"'position' is gone. Write `at: FRAME` or `at: \{position: \[\.\.\.\]\}`"),
        ({"quaternion": [1, 0, 0, 0]}, r"'quaternion' is gone. Write `at: FRAME` or `at: \{quaternion: \[\.\.\.\]\}`"),
        ({"at": {"xyz": [0, 0, 1]}}, "'xyz' is gone. It is called 'position'"),
        ({"off_by": {"euler": [0, 0, 1]}}, "'euler' is gone. Write `rpy`"),
    ],
)
def test_the_old_keys_are_refused_with_the_new_ones(old: dict[str, Any], new: str) -> None:
    box = {"part": "box", "size": [0.1, 0.1, 0.1]}
    with pytest.raises(ValidationError, match=new):
        CellConfig.model_validate({"parts": {"a": box | old}})
    CellConfig.model_validate({"parts": {"a": box}})


@pytest.mark.parametrize(
    ("at", "words"),
    [
        ({"quaternion": [1, 0, 0, 0], "rpy": [0, 0, 0]}, "give the rotation once"),
        ({"quaternion": [0, 0, 0, 0]}, "length zero"),
        ({"position": [0, 0, float("nan")]}, "finite"),
        ({"frame": "world"}, "frame"),
    ],
)
def test_a_place_that_is_none_is_refused(at: dict[str, Any], words: str) -> None:
    for key in ("at", "off_by"):
        with pytest.raises(ValidationError, match=words):
            CellConfig.model_validate({"parts": {"a": {"part": "box", "size": [0.1, 0.1, 0.1], key: at}}})
