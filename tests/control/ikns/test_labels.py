"""Labels that are exchanged, at the beginning and while they were hidden: no other posture is shown."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.mocap import made, off, reaching

from srl.control.ikns.markers import MarkerFit
from srl.runtime.models.body import Body, average

ARM = average(1.75, ("right",))
ARM_MARKERS = tuple(ARM.markers)
SEEN = np.ones(len(ARM.markers), bool)
DT = 0.01


def labelled(q: np.ndarray, names: tuple[str, ...], body: Body = ARM, frames: int = 10) -> MarkerFit:
    """A fit from nothing of a body that stands still; the points of these markers go round in a ring."""
    fit, points = MarkerFit(body), made(body, q)
    at = [fit.names.index(name) for name in names]
    points[at] = points[at[1:] + at[:1]]
    for i in range(frames):
        fit.solve(points + np.random.default_rng(i).normal(0.0, 1e-3, points.shape), SEEN, DT, starts=6)
    return fit


def test_markers_swapped_from_the_first_frame_on_are_rejected() -> None:
    q = reaching(ARM, 1)[0]
    fit = labelled(q, ("RELB", "RWRB"))
    assert {fit.names[i] for i in np.flatnonzero(fit.rejected)} == {"RELB", "RWRB"}
    assert not fit.held.any()
    assert off(fit.q[None], q[None]).max() < 6.0


@pytest.mark.slow
@pytest.mark.sampled
@pytest.mark.parametrize("stature", [1.5, 1.95])
@pytest.mark.parametrize(
    "names",
    [("RWRA", "RWRB"), ("RWRA", "RFIN"), ("RWRB", "RFIN"), ("RWRA", "RWRB", "RFIN"), ("RWRA", "RFIN", "RWRB"),
     ("RFRM", "RWRB"), ("RSHO", "RUPA")],
)  # fmt: skip
def test_labels_exchanged_at_the_beginning_show_no_other_posture(names: tuple[str, ...], stature: float) -> None:
    """The forearm turned over, or the hand in place of the wrist, fits most markers to a centimetre."""
    body = average(stature, ("right",))
    rng = np.random.default_rng(7)
    low, high = body.ranges[6:].T
    for _ in range(3):
        q = np.concatenate([np.zeros(6), (low + high) / 2 + rng.uniform(-0.3, 0.3, 9) * (high - low)])
        fit = labelled(q, names, body)
        shown = ~fit.held
        # The wrist is what it is without FIN; a wrong posture is off by 20 to 180 degrees.
        assert off(fit.angles[None], q[None])[0][shown[3:]].max(initial=0.0) < 12.0
        assert not labelled(q, ("RFIN",), body).held.any()


@pytest.mark.parametrize("names", [("RWRA", "RFIN"), ("RWRB", "RFIN"), ("RWRA", "RWRB")])
def test_labels_exchanged_while_they_are_hidden_show_no_other_posture(names: tuple[str, str]) -> None:
    """One frame without them is enough: what comes back is fitted anew, as nothing is known of where it went."""
    fit, q = MarkerFit(ARM), reaching(ARM, 1)[0]
    points, at = made(ARM, q), [fit.names.index(name) for name in names]
    assert fit.solve(points, SEEN, DT, starts=6)
    gone = SEEN.copy()
    gone[at] = False
    fit.solve(points, gone, DT)
    points[at] = points[at[::-1]]
    for _ in range(100):
        fit.solve(points, SEEN, DT)
        assert off(fit.angles[None], q[None])[0][~fit.held[3:]].max(initial=0.0) < 12.0


@pytest.mark.parametrize("degrees", [75.0, 89.0])
def test_a_wrist_exchanged_while_the_forearms_marker_is_hidden_isnt_turned_over(degrees: float) -> None:
    q = reaching(ARM, 1)[0]
    q[ARM.names.index("right_forearm_pronation")] = np.deg2rad(degrees)
    points, at = made(ARM, q), [ARM_MARKERS.index(name) for name in ("RWRA", "RWRB")]
    hidden = np.array([name != "RFRM" for name in ARM_MARKERS])
    fit = MarkerFit(ARM)
    for _ in range(10):
        fit.solve(points, hidden, DT, starts=6)
    assert not fit.held[len(fit.held) - 3]  # with the right labels the forearm is shown
    fit = MarkerFit(ARM)
    points[at] = points[at[::-1]]
    for _ in range(20):
        fit.solve(points, hidden, DT, starts=6)
        assert fit.held.all()


def test_a_posture_is_not_shown_before_other_labels_have_been_tried() -> None:
    q = reaching(ARM, 1)[0]
    fit, points = MarkerFit(ARM), made(ARM, q)
    points[fit.names.index("RELB")] += 0.1  # one point is elsewhere: who knows whose
    frames = 0
    while fit.held.all():
        assert fit.solve(points, SEEN, DT)
        frames += 1
        assert frames < 60
    assert frames > 40
    assert off(fit.angles[None], q[None]).max() < 3.0
