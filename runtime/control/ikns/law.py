"""The law `ikns`: control values from the motion that leaves a person's hand still.

Lisini Baldi et al., Exploiting intrinsic kinematic null space for supernumerary robotic limbs control, 2023. What
differs from it, and why: docs/ikns.md.
"""

from __future__ import annotations

from math import inf
from typing import Annotated

import numpy as np
from pydantic import Field

from runtime.contracts.controller import Controller, ControllerConfig
from runtime.contracts.errors import ProfileError, nearest
from runtime.contracts.files import FileOption, KeptFile
from runtime.contracts.signals import Array, Signal
from runtime.contracts.terms import POSE
from runtime.control.ikns import record
from runtime.control.ikns.calibration import refusals
from runtime.control.ikns.delaunay import SitesError
from runtime.control.ikns.sibson import Sibson


class IknsConfig(ControllerConfig):
    """Options of `ikns`."""

    calibration: Annotated[KeptFile, FileOption("Make it with `srl calibrate PROFILE ikns`, or name another")] = Field(
        description="the person's calibration file, beside the profile"
    )
    flip: tuple[str, ...] = Field((), description="degrees of freedom whose sense is turned round")
    clamp: bool = Field(True, description="keep c within 0 and 1")
    catch_up: float = Field(
        1.0, gt=0.0, description="1/s, how fast c goes to where it should be after it was held or reset"
    )


class Ikns(Controller):
    """Reads control values from joint angles, with directions interpolated between calibration points.

    Inputs: `angles` (n,) rad, unwrapped; `hand` (7,) m and w x y z, pose in the calibration's frame, of which only the
    position is used. Outputs `c` (k,), from 0 to 1 over the calibrated range, and `c_rate` (k,) 1/s. Outside the
    points' hull the directions are those of its nearest point. While an input isn't finite, c is held; afterwards it
    goes back at `catch_up` on top of the person's own motion.
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
        self._k, self._n = len(made.dofs), len(made.joints)
        sense = np.array([-1.0 if dof in config.flip else 1.0 for dof in made.dofs])
        lower = np.where(sense > 0.0, found.lower, -found.upper)
        # One row a point: directions, lower ends, ranges.
        directions = (sense[:, None] * found.directions).reshape(len(found.sites), -1)
        self._table = np.hstack([directions, lower, found.upper - found.lower])
        self._clamp, self._catch_up = config.clamp, config.catch_up
        self.inputs = (
            Signal(name="angles", shape=(self._n,), unit="rad", labels=made.joints),
            Signal(name="hand", shape=(7,), unit="m", frame=made.frame, labels=POSE),
        )
        self.outputs = (
            Signal(name="c", shape=(self._k,), unit="1", labels=made.dofs),
            Signal(name="c_rate", shape=(self._k,), unit="1/s", labels=made.dofs),
        )
        self._behind = np.zeros(self._k)  # how far c is still from where it should be
        self._lost = False
        self._clear()

    def _clear(self) -> None:
        self._cycles = self._held = self._outside = 0
        self._for = self._longest = self._farthest = 0.0
        self._least, self._most = np.full(self._k, inf), np.full(self._k, -inf)

    def reset(self) -> None:
        """Begins at the applied value, or at the present one if c commands nothing. Held if an input isn't finite."""
        now, c = self._read(), self.output["c"]
        self._clear()
        self._lost = now is None
        begin = self.applied.get("c", c if now is None else now)
        self._behind = np.zeros(self._k) if now is None else begin - now
        c[:] = begin
        self.output["c_rate"][:] = 0.0

    def update(self, dt: float) -> None:
        c, now = self.output["c"], self._read()
        self._cycles += 1
        if now is None:
            self._lost = True
            self._held += 1
            self._for += dt
            self._longest = max(self._longest, self._for)
            self.output["c_rate"][:] = 0.0
            return
        if self._lost:
            self._lost, self._for = False, 0.0
            self._behind = c - now
        step = self._catch_up * dt
        self._behind -= self._behind.clip(-step, step)
        now += self._behind
        if self._clamp:
            now.clip(0.0, 1.0, out=now)
        np.divide(now - c, dt, out=self.output["c_rate"])
        c[:] = now

    def _read(self) -> Array | None:
        """Returns c (k,) as the paper has it, or None if an input isn't a finite number."""
        q, hand = self.input["angles"], self.input["hand"][:3]
        if not (np.isfinite(q).all() and np.isfinite(hand).all()):
            return None
        near = self._sibson.nearest(hand)
        if near.distance > 0.0:
            self._outside += 1
            self._farthest = max(self._farthest, near.distance)
        row = self._sibson.weights(near.point).dot(self._table)
        k, n = self._k, self._n
        c = row[: k * n].reshape(k, n).dot(q)
        c -= row[k * n : k * n + k]
        c /= row[k * n + k :]
        if not np.isfinite(c).all():  # inputs so large that they overflow
            return None
        np.minimum(self._least, c, out=self._least)
        np.maximum(self._most, c, out=self._most)
        if self._clamp:
            c.clip(0.0, 1.0, out=c)
        found: Array = c
        return found

    def figures(self) -> dict[str, object]:
        """Returns the figures of the run, since the last reset.

        person, date: of the calibration; held, outside: share of the cycles in which c was held, and in which the hand
        was outside the points' hull; longest_hold_s; farthest_outside_m; range: least and greatest c a degree of
        freedom, before it was clamped.
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
