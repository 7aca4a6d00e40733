"""The simulated person repeats an MVNX file as it repeats a BVH."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers import mvnx

from srl.drivers.noitom.skeleton import Skeleton
from srl.runtime.contracts.errors import RecordingError
from srl.sim.parts.body.body import BodyConfig, BodyPart
from srl.sim.parts.body.motion import Recorded, Scripted

NEURON = Skeleton("axis-neuron")


def walk(n: int = 150, rate: float = 60.0) -> tuple[np.ndarray, np.ndarray]:
    """(n, 59, 4), (n, 59, 3) of a person who walks."""
    script = Scripted("walk", NEURON, 1.1, 0, "wearer")
    frames = [script.at(i / rate) for i in range(n)]
    translation = np.tile(script.offsets, (n, 1, 1))
    translation[:, 0] = [hips for hips, _ in frames]
    return np.array([turns for _, turns in frames]), translation


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "walk.mvnx"
    path.write_text(mvnx.text(*mvnx.of_suit(NEURON, *walk()), 60.0))
    return path


def test_the_person_moves_as_the_file_says(file: Path) -> None:
    rotation, translation = walk()
    motion = Recorded(file, NEURON, 1.0, False)
    measured = [i for i, name in enumerate(NEURON.names) if name in mvnx.JOINT_OF.values()]
    np.testing.assert_allclose(motion.offsets[measured[1:]], translation[0, measured[1:]], atol=1e-5)
    for frame in (0, 60, 149):
        hips, turns = motion.at(frame / 60.0)
        np.testing.assert_allclose(hips, translation[frame, 0], atol=1e-5)
        assert np.abs((turns * rotation[frame])[measured].sum(axis=1)) == pytest.approx(1.0, abs=1e-6)
    middle = motion.at(90.5 / 60.0)[0]
    np.testing.assert_allclose(middle, translation[90:92, 0].mean(axis=0), atol=1e-4)
    assert motion.duration == pytest.approx(149 / 60.0)


def test_the_part_takes_it_by_the_key_of_a_bvh_file(file: Path) -> None:
    part = BodyPart("wearer", BodyConfig(recording=file), 0)
    assert part.duration == pytest.approx(149 / 60.0)
    with pytest.raises(RecordingError, match=r"'\.c3d' is no kind of a suit's recording.*\.bvh or \.mvnx"):
        BodyPart("wearer", BodyConfig(recording=file.with_suffix(".c3d")), 0)
