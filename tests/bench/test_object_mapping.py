"""The peers of the bench `object-mapping` do the same work as the law, or as much of it as the bench says."""

from __future__ import annotations

import sys

import numpy as np
import pinocchio as pin
import pytest

from bench import object_mapping as bench
from srl.runtime.contracts.rotation import homogeneous


@pytest.mark.parametrize("count", [1, 4])
def test_the_papers_equations_with_pinv_take_the_tips_where_the_law_does(count):
    frames, places = bench.closing(), bench.worn(count)
    bases = np.array([homogeneous(place) for place in places])
    law, plain = bench.ours(frames, places), bench.plain(frames, bases)
    found = np.array([[bench.tips(solve(i), bases) for solve in (law, plain)] for i in range(bench.FRAMES)])
    way = np.linalg.norm(np.diff(found[:, 0], axis=0), axis=2).sum(axis=0)
    assert (way > 0.02).all()  # m: it is a motion
    assert np.linalg.norm(found[:, 0] - found[:, 1], axis=2).max() < 0.005


def test_the_urdf_for_the_peer_is_the_finger():
    bases = np.array([homogeneous(place) for place in bench.worn(2)])
    model = pin.buildModelFromXML(bench.urdf(bases))
    data, q = model.createData(), np.random.default_rng(1).uniform(-1.0, 1.0, 8)
    assert list(model.names[1:]) == [f"finger_{i}_joint_{j}" for i in range(2) for j in range(4)]
    pin.framesForwardKinematics(model, data, q)
    ends = [data.oMf[model.getFrameId(f"finger_{i}_tip")].translation for i in range(2)]
    np.testing.assert_allclose(ends, bench.tips(q, bases), atol=1e-9)


def test_without_dex_retargeting_the_bench_goes_on(monkeypatch):
    monkeypatch.setitem(sys.modules, "dex_retargeting.optimizer", None)
    bases = np.array([homogeneous(place) for place in bench.worn(1)])
    assert bench.dex(np.zeros((1, 1, 3)), bases) is None
