"""The driver against the twin, in lockstep over real sockets: torque loop, reflex, recovery, stall."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, Self

import numpy as np
import pytest
from helpers import panda as helpers_panda
from helpers.panda import QUIET
from helpers.wait import until

from srl.drivers.panda import Panda
from srl.drivers.panda.packets import RobotMode
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.runtime.contracts.signals import Array, Stop
from srl.runtime.models.robots import PANDA


class Pair:
    """A driver and a twin; a cycle is one state of the robot and the command that answers it."""

    def __init__(self, robot: str = "panda", interface: str = "torque", config: Any = None, **options: Any) -> None:
        self.twin = helpers_panda.twin(robot, **(QUIET | {"patience": 0.9} | options))
        self.twin.open()
        given = {"port": self.twin.address, "interface": interface} | (config or {})
        self.driver = Panda("arm", Panda.Config.model_validate(given))
        self.state = {signal.name: np.full(signal.shape, np.nan) for signal in self.driver.states}
        self.wanted = np.zeros(7)
        self.driver.bind(self.state, {signal.name: self.wanted for signal in self.driver.commands})
        with self.turning():
            self.driver.open()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with self.turning():
            self.driver.close()
        self.twin.close()

    @contextlib.contextmanager
    def turning(self) -> Iterator[None]:
        """The twin goes on in a thread meanwhile, for calls that block."""
        end = threading.Event()

        def serve() -> None:
            while not end.is_set():
                helpers_panda.turn(self.twin)

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield
        finally:
            end.set()
            thread.join()

    def run(self, cycles: int, wanted: Array | float | None = None, write: bool = True) -> None:
        """So many of the driver's cycles, each with a new state."""
        for _ in range(cycles):
            until(self._newer(), self._turn, what=lambda: f"a state; {self.twin.metrics()}", pause=0.0)
            if wanted is not None:
                self.wanted[:] = wanted
            if write:
                self.driver.write(time.monotonic_ns())

    def _newer(self) -> Callable[[], bool]:
        frames = self.driver.health.frames
        return lambda: self.driver.health.frames > frames

    def _turn(self) -> None:
        helpers_panda.turn(self.twin, pause=False)
        self.driver.read(time.monotonic_ns())

    def until(self, condition: Any) -> None:
        until(condition, lambda: self.run(1), what=lambda: f"{self.driver.health} {self.twin.metrics()}", pause=0.0)

    @property
    def fault(self) -> str:
        return self.driver.health.fault

    @property
    def mode(self) -> RobotMode:
        return self.twin.robot.controller.mode


@pytest.mark.slow
@pytest.mark.parametrize("robot", ["panda", "fr3"])
def test_a_torque_loop_runs_without_a_packet_lost(robot: str) -> None:
    with Pair(robot) as pair:
        pair.run(3, 0.0)
        np.testing.assert_allclose(pair.state["position"], PANDA.home, atol=1e-5)
        pair.until(lambda: pair.mode is RobotMode.MOVE)
        pair.run(20, 0.0)
        before, taken = pair.state["position"].copy(), pair.twin.setpoints
        for _ in range(1000):
            pair.run(1, np.array([0.4, 0, 0, 0.6, 0, 0, 0]) - 2.0 * pair.state["velocity"] * [1, 1, 1, 1, 0, 0, 0])
        moved = pair.state["position"] - before
        assert moved[0] > 0.05
        assert moved[3] > 0.05
        assert pair.fault == ""
        assert pair.state["success_rate"][0] == 1.0
        assert pair.twin.setpoints - taken >= 1000
        assert (pair.twin.robot.controller.reception.total, pair.driver.health.errors) == (0, 0)


@pytest.mark.slow
@pytest.mark.parametrize(("robot", "interface"), [("panda", "velocity"), ("fr3", "velocity"), ("fr3", "position")])
def test_joint_motions_are_followed(robot: str, interface: str) -> None:
    with Pair(robot, interface) as pair:
        start = PANDA.home if interface == "position" else np.zeros(7)
        pair.run(3, start)
        pair.until(lambda: pair.mode is RobotMode.MOVE)
        pair.run(10, start)
        before = pair.state["position"].copy()
        pair.run(600, PANDA.home + 0.05 if interface == "position" else 0.1)
        pair.run(200, PANDA.home + 0.05 if interface == "position" else 0.0)
        expected = 0.05 if interface == "position" else 0.06
        np.testing.assert_allclose(pair.state["position"] - before, expected, atol=3e-3)
        assert pair.fault == ""


