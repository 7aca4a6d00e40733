"""What each muscle gives at rest and at its greatest voluntary contraction, and why that can't be used."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from pydantic import Field

from srl.control.emg.processing import EmgError, Filters, OnlineEnvelope, greatest
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.signals import Array

MAINS: Final = (50.0, 60.0)  # Hz
_BESIDE: Final = 1.0  # Hz around each of its harmonics
_FLAT: Final = 0.002  # share of the greatest value; two successive samples so near to it aren't by chance
_CLIPPED: Final = 4  # such samples, from which on it is saturated


class Thresholds(Options):
    """What a calibration must reach."""

    factor: float = Field(10.0, ge=2, le=1000, description="least of the greatest contraction, in multiples of rest")
    agree: float = Field(0.2, gt=0, lt=1, description="share by which a muscle's contractions may differ")
    other: float = Field(
        0.8, gt=0, le=3, description="most that another muscle may give in a muscle's contraction, in shares of its own"
    )
    hum: float = Field(0.5, gt=0, le=1, description="share of the power at rest that may be at the mains' harmonics")
    hum_level: float = Field(
        0.02, gt=0, le=1, description="share of the greatest contraction up to which a hum does no harm"
    )


@dataclass(frozen=True)
class Mvc:
    """What was found, n muscles with r contractions each.

    Attributes:
        muscles: (n,) their names.
        rest: (n,) V, mean of the envelope at rest.
        levels: (n, r, n) V: in the contractions of muscle i, of the muscle in the last place the highest mean of the
            envelope over the window.
        mvc: (n,) V, the greatest of all of them.
        hum: (n,) share of the power at rest that is at the mains' harmonics.
        mains: (n,) Hz, of these.
        clipped: (n,) number of samples at the end of the range in its own contractions.
        constant: (n,) whether nothing but one value came at rest.
        envelopes: of its own contractions, by muscle and repeat from 0: (m,) V.
        rate: Hz, of the envelopes.
    """

    muscles: tuple[str, ...]
    rest: Array
    levels: Array
    mvc: Array
    hum: Array
    mains: Array
    clipped: Array
    constant: Array
    envelopes: Mapping[tuple[int, int], Array]
    rate: float

    @property
    def own(self) -> Array:
        """(n, r) V: each muscle's level in its own contractions."""
        return np.array([self.levels[i, :, i] for i in range(len(self.muscles))])


def fit(
    muscles: Sequence[str], rest: Array, contractions: Mapping[tuple[int, int], Array], filters: Filters, window: float
) -> Mvc:
    """Computes it.

    Args:
        muscles: (n,) names.
        rest: (m, n) V, samples at rest.
        contractions: (m, n) V, samples by muscle and repeat, from 0.
        filters: of the envelope.
        window: s, of the mean.
    Raises:
        EmgError: a piece is too short, or a muscle has no signal at all.
    """
    n, r = len(muscles), 1 + max(j for _, j in contractions)
    settled = round(filters.rate / filters.cutoff)
    if len(rest) <= 2 * settled:
        raise EmgError("rest", f"{len(rest) / filters.rate:.2f} s of samples came", "Record more: --option rest=5")
    level = OnlineEnvelope(n, filters).take(rest)[settled:].mean(axis=0)
    levels = np.zeros((n, r, n))
    envelopes: dict[tuple[int, int], Array] = {}
    trials = []
    for (i, j), samples in contractions.items():
        trial = OnlineEnvelope(n, filters).take(samples)
        trials.append(trial)
        levels[i, j] = _highest(trial, filters.rate, window)
        envelopes[i, j] = trial[:, i]
    constant = np.ptp(rest, axis=0) == 0.0
    mvc = levels.max(axis=(0, 1)) if constant.any() else greatest(trials, filters.rate, window)
    hums = [_hum(column, filters) for column in rest.T]
    clipped = np.array([sum(_at_the_end(contractions[i, j][:, i]) for j in range(r)) for i in range(n)])
    return Mvc(
        tuple(muscles), level, levels, mvc, np.array([h for h, _ in hums]), np.array([f for _, f in hums]), clipped,
        constant, envelopes, filters.rate,
    )  # fmt: skip


def _highest(trial: Array, rate: float, window: float) -> Array:
    """(n,) V: as `greatest`, but a muscle without any signal has 0, so that the reason can be told by its name."""
    there = trial.max(axis=0) > 0.0
    found = np.zeros(trial.shape[1])
    if there.any():
        found[there] = greatest([trial[:, there]], rate, window)
    return found


