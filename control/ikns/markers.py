"""Joint angles from labelled markers: global least squares over all markers of a body, frame after frame.

Gauss-Newton on the body's chain, from where the motion goes. A marker that is farther from its place on the fitted body
than the gate, or near another's (a reflection, swapped labels), is left out and the rest fitted again. What the markers
that are left can't show is held: FIN lost, the wrist stays. Each frame says what was used, rejected and held.

Where a search had to leave markers out, or fits badly, the labels may be exchanged: it is shown once no other labelling
of an arm fits better by another posture.

Skin moves and bodies aren't chains, so the fit with a marker and the fit without it differ by some degrees. Where the
used markers change, the angles go on from where they were, and what they differ by fades. A joint that was held is at
once where it is seen again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import exp
from typing import Any, Final

import eigenpy
import numpy as np
from numpy.typing import NDArray

from srl.control.ikns.labels import OTHER, fits_better, labellings, ways
from srl.control.ikns.marker_chain import MarkerChain
from srl.control.ikns.observability import Mask, Observability
from srl.control.ikns.postures import STARTS, Postures, rigid
from srl.runtime.contracts.rotation import euler_angles
from srl.runtime.contracts.signals import Array
from srl.runtime.models.body import Body, Marker, Side

_STEPS: Final = 4  # of Gauss-Newton in a frame, at most
_SEARCH_STEPS: Final = 15  # the same where nothing is known of the posture
_SMALL: Final = 1.5e-2  # rad and m; what is left after a smaller step is the next frame's
_LARGE: Final = 0.4  # rad and m, the greatest step
_DAMPING: Final = 1e-7  # m^2 per rad^2, in a search; a step of 1 rad costs what 0.3 mm of residual do
_PRIOR: Final = 5e-4  # m^2 per rad^2; leaving the predicted posture by 0.045 rad costs what 1 mm of residual does, so
# that a posture in which the markers barely show a direction doesn't let noise run along it
_COAST: Final = 0.8  # of the last frame's velocity that is predicted
_FORCE: Final = 100.0  # m/s^2; a marker that leaves its predicted place faster is suspected before the fit
_FADE: Final = 0.2  # s, time constant with which a change of markers comes through
_ACCEPTED_AFTER: Final = 0.5  # s, after which a marker that stays beyond the gate is accepted, unless near another's
_SPARE: Final = 4  # of as many markers, one may be left out of a fit that is shown
_NEAR: Final = 0.5  # of the gate, the greatest residual of a fit that is shown
_OVER: Final = 0.8  # rad beyond its range, where no forearm is
_SURE: Final = 0.25  # of the gate, the greatest residual of a search that needs no other look
_LOST: Final = 10  # frames without a fit, after which the posture is searched anew


class MarkerFit:
    """The posture of a body that fits its markers best.

    Attributes:
        angles: (n,) rad (torso's x, y, z: m), those of the joints' ranges; the torso's yaw is unwrapped. A change of
            markers fades in; where `held` falls they jump.
        q: (n,) the same as fitted.
        held: (n,) True where this frame's markers don't show the joint, or it returns to its range by other angles of
            the same posture, or has two readings there; where it hangs on such a joint of torso or clavicle; everywhere
            while the fit is doubtful. It keeps its value.
        used: (k,) True for markers that this frame's fit rests on.
        rejected: (k,) True for markers that were seen, and not where the body can have them.
        residual: m, rms distance of the used markers from their places.
        known: False until a frame showed the posture, and again after it was lost.
    """

    def __init__(self, body: Body, markers: Mapping[str, Marker] | None = None, gate: float = 0.04) -> None:
        """
        Args:
            markers: places by name, in the order of `solve`; the body's own if left out.
            gate: m, how far a marker may be from its place.
        """
        self.body, self.gate = body, gate
        self.markers = dict(body.markers if markers is None else markers)
        self.names = tuple(self.markers)
        n, k = len(body.joints), len(self.names)
        self._chain = MarkerChain(body, self.markers)
        self._eye = np.eye(n)
        # Joints, and what hangs on them: where an arm's markers are says nothing of an arm whose shoulder isn't seen.
        self._carried: list[tuple[list[int], Mask]] = []
        for side in body.sides:
            clavicle = list(body.chains[f"{side}_clavicle"])
            carried = np.isin(np.arange(n), [*clavicle, *body.chains[f"{side}_arm"]])
            self._carried.append(([*body.chains["torso"], *clavicle], carried))
        self._postures = Postures(body)
        self._relabelled = labellings(self.markers)
        self._queue: list[tuple[NDArray[np.intp], Side | None]] = []
        self._lower = np.array([m.segment.endswith(("forearm", "hand")) for m in self.markers.values()])
        self._places, self._torso = self._chain.places, np.array([m.segment == "torso" for m in self.markers.values()])
        self.q, self.angles = np.zeros(n), np.zeros(n)
        self._rest, self._goal = np.zeros(n), np.zeros((k, 3))  # what fades; the frame before
        self.used, self.rejected = np.zeros(k, bool), np.zeros(k, bool)
        self.residual = 0.0
        self._observability = Observability(self.jacobian(self._postures.start(STARTS[0])), self._chain.support)
        self.reset()

    def reset(self) -> None:
        """Forgets the posture."""
        self.known = False
        self.q, self.angles = np.zeros_like(self.q), np.zeros_like(self.q)
        self._rest[:] = 0.0
        self.held = np.ones(len(self.body.joints), bool)
        self._velocity = np.zeros(len(self.body.joints))
        self._age = 0.0  # s since the last fit
        self._missed = self._tried = 0
        self._rejected_for = np.zeros(len(self.names))  # s for which each marker has been rejected
        self._shown = False  # whether `angles` are anybody's
        self._unobserved = self.held  # what the markers don't show
        self._poor = False  # whether the fit isn't good enough to be shown
        self._beyond = False  # whether more is held than that
        self._queue = []  # other labellings that could still fit better than the posture that was found
        self._suspect = False  # whether one did: then none is shown before all have been tried
        self._seen = np.zeros(len(self.names), bool)  # in the frame before

    def solve(self, points: Array, visible: Mask, dt: float = 0.01, starts: int = 1) -> bool:
        """Fits the body to one frame.

        Args:
            points: (k, 3) m, in the frame in which the torso is wanted.
            visible: (k,) whether the point is this frame's.
            dt: s since the frame before.
            starts: postures from which to search in this frame, where the posture isn't known.
        Returns:
            Whether it fits; else everything keeps its value and is held. So it does while a fit is followed that a
            search would refuse.
        """
        seen = visible & np.isfinite(points).all(axis=1)
        goal = np.where(seen[:, None], points, 0.0)
        shown, turned = self.angles, self._return()
        before, used, fitted, beyond = self.q, self.used, self._missed == 0, self._beyond
        unobserved, held = self._unobserved, self.held
        first = not self.known
        self._age += dt
        done = self._follow(goal, seen) if self.known else self._search(goal, seen, starts)
        if done and self.known and (unobserved & ~self._unobserved).any() and not self._sure(seen):
            self._queue = ways(self._relabelled, seen if self._queue else seen & ~self._seen)
        self._seen = seen
        if done and self._queue and self._mislabelled(goal, seen, starts):
            done = self.known = False
            self._suspect, self._queue = True, []
            if self._shown:
                before, self._rest = shown, np.zeros_like(shown)
        if not done:
            self._miss(before, seen)
            return False
        self._rest[~self._unobserved] *= exp(-dt / _FADE)
        moved = self.q - before
        if not first and fitted and not np.array_equal(used, self.used):
            change = self._change(before, used, goal)
            self._rest += change
            moved += change
        back = (unobserved & ~self._unobserved) | turned  # `held` says where a joint is, not was
        self._rest[back] = moved[back] = 0.0
        self._judge(seen)
        if beyond or self._beyond:
            self._rest = np.where(self.held, shown - self.q, np.where(held, 0.0, self._rest))
        # In no time, as at a reset, there is no speed; it was 1e6 rad/s, and led the next frames astray.
        self._velocity = moved / max(self._age, 1e-6) if self._age > 0.0 else np.zeros_like(moved)
        anybody = self._shown
        self.known, self._age, self._missed = True, 0.0, 0
        self._shown = self._shown or not self._queue
        self._goal = goal
        self._rejected_for = np.where(self.rejected, self._rejected_for + dt, 0.0)
        self.angles = np.where(self.held, shown, self.q + self._rest) if self._beyond else self.q + self._rest
        if self._rest.any():
            self._chain.place(self.angles)
        unclear = self._postures.ambiguous(self.q)
        if turned.any():  # the same posture; its angles are given in the next frame, where `held` falls
            unclear, self._unobserved = unclear | turned, self._unobserved | turned
        if unclear.any():
            self.held = self.held | unclear
            if anybody:
                self.angles = np.where(unclear, shown, self.angles)
        return True

    def _return(self) -> Mask:
        """Goes on by the angles nearest to the joints' ranges. Returns (n,) True for joints whose angles differ."""
        q = self._postures.returned(self.q) if self.known else self.q
        turned: Mask = q != self.q
        self.q, self._velocity = q, np.where(turned, 0.0, self._velocity)
        return turned

    def _change(self, before: Array, used: Mask, goal: Array) -> Array:
        """(n,): what takes back the motion of the fitted angles that is only the change of the used markers."""
        now, common, change = self.q, used & self.used, np.zeros_like(before)
        active, _ = self._observability.of(common)
        if not np.array_equal(common, used):  # some are gone: as if they had been gone a frame ago
            self.q = before
            self._chain.place(before)
            self._fit(self._goal, active, _STEPS, _PRIOR)
            change += before - self.q
        if not np.array_equal(common, self.used):  # some are back: as if they weren't yet
            self.q = before
            self._chain.place(before)
            self._fit(goal, active, _STEPS, _PRIOR)
            change += self.q - now
        self.q = now
        self._chain.place(now)
        return change

    def _judge(self, seen: Mask) -> None:
        """Says what is held, which may be more than what the markers don't show; the fit goes on all the same."""
        self._poor, self.held = self._is_poor(seen), self._unobserved
        if self._poor:
            self.held = np.ones_like(self._unobserved)
        elif self._unobserved.any():
            for joints, carried in self._carried:
                if self._unobserved[joints].any() and not self.held[carried].all():
                    self.held = self.held | carried
        self._beyond = self.held is not self._unobserved

    def _is_poor(self, seen: Mask) -> bool:
        """Whether a search would refuse this fit: too many markers left out, too far off, no person's posture."""
        if np.count_nonzero(self.rejected) > np.count_nonzero(seen) // _SPARE or self.residual > _NEAR * self.gate:
            return True
        if self._queue or self._postures.turned(self.q) > _OVER:
            return True
        return self._poor and self._postures.refused(np.where(self._unobserved, 0.0, self.q))

    def _miss(self, before: Array, seen: Mask) -> None:
        """A frame without a fit."""
        self.q, self._velocity = before, np.zeros_like(before)
        self._chain.place(self.q + self._rest)  # where the body is, whichever angles are shown
        self.held = self._unobserved = np.ones(len(before), bool)
        self.used, self.rejected = np.zeros_like(seen), seen.copy()
        self._missed += 1
        if self._missed >= _LOST:
            self.known = False

    def pose(self, segment: str) -> Any:
        """The pose (`pinocchio.SE3`) of a segment at the present angles, m; a view that the next frame changes."""
        return self._chain.pose(self.body.segments[segment])

    def predicted(self, q: Array) -> Array:
        """(k, 3) m: where the markers are at q (n,); for checks, as `pose` then is that at q."""
        self._chain.place(q)
        return self._chain.points.copy()

    def jacobian(self, q: Array) -> Array:
        """(3 k, n): the derivative of `predicted`, row by row."""
        self._chain.place(q)
        return self._chain.jacobian(self._chain.support[:, None, :])

    def observed(self, names: Sequence[str]) -> Mask:
        """(n,) True for joints that these markers show."""
        return ~self._observability.of(np.array([name in names for name in self.names]))[1]

    def needed(self, name: str) -> tuple[str, ...]:
        """The joints that aren't observed when this marker alone is lost."""
        rest = self.observed([other for other in self.names if other != name])
        lost = self.observed(self.names) & ~rest
        return tuple(joint for joint, gone in zip(self.body.names, lost, strict=True) if gone)

    # -- one frame

    def _follow(self, goal: Array, seen: Mask) -> bool:
        """Fits from where the motion goes. Suspects are left out first, and come back where the fit confirms them."""
        before = self.q
        self.q = before + _COAST * self._age * self._velocity
        self._chain.place(self.q)
        leap = self.gate + 0.5 * _FORCE * self._age**2
        wrong = self._chain.wrong(goal, self.gate, self._chain.distance(goal))
        use = seen & (wrong <= leap)
        if 2 * np.count_nonzero(use) <= np.count_nonzero(seen):
            use = seen  # not they, but the person leapt
        accepted = (self._rejected_for == 0.0) | (self._rejected_for > _ACCEPTED_AFTER) & np.isfinite(wrong)
        for suspect in np.flatnonzero(seen & ~use & accepted):
            # What alone shows a joint that was held may be anywhere, if it wasn't rejected a moment ago.
            more = use.copy()
            more[suspect] = True
            if (self._unobserved & self._observability.of(use)[1] & ~self._observability.of(more)[1]).any():
                use = more
        return self._settle(goal, seen, use, before, _STEPS, _PRIOR, (int(np.count_nonzero(seen)) - 1) // 2)

    def _settle(self, goal: Array, seen: Mask, use: Mask, before: Array, steps: int, prior: float, spare: int) -> bool:
        """Fits, leaves out what is beyond the gate, fits again. Held joints are where they were before.

        Returns False where more than `spare` markers would have to be left out.
        """
        readmitted, start = False, self.q
        for attempt in range(len(seen)):
            active, held = self._observability.of(use)
            if held.all():
                return False
            if attempt or held.any():
                self.q = np.where(held, before, start)
                self._chain.place(self.q)
            fresh = (self._unobserved & ~held).any()  # nothing is known of where a held joint went
            self._fit(goal, active, *((_SEARCH_STEPS, _DAMPING) if fresh else (steps, prior)))
            distance = self._chain.distance(goal)
            wrong = self._chain.wrong(goal, self.gate, distance)
            beyond = np.where(use, wrong, 0.0)
            worst = int(beyond.argmax())
            if beyond[worst] > self.gate:
                if np.count_nonzero(seen) - np.count_nonzero(use) >= spare:
                    return False
                use = use.copy()
                use[worst] = False
                continue
            back = seen & ~use & (wrong <= self.gate)
            if readmitted or not back.any():
                self._unobserved, self.used, self.rejected = held, use, seen & ~use
                count = np.count_nonzero(use)
                self.residual = float(np.sqrt((distance[use] ** 2).sum() / count))
                return bool(np.count_nonzero(seen) - count <= spare)
            use, readmitted = use | back, True
        return False

    def _fit(self, goal: Array, active: Array, steps: int, prior: float) -> None:
        """Gauss-Newton from the present posture, which is the prior; the last step's posture is placed."""
        start = q = self.q
        weight = prior * self._eye
        for _ in range(steps):
            J = self._chain.jacobian(active)
            left = (goal - self._chain.points).ravel()
            step = eigenpy.LLT(J.T @ J + weight).solve(J.T @ left + prior * (start - q))
            size = np.abs(step).max()
            q = q + (step if size <= _LARGE else step * (_LARGE / size))
            self._chain.place(q)
            if size < _SMALL:
                break
        self.q = q

    # -- from nothing

    def _search(self, goal: Array, seen: Mask, starts: int) -> bool:
        """Tries the next of a few starts; of those that a person can have, takes the one that fits best."""
        torso = self._torso & seen
        if np.count_nonzero(torso) < 3:
            return False
        last = self.q
        R, t = rigid(self._places[torso], goal[torso])
        trunk = (*t, *euler_angles(R[None], "ZYX")[0])
        found: list[tuple[int, float, Array, tuple[Mask, Mask, Mask]]] = []
        for _ in range(starts):
            q = self._postures.start(STARTS[self._tried % len(STARTS)])
            self._tried += 1
            q[:6] = trunk
            self.q = q
            self._chain.place(q)
            # Far from the posture, whole limbs would be left out and the rest would fit.
            spare = int(np.count_nonzero(seen)) // _SPARE
            if not self._settle(goal, seen, seen, last if self._shown else q, _SEARCH_STEPS, _DAMPING, spare):
                continue
            if self.residual > _NEAR * self.gate:  # each within the gate, and yet not this body: crossed labels, say
                continue
            q = self._postures.home(self.q, last)
            if self._postures.refused(np.where(self._unobserved, 0.0, q)):
                continue
            left_out = int(np.count_nonzero(self.rejected))
            found.append((left_out, self.residual, q, (self._unobserved, self.used, self.rejected)))
            if not left_out and self.residual < _SURE * self.gate:
                break
        if not found:
            self.q = last
            return False
        left_out, self.residual, self.q, (self._unobserved, self.used, self.rejected) = min(
            found, key=lambda one: one[:2]
        )
        self._chain.place(self.q)
        self._queue = [] if self._sure(seen) and not self._suspect else ways(self._relabelled, seen)
        return True

    def _sure(self, seen: Mask) -> bool:
        """Whether the fit is one by these labels alone: each marker of the lower arm is there, and in its place.

        Two markers of a wrist are enough to turn a forearm over, beyond its range as a rule.
        """
        fits = not self.rejected.any() and self.residual < _SURE * self.gate
        return bool(fits and seen[self._lower].all() and self._postures.turned(self.q) < OTHER)

    def _mislabelled(self, goal: Array, seen: Mask, count: int) -> bool:
        """Tries the next `count` other labellings. Returns whether one fits better by another posture."""
        mine = self.q, self._unobserved, self.used, self.rejected, self.residual
        before = (int(np.count_nonzero(self.rejected)), self.residual, self._far(self.q, self._unobserved))
        spare = int(np.count_nonzero(seen)) // _SPARE
        found = False
        for _ in range(min(count, len(self._queue))):
            order, over = self._queue.pop()
            start = mine[0] if over is None else self._postures.turned_over(mine[0], over)
            self.q = start
            self._chain.place(start)
            fits = self._settle(goal[order], seen[order], seen[order], start, _SEARCH_STEPS, _DAMPING, spare)
            if fits and self.residual <= _NEAR * self.gate:  # as a search has it
                q = self._postures.home(self.q, mine[0])
                both = ~(self._unobserved | mine[1])
                after = (int(np.count_nonzero(self.rejected)), self.residual, self._far(q, self._unobserved))
                found = bool(np.abs(q - mine[0])[both].max(initial=0.0) > OTHER) and fits_better(after, before)
            self.q, self._unobserved, self.used, self.rejected, self.residual = mine
            if found:
                break
        self._chain.place(self.q)
        self._suspect &= bool(found or self._queue)
        return found

    def _far(self, q: Array, unobserved: Mask) -> float:
        """rad: how far the joints are beyond their ranges, at most."""
        return float(self._postures.excess(np.where(unobserved, 0.0, q)).max())
