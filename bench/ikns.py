"""What the null space costs in a cycle: joint angles from markers, and the control value from them."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter_ns

import numpy as np

from bench.pairs import Row, measure
from srl.runtime.contracts.signals import Array
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.profile import profile, wiring

_BEGUN = 500  # cycles, until the wearer moves
_FRAMES = 500
_AIM = 250.0  # us
_METRICS = ("arm-angles", "ikns", "both")


def run() -> list[Row]:
    """`arm-angles` and `ikns` of the profile ikns-finger, on what its simulated cameras saw, frame by frame."""
    lockstep = Lockstep(wiring.build(*profile.load("ikns-finger"), []))
    laws = {law.name: law for law in lockstep.graph.controllers}
    arm, ikns = laws["arm"], laws["intent"]
    for _ in range(_BEGUN):
        lockstep.step()
    seen: list[dict[str, Array]] = []
    for _ in range(_FRAMES):
        lockstep.step()
        seen.append({name: values.copy() for name, values in arm.input.items()})
    angles, hand, held = (arm.output[name] for name in ("angles", "hand", "held"))

    def ours() -> dict[str, float]:
        """There and back through the motion, so that the next time begins where this one ends."""
        times = []
        for frame in [*seen, *reversed(seen)]:
            for name, values in frame.items():
                arm.input[name][:] = values
            start = perf_counter_ns()
            arm.update(0.01)
            half = perf_counter_ns()
            ikns.input["angles"][:], ikns.input["hand"][:], ikns.input["held"][:] = angles, hand, held
            ikns.update(0.01)
            times.append((half - start, perf_counter_ns() - half))
        first, second = np.array(times).T / 1e3
        metrics = (np.median(first), np.median(second), np.median(first + second))
        return dict(zip(_METRICS, map(float, metrics), strict=True))

    pairs = measure(ours, {"the aim": lambda: dict.fromkeys(_METRICS, _AIM)})
    rows = [pairs.row("ikns-cycle", what, what, "the aim", "us") for what in _METRICS]
    return [replace(r, aim=f"at most {_AIM:g} us", holds=r.ours <= _AIM) if r.what == "both" else r for r in rows]
