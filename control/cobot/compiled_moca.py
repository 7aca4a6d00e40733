"""`moca-impedance` in C (native/moca_impedance.c)."""

from __future__ import annotations

import numpy as np

from srl.control.cobot.moca_impedance import MocaImpedance
from srl.control.shared.compiled_chain import bodies_of, body_of, joint_places
from srl.control.shared.ramp import QUICKEST
from srl.runtime.contracts.compiled import Compiled, NotCompiledError, Step, bind, numbers


class CompiledMoca(Compiled):
    """While a load comes in or goes, the Python law computes."""

    law: MocaImpedance

    def _bind(self) -> Step:
        law, c = self.law, self.law._config
        if c.payload == "identified":
            raise NotCompiledError("it doesn't take an identified payload")
        bare, model = law._dynamics._bare, law._dynamics._model
        moved = model if law._moved is None else law._moved._model
        first, second, n = c.manipulation, c.locomotion, model.nv
        options = numbers(
            c.stiffness, c.damping_ratio, c.unit_mass,
            first.base, second.base, first.arm, second.arm, first.posture, second.posture,
            c.blend, c.virtual_mass, c.base_damping, c.base_acceleration is not None, c.base_acceleration or [0.0] * 3,
            c.gravity == "here", c.coriolis, c.payload is not None,
            bare.gravity.linear, QUICKEST,
        )  # fmt: skip
        self.state, self.postures = np.zeros(50), np.zeros((3, n))
        self.loaded = np.zeros(11)
        i, o, applied = law.input, law.output, law.applied
        return bind(
            "moca-impedance", *(i[signal.name] for signal in law.inputs),
            applied.get("torque", o["torque"]), applied.get("base_twist", o["base_twist"]),
            law.param["stiffness"], law.param["damping"], options, joint_places(bare), bodies_of(bare), self.loaded,
            numbers(model.armature), numbers(moved.armature), self.state, self.postures,
            o["torque"], o["base_twist"], o["force"],
        )  # fmt: skip

    def _enter(self) -> None:
        law, priority, values = self.law, self.law._priority, self.law._ramps.values
        self.loaded[:10], self.loaded[10] = (
            body_of(law._dynamics._model.inertias[law._dynamics._last]),
            law._dynamics._hanging,
        )
        self.state[:] = numbers(
            law._turn, law._D, law._age, values["stiffness"], values["damping"],
            priority._locomotion, priority.level, priority._fade, law._dynamics.load,
            law._cycles, law._held_back, law._singular, law._strongest,
        )  # fmt: skip
        self.postures[:] = priority.preferred, priority._chosen, priority._offset

    def _leave(self) -> None:
        law, priority, s = self.law, self.law._priority, self.state.tolist()
        law._turn, law._D = (s[0], s[1], s[2]), self.state[3:39].reshape(6, 6).copy()
        law._age, law._ramps.values["stiffness"], law._ramps.values["damping"] = int(s[39]), s[40], s[41]
        priority._locomotion, priority.level, priority._fade = s[42] > 0.5, s[43], s[44]
        law._cycles, law._held_back, law._singular, law._strongest = int(s[46]), int(s[47]), int(s[48]), s[49]
        priority.preferred[:], priority._chosen[:], priority._offset[:] = self.postures
