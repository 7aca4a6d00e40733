"""How much a control value trembles because markers do: the expected noise of c, per millimetre of theirs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from srl.control.ikns.calibration import Calibration
from srl.control.ikns.markers import MarkerFit
from srl.runtime.contracts.signals import Array
from srl.runtime.models.body import Body

_WEAK: Final = 1e-6  # singular values below this share of the largest: what no marker shows
_MM: Final = 1e-3


def noise_of_c(body: Body, joints: Sequence[str], postures: Array, found: Calibration) -> Array:
    """Returns (N, k): the standard deviation of each c at each point with 1 mm of noise on every marker's coordinate.

    For a fit of all markers by least squares, from its derivative at the posture; joints that are not among `joints`
    are at zero there, and are fitted, too.

    Args:
        body: with the markers that are used.
        joints: names of the angles, n; all are the body's.
        postures: (N, n) rad, at the points.
        found: the calibration.
    """
    fit = MarkerFit(body)
    places = [body.names.index(joint) for joint in joints]
    noise = np.full(found.lower.shape, np.nan)
    for i, posture in enumerate(postures):
        if not np.isfinite(posture).all():
            continue
        q = np.zeros(len(body.names))
        q[places] = posture
        gain = np.linalg.pinv(fit.jacobian(q), rcond=_WEAK)[places]
        span = found.upper[i] - found.lower[i]
        noise[i] = np.linalg.norm(found.directions[i] @ gain, axis=1) * _MM / span
    return noise
