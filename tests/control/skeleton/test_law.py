"""The law `skeleton`: its outputs are the kinematics' and the paper's, its names are the suit's and the servos'."""

from pathlib import Path

import numpy as np
import pytest
from helpers.control import bound
from helpers.shared import shared
from helpers.skeleton import FILES, FOLDER, TWO, tip
from pydantic import ValidationError

from srl.control.skeleton.law import Skeleton, SkeletonLawConfig
from srl.control.skeleton.paper import PaperVector
from srl.drivers.noitom.config import signals
from srl.drivers.noitom.skeleton import Skeleton as Suit
from srl.runtime.contracts.files import Files
from srl.runtime.models.models import ArmsModel, context
from srl.runtime.models.skeleton import bvh


def law(**options: object) -> Skeleton:
    models = context({"srl-arms": options.pop("arms", ArmsModel())}) | {"files": Files()}  # type: ignore[dict-item]
    return bound(Skeleton("skeleton", SkeletonLawConfig.model_validate(options, context=models)))


def test_its_ports_go_by_the_suits_names() -> None:
    rotation, translation = signals(Suit("axis-neuron"))
    inputs = {signal.name: signal for signal in law(arms=ArmsModel(sides=("left", "right"))).inputs}
    assert list(inputs) == ["rotation", "translation", "right", "left"]
    for own, suits in ((inputs["rotation"], rotation), (inputs["translation"], translation)):
        assert (own.labels, own.components, own.unit) == (suits.labels, suits.components, suits.unit)
    assert [signal.naming_fault() for signal in law().outputs] == ["", ""]


def test_nodes_and_vector_of_a_real_frame() -> None:
    path = shared(f"{FOLDER}/{FILES[1]}")
    controller = law(hierarchy=str(path))
    names = controller.inputs[0].labels
    turns, places = bvh.read(path).pose(names)
    controller.input["rotation"][:], controller.input["translation"][:] = turns[100], places[100]
    controller.input["right"][:] = TWO
    controller.reset()
    nodes, figure = controller.output["nodes"], controller.config.figure  # type: ignore[attr-defined]
    expected = bvh.read(path).world_positions()[100] / 100.0
    human = [figure.tree.index(name) for name in figure.human.names]
    np.testing.assert_allclose(nodes[human], expected, rtol=0, atol=1e-12)
    _, translation, arms = PaperVector(figure).read(controller.output["vector"])
    np.testing.assert_allclose(translation, places[100], rtol=0, atol=1e-12)
    np.testing.assert_allclose(arms["right"], TWO, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(arms["left"], 0.0)


def test_the_end_is_where_pinocchio_puts_it() -> None:
    controller = law()
    controller.input["rotation"][:] = 1.0, 0.0, 0.0, 0.0
    controller.input["right"][:] = TWO
    controller.update(0.01)
    names, nodes = controller.outputs[0].labels, controller.output["nodes"]
    np.testing.assert_allclose(nodes[names.index("REnd")] - nodes[names.index("Spine")], tip(TWO), rtol=0, atol=1e-12)


def test_a_hierarchy_that_cant_be_read_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.bvh").write_text("HIERARCHY\nROOT Hips\n{\nOFFSET 0 0\n")
    with pytest.raises(ValidationError, match="line 4: 2 number"):
        law(hierarchy=str(tmp_path / "a.bvh"))
    (tmp_path / "b.bvh").write_text("HIERARCHY\nROOT Hips\n{\nOFFSET 0 0 0\n}\n")
    with pytest.raises(ValidationError, match="no node 'Spine'"):
        law(hierarchy=str(tmp_path / "b.bvh"))


def test_without_the_vector_there_is_none() -> None:
    assert [signal.name for signal in law(vector=False).outputs] == ["nodes"]
