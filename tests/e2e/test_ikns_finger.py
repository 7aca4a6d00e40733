"""The vertical path in simulation: a wearer's arm, cameras, joint angles, control values, a finger that closes."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest
from helpers.upper_body import POINT, STEADY

from srl.control.ikns.record import Record
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.wearer import Follow, Hold, Instruction
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.profile import profile, wiring
from srl.sim.world.cell import Cell

pytestmark = pytest.mark.slow

CALM = [f"sim.parts.wearer.{key}={value}" for key, value in STEADY.items()]
EXACT = "sim.devices.mocap={noise: 0.0}"


class Run:
    """A profile in lockstep, and the wearer in it."""

    def __init__(self, name: str, *overrides: str) -> None:
        self.lockstep = Lockstep(wiring.build(*profile.load(name, overrides), []), lambda text: None)
        self.views = self.lockstep.graph.row.views
        self.wearer: Any = cast(Any, cast(Cell, self.lockstep.graph.world).parts["wearer"]).wearer

    def rows(self, instruction: Instruction | None, seconds: float, *names: str) -> list[Array]:
        """Signals over some time, as (cycles, elements)."""
        if instruction is not None:
            self.wearer.instruct(instruction)
        found: list[list[Array]] = [[] for _ in names]
        for _ in range(round(100 * seconds)):
            self.lockstep.step()
            for name, values in zip(names, found, strict=True):
                values.append(self.views[name].copy())
        return [np.array(values) for values in found]


def test_arm_angles_gives_back_the_wearer_s_own_angles() -> None:
    run = Run("ikns-finger", *CALM, EXACT)
    run.rows(Hold(POINT), 2.0)
    angles, truth, used, hand, own = run.rows(
        Hold(POINT, "swivel"), 6.0, "arm.angles", "world.wearer_position", "arm.used", "arm.hand", "world.wearer_hand"
    )
    names = run.lockstep.graph.laws[0].controller.outputs[0].labels
    own_names = cast(Cell, run.lockstep.graph.world).truth[0].labels
    mine = truth[:, [own_names.index(name) for name in names]]
    # The cameras' sample is that of the cycle before.
    assert np.rad2deg(np.abs(angles[1:] - mine[:-1]).max()) < 0.2
    assert (used == 1.0).all()
    assert hand[1:] == pytest.approx(own[:-1], abs=1e-3)


def test_c_is_monotone_in_the_swivel_and_closes_the_finger() -> None:
    run = Run("ikns-finger", *CALM, EXACT, "sim.parts.wearer.watches={}")
    run.rows(Hold(POINT), 2.0)
    dofs, c, finger, leak = run.rows(
        Hold(POINT, "swivel"), 6.0, "world.wearer_dofs", "intent.c", "world.finger_position", "world.wearer_leak"
    )
    swivel = dofs[:-1, 0]
    order = np.argsort(swivel)
    low, high = swivel.min(), swivel.max()
    line = np.interp(np.linspace(low, high, 25), swivel[order], c[1:, 0][order])
    steps = np.diff(line) * np.sign(line[-1] - line[0])
    assert (steps[2:-2] > 0.0).all()
    assert np.ptp(c) > 0.9
    assert np.ptp(finger[:, 1]) > 0.9 * 1.5
    assert leak.max() < 1e-4


def test_the_wearer_makes_the_finger_follow_with_the_hand_still() -> None:
    run = Run("ikns-finger")
    times = np.linspace(0.0, 16.0, 300)
    curve = 0.5 + 0.35 * np.sin(0.7 * times)
    finger, leak = run.rows(Follow(times, curve[:, None]), 16.0, "world.finger_position", "world.wearer_leak")
    closed = (finger[:, 1] + 0.3) / 1.5
    off = (closed - np.interp(np.arange(1600) / 100, times, curve))[800:]
    assert np.sqrt(np.mean(off**2)) < 0.05
    assert leak[800:].max() < 0.02
    print(f"simulated: rms {100 * np.sqrt(np.mean(off**2)):.1f} %, leak {1e3 * leak[800:].max():.1f} mm")


@pytest.mark.parametrize(("name", "dofs"), [("ikns-finger", ("swivel",)), ("ikns-two", ("swivel", "shrug"))])
def test_the_profiles_have_calibrations_of_their_wearers(name: str, dofs: tuple[str, ...]) -> None:
    run = Run(name)
    law: Any = run.lockstep.graph.laws[1].controller  # a calibration that is refused doesn't get here
    record: Record = law._record
    assert record.person == "simulated"
    assert record.dofs == dofs
    assert len(record.points) == 10


def test_two_dofs_move_two_joints() -> None:
    run = Run("ikns-two", *CALM, EXACT, "sim.parts.wearer.watches={}")
    swung = []
    for dof in ("swivel", "shrug"):
        run.rows(Hold(POINT), 2.0)
        swung += run.rows(Hold(POINT, dof), 7.0, "intent.c")  # type: ignore[arg-type]
    spans = np.array([np.ptp(c, axis=0) for c in swung])
    assert spans.diagonal().min() > 0.85
    assert max(spans[0, 1], spans[1, 0]) < 0.3
