"""Characteristics of a glove's sensors from shapes of the hand: the maths alone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.commissioning.calibration.glove.fit import GloveError, Held, Thresholds, fit, refusals
from srl.commissioning.calibration.glove.samples import Plan, Samples, held, moved
from srl.commissioning.calibration.glove.shapes import AGAIN, ALONE, FIST, FLAT, Angles, bent_in, shapes
from srl.runtime.models.human_hand import SENSORS

NAMES = tuple(name for name in SENSORS[22] if bent_in(name) is not None)
KNOWN = Angles()


def given_by(offset: np.ndarray, gain: np.ndarray, noise: float = 0.5) -> dict[int, Held]:
    """What a hand that is exactly as told gives."""
    found = {}
    for number, shape in shapes(KNOWN).items():
        mean = offset + np.array([shape.angles.get(name, 0.0) for name in NAMES]) / gain
        found[number] = Held(mean, np.full(len(NAMES), noise), mean - 1.0, mean + 1.0, 100)
    return found


@st.composite
def characteristics(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray]:
    """Offsets and gains of any sign with which no sensor comes to an end of its scale."""
    angles = np.array([max(shape.angles.get(name, 0.0) for shape in shapes(KNOWN).values()) for name in NAMES])
    spans = np.array([draw(st.floats(25.0, 150.0)) * draw(st.sampled_from([1.0, -1.0])) for _ in NAMES])
    low = np.array([draw(st.floats(5.0, 250.0 - abs(span))) for span in spans])
    return low + np.maximum(-spans, 0.0), angles / spans


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(characteristics())
def test_what_an_exact_hand_gives_is_found_exactly_and_taken(hidden: tuple[np.ndarray, np.ndarray]) -> None:
    offset, gain = hidden
    found = fit(NAMES, given_by(offset, gain), KNOWN)
    np.testing.assert_allclose(found.offset, offset, atol=1e-9)
    np.testing.assert_allclose(found.gain, gain, rtol=1e-9)
    assert refusals(found, KNOWN, Thresholds()) == ()
    assert (found.uncertain > 0.0).all()
    for number, shape in shapes(KNOWN).items():
        bent = np.array([shape.angles.get(name, 0.0) for name in NAMES])
        own = found.gain * (found.held[number].mean - found.offset)
        np.testing.assert_allclose(own, bent, atol=1e-9)


@settings(max_examples=40, deadline=None)
@given(characteristics(), st.sampled_from([n for n in NAMES if bent_in(n) == FIST]), st.data())
def test_an_exchange_between_two_fingers_is_found(
    hidden: tuple[np.ndarray, np.ndarray], one: str, data: st.DataObject
) -> None:
    others = [n for n in NAMES if bent_in(n) == FIST and n.partition("_")[0] != one.partition("_")[0]]
    i, j = NAMES.index(one), NAMES.index(data.draw(st.sampled_from(others)))
    reported = given_by(*hidden)
    for each in reported.values():
        for values in (each.mean, each.least, each.greatest):
            values[[i, j]] = values[[j, i]]
    places = {error.place for error in refusals(fit(NAMES, reported, KNOWN), KNOWN, Thresholds())}
    assert places == {NAMES[i], NAMES[j]}


@settings(max_examples=40, deadline=None)
@given(characteristics(), st.sampled_from(NAMES), st.floats(1.0, 255.0))
def test_a_sensor_that_doesnt_move_is_the_only_one_refused(
    hidden: tuple[np.ndarray, np.ndarray], dead: str, at: float
) -> None:
    reported, i = given_by(*hidden), NAMES.index(dead)
    for each in reported.values():
        each.mean[i] = each.least[i] = each.greatest[i] = at
    found = fit(NAMES, reported, KNOWN)
    assert [error.place for error in refusals(found, KNOWN, Thresholds())] == [dead]


@settings(max_examples=40, deadline=None)
@given(characteristics(), st.lists(st.sampled_from([FLAT, FIST, AGAIN, *ALONE.values()]), min_size=1, max_size=3))
def test_no_counts_make_a_number_that_isnt_one_pass(hidden: tuple[np.ndarray, np.ndarray], constant: list[int]) -> None:
    """Shapes in which the hand stayed flat: refused or right, never a gain that isn't finite."""
    reported = given_by(*hidden)
    for number in constant:
        for to, source in zip(
            (reported[number].mean, reported[number].least, reported[number].greatest),
            (reported[FLAT].mean, reported[FLAT].least, reported[FLAT].greatest), strict=True,
        ):  # fmt: skip
            to[:] = source
    found = fit(NAMES, reported, KNOWN)
    if not refusals(found, KNOWN, Thresholds()):
        assert np.isfinite(found.gain).all()
        np.testing.assert_allclose(found.gain, hidden[1], rtol=1e-9)


