"""Live gains of `joint-impedance`: no value that a client can set makes the arm unstable, however often it changes."""

from __future__ import annotations

from itertools import product
from math import inf, nan
from pathlib import Path
from time import monotonic_ns

import numpy as np
import pinocchio as pin
import pytest
from helpers.joint_impedance import ROBOT, K, Q, law
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.control.arm.joint_impedance import JointImpedance
from srl.control.arm.sampled import GROWTH, cases, growth
from srl.runtime.ipc.requests import Answer, RequestKind, RequestWriter
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.loop.control_end import ControlEnd
from srl.runtime.loop.request_queue import RequestQueue
from srl.runtime.models.robots.pinocchio_model import pinocchio_model
from srl.runtime.profile import profile, wiring

LIGHT = {"stiffness": {"yaw": 25.0, "shoulder": 40.0, "elbow": 25.0, "wrist": 8.0}, "rotor_inertia": 0.0015}


def grows(made: JointImpedance, k: float, d: float, dt: float) -> float:
    """1/s: the greatest growth in all that the arm may touch, from the gains that the law itself takes."""
    options = made._config
    model = pinocchio_model(ROBOT)
    touched = cases(model, ROBOT.home, ROBOT.q_lower, ROBOT.q_upper, np.full(4, options.rotor_inertia))
    return max(growth(M, C, *made._gains(k, d, M.diagonal()), dt) for M, C in touched)


@pytest.mark.parametrize("rate", [300, 500, 1000])
def test_within_the_bounds_nothing_grows(rate: int) -> None:
    made = law(**LIGHT)
    wide = {p.name: p.upper for p in made.parameters}
    unbounded = grows(made, wide["stiffness"], wide["damping"], 1 / rate)
    made.narrow(1 / rate)
    stiffness, damping = made.parameters
    assert stiffness.lower <= 1.0 <= stiffness.upper
    assert damping.lower <= 1.0 <= damping.upper
    assert (stiffness.upper < wide["stiffness"]) == (unbounded >= GROWTH)
    if grows(made, 1.0, 1.0, 1 / rate) >= GROWTH:  # the profile's own gains are doubted; live ones make them no worse
        assert (stiffness.upper, damping.upper) == (1.0, 1.0)
        return
    of_k = (0.05, 0.25, 0.6, 1.0, stiffness.upper)
    of_d = (damping.lower, 1.0, damping.upper)
    assert max(grows(made, k, d, 1 / rate) for k, d in product(of_k, of_d)) < GROWTH


def test_a_client_gets_no_value_past_the_bounds(tmp_path: Path) -> None:
    graph = wiring.build(*profile.load("worn-arm", []))
    known = graph.layout.meta["parameters"]
    (at,) = [i for i, entry in enumerate(known) if entry["name"] == "body.damping"]
    assert 1.0 < known[at]["upper"] < 1.5  # at 500 Hz both at 1.5 would grow
    folder = RunFolder(tmp_path)
    RequestWriter.create(folder.requests)
    ring, queue = RequestWriter(folder.requests), RequestQueue(folder, graph, ControlEnd(folder.stop_socket))
    hostile = [[nan], [inf], [-inf], [1e300], [-1.0], [1.5], [], [1.0, 1.0]]
    sent = [(at, values) for values in hostile] + [(-1, [1.0]), (99, [1.0])]
    for target, values in sent:
        ring.send(RequestKind.PARAMETER, monotonic_ns() + 10**12, target, np.array(values))
    answers = []
    for cycle in range(len(sent)):
        pending = queue.take(cycle * 2_000_000)
        assert pending is not None
        answers.append(pending.answer)
    assert answers == [Answer.REFUSED_VALUE] * len(sent)
    assert graph.row.views["body.damping"][()] == 1.0


@given(
    st.lists(st.tuples(st.booleans(), st.booleans(), st.integers(1, 30)), min_size=1, max_size=12),
    st.floats(-1.5, 1.5),
)
@settings(max_examples=15)
def test_toggling_the_gains_gives_no_energy(toggles: list[tuple[bool, bool, int]], speed: float) -> None:
    """As fast as a client likes, between the bounds: the energy of motion and springs only falls."""
    made, dt = law(follow=False, most=100.0), 1e-3
    made.narrow(dt)
    bounds = {p.name: (p.lower, p.upper) for p in made.parameters}
    made.reset()
    model = pinocchio_model(ROBOT)
    data = model.createData()
    q, qd = Q + 0.1, np.array([0.0, speed, -speed, 0.0])
    gains = np.array(list(K.values()))

    def cycle() -> float:
        nonlocal q, qd
        made.input["q"][:], made.input["qd"][:] = q, qd
        made.update(dt)
        M = pin.crba(model, data, q)
        M = np.triu(M) + np.triu(M, 1).T
        k = made._ramps.values["stiffness"]
        energy = 0.5 * float(qd @ M @ qd) + 0.5 * k * float(gains @ (made.output["desired"] - q) ** 2)
        for _ in range(5):
            qd = qd + dt / 5 * pin.aba(model, data, q, qd, made.output["torque"])
            q = q + dt / 5 * qd
        return energy

    energies = [cycle()]
    for stiff, damped, cycles in toggles:
        made.param["stiffness"][()] = bounds["stiffness"][stiff]
        made.param["damping"][()] = bounds["damping"][damped]
        energies += [cycle() for _ in range(cycles)]
    assert np.diff(energies).max(initial=0.0) < 2e-3 * energies[0]
