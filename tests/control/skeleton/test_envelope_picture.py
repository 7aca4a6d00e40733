"""What a picture of the envelope is given, against the law's own distances and the skeleton's nodes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.blame import HIGH, LOW, Wearer

from srl.control.skeleton.body_clearance import BodyClearanceConfig
from srl.control.skeleton.collision import Collision, CollisionConfig
from srl.control.skeleton.envelope import PARTS
from srl.control.skeleton.kinematics import Kinematics
from srl.testing import bound


def law(**options: Any) -> tuple[Collision, Wearer]:
    made = bound(Collision("collision", CollisionConfig(**options)))
    wearer = Wearer(BodyClearanceConfig(least=0.02, uncertainty=0.0), np.random.default_rng(5), 1.0)
    made.input["translation"][:] = wearer.translation
    made.input["rotation"][:] = wearer.rotation(0.0)
    made.reset()
    return made, wearer


def test_capsules_run_from_node_to_node_and_have_their_least_distance() -> None:
    made, wearer = law()
    kinematics = Kinematics(made.config.figure)  # type: ignore[attr-defined]
    signal = next(s for s in made.outputs if s.name == "envelope")
    pairs = made.outputs[0].labels
    rng = np.random.default_rng(1)
    for k in range(20):
        q = rng.uniform(LOW, HIGH)
        made.input["rotation"][:], made.input["arm"][:] = wearer.rotation(0.1 * k), q
        made.update(0.01)
        nodes = kinematics.nodes(made.input["rotation"], wearer.translation, {"right": q})
        tree = made.config.figure.tree  # type: ignore[attr-defined]
        for name, row in zip(signal.labels, made.output["envelope"], strict=True):
            ends = (PARTS[name].start, PARTS[name].end) if name in PARTS else name.split("-")
            assert row[:6] == pytest.approx(np.ravel([nodes[tree.index(end)] for end in ends]), abs=1e-9)
            mine = [d for d, pair in zip(made.output["distance"], pairs, strict=True) if name in pair.split("/")]
            assert row[7] == min(mine) if mine else np.isnan(row[7])
    assert np.isnan(made.output["envelope"][signal.labels.index("RBase-RJ1"), 7])  # not compared with anything


def test_the_closest_gaps_are_those_of_the_three_nearest_segments() -> None:
    made, _ = law()
    names = [pair.split("/")[1] for pair in made.outputs[0].labels]
    least = {name: made.output["distance"][[n == name for n in names]].min() for name in names}
    closest = made.output["closest"]
    assert closest[:, 6].tolist() == sorted(least.values())[:3]
    ends = np.linalg.norm(closest[:, 3:6] - closest[:, :3], axis=1)
    assert ends == pytest.approx(np.abs(closest[:, 6]), abs=1e-9)


def test_it_can_be_left_out_and_what_isnt_compared_has_no_distance() -> None:
    made, _ = law(picture=False)
    assert {s.name for s in made.outputs} == {"distance", "approach", "points", "least"}
    envelope = CollisionConfig().envelope
    pairs = [(envelope.links[p.link], envelope.segments[p.segment]) for p in envelope.pairs]
    kept = [pair for pair in pairs if pair[1] == "head"]
    made, _ = law(leave_out=[pair for pair in pairs if pair not in kept])
    shown = made.output["envelope"][:, 7]
    assert np.isfinite(shown).sum() == len(kept) + 1
    assert np.isfinite(made.output["closest"]).all(axis=1).tolist() == [True, False, False]
