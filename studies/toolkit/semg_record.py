"""Recorded EMG: pieces without a gap, from a recording of the trigno driver or from arrays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from srl.drivers.trigno.protocol import RATE
from srl.runtime.contracts.errors import nearest
from srl.runtime.contracts.signals import Array
from srl.runtime.recording.reader import Recording
from srl.studies.toolkit import semg
from srl.studies.toolkit.errors import StudyError
from srl.studies.toolkit.semg import Activity, Filters

LATE: Final = 0.005  # s by which stamps may be ahead of the count; a missing radio frame is 0.0135 s
GONE: Final = 0.1  # s of exact zeros after which a sensor counts as out of reach (sheet delsys_trigno §5)


@dataclass(frozen=True)
class Piece:
    """Samples without a gap.

    Attributes:
        time: (k,) s since the record's beginning.
        values: (k, n).
    """

    time: Array
    values: Array


@dataclass(frozen=True)
class Emg:
    """A record, or a result computed from one.

    Attributes:
        muscles: (n,) names.
        rate: Hz.
        pieces: in order of time, at least one.
        absent: s for which each muscle's sensor was out of reach; those spans aren't in the pieces.
        place: the source, for errors.
    """

    muscles: tuple[str, ...]
    rate: float
    pieces: tuple[Piece, ...]
    absent: tuple[float, ...]
    place: str = semg.PLACE

    @property
    def seconds(self) -> float:
        """s of samples in all pieces."""
        return sum(len(piece.time) for piece in self.pieces) / self.rate

    @property
    def lost(self) -> float:
        """s missing between the first sample and the last."""
        whole = self.pieces[-1].time[-1] - self.pieces[0].time[0] + 1 / self.rate
        return max(float(whole) - self.seconds, 0.0)

    def envelope(self, filters: Filters | None = None) -> Emg:
        """Returns the envelope of each piece; pieces too short for the filters are left out.

        Raises:
            StudyError: the filters are for another rate, or all pieces are too short.
        """
        filters = filters or Filters(self.rate)
        if not math.isclose(filters.rate, self.rate):
            problem = f"filters for {filters.rate:g} Hz, samples at {self.rate:g} Hz"
            raise StudyError(self.place, problem, "Make the filters for the record's rate")
        least = math.ceil(filters.rate / filters.cutoff)
        made = [Piece(p.time, semg.envelope(p.values, filters)) for p in self.pieces if len(p.time) > least]
        if not made:
            problem = f"no piece is longer than {least / filters.rate:g} s"
            raise StudyError(self.place, problem, "Record more without a gap")
        return self._with(made)

    def between(self, start: float, end: float) -> Emg:
        """Returns the part within [start, end), s: a trial of a longer record.

        Compute the envelope first, so that the filters don't start anew at the trial's ends.

        Raises:
            StudyError: there are no samples in this span.
        """
        kept = []
        for piece in self.pieces:
            inside = (piece.time >= start) & (piece.time < end)
            if inside.any():
                kept.append(Piece(piece.time[inside], piece.values[inside]))
        if not kept:
            problem = f"nothing between {start:g} and {end:g} s"
            have = f"It goes from {self.pieces[0].time[0]:.3f} to {self.pieces[-1].time[-1]:.3f} s"
            raise StudyError(self.place, problem, have)
        return self._with(kept)

    def greatest(self, window: float = 0.5) -> Array:
        """Returns each muscle's highest mean over `window` s, (n,), for an envelope that is an MVC trial.

        Raises:
            StudyError: no piece is that long, or a muscle has no signal.
        """
        width = max(round(window * self.rate), 1)
        long = [piece.values for piece in self.pieces if len(piece.values) >= width]
        if not long:
            problem = f"no piece is {window:g} s long"
            raise StudyError(self.place, problem, "Hold the contraction longer, or take a shorter window")
        return semg.greatest(long, self.rate, window)

    def normalise(self, mvc: ArrayLike) -> Emg:
        """Returns an envelope as a share of the MVC (n,); raises StudyError if they don't match."""
        return self._with([Piece(p.time, semg.normalise(p.values, mvc)) for p in self.pieces])

    def activity(self) -> Activity:
        """Returns the figures of a normalised envelope, over all its pieces."""
        return semg.activity(np.concatenate([p.values for p in self.pieces]), self.muscles, self.rate)

    def _with(self, pieces: Sequence[Piece]) -> Emg:
        return Emg(self.muscles, self.rate, tuple(pieces), self.absent, self.place)


def from_arrays(samples: ArrayLike, muscles: Sequence[str], rate: float, place: str = semg.PLACE) -> Emg:
    """Makes a record without gaps from samples (k, n); spans of exact zeros (a sensor out of reach) are cut out.

    Raises:
        StudyError: not (k, n) for these n muscles, not finite, or nothing is left.
    """
    values = np.asarray(samples, float)
    if values.ndim != 2 or values.shape[1] != len(muscles) or len(set(muscles)) < len(muscles):
        problem = f"an array of shape {values.shape} for {', '.join(muscles)}"
        raise StudyError(place, problem, "Give (samples, muscles), and each muscle a name of its own")
    if not rate > 0 or not np.isfinite(values).all():
        raise StudyError(place, "the rate isn't above 0, or a sample isn't finite", "Cut the record there into pieces")
    return _present([Piece(np.arange(len(values)) / rate, values)], tuple(muscles), rate, place)


