"""One trial of rendered impedance: a sinusoidal force or torque at the handle, and how the handle really moves.

The profile itself runs, from the handle's sensor through law and guard to the simulated arm and base. Nobody holds the
handle but this force.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from math import ceil, pi
from typing import Any, Final, cast

import numpy as np

from srl.runtime.contracts.rotation import Quaternion, error
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.header import CYCLE, Cause
from srl.sim.parts.things.ft_sensor import HandlePart
from srl.studies.simulated import cell, lockstep, parsed
from srl.studies.superman.as_published import as_published
from srl.studies.tasks.task import Value

TRIAL: Final = "superman-rendered"
AXES: Final = ("y", "z", "rz")
_BUTTONS: Final = {"y": {"A": 0.2}, "z": {"A": 0.2}, "rz": {"A": 0.2, "M": 0.4}}  # s, when each is pressed
_LOCOMOTION: Final = 0.6
_BEGIN: Final = 1.0  # s: the buttons have had their effect
_SETTLE: Final = 1.0  # s, at least, and at least one period
_MEASURED: Final = 2.0  # s, at least, and at least two periods
_GRIP: Final = "grip/grip"


def trial(text: str, parameters: dict[str, Any], seed: int) -> Mapping[str, Value]:
    """Measures one frequency.

    Args:
        text: the profile's, moca-man or kairos-man.
        parameters: `axis`, of AXES, of the world; `frequency`, Hz; `amplitude`, N or N m; `locomotion`; `published`:
            without the additions; `mass` and `damping` on this axis, kg and N s/m, or kg m^2 and N m s/rad.
        seed: of the world's noise.
    Returns:
        gain and phase (degrees) of the velocity by the force, over those of 1 / (M jw + D); moved (m or rad), the
        amplitude; rest: share of the motion about its mean that isn't this sine; cause of a stop.
    """
    made = _Shaken(text, parameters, seed)
    t, x = made.run()
    w = 2.0 * pi * parameters["frequency"]
    columns = np.stack([np.cos(w * t), np.sin(w * t), np.ones_like(t), t - t.mean()], axis=1)
    fit, *_ = np.linalg.lstsq(columns, x, rcond=None)
    drifting = columns[:, 2:] @ fit[2:]
    rest = x - columns @ fit
    moved = complex(fit[0], -fit[1])  # x = Re(moved e^jwt); the force is Re(-j amplitude e^jwt)
    rendered = 1j * w * moved / (-1j * parameters["amplitude"])
    ratio = rendered * complex(parameters["damping"], w * parameters["mass"])
    return {
        "gain": abs(ratio), "phase": float(np.rad2deg(np.angle(ratio))), "moved": abs(moved),
        "rest": float(np.std(rest) / max(np.std(x - drifting), 1e-12)), "cause": made.cause,
    }  # fmt: skip


class _Shaken:
    """A profile in lockstep whose handle is shaken."""

    def __init__(self, text: str, parameters: Mapping[str, Any], seed: int) -> None:
        self._p = parameters
        presses = dict(_BUTTONS[parameters["axis"]]) | ({"P": _LOCOMOTION} if parameters["locomotion"] else {})
        changes: dict[str, Any] = {
            "sim": {
                "parts": {"person": None},
                "devices": {"panel": {"person": None, "presses": {n: [[t, t + 0.1]] for n, t in presses.items()}}},
            },
        }
        content = parsed(text, changes, seed)
        if parameters["published"]:
            content["controllers"] = as_published(content["controllers"])
        (guide,) = (entry for entry in content["controllers"] if entry["use"] == "admittance")
        guide["dead_band"] = [0.0, 0.0]  # it would take a share of the force that depends on the amplitude
        # JSON is YAML, and keeps the order of a mapping's keys.
        self._lockstep = lockstep(json.dumps(content), {})
        self._cell, self._ints = cell(self._lockstep), self._lockstep.graph.row.ints
        self._grip = cast(HandlePart, self._cell.parts["grip"])
        self._dt = self._lockstep.period * 1e-9
        self.cause = ""

    def run(self) -> tuple[Array, Array]:
        """(k,) s since the force began, and (k,) m or rad, after it has settled."""
        p, data = self._p, self._cell.data
        body = int(self._cell.model.body(_GRIP).id)
        period = 1.0 / p["frequency"]
        settled = period * ceil(max(_SETTLE, period) / period)
        seconds = settled + period * ceil(max(_MEASURED, 2.0 * period) / period)
        axis = {"y": 1, "z": 2, "rz": 5}[p["axis"]]
        for _ in range(round(_BEGIN / self._dt)):
            self._lockstep.step()
        started = _four(data.xquat[body])
        times, found = [], []
        for k in range(round(seconds / self._dt)):
            wrench = np.zeros(6)
            wrench[axis] = p["amplitude"] * np.sin(2.0 * pi * p["frequency"] * k * self._dt)
            self._grip.push(wrench)
            self._lockstep.step()
            if (cause := int(self._ints[CYCLE.cause])) and not self.cause:
                self.cause = Cause(cause).name.lower().replace("_", " ")
            if k * self._dt >= settled:
                times.append((k + 1) * self._dt)
                place = (*data.xpos[body].tolist(), *error(_four(data.xquat[body]), started))
                found.append(place[axis])
        return np.array(times), np.array(found)


def _four(q: Array) -> Quaternion:
    w, x, y, z = q.tolist()
    return w, x, y, z
