"""Surface EMG to muscle activity: band-pass, rectify, low-pass, share of the greatest voluntary contraction (MVC).

Arrays are (k, n): k samples of n muscles. The band and the cut-off are usual for surface EMG, and so is
the mean over 0.5 s of an MVC trial (Konrad, The ABC of EMG, 2005). The same functions serve the calibration of a
person, the law `emg-activation` in the loop, and the evaluation of studies.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from scipy import signal

from srl.runtime.contracts.errors import SrlError
from srl.runtime.contracts.signals import Array

PLACE: Final = "surface EMG"
_OFFLINE: Final = 2  # passes: forwards and backwards


class EmgError(SrlError):
    """What surface EMG was given can't be processed, or no calibration can be made of it."""


@dataclass(frozen=True)
class Filters:
    """Butterworth filters; at the cut-offs the gain is 1/sqrt(2), offline and online alike.

    Attributes:
        rate: Hz, of the samples.
        band: Hz. Below it is movement of cables and skin, above it the electronics' noise.
        band_order: of each flank.
        cutoff: Hz, of the envelope.
        cutoff_order: of the envelope. Offline both filters run twice, so flanks are twice as steep.
    """

    rate: float
    band: tuple[float, float] = (20.0, 450.0)
    band_order: int = 4
    cutoff: float = 5.0
    cutoff_order: int = 2

    def __post_init__(self) -> None:
        """Raises EmgError: cut-offs impossible at this rate, or orders outside 1 to 8."""
        low, high = self.band
        if not 0 < low < high < self.rate / 2:
            problem = f"a band of {low:g} to {high:g} Hz at {self.rate:g} Hz"
            raise EmgError(PLACE, problem, f"Both must rise and lie between 0 and {self.rate / 2:g} Hz")
        if not 0 < self.cutoff < self.rate / 2:
            problem = f"the envelope's cut-off is {self.cutoff:g} Hz at {self.rate:g} Hz"
            raise EmgError(PLACE, problem, "Take 2 to 10 Hz")
        if self.band_order not in range(1, 9) or self.cutoff_order not in range(1, 9):
            raise EmgError(PLACE, f"orders {self.band_order} and {self.cutoff_order}", "Take 1 to 8; 4 and 2 do")

    def band_pass(self, passes: int = 1) -> Array:
        """Returns second-order sections that give the band-pass when run `passes` times."""
        low, high = (self._warped(f) for f in self.band)
        # Widened by as much as the further passes narrow it; its middle stays.
        half = 0.5 * (high - low) / _prototype(self.band_order, passes)
        middle = math.hypot(half, math.sqrt(low * high))
        edges = [self._unwarped(middle - half), self._unwarped(middle + half)]
        found: Array = signal.butter(self.band_order, edges, "bandpass", output="sos", fs=self.rate)
        return found

    def low_pass(self, passes: int = 1) -> Array:
        """Returns second-order sections that give the envelope's low-pass when run `passes` times."""
        edge = self._unwarped(self._warped(self.cutoff) / _prototype(self.cutoff_order, passes))
        found: Array = signal.butter(self.cutoff_order, edge, "lowpass", output="sos", fs=self.rate)
        return found

    @property
    def delay(self) -> float:
        """s by which the online envelope lags behind slow changes (the low-pass's delay at 0 Hz)."""
        return (
            1.0
            / (2 * self.rate * math.tan(math.pi * self.cutoff / self.rate))
            / math.sin(math.pi / (2 * self.cutoff_order))
        )

    def _warped(self, frequency: float) -> float:
        """Returns the analogue frequency that the bilinear transform maps to this one."""
        return math.tan(math.pi * frequency / self.rate)

    def _unwarped(self, analogue: float) -> float:
        return math.atan(analogue) * self.rate / math.pi


def envelope(samples: ArrayLike, filters: Filters) -> Array:
    """Returns the envelope of a whole record without lag: each filter runs forwards and backwards.

    Args:
        samples: (k, n), any unit; an offset has no effect.
        filters: the filters.

    Returns:
        (k, n) in the samples' unit, at least 0: the mean of the rectified signal, 0.8 of its RMS where it is noise.

    Raises:
        EmgError: not (k, n), not finite, or shorter than the filters' memory.
    """
    raw = checked(samples)
    # Both ends are mirrored for so long that the filters' transients have decayed.
    pad = math.ceil(filters.rate / filters.cutoff)
    if len(raw) <= pad:
        problem = f"{len(raw)} samples, expected more than {pad} ({pad / filters.rate:g} s)"
        raise EmgError(PLACE, problem, "Take a longer piece, or a higher cut-off")
    muscle = signal.sosfiltfilt(filters.band_pass(_OFFLINE), raw, axis=0, padlen=pad)
    smooth = signal.sosfiltfilt(filters.low_pass(_OFFLINE), np.abs(muscle), axis=0, padtype="even", padlen=pad)
    # A low-pass of second or higher order undershoots a little; activity has no sign.
    found: Array = np.maximum(smooth, 0.0)
    return found