def from_recording(recording: Recording, device: str = "emg", muscles: Sequence[str] | None = None) -> Emg:
    """Returns every sample of a trigno device, from the signals `samples` and `count` that its `block` option adds.

    A sample's time is its number divided by the rate, mapped to the recording's time by the rows' stamps. A new piece
    begins in three cases: from one row to the next more samples came than a row holds; the driver connected anew or
    found samples lost; or the stamps are ahead of the count.

    Args:
        recording: of `srl run --record`, or of a black box.
        device: its name in the profile.
        muscles: channels, in the wanted order; None: all.

    Raises:
        StudyError: there is no such device, it had no `block`, a channel is unknown, or no samples came.
    """
    place, fields = f"{recording.path}: {device}", recording.layout.fields
    if device not in recording.layout.devices:
        raise StudyError(place, "there is no such device", nearest(device, recording.layout.devices))
    if f"{device}.samples" not in fields or f"{device}.count" not in fields:
        remedy = f"Record with `block: 64` in devices.{device}, so that each row keeps all new samples"
        raise StudyError(place, "the recording holds one sample a cycle", remedy)
    labels = fields[f"{device}.emg"].labels
    wanted = tuple(labels if muscles is None else muscles)
    for name in wanted:
        if name not in labels:
            raise StudyError(place, f"there is no channel '{name}'", nearest(name, labels))
    pieces = _pieces(recording, device, [labels.index(name) for name in wanted])
    if not pieces:
        raise StudyError(place, "no samples came", "Look at the device's health in the recording")
    return _present(pieces, wanted, RATE, place)


def _pieces(recording: Recording, device: str, columns: list[int]) -> list[Piece]:
    count = np.rint(recording.value(f"{device}.count")[:, 0]).astype(np.int64)
    samples = recording.value(f"{device}.samples")
    stamped = recording.int(f"{device}.stamp")
    # s from a sample's number to its time, if the row has a stamp of its own.
    offset = (stamped - recording.int("now")[0]) / 1e9 - count / RATE
    known = (stamped >= 0) & (np.diff(stamped, prepend=-1) != 0)
    broken = _changes(recording.int(f"{device}.reconnects")) | _changes(recording.int(f"{device}.resyncs"))
    runs: list[_Run] = []
    last, pending = 0, True
    for row in range(len(count)):
        pending |= bool(broken[row])
        if count[row] == last:
            continue
        # The driver's count starts again with each connection.
        new = int(count[row] - last) if count[row] > last else int(count[row])
        pending |= count[row] < last or new > samples.shape[1]
        last = int(count[row])
        if not new:
            continue
        if pending or (known[row] and runs[-1].offsets and offset[row] > runs[-1].offsets[-1] + LATE):
            runs.append(_Run())
            pending = False
        run, kept = runs[-1], min(new, samples.shape[1])
        if run.first < 0:
            run.first = int(count[row]) - kept + 1
        run.blocks.append(samples[row, -kept:][:, columns])
        if known[row]:
            run.counts.append(int(count[row]))
            run.offsets.append(float(offset[row]))
    return [run.piece() for run in runs if run.counts]


def _changes(words: np.ndarray) -> np.ndarray:
    """Returns whether each row's word, (k,), differs from the previous row's."""
    return np.concatenate(([False], words[1:] != words[:-1]))


class _Run:
    """Rows that follow each other without a gap."""

    def __init__(self) -> None:
        self.first = -1  # number of the first sample, from 1
        self.blocks: list[Array] = []
        self.counts: list[int] = []  # where a stamp is known,
        self.offsets: list[float] = []  # s from a sample's number to its time

    def piece(self) -> Piece:
        values = np.concatenate(self.blocks)
        # A row's stamp and count are the time and the number of its last sample.
        numbers = np.arange(self.first, self.first + len(values))
        return Piece(numbers / RATE + np.interp(numbers, self.counts, self.offsets), values)


def _present(pieces: Sequence[Piece], muscles: tuple[str, ...], rate: float, place: str) -> Emg:
    """Cuts out the spans in which a sensor was out of reach: their zeros would look like a muscle at rest."""
    kept, absent = [], np.zeros(len(muscles))
    for piece in pieces:
        gone = np.stack([_long(column == 0, round(GONE * rate)) for column in piece.values.T], axis=1)
        absent += gone.sum(axis=0) / rate
        there = np.concatenate(([False], ~gone.any(axis=1), [False]))
        edges = np.flatnonzero(there[1:] != there[:-1])
        kept += [Piece(piece.time[a:b], piece.values[a:b]) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    if not kept:
        names = ", ".join(name for name, gone in zip(muscles, absent, strict=True) if gone)
        raise StudyError(place, f"no signal from {names}" if names else "no samples", "Check the sensors")
    return Emg(muscles, rate, tuple(kept), tuple(float(s) for s in absent), place)


def _long(flags: np.ndarray, least: int) -> np.ndarray:
    """Keeps only those runs of true that have at least this length."""
    padded = np.concatenate(([False], flags, [False]))
    edges = np.flatnonzero(padded[1:] != padded[:-1])
    found = np.zeros(len(flags), bool)
    for a, b in zip(edges[::2], edges[1::2], strict=True):
        if b - a >= least:
            found[a:b] = True
    return found
