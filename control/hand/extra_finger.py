"""A robotic extra finger: its place on the body, its chain, and its inverse kinematics, equation (5)."""

from __future__ import annotations

from collections.abc import Mapping
from math import sqrt
from typing import Any, ClassVar, Final

import numpy as np
from pydantic import Field, model_validator

from srl.control.shared.kinematics import Chain
from srl.control.shared.symmetric import Vector, dot, gram, raised_inverse, times
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.signals import Array
from srl.runtime.models.models import FingerModel, FingerOption, named

_HELD: Final = (0.0, 0.0, 0.0)  # the column of J of a joint at its limit


class ExtraFinger(Options):
    """One extra finger: its name, which is that of its frame, too, and its description.

    In a profile the plain name of a model stands for {model: NAME}.
    """

    gone: ClassVar[Mapping[str, str]] = {
        "base": "write under `frames:` where the finger is worn, as `finger: {parent: hand, position: [...]}`",
        **dict.fromkeys(("joints", "rows", "lower", "upper"), "write models: {finger: {kind: finger, rows: ...}}"),
    }

    model: FingerOption = named("finger")
    name: str = Field(default="finger", pattern=r"^[a-z][a-z0-9_]*$", description="left out: the model's")

    @model_validator(mode="before")
    @classmethod
    def _by_name(cls, given: Any) -> Any:
        if isinstance(given, str):
            return {"model": given, "name": given}
        if not isinstance(given, Mapping):
            return given
        model = given.get("model")
        return {"name": model, **given} if isinstance(model, str) else given


class FingerKinematics:
    """Moves one finger's joints so that its tip follows."""

    def __init__(self, model: FingerModel, base: Array, damping: float) -> None:
        """Args:
        model: its description.
        base: (4, 4), its base in the frame of the tips, m.
        damping: m/rad; singular values of J below it are damped.
        """
        self.chain = Chain(base, np.array(model.rows))
        self.n = len(model.rows)
        self.limits = [(low, 0.5 * (low + high), high) for low, high in zip(model.lower, model.upper, strict=True)]
        self.damping2 = damping**2
        self.curvature = 0.5 * sum(abs(a) for _, a in model.rows)

    def follow(self, q: list[float], dp: Vector, v: Vector, pull: float) -> tuple[list[float], list[float]]:
        """(5): dq_a = J_a^+ dp_a + N_J chi, within the joint limits, and the rate for the tip's velocity.

        A joint that would pass its limit stops there, and the others take over what they can.

        Args:
            q: (n,) rad, for which `chain.forward` was called last.
            dp: m, desired displacement of the tip.
            v: m/s, desired velocity of the tip.
            pull: chi = pull (middle - q), 0..1.
        Returns:
            dq (n,) rad, dq/dt (n,) rad/s.
        """
        J = self.chain.jacobian()
        room = [(low - x, high - x) for x, (low, _, high) in zip(q, self.limits, strict=True)]
        # chi and J of the free joints. A held joint has a given step, and its column of J is zero.
        chi = [pull * (middle - x) for x, (_, middle, _) in zip(q, self.limits, strict=True)]
        free = list(J)
        # Near the border of the workspace the tip's displacement is quadratic in the joints: a long step would
        # overshoot.
        floor = max(self.damping2, self.curvature * sqrt(dot(dp, dp)))
        while True:
            # J^+ = J^T (J J^T)^-1, and N_J chi = chi - J^+ J chi
            inverse = raised_inverse(gram(free), floor)
            x, y, z = dp
            for (jx, jy, jz), step in zip(J, chi, strict=True):
                x, y, z = x - jx * step, y - jy * step, z - jz * step
            way, rate = times(inverse, (x, y, z)), times(inverse, v)
            again, dq = False, []
            for j, (low, high) in enumerate(room):
                step = chi[j] + dot(free[j], way)
                if step < low or step > high:  # never true of a NaN, which would be held without end
                    chi[j], free[j], again = low if step < low else high, _HELD, True
                dq.append(step)
            if not again:
                return dq, [dot(column, rate) for column in free]