def _hum(samples: Array, filters: Filters) -> tuple[float, float]:
    """The share of the power in the band at the harmonics of the mains, and Hz of the mains that has more."""
    power = np.abs(np.fft.rfft((samples - samples.mean()) * np.hanning(len(samples)))) ** 2
    frequency = np.fft.rfftfreq(len(samples), 1.0 / filters.rate)
    band = (frequency >= filters.band[0]) & (frequency <= filters.band[1])
    if not (whole := power[band].sum()):
        return 0.0, MAINS[0]

    def share(mains: float) -> float:
        away = np.abs(frequency - mains * np.maximum(np.round(frequency / mains), 1.0))
        return float(power[band & (away <= _BESIDE)].sum() / whole)

    most = max(MAINS, key=share)
    return share(most), most


def _at_the_end(samples: Array) -> int:
    """Number of samples at the end of the range: near the greatest or least value, and not alone."""
    count = 0
    for side in (samples, -samples):
        top = side.max()
        near = side >= top - _FLAT * abs(top)
        count += int((near[1:] & near[:-1]).sum())
    return count


def refusals(found: Mvc, thresholds: Thresholds) -> tuple[EmgError, ...]:
    """Why it can't be used; none if it can. Of each muscle the first reason, as the others follow from it."""
    reasons: dict[str, EmgError] = {}
    for kind in (_dead, _saturated, _humming, _exchanged, _other, _small, _differing):
        for error in kind(found, thresholds):
            reasons.setdefault(error.place, error)
    return tuple(reasons.values())


def _dead(found: Mvc, thresholds: Thresholds) -> Iterator[EmgError]:
    for name, dead in zip(found.muscles, found.constant, strict=True):
        if dead:
            remedy = "See to its sensor and its slot in `channels`; without it, take the muscle out of the profile"
            yield EmgError(name, "its channel is dead: one value all the time", remedy)


def _saturated(found: Mvc, thresholds: Thresholds) -> Iterator[EmgError]:
    for name, count in zip(found.muscles, found.clipped, strict=True):
        if count >= _CLIPPED:
            problem = f"it is saturated: {count} samples lie at the end of its range"
            yield EmgError(name, problem, "Set the sensor's wider range, or see whether the electrode is loose")


def _humming(found: Mvc, thresholds: Thresholds) -> Iterator[EmgError]:
    for i, name in enumerate(found.muscles):
        if found.hum[i] > thresholds.hum and found.rest[i] > thresholds.hum_level * found.own[i].max():
            problem = (
                f"the mains' hum ({found.mains[i]:.0f} Hz) is {found.hum[i]:.0%} of what it gives at rest, "
                f"{1e6 * found.rest[i]:.1f} uV"
            )
            yield EmgError(name, problem, "Clean the skin, press the electrode on, keep away from power supplies")


def _exchanged(found: Mvc, thresholds: Thresholds) -> Iterator[EmgError]:
    top = found.levels.max(axis=1)  # (n, n): contraction of, muscle
    for i, name in enumerate(found.muscles):
        for j, other in enumerate(found.muscles):
            if i != j and top[i, j] > top[j, j] and top[j, i] > top[i, i]:
                problem = f"it is active while {other} contracts, and {other} while it does"
                yield EmgError(name, problem, "Their electrodes are exchanged: correct `channels`, or change them over")


def _small(found: Mvc, thresholds: Thresholds) -> Iterator[EmgError]:
    for i, name in enumerate(found.muscles):
        most = found.own[i].max()
        if most < thresholds.factor * found.rest[i]:
            problem = (
                f"its greatest contraction is {1e6 * most:.1f} uV, {most / found.rest[i]:.1f} times what it gives at "
                f"rest; {thresholds.factor:g} times are needed"
            )
            remedy = f"Contract as hard as you can, relax at rest, see to the electrode: r {i + 1}, or r 0 for rest"
            yield EmgError(name, problem, remedy)


def _other(found: Mvc, thresholds: Thresholds) -> Iterator[EmgError]:
    top = found.levels.max(axis=1)
    for i, name in enumerate(found.muscles):
        shares = np.where(np.arange(len(top)) == i, 0.0, top[i] / np.maximum(top.diagonal(), 1e-12))
        j = int(shares.argmax())
        if shares[j] > thresholds.other:
            other = found.muscles[j]
            problem = f"while it contracts {other} gives {shares[j]:.0%} of its own contraction"
            remedy = f"Contract it alone: r {i + 1}; if that of {other} was weak, r {j + 1}; or see to their electrodes"
            yield EmgError(name, problem, remedy)


def _differing(found: Mvc, thresholds: Thresholds) -> Iterator[EmgError]:
    for i, name in enumerate(found.muscles):
        own = found.own[i]
        if (differ := 1.0 - own.min() / own.max()) > thresholds.agree:
            levels_text = ", ".join(f"{1e6 * level:.1f}" for level in own)
            problem = f"its contractions differ by {differ:.0%} ({levels_text} uV), {thresholds.agree:.0%} are allowed"
            yield EmgError(name, problem, f"Rest longer, then contract as hard each time: r {i + 1}")
