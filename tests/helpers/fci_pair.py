"""The Panda driver beside a scripted robot, millisecond by millisecond."""

import select
import time

import numpy as np
import pytest

from helpers.fci import Robot
from srl.drivers.panda import Panda, packets
from srl.drivers.panda.config import PandaConfig

MS = 1_000_000


VERSIONS = pytest.mark.parametrize("version", packets.VERSIONS)


INTERFACES = pytest.mark.parametrize("interface", ["torque", "velocity", "position"])


class Pair:
    """A robot and a driver that is open; `cycle` is one millisecond of both."""

    def __init__(self, version=10, robot=None, **options):
        self.robot = robot or Robot(version)
        self.driver = Panda("arm", PandaConfig(port=self.robot.address, **options))
        self.state = {s.name: np.zeros(s.shape) for s in self.driver.states}
        (command,) = self.driver.commands
        self.command = np.zeros(command.shape)
        self.driver.bind(self.state, {command.name: self.command})
        self.now = 0
        with self.robot.running():
            self.driver.open()
        self.settle()

    def settle(self):
        """No state is left in the socket."""
        self.robot.serve()
        self.now = time.monotonic_ns()
        self.driver.read(self.now)

    def arrive(self):
        """Waits until the newest state can be read."""
        assert select.select([self.driver.fileno()], [], [], 5)[0]

    def cycle(self, count=1, write=True, states=1):
        for _ in range(count):
            self.robot.tick(states)
            self.now += MS * states
            self.arrive()
            self.driver.read(self.now)
            if write:
                self.driver.write(self.now)
            self.robot.serve()

    def until(self, true, cycles=500, write=True):
        for _ in range(cycles):
            if true():
                return
            self.cycle(write=write)
        raise AssertionError("never came true")

    def start(self):
        self.until(lambda: self.robot.commands)

    def read_until_lost(self):
        for _ in range(500):
            self.driver.read(self.now)
            time.sleep(0.01)

    def close(self):
        with self.robot.running():
            self.driver.close()
        self.robot.close()
