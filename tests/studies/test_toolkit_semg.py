"""Filters against their own promise and scipy, envelopes of known signals, real recordings through the pipeline."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.shared import shared
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from srl.studies.toolkit import semg
from srl.studies.toolkit.errors import StudyError
from srl.studies.toolkit.semg import EmgError, Filters, OnlineEnvelope, activity, envelope, greatest, normalise

F = Filters(2000.0)


def _gain(sections: np.ndarray, frequencies: list[float], rate: float, passes: int) -> list[float]:
    _, response = signal.freqz_sos(sections, worN=frequencies, fs=rate)
    return list(np.abs(response) ** passes)


@pytest.mark.parametrize("passes", [1, 2])
@pytest.mark.parametrize(
    "filters",
    [F, Filters(1000.0), Filters(4000.0, (10, 1990), 2, 3.0, 4), Filters(500.0, (30, 249), 8, 20.0, 1)],
)
def test_cut_offs_are_where_they_are_promised(filters: Filters, passes: int) -> None:
    edges = [*filters.band, math.sqrt(filters.band[0] * filters.band[1])]
    low, high, middle = _gain(filters.band_pass(passes), edges, filters.rate, passes)
    assert (low, high) == pytest.approx((math.sqrt(0.5),) * 2, rel=1e-6)
    assert middle == pytest.approx(1.0, abs=0.01)
    assert _gain(filters.low_pass(passes), [0.0, filters.cutoff], filters.rate, passes) == pytest.approx(
        [1.0, math.sqrt(0.5)], rel=1e-6
    )


def test_one_pass_is_the_ordinary_butterworth() -> None:
    ours, theirs = F.band_pass(), signal.butter(4, (20, 450), "bandpass", output="sos", fs=2000)
    assert _gain(ours, [5, 30, 100, 800], 2000, 1) == pytest.approx(_gain(theirs, [5, 30, 100, 800], 2000, 1), rel=1e-9)


@pytest.mark.parametrize("filters", [F, Filters(1000.0, cutoff=3.0, cutoff_order=4), Filters(2000.0, cutoff_order=1)])
def test_the_stated_delay_is_the_low_passs(filters: Filters) -> None:
    b, a = signal.sos2tf(filters.low_pass())
    _, delay = signal.group_delay((b, a), w=[0.05], fs=filters.rate)
    assert filters.delay == pytest.approx(delay[0] / filters.rate, rel=1e-3)


def _noise(seconds: float, rms: float, seed: int = 0, rate: float = 2000.0) -> np.ndarray:
    """White noise whose part in the band has about this RMS."""
    white = np.random.default_rng(seed).normal(size=(round(seconds * rate), 1))
    return white * rms / math.sqrt((450 - 20) / (rate / 2))


@pytest.mark.slow
def test_noise_gives_its_mean_absolute_value_offline_and_online_whatever_the_offset() -> None:
    raw = _noise(60, 1e-4)
    expected = 1e-4 * math.sqrt(2 / math.pi)
    offline = envelope(raw, F)
    online = OnlineEnvelope(1, F).take(raw + 0.3)
    assert offline.mean() == pytest.approx(expected, rel=0.03)
    assert online[4000:].mean() == pytest.approx(offline[4000:].mean(), rel=0.01)
    assert envelope(raw + 0.3, F) == pytest.approx(offline, abs=1e-8)


def test_offline_has_no_lag_and_online_the_stated_one() -> None:
    rate, t = 2000.0, np.arange(20000) / 2000.0
    shape = 1 + 0.8 * np.sin(2 * np.pi * 0.5 * t)  # slow against the cut-off
    carrier = np.sin(2 * np.pi * 120 * t)
    raw = (shape * carrier)[:, None]
    expected = shape * 2 / math.pi
    middle = slice(4000, 16000)
    assert envelope(raw, F)[middle, 0] == pytest.approx(expected[middle], rel=0.01)
    online = OnlineEnvelope(1, F).take(raw)[:, 0]
    lag = round(F.delay * rate)
    assert online[4000 + lag : 16000 + lag] == pytest.approx(expected[middle], rel=0.02)


def test_artefacts_out_of_the_band_are_removed() -> None:
    t = np.arange(20000) / 2000.0
    raw = np.stack([np.sin(2 * np.pi * 3 * t), np.sin(2 * np.pi * 900 * t), np.sin(2 * np.pi * 100 * t)], axis=1)
    mean = envelope(raw, F)[4000:16000].mean(axis=0)
    assert mean[0] < 1e-3
    assert mean[1] < 1e-3
    assert mean[2] == pytest.approx(2 / math.pi, rel=0.01)


@pytest.mark.slow
@settings(max_examples=30)
@given(st.lists(st.integers(0, 400), min_size=1, max_size=20), st.integers(0, 100))
def test_online_gives_the_same_however_it_is_cut(cuts: list[int], seed: int) -> None:
    raw = np.random.default_rng(seed).normal(0.2, 1, (sum(cuts) + 1, 3))
    whole = OnlineEnvelope(3, F).take(raw)
    online = OnlineEnvelope(3, F)
    parts = [online.take(part) for part in np.split(raw, np.cumsum(cuts))]
    assert np.concatenate(parts) == pytest.approx(whole, rel=1e-12, abs=1e-15)
    assert online.value == pytest.approx(whole[-1], rel=1e-12, abs=1e-15)


def test_scaling_the_signal_scales_the_envelope_and_leaves_the_share_of_the_mvc() -> None:
    task, most = envelope(_noise(5, 1.0, 1), F), envelope(_noise(5, 4.0, 2), F)
    share = normalise(task, greatest([most], 2000))
    again = normalise(envelope(_noise(5, 7.0, 1), F), greatest([envelope(_noise(5, 28.0, 2), F)], 2000))
    assert again == pytest.approx(share, rel=1e-9)
    assert 0.2 < share.mean() < 0.25  # the best half second lies above the mean


def test_the_mvc_is_the_best_window_of_all_trials() -> None:
    quiet, strong = np.full((4000, 2), 1.0), np.full((4000, 2), 1.0)
    strong[1000:2000, 0] = 5.0
    strong[3000, 1] = 1000.0  # one sample is no contraction
    assert greatest([quiet, strong], 2000, 0.5) == pytest.approx([5.0, 1.0 + 999 / 1000])


def test_the_figures_of_a_trial() -> None:
    normal = np.stack([np.linspace(0, 1, 1001), np.full(1001, 1.5)], axis=1)
    found = activity(normal, ["biceps", "triceps"], 1000)
    assert found.mean == pytest.approx([0.5, 1.5])
    assert (found.static[0], found.median[0], found.peak[0]) == pytest.approx((0.1, 0.5, 0.9))
    assert list(found.above) == [0, 1]
    assert found.seconds == 1.001


def test_the_papers_muscles() -> None:
    assert semg.MUSCLES == {"deltoid_anterior": "AD", "deltoid_posterior": "PD", "biceps": "BC", "triceps": "TR"}


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Filters(800.0), "between 0 and 400 Hz"),
        (lambda: Filters(2000.0, (450, 20)), "450 to 20 Hz"),
        (lambda: Filters(2000.0, cutoff=0), "cut-off is 0 Hz"),
        (lambda: Filters(2000.0, band_order=0), "orders 0 and 2"),
        (lambda: envelope(np.zeros(5000), F), r"shape \(5000,\).*emg\[:, None\]"),
        (lambda: envelope(np.zeros((400, 1)), F), r"400 samples, expected more than 400 \(0.2 s\)"),
        (lambda: envelope(np.full((5000, 1), np.nan), F), "finite"),
        (lambda: envelope(np.zeros((0, 2)), F), "shape"),
        (lambda: OnlineEnvelope(2, F).take(np.zeros((5, 3))), "3 muscles, expected 2"),
        (lambda: greatest([], 2000), "no MVC trial"),
        (lambda: greatest([np.ones((10, 1))], 2000), "0.005 s, expected at least 0.5 s"),
        (lambda: greatest([np.zeros((2000, 1))], 2000), "muscle 1 has no signal"),
        (lambda: greatest([np.ones((2000, 1)), np.ones((2000, 2))], 2000), "different muscles"),
        (lambda: normalise(np.ones((5, 2)), [1.0]), "2 muscles and 1 MVC values"),
        (lambda: normalise(np.ones((5, 2)), [1.0, 0.0]), "all above 0"),
        (lambda: activity(np.ones((5, 2)), ["biceps", "biceps"], 2000), "biceps, biceps for 2"),
    ],
)
def test_mistakes(make: object, says: str) -> None:
    assert callable(make)
    with pytest.raises((StudyError, EmgError), match=says):
        make()


# Real recordings


def test_bursts_of_a_real_muscle_stand_out_of_its_rest() -> None:
    raw = np.loadtxt(shared("data/semg/emg_1.txt"))[:, None]
    filters = Filters(1000.0)
    found = envelope(raw, filters)
    share = normalise(found, greatest([found], 1000.0))[:, 0]
    # Rest most of the time, and several bursts apart from each other, each up to 0.3 or more of the strongest.
    assert np.median(share) < 0.2
    bursts = np.flatnonzero(np.diff((share > 0.3).astype(int)) == 1)
    assert 3 <= len(bursts) <= 100
    # Independent of our filters: the power of the band by Fourier, second by second, rises and falls with it.
    seconds = len(raw) // 1000
    spectrum = np.fft.rfft(raw[: seconds * 1000, 0].reshape(seconds, 1000) * np.hanning(1000), axis=1)
    rms = np.sqrt((np.abs(spectrum[:, 20:451]) ** 2).sum(axis=1))
    means = found[: seconds * 1000, 0].reshape(seconds, 1000).mean(axis=1)
    assert np.corrcoef(rms, means)[0, 1] > 0.9
    online = OnlineEnvelope(1, filters).take(raw)
    lag = round(filters.delay * 1000)
    assert np.corrcoef(online[2000 + lag :, 0], found[2000:-lag, 0])[0, 1] > 0.9


def test_the_papers_four_muscles_while_a_real_box_is_lifted() -> None:
    file = shared("data/vicon_upper_limb_emg/markers_analogs.c3d")
    c3d = pytest.importorskip("c3d", reason="the package c3d (of the dev extra) reads this recording")
    with file.open("rb") as stream:
        reader = c3d.Reader(stream)
        labels = [label.strip().split(".")[0] for label in reader.analog_labels]
        box = [i for i, label in enumerate(reader.point_labels) if label.startswith("boite:")]
        frames = [(points[box, 2], signals) for _, points, signals in reader.read_frames()]
        rate = float(reader.analog_rate)
    height = np.median([z for z, _ in frames], axis=1)  # mm, of the box, at 100 Hz
    analog = np.concatenate([signals for _, signals in frames], axis=1).T
    columns = [labels.index(name) for name in ("Delt_ant", "Delt_post", "Biceps", "Triceps")]
    raw = analog[:, columns].astype(float)
    assert rate == 2000.0
    found = envelope(raw, Filters(rate))
    share = normalise(found, greatest([found], rate))
    summary = activity(share, list(semg.MUSCLES), rate)
    assert summary.seconds == pytest.approx(5.8)
    assert (summary.static < summary.median).all()
    assert (summary.median < summary.peak).all()
    assert (summary.peak > 2 * summary.static).all()  # none is at rest all the time, none at work
    # The markers are the oracle: the deltoid's anterior part raises the arm, so its greatest effort falls into the
    # time when the box has left its place (700 mm) and hasn't settled on the new one (928 mm).
    deltoid = share[:, 0].reshape(len(height), -1).mean(axis=1)
    moving = np.arange(np.flatnonzero(height > 710)[0], np.flatnonzero(height > 935)[-1])
    assert np.argmax(deltoid) in moving
    assert deltoid[moving].mean() > 3 * np.delete(deltoid, moving).mean()
    # In the last second the arm is at rest.
    assert deltoid[-100:].mean() < 0.1 * deltoid[moving].mean()
