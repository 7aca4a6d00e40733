"""EMG from recordings of the trigno driver: every sample once, at its time; gaps are found and said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.run import call

from srl.runtime.ipc.layout import Layout
from srl.runtime.recording.reader import Recording, read
from srl.studies.toolkit.errors import StudyError
from srl.studies.toolkit.semg import Filters
from srl.studies.toolkit.semg_record import Emg, from_arrays, from_recording

RATE = 2000
BLOCK = 64
START = 7_000_000_000_000_000  # ns


def _signal(numbers: np.ndarray, channels: int = 2) -> np.ndarray:
    """(k, n), different for each sample and channel, and never 0."""
    return np.stack([(numbers + 1) * 1e-6 * (c + 1) for c in range(channels)], axis=1)


class Made:
    """Rows as the driver would leave them, written cycle by cycle."""

    def __init__(self, block: int = BLOCK) -> None:
        self.layout = Layout(devices=["emg"])
        self.layout.add("emg.emg", "state", (2,), "V", labels=("biceps", "triceps"))
        if block:
            self.layout.add("emg.samples", "state", (block, 2), "V")
            self.layout.add("emg.count", "state", (1,), "1")
        self.rows: list[np.ndarray] = []
        self.buffer, self.count = np.zeros((block, 2)), 0
        self.shown = 0  # what the row says; it keeps the old count until samples come
        self.stamp, self.reconnects, self.resyncs = -1, 0, 0

    def cycle(self, new: np.ndarray | None = None, at: float = 0.0) -> None:
        """A row; `new` samples (k, 2), the last of which was taken at `at` s."""
        if new is not None and len(new):
            self.count += len(new)
            self.shown = self.count
            self.buffer = np.concatenate([self.buffer, new])[-len(self.buffer) :]
            self.stamp = START + round(at * 1e9)
        row = np.zeros(self.layout.width, np.int64)
        names = self.layout.int_names
        row[names.index("now")] = START + len(self.rows) * 5_000_000
        for word in ("stamp", "reconnects", "resyncs"):
            row[names.index(f"emg.{word}")] = getattr(self, word)
        values = np.concatenate([np.zeros(2), self.buffer.ravel(), [self.shown]])
        row[self.layout.ints :] = values[: self.layout.floats].view(np.int64)
        self.rows.append(row)

    def stream(self, first: int, last: int, each: int = 27) -> None:
        """Samples first..last - 1, sample number n taken at n / 2000 s, some a cycle."""
        for start in range(first, last, each):
            numbers = np.arange(start, min(start + each, last))
            self.cycle()
            self.cycle(_signal(numbers), numbers[-1] / RATE)

    def recording(self) -> Recording:
        rows = np.array(self.rows)
        return Recording(Path("made.rrd"), self.layout, np.arange(1, len(rows) + 1), rows, [], [], 0)


def _numbers(emg: Emg) -> list[np.ndarray]:
    return [np.rint(piece.values[:, 0] * 1e6).astype(int) - 1 for piece in emg.pieces]


def test_every_sample_once_at_its_time() -> None:
    made = Made()
    made.stream(0, 2000)
    emg = from_recording(made.recording())
    (piece,) = emg.pieces
    assert np.array_equal(_numbers(emg)[0], np.arange(2000))
    assert piece.time == pytest.approx(np.arange(2000) / RATE, abs=1e-8)
    assert (emg.muscles, emg.rate, emg.lost, emg.seconds) == (("biceps", "triceps"), 2000, pytest.approx(0), 1.0)
    chosen = from_recording(made.recording(), muscles=["triceps"])
    assert chosen.pieces[0].values == pytest.approx(piece.values[:, 1:])


@pytest.mark.parametrize("each", [1, 26, 27, 54, 64])
def test_any_number_of_samples_a_cycle_that_a_row_holds(each: int) -> None:
    made = Made()
    made.stream(0, 900, each)
    assert np.array_equal(np.concatenate(_numbers(from_recording(made.recording()))), np.arange(900))


def test_more_samples_than_a_row_holds_begin_a_new_piece() -> None:
    made = Made()
    made.stream(0, 540)
    made.cycle(_signal(np.arange(540, 740)), 739 / RATE)
    made.stream(740, 1010)
    emg = from_recording(made.recording())
    assert [(n[0], n[-1]) for n in _numbers(emg)] == [(0, 539), (676, 1009)]
    assert emg.lost == pytest.approx(136 / RATE, abs=1e-6)
    assert emg.pieces[1].time[0] == pytest.approx(676 / RATE, abs=1e-8)


def test_rows_that_are_missing_begin_a_new_piece_only_if_samples_are() -> None:
    made = Made()
    made.stream(0, 1080)
    recording = made.recording()
    recording.rows = np.delete(recording.rows, [20, 21], axis=0)  # 27 samples came there; the next row has 54 new
    assert np.array_equal(np.concatenate(_numbers(from_recording(recording))), np.arange(1080))
    recording.rows = np.delete(recording.rows, range(30, 40), axis=0)
    emg = from_recording(recording)
    assert len(emg.pieces) == 2
    assert emg.lost > 0.03


@pytest.mark.parametrize("at_once", [True, False])
def test_a_new_connection_counts_from_the_start(at_once: bool) -> None:
    made = Made()
    made.stream(0, 270)
    made.cycle()
    made.reconnects += 1
    made.count = 0
    if at_once:
        made.shown = 0
    made.stream(2000, 2270)
    emg = from_recording(made.recording())
    assert [(n[0], n[-1]) for n in _numbers(emg)] == [(0, 269), (2000, 2269)]
    assert emg.pieces[1].time[0] == pytest.approx(1.0, abs=1e-8)
    assert emg.lost == pytest.approx((2000 - 270) / RATE, abs=1e-6)


def test_samples_lost_in_the_stream_begin_a_new_piece() -> None:
    made = Made()
    made.stream(0, 270)
    made.resyncs += 1
    made.stream(400, 670)  # the count goes on
    made.stream(700, 970)  # a radio frame is missing, seen by the stamps alone
    emg = from_recording(made.recording())
    assert [(n[0], n[-1]) for n in _numbers(emg)] == [(0, 269), (400, 669), (700, 969)]
    assert emg.pieces[2].time == pytest.approx(np.arange(700, 970) / RATE, abs=1e-8)


def test_a_recording_that_begins_in_mid_stream() -> None:
    made = Made()
    made.stream(0, 5400)
    recording = made.recording()
    recording.rows = recording.rows[301:]
    numbers = np.concatenate(_numbers(from_recording(recording)))
    assert np.array_equal(numbers, np.arange(numbers[0], 5400))


def test_a_sensor_out_of_reach_is_cut_out() -> None:
    samples = _signal(np.arange(6000))
    samples[2000:3000, 1] = 0.0
    samples[4000:4100, 0] = 0.0  # too short to say so
    emg = from_arrays(samples, ["biceps", "triceps"], RATE)
    assert [(n[0], n[-1]) for n in _numbers(emg)] == [(0, 1999), (3000, 5999)]
    assert emg.absent == (0.0, 0.5)
    with pytest.raises(StudyError, match="no signal from triceps"):
        from_arrays(samples[2000:3000], ["biceps", "triceps"], RATE)


def test_trials_of_a_record() -> None:
    rng = np.random.default_rng(0)
    raw = rng.normal(size=(20000, 1)) * np.repeat([4.0, 1.0], 10000)[:, None]
    emg = from_arrays(raw, ["biceps"], RATE).envelope()
    mvc = emg.between(0.5, 4.5).greatest()
    share = emg.normalise(mvc).between(5.5, 9.5).activity()
    assert 0.2 < share.mean[0] < 0.25
    assert share.seconds == pytest.approx(4.0)
    with pytest.raises(StudyError, match="nothing between 20 and 30 s"):
        emg.between(20, 30)
    with pytest.raises(StudyError, match="no piece is 9 s long"):
        emg.between(1, 2).greatest(9)


def test_short_pieces_are_left_out_of_the_envelope() -> None:
    samples = _signal(np.arange(6000), 1)
    samples[300:700] = 0.0
    emg = from_arrays(samples, ["biceps"], RATE)
    assert [len(p.time) for p in emg.pieces] == [300, 5300]
    assert [len(p.time) for p in emg.envelope().pieces] == [5300]
    with pytest.raises(StudyError, match="no piece is longer"):
        emg.between(0, 0.1).envelope()
    with pytest.raises(StudyError, match="filters for 1000 Hz, samples at 2000 Hz"):
        emg.envelope(Filters(1000.0))


def test_mistakes() -> None:
    made = Made(block=0)
    made.cycle()
    with pytest.raises(StudyError, match=r"one sample a cycle.*block: 64"):
        from_recording(made.recording())
    made = Made()
    made.cycle()
    with pytest.raises(StudyError, match="no samples came"):
        from_recording(made.recording())
    with pytest.raises(StudyError, match=r"no such device.*emg"):
        from_recording(made.recording(), "egm")
    with pytest.raises(StudyError, match=r"no channel 'bicep'.*'biceps'"):
        from_recording(made.recording(), muscles=["bicep"])
    with pytest.raises(StudyError, match="for biceps"):
        from_arrays(np.zeros((5, 2)), ["biceps"], RATE)
    with pytest.raises(StudyError, match="finite"):
        from_arrays(np.full((5, 1), np.inf), ["biceps"], RATE)


PROFILE = """
name: emg
rate: 200
devices:
  emg: {driver: trigno, port: tcp://192.168.1.30, channels: {deltoid_anterior: 1, biceps: 3}, block: 64}
sim:
  world: cell
  parts: {crate: {part: box, size: [0.3, 0.3, 0.3], at: {position: [1.0, 0, 0.15]}}}
  devices:
    emg:
      activation:
        deltoid_anterior: [[0, 1.0], [3, 1.0], [3.001, 0.2], [20, 0.2]]
        biceps: [[0, 0.5], [20, 0.5]]
      out_of_reach: {biceps: [[6, 6.5]]}
      loss: [[7, 7.3]]
"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Emg:
    folder = tmp_path_factory.mktemp("emg")
    (folder / "emg.yaml").write_text(PROFILE)
    call(folder, "run", "emg.yaml", "--sim", "--fast", "--duration", "9", "--record", "emg.rrd", "--json")
    return from_recording(read(folder / "emg.rrd"))


@pytest.mark.slow
def test_a_simulated_run_recorded_and_evaluated(recorded: Emg) -> None:
    assert recorded.muscles == ("deltoid_anterior", "biceps")
    assert len(recorded.pieces) == 3
    assert recorded.absent == (0.0, pytest.approx(0.5, abs=0.03))
    assert recorded.pieces[0].time[-1] == pytest.approx(6.0, abs=0.03)
    whole = recorded.envelope()
    share = whole.normalise(whole.between(0.3, 2.7).greatest()).between(3.3, 5.7).activity()
    # The deltoid's 0.2 of its MVC; the biceps held its own half throughout. The best half second is above the mean.
    assert share.mean == pytest.approx([0.2, 1.0], rel=0.07)
