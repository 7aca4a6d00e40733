"""`admittance` in C (native/admittance.c)."""

from __future__ import annotations

from srl.control.cobot.admittance import _LONGEST, _QUICKEST, Admittance
from srl.control.cobot.release import ReleaseConfig
from srl.runtime.contracts.compiled import Compiled, NotCompiledError, Step, bind, numbers
from srl.runtime.contracts.gravity import GRAVITY

_FACTORS = ("scale", "damping", "leash")


class CompiledAdmittance(Compiled):
    """A force that isn't finite is the Python law's."""

    law: Admittance

    def _bind(self) -> Step:
        law = self.law
        c, unloaded, release = law._config, law._unloaded, law._config.release or ReleaseConfig()
        if c.tank is not None and c.force_age:
            raise NotCompiledError("it doesn't take `force_age`")
        leash, tank, braked = c.leash, c.tank or 0.0, c.release is not None
        draws = release.draw_in if braked else None
        options = numbers(
            law.transform["sensor"], unloaded.bias, GRAVITY * unloaded.tool_mass, unloaded.tool_com, c.dead_band,
            c.mass, c.damping,
            [0.0] * 5 if leash is None else
            [1.0, leash.distance, leash.stiffness, leash.angle, leash.rotational_stiffness],
            c.tank is not None, tank, c.brake,
            braked, release.deceleration, release.angular, release.settle, release.onset,
            draws is not None, draws or 0.0,
            law._slowest, _LONGEST, _QUICKEST,
        )  # fmt: skip
        self.state = numbers([0.0] * 27)
        i, o = law.input, law.output
        return bind(
            "admittance", i["wrench"], i["pose"], i["twist"], i["modes"], *(law.param[name] for name in _FACTORS),
            options, self.state, o["pose"], o["twist"], o["hand"], o["force"], o["tank"],
        )  # fmt: skip

    def _enter(self) -> None:
        law, virtual, tank = self.law, self.law._virtual, self.law._tank
        self.state[:] = [
            *virtual.velocity, *virtual.position, *virtual.orientation, *(law._ramps.values[name] for name in _FACTORS),
            *((0.0, 0.0, 0.0) if tank is None else (tank.level, tank.brake, tank.emptied)),
            *((0.0, 0.0) if law._releases is None else (release._level for release in law._releases)),
            *((0.0, 0.0) if law._draws is None else (draw._left for draw in law._draws)),
            *law._ahead, law._leashed,
        ]  # fmt: skip

    def _leave(self) -> None:
        law, s = self.law, self.state.tolist()
        law._virtual.velocity, law._virtual.position = s[:6], s[6:9]
        law._virtual.orientation = (s[9], s[10], s[11], s[12])
        law._ramps.values.update(zip(_FACTORS, s[13:16], strict=True))
        law._scale()
        if law._tank is not None:
            law._tank.level, law._tank.brake, law._tank.emptied = s[16], s[17], int(s[18])
        for release, level in zip(law._releases or (), s[19:21], strict=False):
            release._level = level
        for draw, left in zip(law._draws or (), s[21:23], strict=False):
            draw._left = left
        law._ahead, law._leashed = (s[23], s[24], s[25]), int(s[26])