def test_a_reflex_is_a_fault_and_recovery_an_act_of_its_own() -> None:
    with Pair() as pair:
        pair.run(3, 0.0)
        pair.until(lambda: pair.mode is RobotMode.MOVE)
        pair.run(20, 0.0)
        world = pair.twin.robot.world
        push = world.data.xfrc_applied[world.model.body("arm/flange").id]
        push[1] = 60.0
        pair.until(lambda: pair.fault)
        assert pair.fault.startswith("reflex: ")
        push[1] = 0.0
        pair.run(50, 0.0)
        assert pair.mode is RobotMode.REFLEX
        pair.driver.recover(time.monotonic_ns())
        pair.until(lambda: pair.mode is RobotMode.MOVE)
        pair.run(50, 0.0)
        assert (pair.fault, pair.twin.robot.controller.reflexes) == ("", 1)


@pytest.mark.slow
@pytest.mark.parametrize("robot", ["panda", "fr3"])
def test_a_stalled_loop_loses_its_motion_and_goes_on_after_recovery(robot: str) -> None:
    with Pair(robot, patience=0.02) as pair:
        pair.run(3, 0.0)
        pair.until(lambda: pair.mode is RobotMode.MOVE)
        pair.run(20, 0.0)
        taken = pair.twin.setpoints
        for _ in range(3000):  # we stall: nobody reads or writes for three seconds of the robot
            helpers_panda.turn(pair.twin, pause=pair.mode is RobotMode.MOVE)
        assert pair.mode is RobotMode.REFLEX
        assert pair.twin.setpoints - taken <= 1
        pair.until(lambda: pair.fault)
        assert pair.fault == "reflex: communication_constraints_violation"
        # The kernel kept the oldest of what piled up; a few reads throw it away.
        pair.run(30)
        assert pair.twin.robot.controller.ticks - pair.driver._id <= 1
        pair.driver.recover(time.monotonic_ns())
        pair.until(lambda: pair.mode is RobotMode.MOVE)
        pair.run(50, 0.0)
        assert pair.fault == ""


def test_a_hung_robot_is_a_lost_device_that_can_be_opened_again() -> None:
    with Pair() as pair:
        pair.run(50, 0.0)
        pair.twin.muted = True
        with pytest.raises(DeviceLostError, match="no state"):
            pair.run(1)
        pair.driver.close()
        pair.twin.muted = False
        with pair.turning():
            pair.driver.open()
        pair.run(5, 0.0)
        assert pair.driver.health.reconnects == 1
        assert pair.fault.startswith("reflex: communication_constraints_violation")
        pair.driver.recover(time.monotonic_ns())
        pair.until(lambda: pair.mode is RobotMode.MOVE)


def test_the_user_stop_is_a_fault_while_it_lasts() -> None:
    with Pair(user_stop=[[0.2, 0.5]]) as pair:
        pair.until(lambda: pair.fault)
        assert "stopped by a person" in pair.fault
        pair.until(lambda: pair.mode is RobotMode.IDLE)
        pair.driver.recover(time.monotonic_ns())
        pair.until(lambda: pair.mode is RobotMode.MOVE)


def test_closing_ends_the_motion_in_good_order() -> None:
    pair = Pair("panda", "velocity")
    with pair:
        pair.run(3, 0.0)
        pair.until(lambda: pair.mode is RobotMode.MOVE)
        pair.run(200, 0.2)
    controller = pair.twin.robot.controller
    assert (controller.mode, controller.reflexes) == (RobotMode.IDLE, 0)
    assert np.abs(controller.motion.dq).max() < 1e-3


def test_a_stop_brings_the_arm_to_rest() -> None:
    with Pair() as pair:
        pair.run(3, 0.0)
        pair.until(lambda: pair.mode is RobotMode.MOVE)
        pair.run(100, np.array([0.4, 0, 0, 0.6, 0, 0, 0]))
        pair.driver.stop(Stop.HOLD)
        until(lambda: pair.mode is not RobotMode.MOVE, lambda: pair.run(1, write=False), pause=0.0)
        pair.run(100, write=False)
        assert np.abs(pair.state["velocity"]).max() < 0.01
        assert pair.fault == ""


def test_the_profiles_settings_reach_the_robot() -> None:
    with Pair(config={"collision": {"torque": 33.0, "force": 44.0}, "load": {"mass": 0.7}}) as pair:
        settings = pair.twin.robot.controller.settings
        np.testing.assert_array_equal(settings.upper_torque, 33.0)
        np.testing.assert_array_equal(settings.lower_force, 44.0)
        assert settings.load_mass == 0.7
    bad = {"load": {"mass": 0.7, "inertia": {"xx": -1.0, "yy": 1e-3, "zz": 1e-3, "xy": 0.0, "xz": 0.0, "yz": 0.0}}}
    with pytest.raises(DeviceError, match="SetLoad"):
        Pair(config=bad)
