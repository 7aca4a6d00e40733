"""Links of a picture: where they are, against Pinocchio's forward kinematics."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from helpers.urdf import URDF, write_urdf

from srl.control.shared.kinematics import Chain
from srl.runtime.contracts.errors import OptionError
from srl.runtime.contracts.linkage import Link, Linkage
from srl.runtime.models.models import FingerModel
from srl.runtime.models.robots import ARMS, SUMMIT_XL, linkages, urdf
from srl.runtime.models.robots.pinocchio_model import pinocchio_model

RNG = np.random.default_rng(1)


@pytest.mark.parametrize("name", ARMS)
def test_an_arms_links_are_where_pinocchio_puts_them(name: str) -> None:
    robot, linkage = ARMS[name], linkages.arm(ARMS[name])
    model = pinocchio_model(robot)
    data = model.createData()
    order = RNG.permutation(robot.n)  # recorded in any order: by name
    for _ in range(5):
        q = RNG.uniform(-2.0, 2.0, robot.n)
        pin.framesForwardKinematics(model, data, q)
        placed = linkage.placed([robot.labels[i] for i in order], q[order])
        assert placed[1:-1] == pytest.approx(np.array([data.oMi[i + 1].homogeneous for i in range(robot.n)]), abs=1e-12)
        assert placed[-1] == pytest.approx(data.oMf[model.getFrameId("flange")].homogeneous, abs=1e-12)


def test_a_fingers_tip_is_where_its_laws_chain_has_it() -> None:
    model = FingerModel()
    q = np.array([0.3, -0.4, 0.9, 1.1])
    tip = linkages.finger(model).placed(model.names, q)[-1, :3, 3]
    assert tip == pytest.approx(Chain(np.eye(4), np.array(model.rows)).forward(q.tolist()), abs=1e-12)


def test_a_base_stands_on_the_ground() -> None:
    (link,) = linkages.base(SUMMIT_XL).links
    lowest = min(s.pose[2] - (s.size[0] if s.kind == "cylinder" else s.size[2]) for s in link.solids)
    assert lowest == pytest.approx(0.0, abs=1e-12)


def test_a_value_that_is_not_known_leaves_only_its_own_link_unknown() -> None:
    linkage = linkages.arm(ARMS["ur16e"])
    values = np.zeros((1, 6))
    values[0, 2] = np.nan
    known = np.isfinite(linkage.moved(ARMS["ur16e"].labels, values)[0]).all(axis=1)
    assert known.tolist() == [True, True, False, True, True, True]


@pytest.mark.parametrize("names", [("shoulder", "slide"), ("a", "b")])  # its own names, or other ones in its order
def test_a_urdf_is_read_as_pinocchio_reads_it(tmp_path, names: tuple[str, str]) -> None:
    file = write_urdf(tmp_path)
    linkage = urdf.read(file.read_bytes(), file, names, "plate", "tool").linkage
    model = pin.buildModelFromUrdf(str(file))
    data = model.createData()
    for q in RNG.uniform(-1.0, 1.0, (5, 2)):
        pin.framesForwardKinematics(model, data, np.array([q[0], q[1], -0.5 * q[1] + 0.01]))
        base = data.oMf[model.getFrameId("plate")].homogeneous
        for link, place in zip(linkage.links, linkage.placed(names, q), strict=True):
            expected = np.linalg.inv(base) @ data.oMf[model.getFrameId(link.name)].homogeneous
            assert place == pytest.approx(expected, abs=1e-12), link.name


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("<robot", "<robot", "2 joints move, and the robot has 3"),
        ("</robot>", "", "isn't XML"),
        ("robot", "sdf", "begins with <sdf>"),
        ('child link="tool"', 'child link="arm"', "two joints move the link 'arm'"),
        ('parent link="root"', 'parent link="tool"', "form a circle"),
        ('xyz="0 0 0.3"', 'xyz="0 0 nan"', "isn't 3 numbers"),
        ('xyz="0 0 0.3"', 'xyz="${l} 0 0"', "is xacro"),
        ('axis xyz="0 1 0"', 'axis xyz="0 0 0"', "no direction"),
        ('link name="tool"', "link", "has no name"),
        ('type="prismatic"', 'type="screw"', "no type of joint"),
    ],
)
def test_a_urdf_that_cannot_be_used_says_why(tmp_path, old: str, new: str, reason: str) -> None:
    file = write_urdf(tmp_path)
    with pytest.raises(OptionError, match=reason):
        urdf.read(URDF.replace(old, new).encode(), file, ("a", "b", "c"))


def test_bytes_and_bombs_are_no_urdf(tmp_path) -> None:
    bomb = '<!DOCTYPE r [<!ENTITY a "0"><!ENTITY b "' + "&a;" * 20 + '">' + "".join(
        f'<!ENTITY x{i} "{("&x" + str(i - 1) + ";") * 20 if i else "&b;"}">' for i in range(9)
    ) + "]><robot>&x8;</robot>"  # fmt: skip
    for content in (b"\xff\xfe\x00", b"", bomb.encode(), b"\x7fELF"):
        with pytest.raises(OptionError):
            urdf.read(content, tmp_path / "x.urdf", ())


def test_links_in_a_file_that_was_damaged_are_refused() -> None:
    with pytest.raises(ValueError, match="no place"):
        Linkage.of([vars(Link("a", 0)) | {"solids": []}])
