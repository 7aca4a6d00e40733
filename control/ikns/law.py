"""The law `ikns`: control values from the motion that leaves a person's hand still.

Lisini Baldi et al., Exploiting intrinsic kinematic null space for supernumerary robotic limbs control, 2023. What
differs from it, and why: docs/ikns.md.
"""

from __future__ import annotations

from math import inf
from typing import Annotated

import numpy as np
from pydantic import Field

from srl.control.ikns import record
from srl.control.ikns.calibration import Calibration, refusals
from srl.control.ikns.delaunay import SitesError
from srl.control.ikns.sibson import Sibson
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.errors import ProfileError, nearest
from srl.runtime.contracts.files import FileOption, KeptFile
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import POSE


class IknsConfig(ControllerConfig):
    """Options of `ikns`."""

    calibration: Annotated[KeptFile, FileOption("Make it with `srl calibrate PROFILE ikns`, or name another")] = Field(
        description="the person's calibration file, beside the profile"
    )
    flip: tuple[str, ...] = Field((), description="degrees of freedom whose sense is turned round")
    clamp: bool = Field(True, description="keep c within 0 and 1")
    catch_up: float = Field(
        1.0,
        gt=0.0,
        allow_inf_nan=False,
        description="1/s, how fast c goes to where it should be after it was held or reset",
    )
    held: bool = Field(True, description="whether the input `held` tells which angles are held")
    unseen: float = Field(
        0.1,
        ge=0.0,
        le=1.0,
        description="how wrong c may become by joints whose angles are held; beyond that c is held too",
    )
    inset: float = Field(
        0.05, ge=0.0, le=0.5, description="how far within the points' hull c is read at most, as a share of the way in"
    )
    max_hold: float = Field(
        2.0,
        gt=0.0,
        le=60.0,
        description="s for which c may be held, less what it was seen since; then the person is lost, the limb stops",
    )


