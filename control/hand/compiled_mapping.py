"""`object-mapping` in C (native/object_mapping.c)."""

from __future__ import annotations

import numpy as np

from srl.control.hand.object_mapping import _SMOOTHING, ObjectMapping
from srl.runtime.contracts.compiled import Compiled, NotCompiledError, Step, bind, numbers
from srl.runtime.models.human_hand import FINGERS

_POINTS = len(FINGERS)


class CompiledObjectMapping(Compiled):
    """Cycles whose motion is damped, or whose sphere stands on other points than the last one's, are the Python law's.

    So are those of fewer than three fingertips: their motion is always damped.
    """

    law: ObjectMapping

    def _bind(self) -> Step:
        law = self.law
        if len(law._fingers) > 1:
            raise NotCompiledError("it takes one finger")
        if not law._object.is_similar or len(law._chosen) < 3:
            raise NotCompiledError("it takes a similarity, or a rigid motion, of three fingertips or more")
        finger, i, o = law._fingers[0], law.input, law.output
        self._count = count = len(law._chosen)
        chain = finger.chain
        options = numbers(
            count, law._chosen, np.zeros(_POINTS - count), law._rigid, law._object.share,
            law._max_following_error, _SMOOTHING,
            finger.damping2, finger.curvature, chain.base,
        )  # fmt: skip
        rows = numbers(*((*row, *limits) for row, limits in zip(chain.rows, finger.limits, strict=True)))
        self._reference, self.state = np.zeros(7 + 3 * _POINTS), np.zeros(3 * _POINTS + 15)
        return bind(
            "object-mapping", law.applied.get("q", o["q"]), i["tips"], law.param["drift_pull"], law.param["centring"],
            options, rows, self._reference, self.state, o["q"], o["q_velocity"], o["sphere"], o["target"],
            o["skeleton"],
        )  # fmt: skip

    def _enter(self) -> None:
        law, finite, support = self.law, self.law._finite, self.law._enclosing.support
        unused = [0.0] * (3 * (_POINTS - self._count))
        self._reference[:] = numbers(law._home, finite.c0, finite.from_centre, unused, finite.a2)
        self.state[:] = numbers(
            law._before, unused, law._target, law._velocity, len(support), support, [0.0] * (4 - len(support)),
            law._radii, law._nearest, law._error_limited,
        )  # fmt: skip

    def _leave(self) -> None:
        law, s = self.law, self.state.copy()
        rest = s[3 * _POINTS :].tolist()
        law._before = s[: 3 * self._count].reshape(-1, 3)
        law._target = s[3 * _POINTS : 3 * _POINTS + 3].reshape(1, 3)
        law._velocity = [(rest[3], rest[4], rest[5])]
        law._enclosing.support = [int(corner) for corner in rest[7 : 7 + int(rest[6])]]
        law._radii, law._nearest, law._error_limited = (rest[11], rest[12]), rest[13], int(rest[14])
        x, y, z = law.output["skeleton"][-1].tolist()
        law._tips = [(x, y, z)]
