"""A Franka robot's packets in C and in Python: the same bits, of the driver and of the simulated robot."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.compiled import ODD, needs_c
from helpers.panda import Cabinet
from hypothesis import given
from hypothesis import strategies as st

from srl.drivers.panda.config import STATES
from srl.drivers.panda.motion import Motion, Phase
from srl.drivers.panda.packets import VERSIONS, state_record
from srl.drivers.panda.protocol import Status
from srl.drivers.panda.requests import SetEEToK
from srl.drivers.panda.state import StateReader
from srl.runtime.contracts.compiled import undone
from srl.runtime.contracts.rotation import from_euler_xyz, homogeneous, matrix, normalised
from srl.runtime.contracts.signals import Kind

pytestmark = needs_c
SIZES = dict.fromkeys(STATES, 7) | {"wrench": 6, "success_rate": 1}
seeds = st.integers(0, 2**32 - 1)


def state(version: int, rng: np.random.Generator, odd: bool) -> bytes:
    """A RobotState of random numbers, with a rotation, or with something odd in it."""
    record = state_record(version)
    assert record.dtype.names is not None
    for name in record.dtype.names:
        field = record[name]
        if field.dtype.kind == "f":
            record[name] = rng.normal(0.0, 3.0, field.shape)
    record["message_id"] = rng.integers(0, 2**62)
    pose = np.eye(4)
    w, x, y, z = rng.normal(size=4).tolist()
    pose[:3, :3], pose[:3, 3] = matrix(normalised((w, x, y, z))), rng.normal(size=3)
    record["O_T_EE"] = pose.T.ravel()
    if odd:
        name = rng.choice(["q", "dq", "tau_J", "tau_J_d", "O_T_EE", "O_F_ext_hat_K"])
        with np.errstate(over="ignore"):
            record[name][rng.integers(len(record[name]))] = rng.choice(ODD)
    return record.tobytes()


@given(st.sampled_from(VERSIONS), st.lists(st.tuples(seeds, st.booleans()), min_size=1, max_size=8))
def test_a_sequence_of_states(version: int, given: list[tuple[int, bool]]) -> None:
    pair = [(StateReader(version), {name: np.zeros(size) for name, size in SIZES.items()}) for _ in range(2)]
    (_, arrays), (python, other) = pair
    python._filled, python._fill = other, undone
    for seed, odd in given:
        data = state(version, np.random.default_rng(seed), odd)
        with np.errstate(all="ignore"):
            taken = [reader.fill(data, states) for reader, states in pair]
        assert taken[0] == taken[1]
        for name in SIZES:
            assert arrays[name].tobytes() == other[name].tobytes(), name


@pytest.mark.parametrize("version", VERSIONS)
def test_an_ordinary_state_is_read_in_c(version: int) -> None:
    reader = StateReader(version)
    assert reader.fill(state(version, np.random.default_rng(1), False), {n: np.zeros(s) for n, s in SIZES.items()})
    assert reader._fill(0.0, reader.single) == 0


@given(st.sampled_from(VERSIONS), st.lists(st.tuples(seeds, st.booleans()), min_size=1, max_size=8), st.booleans())
def test_a_sequence_of_torques(version: int, given: list[tuple[int, bool]], far: bool) -> None:
    pair = [Motion(version, Kind.TORQUE, StateReader(version)) for _ in range(2)]
    pair[1]._torques_in_c = undone
    wanted = np.zeros(7)
    for motion in pair:
        motion.phase = Phase.RUNNING
    for k, (seed, odd) in enumerate(given):
        rng = np.random.default_rng(seed)
        data = state(version, rng, odd and not seed % 2)
        wanted += rng.normal(0.0, 100.0 if far else 1.0, 7)
        if odd:
            wanted[rng.integers(7)] = rng.choice(ODD)
        if k == 5:
            for motion in pair:
                motion._torque.start()
        packets = [motion.packet(data, wanted) for motion in pair]
        assert packets[0] == packets[1]
        assert np.asarray(pair[0].values).tobytes() == np.asarray(pair[1].values).tobytes()
        wanted[~np.isfinite(wanted)] = 0.0


def test_torques_of_a_running_motion_are_packed_in_c() -> None:
    motion = Motion(5, Kind.TORQUE, StateReader(5))
    motion.phase = Phase.RUNNING
    motion.packet(state(5, np.random.default_rng(1), False), np.ones(7))
    assert motion._torques_in_c(0.0, False) == 0


def shaken(cabinet: Cabinet, rng: np.random.Generator) -> Any:
    """The controller, with random numbers in all that a state tells."""
    control, sensors = cabinet.control, cabinet.robot.sensors
    of_controller = (control.torque, control.motion.state, control.external, control.wrench, control.pose)
    for array in (sensors.values, sensors.effort_rate, *of_controller):
        array[...] = rng.normal(0.0, 2.0, array.shape)
    control.touching[...] = rng.integers(0, 2, (2, 13)) * (rng.random() < 0.5)
    return control


@pytest.mark.parametrize("robot", ["panda", "fr3"])
@pytest.mark.parametrize("seed", range(3))
def test_what_a_simulated_robot_sends(robot: str, seed: int) -> None:
    rng, cabinet = np.random.default_rng(seed), Cabinet(robot)
    writer, sent = cabinet.robot.writer, []
    for turn in range(20):
        if turn == 10:
            to_k = homogeneous((*rng.uniform(-0.1, 0.1, 3), *from_euler_xyz(*rng.uniform(-3.0, 3.0, 3))))
            assert cabinet.control.apply(SetEEToK(tuple(to_k.T.ravel().tolist()))) is Status.SUCCESS
        shaken(cabinet, rng)
        of_c = cabinet.robot.write().tobytes()
        assert writer._in_c(0.0, writer._single) == 0
        in_c, writer._in_c = writer._in_c, undone
        assert cabinet.robot.write().tobytes() == of_c
        writer._in_c = in_c
        sent.append(of_c)
    assert len(set(sent)) == len(sent)


def test_what_ends_a_motion() -> None:
    rng, cabinet, found = np.random.default_rng(1), Cabinet(), set()
    for _ in range(200):
        control = shaken(cabinet, rng)
        cabinet.robot.sensors.values[:2] *= 0.5 * rng.random()
        cabinet.robot.sensors.position[3] -= 1.5
        cabinet.robot.sensors.position[5] += 1.5
        trouble = any(control._beyond()) or bool(control.touching[1].any())
        assert control._watch_in_c(0.0) == trouble
        found.add(trouble)
    assert found == {False, True}
