"""Watches what a gripper holds: identifies a load from pick-up on, and tells it from contact, support and loss.

    open       nothing is held; the sensor's bias is followed
    picking    closed: what pulls down, up to the heaviest load, may be the load; what pulls otherwise is contact
    carrying   the load is known: whatever differs from it by more than the threshold is contact
    releasing  opened: the known load may still be there, whole or in part

Picking ends once the tool has moved by `lift` from where the gripper closed, for then the load hangs freely or there is
none. The estimate rests during contact. A load that is no longer felt was dropped or put down. Picking then begins
again, where the tool is. So it does when something seems to bear the load from below and the tool is raised by `lift`
all the same: a part of the load is gone.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from math import inf, sqrt
from operator import sub
from typing import Final

from pydantic import ConfigDict, Field

from srl.control.cobot.axes import DeadBand, ForceTorque
from srl.control.cobot.contact_wrench import cross, square
from srl.control.cobot.load_estimate import LoadEstimate, Motion, Vector
from srl.runtime.contracts.entry import BaseModel

_SAMPLE: Final = 8e-3  # s between two samples of the estimate: filtered ones that are closer say little more
_FOLLOWED: Final = 20.0  # 1/s with which the estimate follows a load that is coming in
_SETTLED: Final = 1.0  # s with which the bias is followed
_ONCE: Final = 0.1  # s within which a load that goes is dropped, not put down
_GONE: Final = 0.25  # share of the load's weight below which it may be gone
_DOUBTFUL: Final = 0.5  # thresholds from which on it is asked whether what isn't known of the load explains it
_CLEAR: Final = 2.0  # thresholds by which a load must be heavier, so that its loss is seen at once


class Phase(IntEnum):
    """See the module's docstring."""

    OPEN = 0
    PICKING = 1
    CARRYING = 2
    RELEASING = 3


