"""A calibration from a motion file: the steps follow what the person did; what can't be played is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from helpers import c3d_files, mvnx

from srl.commissioning.calibration.ikns.method import IknsMethod
from srl.commissioning.calibration.played import played
from srl.commissioning.calibration.request import CalibrationRequest
from srl.drivers.noitom.skeleton import Skeleton
from srl.runtime.contracts.errors import RequestError
from srl.runtime.contracts.rotation import product
from srl.runtime.models.body import Body, average
from srl.runtime.profile import profile
from srl.sim.parts.body.motion import Scripted

SHORT = ("walk=5", "stands=3", "hold=4", "sure=60", "drift=60")


RATE = 50.0
HEADING = 0.5  # rad, of the suit's world against the line on which the person stands


def session() -> tuple[np.ndarray, np.ndarray]:
    """(n, 59, 4), (n, 59, 3) m: a person who stands three times on the line, and walks about in between."""
    skeleton = Skeleton("axis-neuron")
    still, walk = (Scripted(script, skeleton, 1.0, 0, "wearer") for script in ("still", "walk"))
    turns, hips = [], []
    for motion, seconds in ((still, 10.0), (walk, 8.0), (still, 8.0), (walk, 8.0), (still, 9.0)):
        for i in range(round(seconds * RATE)):
            place, rotation = motion.at(i / RATE)
            rotation[0] = product((np.cos(HEADING / 2), 0.0, np.sin(HEADING / 2), 0.0), tuple(rotation[0]))
            turns.append(rotation)
            hips.append(place)
    translation = np.tile(skeleton.offsets, (len(turns), 1, 1))
    translation[:, 0] = hips
    return np.array(turns), translation


@pytest.mark.slow
def test_a_suit_is_calibrated_from_an_mvnx_file(tmp_path: Path) -> None:
    file = tmp_path / "p07.mvnx"
    text = mvnx.text(*mvnx.of_suit(Skeleton("axis-neuron"), *session()), RATE)
    file.write_text(text)
    called(file, "suit-station", "suit", *SHORT)
    made = json.loads(file.with_suffix(".json").read_text())
    assert made["heading"] == pytest.approx(HEADING, abs=0.02)
    assert (made["person"], made["simulated"], made["date"], made["stands"]) == ("P07", False, "2026-01-02", 3)
    file.write_text(text[: text.index("<frame", len(text) // 2)] + "</frames></subject></mvnx>")
    with pytest.raises(RequestError, match=r"ends after 2\d\.\d s, in the step 'Stand still'"):
        called(file, "suit-station", "suit", *SHORT)


def called(file: Path, name: str, kind: str, *options: str, person: str | None = "P07") -> None:
    """Calibrates; errors come out."""
    from srl.commissioning.calibration import session
    from srl.commissioning.calibration.screen import Plain

    request = CalibrationRequest(
        name, kind, person=person, out=file.with_suffix(".json"), recording=[file], option=options, yes=True
    )
    session.run(request, Plain(lambda text: None))


@pytest.mark.slow
def test_markers_of_a_c3d_file_become_the_samples_of_ikns(tmp_path: Path) -> None:
    checked, source = profile.load("ikns-finger")
    body: Body = average(1.75, ("right",))
    rest = np.array([0.5 * (joint.lower + joint.upper) for joint in body.joints])
    rest[: len(rest) - 7] = 0.0
    elbow = [joint.name for joint in body.joints].index("right_elbow_flexion")
    frames = []
    for i in range(300):
        q = rest.copy()
        q[elbow] = 1.4 + 0.2 * np.sin(i / 50.0)
        poses = body.forward(q)
        frames.append([poses[m.segment][:3, :3] @ m.at + poses[m.segment][:3, 3] for m in body.markers.values()])
    points = np.array(frames) + np.array([0.0, 0.0, 1.4])
    file = tmp_path / "arm.c3d"
    file.write_bytes(c3d_files.content(points, tuple(f"wearer:{name}" for name in body.markers)))
    method = IknsMethod(
        CalibrationRequest("ikns-finger", "ikns", person="P07"), checked, source, tmp_path / "p.json", print
    )
    channel_map, rows = played(method, file)
    assert channel_map.mark is None
    assert (channel_map.simulated, channel_map.person) == (False, "P07")
    samples = channel_map.samples(rows)
    seen = samples.angles[np.isfinite(samples.angles).all(axis=1)][20:]  # once the law has found the arm
    assert len(seen) > 200
    found = seen[:, list(channel_map.options.angles).index("right_elbow_flexion")]
    assert np.ptp(found) == pytest.approx(0.4, abs=0.02)


@pytest.mark.parametrize(("profile_name", "kind", "ending", "words"), [
    ("suit-station", "suit", ".c3d", "it can stand for vicon or natnet, of which the calibration reads 0"),
    ("ikns-finger", "ikns", ".mvnx", "it can stand for xsens-mvn or noitom, of which the calibration reads 0"),
])  # fmt: skip
def test_a_file_of_another_system_is_refused(
    profile_name: str, kind: str, ending: str, words: str, tmp_path: Path
) -> None:
    with pytest.raises(RequestError, match=words):
        called(tmp_path / f"a{ending}", profile_name, kind)
    with pytest.raises(RequestError, match="doesn't say whose it is"):
        called(tmp_path / f"a{ending}", profile_name, kind, person=None)
