"""A person's body from a static trial, and the angles of recordings against Vicon's own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers import mocap
from helpers.mocap import difference, frames, made, reaching

from srl.control.ikns.identify import IdentificationError, Measures, identify, plug_in_gait
from srl.control.ikns.markers import MarkerFit
from srl.runtime.models.body import Body, Marker, average

MARKS = plug_in_gait({"right": Measures()})
ARM = ("shoulder_abduction", "shoulder_flexion", "shoulder_rotation", "elbow_flexion")
PLAIN = average(1.75, ("right",))


def trial(body: Body, bent: float = 80.0, count: int = 5) -> dict[str, np.ndarray]:
    q = reaching(body, count)
    q[:, body.names.index("right_elbow_flexion")] = np.deg2rad(bent)
    q[:, :2] = 0.0
    points = np.array([made(body, row) for row in q])
    return {name: points[:, i] for i, name in enumerate(body.markers)}


def fitted(body: Body, markers: dict[str, np.ndarray]) -> tuple[np.ndarray, MarkerFit]:
    """(frames, n): the angles, and the fit after the last frame. The first frame is shown until its labels are sure."""
    fit = MarkerFit(body)
    points = frames(markers, fit.names)
    angles: list[np.ndarray] = []
    for _ in range(20):
        fit.solve(points[0], np.isfinite(points[0]).all(axis=1), 0.01, starts=6)
    assert not fit.held.all()
    for row in points:
        assert fit.solve(row, np.isfinite(row).all(axis=1), 0.01, starts=6)
        assert not fit.rejected.any()
        angles.append(fit.angles.copy())
    return np.array(angles), fit


def test_a_trial_of_a_known_body_gives_a_body_that_fits_it() -> None:
    """The lengths are those that the rules find; the markers fit to less than a millimetre in every frame."""
    seen = trial(PLAIN)
    body, q = identify(PLAIN, seen, MARKS)
    assert body.sizes["upper_arm"]["right"] == pytest.approx(PLAIN.sizes["upper_arm"]["right"], abs=0.015)
    assert body.sizes["forearm"]["right"] == pytest.approx(PLAIN.sizes["forearm"]["right"], abs=0.015)
    assert set(body.markers) == set(PLAIN.markers)
    angles, fit = fitted(body, seen)
    assert fit.residual < 2e-3
    assert np.rad2deg(np.abs(angles - q)[:, 3:]).max() < 2.0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"RWRA": None}, "no marker 'RWRA'"),
        ({"RELB": np.full((5, 3), np.nan)}, "no frame shows all.*'RELB' is seen least"),
    ],
)
def test_trials_that_dont_show_the_landmarks_are_refused(change: dict[str, np.ndarray | None], words: str) -> None:
    seen = {n: v for n, v in {**trial(PLAIN), **change}.items() if v is not None}
    with pytest.raises(IdentificationError, match=words):
        identify(PLAIN, seen, MARKS)


def test_a_straight_elbow_is_refused() -> None:
    with pytest.raises(IdentificationError, match="right elbow is almost straight: bent by 16 degrees, 20 are needed"):
        identify(PLAIN, trial(PLAIN, bent=5.0), MARKS)
    with pytest.raises(IdentificationError, match="shows no axis"):
        identify(PLAIN, trial(PLAIN, bent=5.0), MARKS, least_bend=0.1)


@pytest.mark.parametrize(("bent", "off"), [(60.0, 4.0), (30.0, 10.0), (22.0, 16.0)])
def test_the_straighter_the_elbow_the_worse_is_the_shoulder(bent: float, off: float) -> None:
    """Trials with elbows bent by 20 to 32 degrees are usual."""
    q = reaching(PLAIN, 5)
    _, found = identify(PLAIN, trial(PLAIN, bent), MARKS)
    rotation = PLAIN.names.index("right_shoulder_rotation")
    assert 0.8 * off < np.rad2deg(np.abs(found - q)[:, rotation]).max() < 1.05 * off


def test_the_static_trial_has_vicons_own_shoulder_and_elbow() -> None:
    """Our names for the file's columns: flexion, abduction, rotation; flexion of the elbow."""
    static = mocap.gait("Static")
    body, q = mocap.gait_body(static)
    chosen = np.linspace(0, len(static["CLAV"]) - 1, len(q)).astype(int)
    for side, letter in (("left", "L"), ("right", "R")):
        ours = {n: np.rad2deg(q[:, body.names.index(f"{side}_{n}")]) for n in ARM}
        shoulder, elbow = (static[f"{letter}{n}Angles"][chosen] for n in ("Shoulder", "Elbow"))
        for i, name in enumerate(("shoulder_flexion", "shoulder_abduction", "shoulder_rotation")):
            assert np.abs(difference(ours[name], shoulder[:, i])).max() < 0.1, name
        assert np.abs(difference(ours["elbow_flexion"], elbow[:, 0])).max() < 0.1
        poses = mocap.vicon_angles(*mocap.as_vicon(body, q, side))
        theirs = mocap.vicon_angles(
            *(mocap.axes(static, s)[chosen] for s in ("TRX", f"{letter}HU", f"{letter}RA", f"{letter}HN"))
        )
        for joint, angles in poses.items():
            off = np.abs(difference(angles, theirs[joint])).max(axis=0)
            assert (off < 0.1).all(), (joint, off)


# degrees rms: what one fixed chain leaves of Vicon's angles in walking; its skin has moved since the static trial
LEFT = {"shoulder": (4.5, 2.5, 8), "elbow": (8, 1e-3, 1e-3), "wrist": (6, 2.5, 8)}


def test_walking_by_the_static_trials_body_is_vicons_to_several_degrees() -> None:
    body, _ = mocap.gait_body(mocap.gait("Static"))
    moving = mocap.gait("Movement")
    q, _ = fitted(body, moving)
    for side, letter in (("left", "L"), ("right", "R")):
        ours = mocap.vicon_angles(*mocap.as_vicon(body, q, side))
        theirs = mocap.vicon_angles(
            *(mocap.axes(moving, s) for s in ("TRX", f"{letter}HU", f"{letter}RA", f"{letter}HN"))
        )
        for joint, most in LEFT.items():
            off = difference(ours[joint], theirs[joint])
            rms, around_its_mean = np.sqrt((off**2).mean(axis=0)), off.std(axis=0)
            assert (rms <= most).all(), (side, joint, rms)
            assert (around_its_mean < 2.5).all(), (side, joint, around_its_mean)


def test_the_recording_with_drop_outs_runs_without_a_jump() -> None:
    """Up to 450 ms without a marker: the largest step is that of the movement, not of what comes and goes."""
    markers = mocap.recorded(mocap.LIFTING)
    names = {name: Marker(s, (0.0, 0.0, 0.0)) for s, group in mocap.LIFTER_MARKERS.items() for name in group}
    body, _ = identify(
        replace(average(1.7, ("right",)), markers=names), {n: v[:60] for n, v in markers.items()}, mocap.LIFTER
    )
    points = frames(markers, tuple(body.markers))
    seen = np.isfinite(points).all(axis=2)
    assert (~seen.all(axis=1)).sum() > 60  # there are drop-outs
    q, _ = fitted(body, markers)
    steps = np.rad2deg(np.abs(np.diff(q, axis=0)))[:, 3:]
    changes = (seen[1:] != seen[:-1]).any(axis=1)
    assert changes.sum() >= 8
    beside = np.maximum(np.roll(steps, 1, axis=0), np.roll(steps, -1, axis=0))
    assert (steps - beside)[changes].max() < 1.5
    assert steps.max() < 4.0
