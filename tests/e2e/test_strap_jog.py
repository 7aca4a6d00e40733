"""The profile `strap-jog`: a worn arm, its two sensors and the law, with the runtime's own cycle, simulated."""

from __future__ import annotations

import numpy as np
import pytest

from srl.runtime.ipc.header import DEVICE, LINK_CONNECTED, State
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.profile import profile, wiring

pytestmark = pytest.mark.slow

POSTURE = [0.0, -0.2, 0.1, -0.6, 0.01, 0.1, 0.2]  # rad, m


class Run:
    """A run with a client that sets a posture from `when` (s) on; what it gave, row by row."""

    def __init__(self, seconds: float, when: float = np.inf, *overrides: str) -> None:
        lockstep = Lockstep(wiring.build(*profile.load("strap-jog", list(overrides)), []))
        row, layout = lockstep.graph.row, lockstep.graph.layout
        client = row.devices[layout.devices.index("client")]
        rows, self.states = [], []
        for _ in range(round(seconds * 1e9 / lockstep.period)):
            lockstep.sense()
            now = lockstep.count * lockstep.period
            client[DEVICE.stamp], client[DEVICE.link] = now, client[DEVICE.link] | LINK_CONNECTED
            row.views["client.position"][:] = POSTURE if now >= 1e9 * when else np.nan
            self.states.append(lockstep.act())
            rows.append(row.words.copy())
        self._layout, self._rows = layout, np.array(rows)

    def value(self, signal: str) -> np.ndarray:
        return self._layout.value(self._rows, signal)


def test_it_compensates_what_the_wearers_gait_and_the_arms_weight_do():
    run = Run(4.0)
    active, command = run.value("strap.active")[:, 0], run.value("arm.position_command.applied")
    assert active[-1] == 1.0
    began = run.states.index(State.ACTIVE)
    np.testing.assert_allclose(command[began], run.value("arm.position")[began], atol=0.01)
    assert np.abs(np.diff(command[began:], axis=0)).max() < 0.02, "no jump"
    true, seen = run.value("world.straps_tilt")[200:, :2], run.value("strap.tilt")[200:, :2]
    assert np.sqrt(np.mean(true**2)) > 0.01
    # The law knows the tilt but for its sensors' noise and delay.
    assert np.sqrt(np.mean((seen - true) ** 2)) < 0.4 * np.sqrt(np.mean(true**2))


def test_a_clients_posture_is_reached_and_compensated():
    run = Run(6.0, 2.0)
    command = run.value("arm.position_command")
    assert np.abs(command[190] - POSTURE).max() > 0.1
    assert 0.001 < np.abs(command[-1] - POSTURE).max() < 0.15
    np.testing.assert_allclose(run.value("arm.position_command.applied")[-1], command[-1], atol=0.03)


def test_a_sensor_that_is_gone_stops_the_limb():
    run = Run(3.0, np.inf, "sim.devices.base.loss=[[2.0, 9.0]]")
    assert run.states[190] is State.ACTIVE
    assert run.states[-1] is State.STOPPED


def test_a_sensor_that_says_nothing_fades_out_and_then_stops_the_limb():
    """Its cable is in place and no frame comes: NaN after 0.1 s, stale after 0.5 s, unless the profile waits longer."""
    silent = "sim.devices.belt.silent=[[2.0, 3.0]]"
    run = Run(3.0, np.inf, silent)
    active = run.value("strap.active")[:, 0]
    assert active[205] == 1.0
    assert active[240] < 0.8
    assert run.states[240] is State.ACTIVE
    assert run.states[-1] is State.STOPPED
    patient = Run(5.0, np.inf, silent, "devices.belt.max_age=2.0")
    active = patient.value("strap.active")[:, 0]
    assert active[290] == 0.0
    assert active[-1] == 1.0
    assert set(patient.states[10:]) == {State.ACTIVE}
    assert np.abs(np.diff(patient.value("arm.position_command")[10:], axis=0)).max() < 0.02, "it fades out and in again"