def test_the_uncertainty_is_that_of_the_angle_at_the_bent_end() -> None:
    """Against many calibrations of one glove, each with its own noise and rounding."""
    offset, gain, random = np.full(len(NAMES), 80.3), np.full(len(NAMES), 0.015), np.random.default_rng(4)
    exact = given_by(offset, gain)
    bent = np.array([exact[bent_in(name) or FLAT].mean[i] for i, name in enumerate(NAMES)])
    found, output = [], []
    for _ in range(400):
        reported = {}
        for number, each in exact.items():
            mean = each.mean + random.uniform(-0.5, 0.5, len(NAMES)) + random.normal(0.0, 2.0, len(NAMES)) / 5.0
            reported[number] = Held(mean, np.full(len(NAMES), 2.0), mean - 5.0, mean + 5.0, 25)
        glove = fit(NAMES, reported, KNOWN)
        found.append(glove.gain * (bent - glove.offset))
        output.append(glove.uncertain)
    np.testing.assert_allclose(np.std(found, axis=0).mean(), np.mean(output), rtol=0.05)


def test_a_sensor_that_no_shape_bends_is_refused() -> None:
    with pytest.raises(GloveError, match="no shape bends it by a known angle"):
        fit((*NAMES, "wrist_yaw"), given_by(np.full(len(NAMES), 80.0), np.full(len(NAMES), 0.015)), KNOWN)


def test_noise_isnt_motion_and_gaps_are() -> None:
    raw = 100.0 + 3.0 * np.random.default_rng(1).normal(size=(500, 4))
    assert moved(raw) < 2.0
    drifting = raw + np.linspace(0.0, 10.0, 500)[:, None] * [1.0, 0.0, 0.0, 0.0]
    assert moved(drifting) > 5.0
    raw[::10] = np.nan  # a radio that loses some
    assert moved(raw) < 2.0
    raw[:100] = np.nan
    assert moved(raw) == np.inf
    assert moved(raw[:3]) == moved(raw[:, :0]) == np.inf


def test_a_shape_that_was_broken_off_doesnt_count() -> None:
    times = np.arange(100) / 50.0
    marks = np.full(100, FLAT)
    short = Samples(times, np.full((100, 3), 100.0), marks)
    with pytest.raises(GloveError, match=r"shape 2 \(fist\): it wasn't held to its end"):
        held(short, (0, 1, 2), KNOWN, Plan(), Thresholds())
    with pytest.raises(GloveError, match=r"shape 1 \(flat\): it wasn't held to its end"):
        held(short, (0, 1, 2), KNOWN, Plan(hold=3.0), Thresholds())


def test_what_was_broken_off_or_moved_replaces_nothing() -> None:
    """The first time shape 1 is whole and still; then it moves, is broken off, and some sensor is broken all along."""
    marks, raw = [], []
    for number in range(1, 10):
        marks += [0] * 10 + [number] * 110
        raw += [np.full((120, 3), 100.0 + number)]
    marks += [0] * 10 + [1] * 110 + [0] * 10 + [1] * 20
    raw += [np.full((10, 3), 90.0), 90.0 + np.linspace(0.0, 30.0, 110)[:, None] * np.ones(3), np.full((30, 3), 50.0)]
    counts = np.concatenate(raw)
    counts[:, 2] = np.where(np.arange(len(counts)) % 2, np.nan, 1.0)
    samples = Samples(np.arange(len(counts)) / 50.0, counts, np.array(marks))
    found = held(samples, (0, 1), KNOWN, Plan(), Thresholds())
    assert found[1].mean.tolist() == [101.0, 101.0]
    with pytest.raises(GloveError, match=r"shape 1 \(flat\): some samples are missing"):
        held(samples, (0, 2), KNOWN, Plan(), Thresholds())