class Ikns(Controller):
    """Reads control values from joint angles, with directions interpolated between calibration points.

    Inputs: `angles` (n,) rad, continuous but where `held` tells; `hand` (7,) m and w x y z, pose in the calibration's
    frame, of which only the position is used; `held` (n,), 1 where the angle isn't seen and stays as it was (unless the
    option `held` is off).
    Outputs `c` (k,), from 0 to 1 over the calibrated range; `c_rate` (k,) 1/s; `held` (k,), 1 where c is held. Outside
    the points' hull, shrunk by `inset`, the directions are those of its nearest point.

    While an input isn't finite, all of c is held. While joints are held, a degree of freedom is held if they could make
    its c wrong by more than `unseen`. Afterwards c goes back at `catch_up` on top of the person's own motion. Holds
    add up, and what is seen between them is taken off: a sum of more than `max_hold` is the loss of the person.
    """

    Config = IknsConfig
    summary = "control values from a person's own null-space motion (Lisini Baldi 2023)"

    def __init__(self, name: str, config: IknsConfig) -> None:
        super().__init__(name, config)
        file = config.calibration
        made = record.parse(file.content, str(file.path))
        found = made.calibration()
        place = f"controllers.{name}.calibration"
        for reason in refusals(found, made.thresholds):
            raise ProfileError(place, f"{file.path}: {reason.place}: {reason.problem}", reason.remedy)
        for dof in config.flip:
            if dof not in made.dofs:
                problem = f"the calibration has no degree of freedom '{dof}'"
                raise ProfileError(f"controllers.{name}.flip", problem, nearest(dof, made.dofs))
        try:
            self._sibson = Sibson(found.sites)
        except SitesError as error:
            raise ProfileError(place, f"{file.path}: {error.problem}", error.remedy) from None
        self._record = made
        self.simulated = "calibration" if made.simulated else ""
        self.measured_by = made.bodies
        self._k, self._n = len(made.dofs), len(made.joints)
        sense = np.array([-1.0 if dof in config.flip else 1.0 for dof in made.dofs])
        lower = np.where(sense > 0.0, found.lower, -found.upper)
        # One row a point: directions, lower ends, ranges, bounds of what each joint does to c.
        directions = (sense[:, None] * found.directions).reshape(len(found.sites), -1)
        ranges = found.upper - found.lower
        bounds = matters(found).reshape(len(found.sites), -1)
        self._table = np.hstack([directions, lower, ranges, bounds])
        self._unseen = config.unseen
        self._middle, self._scale = found.sites.mean(axis=0), 1.0 - config.inset
        self._clamp, self._catch_up, self._timeout = config.clamp, config.catch_up, config.max_hold
        self.inputs = (
            Signal(name="angles", shape=(self._n,), unit="rad", labels=made.joints),
            Signal(name="hand", shape=(7,), unit="m", frame=made.frame, labels=POSE),
        )
        if config.held:
            self.inputs += (Signal(name="held", shape=(self._n,), unit="1", labels=made.joints),)
        self.outputs = (
            Signal(name="c", shape=(self._k,), unit="1", labels=made.dofs),
            Signal(name="c_rate", shape=(self._k,), unit="1/s", labels=made.dofs),
            Signal(name="held", shape=(self._k,), unit="1", labels=made.dofs),
        )
        self._behind = np.zeros(self._k)  # how far c is still from where it should be
        self._hold = np.zeros(self._k, dtype=bool)
        self._frozen = np.zeros(self._n, dtype=bool)  # joints that were held in the cycle before
        self._missed = 0.0  # s held, less s seen
        self._clear()

    def _clear(self) -> None:
        self._cycles = self._held = self._outside = 0
        self._for = self._longest = self._farthest = 0.0
        self._least, self._most = np.full(self._k, inf), np.full(self._k, -inf)

    def reset(self) -> None:
        """Begins at the applied value, or at the present one if c commands nothing. What is held keeps its value."""
        c = self.output["c"]
        self.lost, self._missed = False, 0.0
        self._frozen[:] = False
        now = self._read(c)
        self._clear()  # this reading belongs to no cycle
        begin = self.applied.get("c", np.where(self._hold, c, now))
        self._behind = np.where(self._hold, 0.0, begin - now)
        c[:] = begin
        self.output["c_rate"][:] = 0.0
        self.output["held"][:] = self._hold

    def update(self, dt: float) -> None:
        c, before, frozen = self.output["c"], self._hold, self._frozen
        now = self._read(c)
        hold = self._hold
        self._cycles += 1
        if hold.any():
            self._held += 1
            self._for += dt
            self._longest = max(self._longest, self._for)
            self._missed += dt
        else:
            self._for, self._missed = 0.0, max(0.0, self._missed - dt)  # a good frame now and then isn't a person
        self.lost = self._missed > self._timeout
        # What comes back, be it c itself or a joint that it did without, moves c at `catch_up`.
        back = before if not (frozen & ~self._frozen).any() else np.ones(self._k, dtype=bool)
        np.copyto(self._behind, c - now, where=back)
        step = self._catch_up * dt
        self._behind -= self._behind.clip(-step, step)
        now += self._behind
        if self._clamp:
            now.clip(0.0, 1.0, out=now)
        np.copyto(now, c, where=hold)
        np.divide(now - c, dt, out=self.output["c_rate"])
        c[:] = now
        self.output["held"][:] = hold

    def _read(self, c: Array) -> Array:
        """Returns c (k,) as the paper has it. Notes which of it must be held; where inputs are missing it is `c`."""
        q, hand, k, n = self.input["angles"], self.input["hand"][:3], self._k, self._n
        self._hold = np.ones(k, dtype=bool)
        if not (np.isfinite(q).all() and np.isfinite(hand).all()):
            return c.copy()
        # The nearest point of the hull, shrunk about its middle: at nearly flat faces the weights themselves are steep.
        middle, scale = self._middle, self._scale
        near = self._sibson.nearest(middle + (hand - middle) / scale)
        if near.distance > 0.0:
            self._outside += 1
            self._farthest = max(self._farthest, scale * near.distance)
        row = self._sibson.weights(middle + (near.point - middle) * scale).dot(self._table)
        found: Array = row[: k * n].reshape(k, n).dot(q)
        found -= row[k * n : k * n + k]
        found /= row[k * n + k : k * n + 2 * k]
        if not np.isfinite(found).all():  # inputs so large that they overflow
            return c.copy()
        if "held" in self.input:
            self._frozen = ~(self.input["held"] <= 0.5)
            self._hold = row[k * n + 2 * k :].reshape(k, n).dot(self._frozen) > self._unseen
        else:
            self._hold = np.zeros(k, dtype=bool)
        np.minimum(self._least, found, out=self._least, where=~self._hold)
        np.maximum(self._most, found, out=self._most, where=~self._hold)
        if self._clamp:
            found.clip(0.0, 1.0, out=found)
        return found

    def metrics(self) -> dict[str, object]:
        """Returns the figures of the run, since the last reset.

        person, date: of the calibration; held, outside: share of the cycles in which some c was held, and in which the
        hand was outside the points' shrunk hull; longest_hold_s; farthest_outside_m; range: least and greatest c a
        degree of freedom, before it was clamped.
        """
        n = max(self._cycles, 1)
        ranges = {
            dof: [float(low), float(high)]
            for dof, low, high in zip(self._record.dofs, self._least, self._most, strict=True)
            if low <= high
        }
        return {
            "person": self._record.person,
            "date": self._record.date.isoformat(),
            "held": self._held / n,
            "longest_hold_s": self._longest,
            "outside": self._outside / n,
            "farthest_outside_m": self._farthest,
            "range": ranges,
        }


def matters(found: Calibration) -> Array:
    """How wrong each c would be if a joint weren't seen while every degree of freedom goes through its range.

    Returns (N, k, n), a bound for the motions of the calibration: |B_ij| sum_l t_lj / (M_i - m_i), with t_lj, how far
    joint j went in the trial of l.
    """
    travel, ranges = found.travel.sum(axis=1), found.upper - found.lower
    bound: Array = np.abs(found.directions) * travel[:, None, :] / ranges[:, :, None]
    return bound
