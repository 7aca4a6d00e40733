"""A stop goes on whatever leaves for the device: a slow link, or a driver that doesn't report, makes it no longer."""

from __future__ import annotations

import numpy as np
import pytest

from srl.runtime.contracts.signals import Command, Kind, Limits, Stop
from srl.runtime.guard import GUARDS
from srl.runtime.testing.lab import Lab

DT = 0.002


@pytest.mark.slow
@pytest.mark.parametrize("every", [1, 4, 7])
def test_a_base_whose_link_takes_one_command_in_some_comes_to_rest(every: int) -> None:
    """With one in seven, the stop took six seconds and a metre."""
    with Lab("base-jog", ["sim.start=auto"]) as run:
        run.setpoint("client.twist", [0, 0, 0])
        run.until("active")
        run.run(0.5)
        run.setpoint("client.twist", [0.3, 0, 0.4])
        run.run(2)
        run.stop()
        started = run.time
        while run.state != "stopped":
            assert run.time - started < 1.5
            if every > 1:
                run.fault("base", "deaf")
                run.step(every - 1)
                run.heal("base")
            run.step()


@pytest.mark.parametrize("kind", [Kind.VELOCITY, Kind.TORQUE])
@pytest.mark.parametrize("report", ["nothing", "one old value"])
@pytest.mark.parametrize("category", [Stop.HOLD, Stop.DAMP])
def test_a_stop_ends_whatever_the_driver_reports(kind: Kind, report: str, category: Stop) -> None:
    one = np.ones(1)
    limits = Limits(velocity=3 * one, acceleration=10 * one, effort=30 * one, effort_rate=300 * one, inertia=one)
    unit = {Kind.VELOCITY: "rad/s", Kind.TORQUE: "N m"}[kind]
    command = Command(name="c", shape=(1,), unit=unit, kind=kind, period=0.01, feedback="position",
                      stops=(Stop.HOLD, Stop.DAMP))  # fmt: skip
    guard = GUARDS[kind]("guard.c", command, limits, DT)
    applied, sent, q, qd = (np.zeros(1) for _ in range(4))
    guard.bind(applied, q, qd, sent)
    guard.reset(q)
    for k in range(1000):
        if k < 100:
            sent[:] = applied
        guard.resynchronise(k < 100 or report == "one old value", DT)
        if k < 150:
            guard.step(np.array([2.0]), None, DT)
        else:
            guard.stop(category, DT)
        acceleration = applied[0] if kind is Kind.TORQUE else 0.0
        qd += acceleration * DT
        if kind is Kind.VELOCITY:
            qd[:] = applied
        q += qd * DT
        if guard.at_rest and k > 150:
            break
    assert guard.at_rest
    assert abs(qd[0]) < 0.5