class WatchConfig(BaseModel):
    """How a load is told from contact."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    threshold: ForceTorque = Field(
        (15.0, 3.0), description="N, N m: what differs from the load by more is contact, and the estimate rests"
    )
    stop: ForceTorque | None = Field(
        (40.0, 10.0),
        description="N, N m: contact of the closed gripper beyond it stops the limb; null: it never does. What bears "
        "the load from below doesn't count, if the tool came on it slowly",
    )
    gentle: float = Field(0.1, ge=0, description="m/s, with which a load is put down at most; what comes faster hits")
    confirm: float = Field(0.006, ge=0, le=0.2, description="s for which it must last")
    reach: float = Field(0.5, gt=0, le=2, description="m from the control point within which a load's middle lies")
    lightest: float = Field(0.3, gt=0, description="kg, below which the gripper counts as empty")
    lift: float = Field(0.05, gt=0, description="m from where the gripper closed, beyond which a load hangs freely")
    settle: float = Field(0.3, gt=0, description="s for which the wrench must agree before something counts as settled")
    gone: float = Field(0.01, gt=0, description="s for which nothing may be felt of a load before it counts as gone")
    noise: ForceTorque = Field((2.0, 0.2), description="N, N m: standard deviations of the wrench's errors")
    bias: DeadBand = Field((5.5, 0.5), description="N, N m: offset of the sensor that is followed while it is open")


class LoadWatch:
    """Computes load and contact from a wrench; see the module's docstring. All vectors are in the tool's axes.

    Attributes:
        estimate: the load.
        phase: what the gripper does.
        expected: (6,) N, N m, the load's wrench.
        share: share of the load that is there, 0 to 1; less than 1 only while it is released.
        outside: (6,) N, N m, what pulls or pushes besides the load.
        contact: whether it is more than the threshold.
        stopping: whether it is more than `stop`.
        drops, put_down, contacts: how often each has happened.
    """

    def __init__(self, config: WatchConfig, heaviest: float) -> None:
        self.config = config
        # The bias may drift from one end of its range to the other: two of these deviations.
        self.estimate = LoadEstimate(heaviest, config.reach, config.noise, config.bias)
        self.phase = Phase.OPEN
        self._bias = [0.0] * 6
        self._origin: Sequence[float] = (0.0, 0.0, 0.0)
        self.drops = self.put_down = self.contacts = 0
        self._begin()

    def _begin(self) -> None:
        self.share, self.outside, self.expected = 1.0, [0.0] * 6, [0.0] * 6
        self.contact = self.stopping = False
        self._since = 0.0  # s since the last sample of the estimate
        self._agreed = self._quiet = self._beyond = self._empty = 0.0  # s for which each has lasted
        self._whole = 0.0  # s since the load was felt as a whole
        self._speed = 0.0  # m/s, the tool's
        self._hits = False  # whether the present contact began fast
        self._lowest = inf  # m, where the tool was lowest while something bore the load from below
        self._excused = (0.0, 0.0)  # N, N m: contact of the last reset, as long as it lasts

    def reset(self, wrench: list[float], at: Motion, place: Sequence[float], closed: bool) -> None:
        """Begins anew. A load that was known and is still held stays known.

        Contact that is there doesn't stop, so that it can be led away; it stops once it has grown by `stop`.
        """
        known = closed and self.phase is Phase.CARRYING
        self._begin()
        if not closed:
            self.estimate.reset()
            self.phase = Phase.OPEN
        elif not known:
            self._pick(place)
            self.estimate.take(*self.estimate.glance(self._unbiased(wrench), at))
        self.update(wrench, at, place, closed, 0.0)
        self.stopping = False
        if self.contact:
            self._excused = sqrt(square(self.outside[:3])), sqrt(square(self.outside[3:]))

    def update(self, wrench: list[float], at: Motion, place: Sequence[float], closed: bool, dt: float) -> None:
        """Computes one step of dt seconds.

        Args:
            wrench: (6,) N, N m of the surroundings on the tool, at its origin.
            at: the motion at that instant.
            place: (3,) m, the tool's origin in the world.
            closed: whether the gripper is closed.
        """
        if closed and self.phase in (Phase.OPEN, Phase.RELEASING):
            self.estimate.reset()
            self._pick(place)
        elif not closed and self.phase in (Phase.PICKING, Phase.CARRYING):
            self.phase, self._quiet = Phase.RELEASING, 0.0
        f = self._unbiased(wrench)
        self.expected = self.estimate.wrench(at)
        self._speed = at.speed
        if self.phase is Phase.OPEN:
            self._wait(wrench, f, dt)
        elif self.phase is Phase.PICKING:
            self._pick_up(f, at, place, dt)
        elif self.phase is Phase.CARRYING:
            self._carry(f, at, place, dt)
        else:
            self._release(f, dt)

    # -- phases

    def _wait(self, wrench: list[float], f: list[float], dt: float) -> None:
        self._judge(f)
        if self.contact:
            return
        most = self.config.bias
        k = dt / (_SETTLED + dt)
        for i, v in enumerate(wrench):
            b = self._bias[i] + k * (v - self._bias[i])
            self._bias[i] = min(max(b, -most[i // 3]), most[i // 3])

    def _pick(self, place: Sequence[float]) -> None:
        self.phase, self.share, self._origin = Phase.PICKING, 1.0, tuple(place)
        self._agreed = self._empty = 0.0
        self._lowest = inf

    def _pick_up(self, f: list[float], at: Motion, place: Sequence[float], dt: float) -> None:
        c, e = self.config, self.estimate
        mass, (x, y, z) = e.glance(f, at)
        weight = [*(mass * g for g in at.g), *cross((x, y, z), at.g)]
        left = list(map(sub, f, weight))
        # What is known by now also explains the load's swing.
        self._judge(min(left, list(map(sub, f, self.expected)), key=self._size))
        self._watch(self.outside, dt)
        if self.contact:
            self._agreed = 0.0
            return
        self._sample(f, at, dt, _FOLLOWED)
        agrees = self._size(list(map(sub, f, e.wrench(at)))) < 0.5
        self._agreed = self._agreed + dt if agrees else 0.0
        moved = sqrt(square([a - b for a, b in zip(place, self._origin, strict=True)]))
        if moved > c.lift and (self._agreed >= c.settle or moved > 2 * c.lift):
            self.phase, self._quiet, self._whole, self._empty = Phase.CARRYING, c.settle, 0.0, 0.0
            if e.mass < c.lightest:
                e.reset()

    def _carry(self, f: list[float], at: Motion, place: Sequence[float], dt: float) -> None:
        c, e = self.config, self.estimate
        w = self.expected
        left = list(map(sub, f, w))
        if e.mass > 0.0 and self._size(left) > _DOUBTFUL:
            left = e.unexplained(left, at, c.threshold)
        self._judge(left)
        self._quiet = 0.0 if self.contact else self._quiet + dt
        if self._quiet >= c.settle and e.mass > 0.0:
            self._sample(f, at, dt, 0.0)
        rest = self._unsupported(at) if self.contact else left
        self._watch(rest, dt)
        if e.mass == 0.0:
            return
        # What is raised isn't borne by a table any more: a part of the load has fallen, and the rest is another load.
        borne = self.contact and rest is not self.outside
        self._lowest = min(self._lowest, place[2]) if borne else inf
        if place[2] - self._lowest > c.lift:
            self.drops += 1
            e.reset()
            self._pick(place)
            self._pick_up(f, at, place, 0.0)
            return
        size = square(w[:3])
        share = (f[0] * w[0] + f[1] * w[1] + f[2] * w[2]) / max(size, 1.0)
        self._whole = 0.0 if share > 1.0 - _GONE else self._whole + dt
        gone = share < _GONE and self._size([a - share * b for a, b in zip(f, w, strict=True)]) < 1.0
        self._empty = self._empty + dt if gone else 0.0
        if gone and self._empty >= (c.gone if size > (_CLEAR * c.threshold[0]) ** 2 else c.settle):
            once = self._whole - self._empty < _ONCE
            self.drops, self.put_down = self.drops + once, self.put_down + (not once)
            e.reset()
            self._pick(place)
            self._judge(f)

    def _release(self, f: list[float], dt: float) -> None:
        w = self.expected
        size = square(w[:3])
        share = (f[0] * w[0] + f[1] * w[1] + f[2] * w[2]) / size if size > 0.0 else 0.0
        self.share = share = min(max(share, 0.0), 1.0)
        self._judge([a - share * b for a, b in zip(f, w, strict=True)])
        self._quiet = self._quiet + dt if self._size(f) < 1.0 else 0.0
        self._beyond = 0.0
        if self._quiet >= self.config.settle:
            self.phase = Phase.OPEN
            self.estimate.reset()

    # -- measures

    def _unbiased(self, wrench: list[float]) -> list[float]:
        return list(map(sub, wrench, self._bias))

    def _size(self, f: list[float]) -> float:
        """How large a wrench is, in thresholds."""
        force, torque = self.config.threshold
        return sqrt(max(square(f[:3]) / force**2, square(f[3:]) / torque**2))

    def _judge(self, outside: list[float]) -> None:
        self.outside = outside
        contact = self._size(outside) > 1.0
        if contact and not self.contact:
            self.contacts += 1
            self._hits = self._speed > self.config.gentle
        self.contact = contact

    def _sample(self, f: list[float], at: Motion, dt: float, bandwidth: float) -> None:
        self._since += dt
        if self._since >= _SAMPLE:
            self.estimate.update(f, at, self._since, bandwidth)
            self._since = 0.0

    def _unsupported(self, at: Motion) -> list[float]:
        """The contact without what may bear the load from below: a force up to its weight, anywhere within reach."""
        F, N = self.outside[:3], self.outside[3:]
        size = sqrt(max(square(at.g), 1.0))
        up: Vector = (-at.g[0] / size, -at.g[1] / size, -at.g[2] / size)
        borne = min(max(_dot(F, up), 0.0), self.estimate.mass * size)
        if borne == 0.0 or self._hits:
            return self.outside
        about = _dot(N, up)
        lever = [n - about * u for n, u in zip(N, up, strict=True)]
        across = sqrt(square(lever))
        k = max(1.0 - self.config.reach * borne / across, 0.0) if across > 0.0 else 0.0
        return [
            *(a - borne * u for a, u in zip(F, up, strict=True)),
            *(k * a + about * u for a, u in zip(lever, up, strict=True)),
        ]

    def _watch(self, f: list[float], dt: float) -> None:
        """Judges whether contact stops the limb."""
        if not self.contact:
            self._excused = (0.0, 0.0)
        if self.config.stop is None:
            return
        force, torque = (a + b for a, b in zip(self.config.stop, self._excused, strict=True))
        beyond = square(f[:3]) > force * force or square(f[3:]) > torque * torque
        self._beyond = self._beyond + dt if beyond else 0.0
        self.stopping = beyond and self._beyond >= self.config.confirm


def _dot(a: Sequence[float], b: Sequence[float]) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
