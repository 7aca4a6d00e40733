"""One word of a shipped profile chooses the capture system; the laws behind go on as they are."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import ROOT

from srl.testing import simulate

pytestmark = pytest.mark.slow


def chosen(tmp_path, profile: str, default: str, word: str):
    """The profile with another word, as its file would have it."""
    text = (ROOT / "profiles" / f"{profile}.yaml").read_text()
    assert default in text
    path = tmp_path / f"{profile}.yaml"
    path.write_text(text.replace(default, word, 1))
    for kept in (ROOT / "profiles").glob(f"{profile}*.json"):
        (tmp_path / kept.name).write_bytes(kept.read_bytes())
    return path


@pytest.mark.parametrize("system", ["xsens", "optitrack", "vicon"])
def test_the_skeleton_follows_by_another_system(tmp_path, system):
    run = simulate(chosen(tmp_path, "human-srl", "capture: noitom", f"capture: {system}"), 1.0)
    labels = run.layout.fields["skeleton.nodes"].labels
    truth = run.value("world.wearer_position")[-1]
    joints = run.layout.fields["world.wearer_position"].labels
    for joint in ("Hips", "Head", "RightHand", "LeftFoot"):
        found = run.value("skeleton.nodes")[-1, labels.index(joint)][[2, 0, 1]]
        np.testing.assert_allclose(found, truth[joints.index(joint)], atol=0.03)
    assert not [event for event in run.events if "lost" in event]


@pytest.mark.exhaustive
def test_ikns_closes_the_finger_by_a_suit(tmp_path):
    run = simulate(chosen(tmp_path, "ikns-finger", "input: ikns ", "input: ikns-xsens "), 6.5)
    c, swivel = run.value("intent.c")[300:, 0], run.value("world.wearer_dofs")[300:, 0]
    assert np.ptp(c) > 0.5
    assert abs(np.corrcoef(c, swivel)[0, 1]) > 0.99
