"""Joints of a URDF that follow others, limits the wrong way round, packages of ROS 2, xacro, and where an arm ends."""

from __future__ import annotations

from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from helpers.arm_urdf import ALL, TIPS
from helpers.urdf import URDF, write_urdf

from srl.runtime.contracts.errors import OptionError
from srl.runtime.contracts.files import KeptFile
from srl.runtime.contracts.linkage import Link
from srl.runtime.models.robot_model import RobotModel
from srl.runtime.models.robots import RobotDescription, urdf, urdf_arm

FILE = Path("hand.urdf")
INERTIAL = '<inertial><mass value="1"/><inertia ixx="1e-2" iyy="1e-2" izz="1e-2" ixy="0" ixz="0" iyz="0"/></inertial>'
WIDE = 'lower="-1" upper="1"'


def joint(
    name: str, parent: str, child: str, follows: str = "", limits: str = WIDE, kind: str = "prismatic", x: float = 0.1
) -> str:
    mimic = f"<mimic {follows}/>" if follows else ""
    ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="{x} 0 0"/><axis xyz="1 0 0"/>'
    limit = f'<limit {limits} velocity="1" effort="9"/>' if kind != "fixed" else ""
    return f'<joint name="{name}" type="{kind}">{ends}{limit}{mimic}</joint>'


def after(name: str, factor: float = 1.0, offset: float = 0.0) -> str:
    return f'joint="{name}" multiplier="{factor}" offset="{offset}"'


def robot(*joints: str, weightless: tuple[str, ...] = ()) -> bytes:
    """An arm of one joint, `turn`, up to the link `palm`; the joints given are behind it, of links f1, f2, f3, f4."""
    links = [f'<link name="{n}">{"" if n in weightless else INERTIAL}</link>' for n in ("base", "palm")]
    links += [
        f'<link name="{n}">{INERTIAL}</link>' for n in ("f1", "f2", "f3") if f'<child link="{n}"/>' in str(joints)
    ]
    turn = joint("turn", "base", "palm", kind="revolute")
    return f'<robot name="hand">{"".join(links)}{turn}{"".join(joints)}</robot>'.encode()


def arm(content: bytes, tip: str | None = "palm", **limits: dict[str, float]) -> RobotDescription:
    return urdf_arm.read(urdf.tree(content, FILE), None, tip, limits, {}, {}).robot


def drawn(content: bytes, *names: str) -> dict[str, Link]:
    return {link.name: link for link in urdf.read(content, FILE, names).linkage.links}


MASTER = joint("j1", "palm", "f1")
SECOND = joint("j2", "f1", "f2", after("j1", -2.0, 0.3))
THIRD = joint("j3", "f2", "f3", after("j2", 3.0, -0.1))
ORDERS = list(permutations((MASTER, SECOND, THIRD)))


@pytest.mark.parametrize("order", ORDERS)
def test_what_follows_a_follower_goes_as_it_does_in_any_order_of_the_file(order: tuple[str, ...]) -> None:
    """j3 = 3 (-2 j1 + 0.3) - 0.1."""
    links = drawn(robot(*order), "turn", "j1")
    for name, factor, offset in (("f1", 1.0, 0.0), ("f2", -2.0, 0.3), ("f3", -6.0, 0.8)):
        assert links[name].joint == "j1", name
        assert (links[name].factor, links[name].offset) == pytest.approx((factor, offset)), name


@pytest.mark.parametrize("order", permutations((0, 1, 2)))
def test_a_held_chain_stands_where_its_first_joint_puts_it(order: tuple[int, ...]) -> None:
    """j1 is held at 0.2, the nearest to zero that its limits let it; the masses behind the palm are where it is."""
    joints = (joint("j1", "palm", "f1", limits='lower="0.2" upper="1"'), SECOND, THIRD)
    made = arm(robot(*(joints[i] for i in order), weightless=("base", "palm")))
    j1 = 0.2
    j2 = -2.0 * j1 + 0.3
    j3 = 3.0 * j2 - 0.1
    places = np.cumsum([0.1 + j1, 0.1 + j2, 0.1 + j3])
    # The arm's frame has its z along the joint's axis, here x.
    assert made.joints[0].link.com[2] == pytest.approx(places.mean())


@pytest.mark.parametrize(
    ("joints", "words"),
    [
        ([MASTER, joint("j2", "f1", "f2", after("ghost"))], "j2.*ghost"),
        ([MASTER, joint("j2", "f1", "f2", 'multiplier="2"')], "j2"),
        ([joint("j1", "palm", "f1", after("j1"))], "j1"),
        ([MASTER, joint("j2", "f1", "f2", after("j3")), joint("j3", "f2", "f3", after("j2"))], "j[23]"),
    ],
    ids=["no such joint", "no joint named", "itself", "in a circle"],
)
def test_what_follows_nothing_is_refused(joints: list[str], words: str) -> None:
    with pytest.raises(OptionError, match=words):
        drawn(robot(*joints), "turn", *(["j1"] if joints[0] == MASTER else []))
    with pytest.raises(OptionError, match=words):
        arm(robot(*joints))


