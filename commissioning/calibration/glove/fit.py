"""The characteristic of each sensor of a glove, from the hand held in known shapes: rad = gain (count - offset).

The flat hand is zero. The angle of the other end is that of the shape in which the sensor's joint is bent: nothing
measures it, so the gain is right as far as the hand has it. The fingers bent one by one say whether each sensor sits on
the finger of its name.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from pydantic import Field

from srl.commissioning.calibration.glove.shapes import AGAIN, ALONE, FINGERS, FIST, FLAT, THUMB, Angles, bent_in, shapes
from srl.runtime.contracts.errors import SrlError
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.signals import Array

LOWEST, HIGHEST = 1.0, 255.0  # counts, the ends of a sensor's scale
_ROUNDING: Final = 1.0 / 12.0  # counts^2, variance of rounding to whole counts
_STILL: Final = 3.0  # counts over all shapes, below which a sensor doesn't move at all
_MEND: Final = "do the shape again: r N, or --redo N --from FILE.rrd"


class GloveError(SrlError):
    """A glove can't be calibrated from these shapes."""


class Thresholds(Options):
    """What a calibration must reach."""

    steady: float = Field(4.0, gt=0, le=50, description="counts, by which a sensor may change while a shape is held")
    differs: float = Field(
        10.0, gt=0, le=100, description="counts, by which some sensor must differ from the shape before"
    )
    span: float = Field(20.0, ge=5, le=200, description="counts, the least between the flat hand and the bent joint")
    noise: float = Field(
        4.0, gt=0, le=50, description="counts, the greatest standard deviation of a sensor in a held shape"
    )
    again: float = Field(
        0.15, gt=0, le=1, description="rad, by which the flat hand at the end may differ from the first"
    )
    own: float = Field(
        0.5, gt=0, lt=1, description="share of the fist that each sensor of a finger bent alone must show"
    )
    other: float = Field(0.85, gt=0, le=2, description="share of the fist that no other finger's sensor may show then")
    beyond: float = Field(
        0.25, gt=0, le=1, description="share of the fist by which a joint may pass flat hand or fist later"
    )


@dataclass(frozen=True)
class Held:
    """What a held shape gave, n sensors.

    Attributes:
        mean, noise, least, greatest: (n,) counts; the noise is a standard deviation.
        count: of samples.
    """

    mean: Array
    noise: Array
    least: Array
    greatest: Array
    count: int


@dataclass(frozen=True)
class Glove:
    """What was found, n sensors.

    Attributes:
        sensors: (n,) their names.
        held: what each shape gave, by its number, of these sensors.
        offset: (n,) counts of the flat hand.
        gain: (n,) rad a count; infinite of a sensor that doesn't move.
        span: (n,) counts from the flat hand to the bent joint.
        noise: (n,) counts, the greatest standard deviation in a shape.
        uncertain: (n,) rad at the bent joint, standard deviation by noise and rounding.
        again: (n,) rad, by which the flat hand at the end differs from that of the beginning.
    """

    sensors: tuple[str, ...]
    held: Mapping[int, Held]
    offset: Array
    gain: Array
    span: Array
    noise: Array
    uncertain: Array
    again: Array

    def shares(self, number: int) -> Array:
        """(n,) how far each joint is bent in a shape: 0 flat, 1 as in the shape that its gain comes from."""
        with np.errstate(divide="ignore", invalid="ignore"):
            found: Array = (self.held[number].mean - self.offset) / self.span
        return found


def fit(sensors: Sequence[str], held: Mapping[int, Held], known: Angles) -> Glove:
    """The characteristic of each sensor.

    Args:
        sensors: (n,) names, each with a shape that bends its joint.
        held: of all shapes, of these sensors.
        known: the joints' angles in the shapes.
    Raises:
        GloveError: no shape bends a sensor's joint by a known angle.
    """
    for name in sensors:
        if bent_in(name) is None:
            remedy = f"Leave it to an average hand: --option average=...,{name}"
            raise GloveError(name, "no shape bends it by a known angle", remedy)
    every = shapes(known)
    number = [bent_in(name) or FLAT for name in sensors]
    angle = np.array([every[n].angles[name] for n, name in zip(number, sensors, strict=True)])
    first, last = held[FLAT], held[AGAIN]
    offset = (first.mean + last.mean) / 2.0
    bent = np.array([held[n].mean[i] for i, n in enumerate(number)])
    span = bent - offset
    with np.errstate(divide="ignore", invalid="ignore"):
        gain = np.where(span == 0.0, np.inf, angle / span)
        of_bent = np.array([held[n].noise[i] ** 2 / held[n].count for i, n in enumerate(number)]) + _ROUNDING
        # An error of the flat count moves nothing there: gain and offset change with it and cancel.
        uncertain = np.abs(gain) * np.sqrt(of_bent)
        again = np.abs(gain) * np.abs(last.mean - first.mean)
    noise = np.max([each.noise for each in held.values()], axis=0)
    return Glove(tuple(sensors), dict(held), offset, gain, span, noise, uncertain, np.nan_to_num(again, nan=0.0))


def refusals(glove: Glove, known: Angles, thresholds: Thresholds) -> tuple[GloveError, ...]:
    """Why the result can't be used; none if it can. Of each sensor the first reason, as the others follow from it."""
    found: dict[str, GloveError] = {}
    for reasons in (_ends, _spans, _noises, _places, _flat):
        for error in reasons(glove, known, thresholds):
            found.setdefault(error.place, error)
        if found and reasons is _spans:
            break  # shares of a span that isn't one say nothing
    return tuple(found.values())


