"""The Panda's fake through the driver's contract: motions, faults, recovery, loss."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers import panda as helpers_panda
from helpers.panda import MS, QUIET
from helpers.sim import world
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from srl.drivers.panda import Panda
from srl.runtime.contracts.errors import DeviceError, DeviceLostError, WiringError
from srl.runtime.contracts.signals import Array, Stop
from srl.runtime.models.robots import PANDA
from srl.sim.devices.panda.fake import FakePanda
from srl.sim.devices.panda.robot import FakePandaConfig


class Loop:
    """Reads, writes, steps the world, as the runtime's loop does."""

    def __init__(self, interface: str = "torque", robot: str = "panda", parts: Any = None, **options: Any) -> None:
        self.world = helpers_panda.cell(robot, **(parts or {}))
        config = Panda.Config.model_validate({"port": "tcp://127.0.0.1:1", "interface": interface})
        self.fake = FakePanda("arm", config, self.world, FakePandaConfig.model_validate(QUIET | options))
        self.state = {signal.name: np.full(signal.shape, np.nan) for signal in self.fake.states}
        self.wanted = np.zeros(7)
        self.fake.bind(self.state, {signal.name: self.wanted for signal in self.fake.commands})
        self.fake.open()

    def run(self, seconds: float, wanted: Array | float | None = None, write: bool = True, period: int = MS) -> None:
        for _ in range(round(seconds * 1e9) // period):
            self.world.advance(self.world.time + period)
            self.fake.read(self.world.time)
            if wanted is not None:
                self.wanted[:] = wanted
            if write:
                self.fake.write(self.world.time)

    @property
    def fault(self) -> str:
        return self.fake.health.fault


def test_it_shows_the_arm_before_it_moves() -> None:
    loop = Loop()
    loop.run(0.002, write=False)
    np.testing.assert_allclose(loop.state["position"], PANDA.home, atol=1e-6)
    np.testing.assert_allclose(loop.state["effort"], [0, -1.7714, -0.6440, 18.5736, 0.6338, 1.6937, 0], atol=0.01)
    np.testing.assert_allclose(loop.state["pose"][:3], [0.306891, 0, 0.590282], atol=1e-5)
    assert np.linalg.norm(loop.state["pose"][3:]) == pytest.approx(1)
    assert loop.fake.health.stamp == loop.world.time
    assert (loop.fake.metrics()["moves"], loop.fault) == (0, "")


def test_states_and_commands_are_the_drivers() -> None:
    loop = Loop()
    real = Panda("arm", loop.fake.config)  # type: ignore[arg-type]
    assert (loop.fake.states, loop.fake.commands) == (real.states, real.commands)
    assert "torque_command" in loop.fake.limits


@pytest.mark.parametrize("robot", ["panda", "fr3"])
def test_torques_move_the_arm_and_a_stop_leaves_it_at_rest(robot: str) -> None:
    loop = Loop(robot=robot)
    loop.run(0.01, 0.0)
    before = loop.state["position"].copy()
    loop.run(0.2, np.array([0.3, 0, 0, 0.5, 0, 0, 0]))
    assert loop.state["position"][3] - before[3] > 0.003
    assert loop.state["success_rate"][0] == 1.0
    loop.fake.stop(Stop.HOLD)
    loop.run(0.5, write=False)
    rest = loop.state["position"].copy()
    loop.run(0.2, write=False)
    np.testing.assert_allclose(loop.state["position"], rest, atol=1e-5)
    assert (loop.fault, loop.fake.metrics()["moves"]) == ("", 1)


def test_a_jump_in_the_command_is_smoothed_by_the_driver() -> None:
    loop = Loop()
    loop.run(0.01, 0.0)
    loop.run(0.01, np.array([0, 0, 0, 5.0, 0, 0, 0]))
    assert loop.fault == ""


@pytest.mark.slow
def test_velocity_and_position_are_followed() -> None:
    loop = Loop("velocity")
    loop.run(0.01, 0.0)
    before = loop.state["position"].copy()
    loop.run(1.0, 0.1)
    loop.run(0.2, 0.0)
    np.testing.assert_allclose(loop.state["position"] - before, 0.1, atol=2e-3)
    goal = Loop("position")
    goal.run(0.01, PANDA.home)
    goal.run(2.0, PANDA.home + 0.2)
    np.testing.assert_allclose(goal.state["position"], PANDA.home + 0.2, atol=2e-3)
    assert loop.fault == goal.fault == ""


def test_a_collision_is_a_fault_that_recover_clears() -> None:
    loop = Loop()
    loop.run(0.02, 0.0)
    push = loop.world.data.xfrc_applied[loop.world.model.body("arm/flange").id]
    push[1] = 60.0
    loop.run(0.05, 0.0)
    assert loop.fault.startswith("reflex: ")
    assert "reflex" in loop.fault.removeprefix("reflex: ")
    push[1] = 0.0
    loop.run(0.2, 0.0)
    assert loop.fault  # it lasts
    loop.fake.recover(loop.world.time)
    loop.run(0.005, write=False)
    assert loop.fault == "recovering from errors"
    loop.run(0.1, 0.0)
    assert loop.fault == ""
    assert loop.fake.metrics()["moves"] == 2


def test_cut_off_commands_end_in_a_fault() -> None:
    loop = Loop(deaf=[[0.1, 0.15]])
    loop.run(0.3, 0.0)
    assert loop.fault == "reflex: communication_constraints_violation"
    assert loop.fake.metrics()["lost_commands"] == 20


def test_a_robot_of_which_nothing_comes_ends_its_motion_as_a_real_one_does() -> None:
    loop = Loop("velocity")
    loop.run(0.3, 0.1)
    for _ in range(30):  # the loop goes on, and no state reaches it
        loop.world.advance(loop.world.time + MS)
        loop.fake.write(loop.world.time)
    assert loop.fake.sent_arrays["velocity_command"].tolist() == [0.0] * 7
    loop.run(0.01, 0.1)
    assert loop.fault == "reflex: communication_constraints_violation"
    assert loop.fake.metrics()["lost_commands"] == 20


def test_the_user_stop_is_a_fault_by_itself() -> None:
    loop = Loop(user_stop=[[0.1, 0.2]])
    loop.run(0.15, 0.0)
    assert "stopped by a person" in loop.fault
    loop.run(0.1, 0.0)
    loop.fake.recover(loop.world.time)
    loop.run(0.05, 0.0)
    assert loop.fault == ""


def test_a_loss_is_a_lost_device_and_the_motion_a_reflex() -> None:
    loop = Loop(loss=[[0.1, 0.2]])
    with pytest.raises(DeviceLostError, match="loss"):
        loop.run(0.3, 0.0)
    loop.fake.close()
    with pytest.raises(DeviceError, match="doesn't answer"):
        loop.fake.open()
    loop.world.advance(250 * MS)
    loop.fake.open()
    assert loop.fault == "" or "reflex" in loop.fault
    loop.run(0.05, 0.0)
    assert loop.fault == "reflex: communication_constraints_violation"
    assert loop.fake.health.reconnects == 1


def test_writes_that_cease_end_the_motion_in_good_order() -> None:
    loop = Loop("velocity")
    loop.run(0.01, 0.0)
    loop.run(0.3, 0.1)
    loop.run(0.5, write=False)
    assert (loop.fault, loop.fake.robot.controller.generator) == ("", 0)
    assert np.abs(loop.state["velocity"]).max() < 1e-3


def test_time_that_the_loop_missed_costs_no_packets() -> None:
    loop = Loop()
    loop.run(0.05, 0.0)
    loop.world.advance(loop.world.time + 60 * MS)
    loop.run(0.05, 0.0)
    assert (loop.fault, loop.fake.metrics()["lost_commands"]) == ("", 0)


def test_a_world_without_such_an_arm_is_refused() -> None:
    config = Panda.Config.model_validate({"port": "tcp://127.0.0.1:1"})
    with pytest.raises(WiringError, match="needs one part"):
        FakePanda("arm", config, world(), FakePandaConfig())


def test_options_the_robot_refuses_are_named() -> None:
    loop = Loop()
    config = Panda.Config.model_validate(
        {
            "port": "tcp://127.0.0.1:1",
            "load": {"mass": 1.0, "inertia": {"xx": -1.0, "yy": 1e-3, "zz": 1e-3, "xy": 0.0, "xz": 0.0, "yz": 0.0}},
        }
    )
    fake = FakePanda("arm", config, loop.world, FakePandaConfig())
    with pytest.raises(DeviceError, match="SetLoad"):
        fake.open()


LIGHT = np.array([2.0, 2.0, 2.0, 2.0, 0.1, 0.1, 0.02])  # N m s/rad


@pytest.mark.parametrize("robot", ["panda", "fr3"])
@pytest.mark.parametrize(("interface", "dropout"), [("torque", 0.05), ("velocity", 0.05), ("position", 0.05)])
@settings(max_examples=4, suppress_health_check=[HealthCheck.too_slow])
@given(wanted=st.lists(st.lists(st.floats(-1, 1), min_size=7, max_size=7), min_size=2, max_size=3))
def test_whatever_is_commanded_the_driver_gives_the_robot_no_reason_to_stop(
    interface: str, robot: str, dropout: float, wanted: list[list[float]]
) -> None:
    loop = Loop(interface, robot, dropout=dropout)
    loop.run(0.01, PANDA.home if interface == "position" else 0.0)
    for values in np.array(wanted):
        for _ in range(60):
            if interface == "torque":
                goal = 3.0 * LIGHT * values - LIGHT * loop.state["velocity"]
            else:
                goal = 3.0 * values if interface == "velocity" else PANDA.home + 0.3 * values
            loop.run(0.001, goal)
            if loop.fault == "reflex: joint_velocity_violation" and interface == "torque":
                return  # too much torque for too long: not the packets' fault
            assert loop.fault == ""