class OnlineEnvelope:
    """The envelope as samples come: causal, and independent of how the samples are split into blocks.

    It lags by `Filters.delay`. It begins at 0, with the first sample taken as the electrode's offset.

    Attributes:
        value: (n,) the newest value.
    """

    def __init__(self, muscles: int, filters: Filters) -> None:
        self.value = np.zeros(muscles)
        self._band, self._low = filters.band_pass(), filters.low_pass()
        self._low_state = np.zeros((len(self._low), 2, muscles))
        self._band_state: Array | None = None

    def take(self, samples: ArrayLike) -> Array:
        """Adds samples (k, n), oldest first; returns their envelope (k, n), at least 0.

        Raises:
            EmgError: not (k, n), or not finite.
        """
        raw = np.asarray(samples, float)
        if raw.ndim == 2 and not len(raw):
            return np.empty((0, len(self.value)))
        raw = checked(raw)
        if raw.shape[1] != len(self.value):
            raise EmgError(PLACE, f"{raw.shape[1]} muscles, expected {len(self.value)}", "Keep their number")
        if self._band_state is None:
            self._band_state = signal.sosfilt_zi(self._band)[:, :, None] * raw[0]
        muscle, self._band_state = signal.sosfilt(self._band, raw, axis=0, zi=self._band_state)
        smooth, self._low_state = signal.sosfilt(self._low, np.abs(muscle), axis=0, zi=self._low_state)
        found: Array = np.maximum(smooth, 0.0)
        self.value[:] = found[-1]
        return found


def greatest(trials: Sequence[ArrayLike], rate: float, window: float = 0.5) -> Array:
    """Returns the greatest voluntary contraction: the highest mean of an envelope over `window`, of all MVC trials.

    Args:
        trials: envelopes (k, n), the same muscles in each.
        rate: Hz.
        window: s; a single peak would be noise.

    Returns:
        (n,) in the envelopes' unit, above 0.

    Raises:
        EmgError: no trial, one shorter than the window, different muscles, or a muscle without any signal.
    """
    if not trials:
        raise EmgError(PLACE, "there is no MVC trial", "Record one for each muscle, before the tasks")
    width = max(round(window * rate), 1)
    best: Array | None = None
    for trial in trials:
        values = checked(trial)
        if len(values) < width:
            problem = f"an MVC trial of {len(values) / rate:g} s, expected at least {window:g} s"
            raise EmgError(PLACE, problem, "Hold the contraction longer, or take a shorter window")
        if best is not None and values.shape[1] != len(best):
            raise EmgError(PLACE, "MVC trials have different muscles", "Record all muscles in each trial")
        sums = np.cumsum(np.concatenate((np.zeros((1, values.shape[1])), values)), axis=0)
        top = ((sums[width:] - sums[:-width]) / width).max(axis=0)
        best = top if best is None else np.maximum(best, top)
    assert best is not None
    if not (best > 0).all():
        at = int(np.argmin(best > 0))
        raise EmgError(PLACE, f"muscle {at + 1} has no signal in any MVC trial", "Check its electrode")
    return best


def normalise(values: ArrayLike, mvc: ArrayLike) -> Array:
    """Returns an envelope (k, n) as a share of the greatest voluntary contraction (n,): 1 is a muscle's MVC.

    Values above 1 occur and are kept: a task may load a muscle more than its MVC trial did.

    Raises:
        EmgError: the muscles differ, or an MVC isn't above 0.
    """
    found, most = checked(values), np.atleast_1d(np.asarray(mvc, float))
    if most.shape != found.shape[1:]:
        raise EmgError(PLACE, f"{found.shape[1]} muscles and {most.size} MVC values", "Give one for each muscle")
    if not (np.isfinite(most) & (most > 0)).all():
        raise EmgError(PLACE, f"MVC values {most}, expected all above 0", "Record an MVC trial for each muscle")
    normal: Array = found / most
    return normal


def _prototype(order: int, passes: int) -> float:
    """Returns the frequency at which a Butterworth low-pass of cut-off 1, run `passes` times, has gain 1/sqrt(2)."""
    return float((2 ** (1 / passes) - 1) ** (0.5 / order))


def checked(samples: ArrayLike) -> Array:
    """The samples as (k, n) float64. Raises EmgError: they aren't, or one isn't finite."""
    found: Array = np.asarray(samples, float)
    if found.ndim != 2 or not found.size:
        raise EmgError(PLACE, f"an array of shape {found.shape}", "Give (samples, muscles), e.g. emg[:, None] for one")
    if not np.isfinite(found).all():
        raise EmgError(PLACE, "there are samples that aren't finite", "Cut the record there into pieces")
    return found