# Limits


def test_limits_the_wrong_way_round_are_named_as_such() -> None:
    content = robot().replace(WIDE.encode(), b'lower="0.7" upper="-0.4"')
    with pytest.raises(OptionError) as raised:
        arm(content)
    assert all(word in raised.value.problem for word in ("turn", "0.7", "-0.4"))
    assert arm(content, turn={"lower": -0.4, "upper": 0.7}).q_upper == pytest.approx([0.7])
    with pytest.raises(OptionError, match="turn has no position limits"):
        arm(robot().replace(WIDE.encode(), b'lower="0" upper="0"'))
    with pytest.raises(OptionError) as raised:
        arm(robot(), turn={"lower": 0.8, "upper": 0.5})
    assert all(word in raised.value.problem for word in ("turn", "0.8", "0.5"))


def test_a_held_joints_limits_the_wrong_way_round_are_refused_too() -> None:
    with pytest.raises(OptionError) as raised:
        arm(robot(joint("j1", "palm", "f1", limits='lower="0.7" upper="-0.4"')))
    assert all(word in raised.value.problem for word in ("j1", "0.7", "-0.4"))


# Packages


@pytest.mark.parametrize("before", ["", "/nowhere/a:"])
def test_packages_of_ros_2_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, before: str) -> None:
    file = write_urdf(tmp_path, mesh=False)
    assert [lack.split()[1] for lack in urdf.read(URDF.encode(), file, ["shoulder", "slide"]).lacking] == [
        "package://small/arm.stl"
    ]
    prefix = tmp_path / "install" / "small"
    (prefix / "share").mkdir(parents=True)
    write_urdf(prefix / "share")
    monkeypatch.delenv("ROS_PACKAGE_PATH", raising=False)
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{before}{prefix}:")
    found = urdf.read(URDF.encode(), file, ["shoulder", "slide"])
    assert found.lacking == ()
    assert any((folder / "small" / "arm.stl").is_file() for folder in found.packages)  # the recorder looks there


# Xacro

_XACRO = '<robot name="a" xmlns:xacro="http://www.ros.org/wiki/xacro">'
_LINKS = '<link name="base"/><link name="l1"/>'
_ENDS = '<parent link="base"/><child link="l1"/>'
SOURCES = {
    "an include alone": f'{_XACRO}<xacro:include filename="b.xacro"/></robot>',
    "a name": f'{_XACRO}<xacro:arg name="p" default=""/><link name="$(arg p)base"/><link name="l1"/>'
    '<joint name="${p}j1" type="revolute"><parent link="${p}base"/><child link="l1"/></joint></robot>',
    "a macro's call beside a link": f'{_XACRO}<link name="base"/><xacro:arm parent="base"/></robot>',
    "a macro's call in a joint": f'{_XACRO}{_LINKS}<joint name="j1" type="revolute">{_ENDS}<xacro:limits/>'
    "</joint></robot>",
    "a number": f'<robot name="a">{_LINKS}<joint name="j1" type="revolute">{_ENDS}<limit lower="${{-pi}}" upper="1"/>'
    "</joint></robot>",
    "a kind": f'<robot name="a">{_LINKS}<joint name="j1" type="${{kind}}">{_ENDS}</joint></robot>',
}


@pytest.mark.parametrize("text", SOURCES.values(), ids=SOURCES)
def test_xacro_is_told_to_be_expanded_whatever_it_has_in_it(text: str) -> None:
    with pytest.raises(OptionError) as raised:
        arm(text.encode(), None)
    assert "xacro" in raised.value.remedy


def test_expanded_xacro_is_taken_with_what_it_leaves() -> None:
    """The namespace's declaration and the comment stay in the file."""
    text = ALL["xacro"].replace('<robot name="six">', '<robot name="six" xmlns:xacro="http://www.ros.org/wiki/xacro">')
    assert RobotModel(urdf=KeptFile(Path("six.urdf"), text.encode()), tip=TIPS["xacro"]).robot.n == 3


# Where an arm ends


def chosen(content: bytes) -> tuple[str, ...]:
    """The joints of the arm where no tip is given; none where one is asked for."""
    try:
        return arm(content, None).labels
    except OptionError as error:
        return () if "tip" in error.remedy else (str(error),)


@pytest.mark.parametrize("kind", ["prismatic", "revolute"])
@pytest.mark.parametrize("chained", [False, True])
def test_a_grippers_finger_is_not_the_arms_last_joint(kind: str, chained: bool) -> None:
    """One finger is driven and the other follows it."""
    fingers = [joint("left", "palm", "f1", kind=kind), joint("right", "palm", "f2", after("left", -1.0), kind=kind)]
    if chained:
        fingers.append(joint("pad", "f2", "f3", after("right"), kind=kind))
    assert chosen(robot(*fingers)) in ((), ("turn",))
    assert arm(robot(*fingers)).labels == ("turn",)


def test_an_arms_own_last_joint_that_slides_stays() -> None:
    assert chosen(robot(joint("slide", "palm", "f1"))) == ("turn", "slide")
