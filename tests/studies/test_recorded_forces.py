"""The study of recorded forces: comparing paths, eq. 1 on its own, recordings that aren't there."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from helpers.shared import shared

from srl.sim.wearer.forces import ForceRecording, Forces
from srl.studies.superman import recorded_forces as study
from srl.studies.superman.assumptions import assumed

ANY = ForceRecording.model_validate({"file": "any.csv", "start": 1.0})


def a_curve(seed: int = 0) -> np.ndarray:
    return np.cumsum(np.random.default_rng(seed).normal(size=(200, 2)), axis=0)


def test_a_path_is_alike_to_itself_moved_turned_and_scaled() -> None:
    c, s = np.cos(0.7), np.sin(0.7)
    moved = 2.5 * a_curve() @ np.array([[c, s], [-s, c]]) + [3.0, -1.0]
    shape, scale = study.alike(a_curve(), moved)
    assert shape == pytest.approx(1.0)
    assert scale == pytest.approx(2.5)
    np.testing.assert_allclose(study.fitted(a_curve(), moved), a_curve(), atol=1e-9)


def test_a_mirror_image_is_another_shape() -> None:
    shape, _ = study.alike(a_curve(), a_curve() * [1.0, -1.0])
    assert shape < 0.9


def test_a_path_without_length_is_like_none() -> None:
    assert study.alike(a_curve(), np.ones((200, 2)))[0] == 0.0


def test_eq_1_makes_a_steady_force_a_steady_speed() -> None:
    t = np.arange(0.0, 5.0, 0.01)
    forces = Forces(t, np.tile([8.1, 0.0, 0.0, 0.0, 0.0, 0.0], (len(t), 1)), ANY)
    times, path = study.law(forces, 1.0, 4.0, dead=0.1)
    speed = np.gradient(path[:, 0], times)
    assert speed[-5] == pytest.approx(8.0 / 40.0, rel=1e-6)
    # M / D = 0.15 s
    assert speed[np.searchsorted(times, 0.15)] == pytest.approx(0.2 * (1 - np.exp(-1)), rel=0.01)


def test_forces_within_the_dead_band_move_nothing() -> None:
    t = np.arange(0.0, 2.0, 0.01)
    forces = Forces(t, np.tile([0.05, 0.05, 0.0, 0.0, 0.0, 0.0], (len(t), 1)), ANY)
    assert not study.law(forces, 1.0, 1.0, dead=0.1)[1].any()


def test_recordings_that_are_not_there_are_left_out_in_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SRL_SHARED", str(tmp_path))
    result = study.run(tmp_path, quick=False)
    assert [claim.holds for claim in result.claims] == [False] * 3
    assert all(claim.measured is None for claim in result.claims)
    assert sum("isn't there" in str(entry) for row in result.table for entry in row.values()) == 2
    assert not result.files
    json.dumps(result.metrics())


def test_the_recordings_are_read_whole() -> None:
    setup = assumed(study.NAME)
    originals, missing = study.found_in(shared("data"), setup)
    assert not missing
    assert [o.name for o in originals] == [*(f"panda-{k}" for k in setup["panda"]["numbers"]), "handover"]
    for original in originals:
        seconds = original.forces().duration - setup["begin"]
        assert 6.0 < seconds < 14.0
        assert original.path.shape[1] == 3
        assert 0.05 < np.ptp(original.path, axis=0).max() < 1.0


@pytest.mark.slow
def test_a_recording_is_replayed_as_eq_1_says(tmp_path: Path) -> None:
    shared("data")
    result = study.run(tmp_path, quick=True)
    found = {claim.id: claim for claim in result.claims}
    assert found["recorded-forces-law"].holds
    assert found["panda-same-shape"].measured is not None
    assert found["handover-same-shape"].measured is None
    assert all((tmp_path / file).stat().st_size > 1000 for file in result.files)
