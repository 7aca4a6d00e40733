"""`kairos-clik` in C (native/kairos_clik.c)."""

from __future__ import annotations

import numpy as np

from srl.control.cobot.contact_compliance import ComplianceConfig
from srl.control.cobot.kairos_clik import KairosClik
from srl.control.shared.ramp import QUICKEST
from srl.runtime.contracts.compiled import Compiled, NotCompiledError, Step, bind, numbers

_FACTORS = ("speed", "gain")


class CompiledKairos(Compiled):
    """What `payload` says of contact is taken; a wrench of which the load's weight is still a part isn't."""

    law: KairosClik

    def _bind(self) -> Step:
        law, c, compliance = self.law, self.law._config, self.law._compliance
        if compliance is not None and not compliance.identified:
            raise NotCompiledError("it takes `force_feedback` only with an identified load")
        feedback = c.force_feedback or ComplianceConfig()
        first, second, n = c.manipulation, c.locomotion, len(law.input["q"])
        options = numbers(
            c.gain, law._firm.diagonal(), c.damping, c.manipulability,
            first.base, second.base, first.arm, second.arm, first.posture, second.posture, c.blend, QUICKEST,
            law._fastest is not None, c.acceleration or 0.0,
            c.base_speed is not None, c.base_speed or [0.0] * 3,
            c.base_acceleration is not None, c.base_acceleration or [0.0] * 3,
            compliance is not None, feedback.mass, feedback.damping, feedback.stiffness, feedback.load_time,
            feedback.dead_band, feedback.carrying, feedback.firm, feedback.release,
        )  # fmt: skip
        self.state, self.postures = np.zeros(46), np.zeros((3, n))
        i, o, applied = law.input, law.output, law.applied
        return bind(
            "kairos-clik", i["q"], i["base_pose"], i["pose"], i["jacobian"], i["desired_pose"], i["desired_twist"],
            i["modes"], i["outside"] if compliance is not None else np.zeros(6),
            applied.get("velocity", o["velocity"]), applied.get("base_twist", o["base_twist"]),
            *(law.param[name] for name in _FACTORS), options, numbers(law._fastest or [0.0] * n),
            self.state, self.postures, o["velocity"], o["base_twist"], o["manipulability"],
            o["contact"] if compliance is not None else np.zeros(6),
        )  # fmt: skip

    def _enter(self) -> None:
        law, priority, c = self.law, self.law._priority, self.law._compliance
        against = [] if c is None else [v for part in c._against for v in (part._firmness, *part._pushed)]
        self.state[:] = numbers(
            law._turn, [law._ramps.values[name] for name in _FACTORS],
            priority._locomotion, priority.level, priority._fade,
            [0.0] * 34 if c is None else
            numbers(c._share, c._quiet, against, c._yielding, c.deviation, c.velocity, c.contact),
            law._cycles, law._damped, law._slowed, law._least,
        )  # fmt: skip
        self.postures[:] = priority.preferred, priority._chosen, priority._offset

    def _leave(self) -> None:
        law, priority, c, s = self.law, self.law._priority, self.law._compliance, self.state.tolist()
        law._turn = (s[0], s[1], s[2])
        law._ramps.values.update(zip(_FACTORS, s[3:5], strict=True))
        priority._locomotion, priority.level, priority._fade = s[5] > 0.5, s[6], s[7]
        priority.preferred[:], priority._chosen[:], priority._offset[:] = self.postures
        if c is not None:
            c._share, c._quiet = s[8], s[9]
            for part, at in zip(c._against, (10, 14), strict=True):
                part._firmness, part._pushed = s[at], s[at + 1 : at + 4]
            c._yielding, c.deviation, c.velocity, c.contact = s[18:24], s[24:30], s[30:36], s[36:42]
        law._cycles, law._damped, law._slowed, law._least = int(s[42]), int(s[43]), int(s[44]), s[45]
