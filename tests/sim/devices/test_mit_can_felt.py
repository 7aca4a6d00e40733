"""What a wearer feels of each fault, from its onset to safety: the figures of docs/devices/mit-can.md, simulated.

An arm of two links hangs out level: the shoulder holds 3.0 N m, the elbow 0.5. The loop stops as its profile says, in
the cycle after it is told. Run with `-s` to see the rows of the page's table.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from helpers.mit_can import AK, PERIOD, TWO, Limb

from srl.runtime.contracts.errors import DeviceLostError
from srl.runtime.contracts.signals import Array, Stop

LONG = 1.5  # s that are looked at


@dataclass
class Felt:
    """Of one fault.

    Attributes:
        told: ms from its onset to the stop; NaN: it was never told.
        speed: rad/s, the highest of each joint.
        travel: rad, how far each has gone at the end.
        step: N m, the largest change of each joint's torque within 4 ms.
    """

    told: float
    speed: Array
    travel: Array
    step: Array

    def row(self, name: str) -> str:
        def pair(values: Array) -> str:
            return ", ".join(f"{abs(v):.2f}" for v in values)

        return f"| {name} | {self.told:.0f} | {pair(self.speed)} | {pair(self.travel)} | {pair(self.step)} |"


def felt(limb: Limb, begin: Callable[[Limb], None], category: Stop) -> Felt:
    limb.open()
    where = limb.hold()
    before, told, lost = limb.truth(), float("nan"), False
    speeds, torques = [], [limb.truth("effort")]
    begin(limb)
    for k in range(round(LONG * 1e9 / PERIOD)):
        now = limb.world.time
        try:
            if not lost:
                limb.fake.read(now)
                if np.isnan(told) or category is Stop.HOLD:
                    limb.fake.command_arrays[limb.name][:] = where
                    limb.fake.write(now)
                else:
                    limb.fake.stop(category)
        except DeviceLostError:
            lost = True
            limb.fake.close()
        if np.isnan(told) and (lost or limb.fault):
            told = (k + 1) * PERIOD * 1e-6
        limb.world.advance(now + PERIOD)
        speeds.append(np.abs(limb.truth("velocity")))
        torques.append(limb.truth("effort"))
    steps = np.abs(np.diff(np.array(torques)[::2], axis=0)).max(axis=0)
    return Felt(told, np.max(speeds, axis=0), limb.truth() - before, steps)


def unplug(*which: int) -> Callable[[Limb], None]:
    return lambda limb: limb.drives.unplugged.update(which)


CASES = {
    "Damiao: elbow's CAN cable out, `hold`": (TWO, "damiao", unplug(1), Stop.HOLD, 20),
    "Damiao: elbow's CAN cable out, `damp`": (TWO, "damiao", unplug(1), Stop.DAMP, 20),
    "Damiao: the bus unplugged or bus-off": (TWO, "damiao", unplug(0, 1), Stop.HOLD, 20),
    "AK V2: elbow's CAN cable out, `hold`": (AK, "v2", unplug(1), Stop.HOLD, 20),
    "AK V2: the bus unplugged or bus-off": (AK, "v2", unplug(0, 1), Stop.HOLD, 20),
    "Damiao: shoulder without power for good, `hold`": (TWO, "damiao", lambda b: b.drives.power_down(0), Stop.HOLD, 20),
    "Damiao: shoulder without power for good, `damp`": (TWO, "damiao", lambda b: b.drives.power_down(0), Stop.DAMP, 20),
    "Damiao: all without power (e-stop)": (TWO, "damiao", lambda b: b.drives.power_down(), Stop.HOLD, 20),
    "Damiao: elbow too hot, switches itself off, `hold`": (
        TWO, "damiao", lambda b: b.drives.motors.fail(1, 1), Stop.HOLD, 10,
    ),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_what_is_felt(name: str) -> None:
    motors, maker, begin, category, soon = CASES[name]
    found = felt(Limb(motors, maker), begin, category)
    print("\n" + found.row(name))
    assert found.told <= soon
    assert found.speed.max() < (0.2 if maker == "v2" else 8.0)
    if category is Stop.HOLD and "elbow" in name:
        assert abs(found.travel[0]) < 0.1  # the shoulder holds on
    if category is Stop.DAMP and "elbow" in name:
        assert found.speed[0] < 2.0  # 3 N m at 2 N m s/rad