def _ends(glove: Glove, known: Angles, thresholds: Thresholds) -> Iterator[GloveError]:
    """Sensors that came to an end of their scale."""
    every = shapes(known)
    for i, name in enumerate(glove.sensors):
        for number, held in glove.held.items():
            if held.least[i] <= LOWEST or held.greatest[i] >= HIGHEST:
                end = LOWEST if held.least[i] <= LOWEST else HIGHEST
                problem = f"it reads {end:.0f}, the end of its scale, in shape {number} ({every[number].name})"
                yield GloveError(name, problem, "Put the glove on anew, or change the glove's own gain and offset")
                break


def _spans(glove: Glove, known: Angles, thresholds: Thresholds) -> Iterator[GloveError]:
    """Sensors that don't move, or too little."""
    means = np.array([held.mean for held in glove.held.values()])
    for i, name in enumerate(glove.sensors):
        shape = bent_in(name) or FLAT
        if np.ptp(means[:, i]) < _STILL:
            problem = f"it doesn't move: {means[:, i].min():.1f} to {means[:, i].max():.1f} counts in all shapes"
            remedy = f"See to its cable; without it: --option average=...,{name}"
            yield GloveError(name, problem, remedy)
        elif abs(glove.span[i]) < thresholds.span:
            problem = (
                f"flat hand and shape {shape} ({shapes(known)[shape].name}) differ by {abs(glove.span[i]):.0f} counts, "
                f"{thresholds.span:.0f} are needed"
            )
            yield GloveError(name, problem, f"Open and bend the hand fully; {_MEND}")


def _noises(glove: Glove, known: Angles, thresholds: Thresholds) -> Iterator[GloveError]:
    """Sensors that are too noisy."""
    for name, noise in zip(glove.sensors, glove.noise, strict=True):
        if noise > thresholds.noise:
            problem = f"its noise is {noise:.1f} counts, {thresholds.noise:g} are allowed"
            yield GloveError(name, problem, "See to its cable and the glove's power, and hold still")


def _places(glove: Glove, known: Angles, thresholds: Thresholds) -> Iterator[GloveError]:
    """Sensors that don't move with the finger of their name, or move with another."""
    own = {f: [i for i, name in enumerate(glove.sensors) if name.startswith(f"{f}_") and bent_in(name) == FIST]
           for f in FINGERS}  # fmt: skip
    for finger, number in ALONE.items():
        shares = glove.shares(number)
        others = [i for f in FINGERS if f != finger for i in own[f]]
        stands = [i for i in own[finger] if shares[i] < thresholds.own]
        moves = [i for i in others if shares[i] > thresholds.other]
        for i in stands:
            problem = f"it shows {shares[i]:.0%} of the fist while the {finger} finger alone is bent"
            if moves:
                names = ", ".join(glove.sensors[j] for j in moves)
                remedy = f"Are its cable and that of {names} exchanged? Else {_MEND}"
            else:
                remedy = f"Bend it fully; {_MEND}"
            yield GloveError(glove.sensors[i], problem, remedy)
        for i in (i for i in own[finger] if i not in stands):
            joint = glove.sensors[i].partition("_")[2]
            for j in (j for j in others if glove.sensors[j].endswith(joint) and shares[j] > shares[i]):
                problem = (
                    f"while the {finger} finger alone is bent it shows {shares[i]:.0%} of the fist, "
                    f"{glove.sensors[j]} {shares[j]:.0%}"
                )
                remedy = f"Are their cables exchanged? Else bend this finger further than the others; {_MEND}"
                yield GloveError(glove.sensors[i], problem, remedy)
        if not stands:
            for i in moves:
                problem = f"it shows {shares[i]:.0%} of the fist while the {finger} finger alone is bent"
                yield GloveError(glove.sensors[i], problem, f"Bend one finger alone, or see to the cables; {_MEND}")
    shares = glove.shares(THUMB)
    for i in (i for f in FINGERS for i in own[f] if shares[i] > thresholds.other):
        problem = f"it shows {shares[i]:.0%} of the fist while the thumb alone is bent"
        yield GloveError(glove.sensors[i], problem, f"Keep the fingers straight, or see to the cables; {_MEND}")


def _flat(glove: Glove, known: Angles, thresholds: Thresholds) -> Iterator[GloveError]:
    """A hand that wasn't flat or wasn't a fist where it should have been, or a glove that slipped."""
    for i, name in enumerate(glove.sensors):
        if glove.again[i] > thresholds.again:
            problem = f"the flat hand differs by {glove.again[i]:.2f} rad between beginning and end"
            yield GloveError(name, problem, "The hand wasn't flat once, or the glove slipped: r 1 and r 9")
            continue
        if bent_in(name) != FIST:
            continue
        for number in (*ALONE.values(), THUMB):
            share = glove.shares(number)[i]
            if share < -thresholds.beyond:
                problem = f"in shape {number} it is straighter by {-share:.0%} of the fist than in the flat hand"
                yield GloveError(name, problem, "The hand wasn't flat: r 1 and r 9")
            elif share > 1.0 + thresholds.beyond:
                problem = f"in shape {number} it is bent further than in the fist: {share:.0%}"
                yield GloveError(name, problem, "The fist wasn't closed: r 2")
            else:
                continue
            break
