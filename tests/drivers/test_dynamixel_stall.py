"""The driver and a twin in a process of its own that hangs: what a stalled bus may still carry out, in real time."""

import time

import numpy as np
import pytest
from helpers.dynamixel import THREE, config
from helpers.peer import Peer
from helpers.twin import bound
from helpers.wait import until

from srl.drivers.dynamixel import Dynamixel
from srl.drivers.dynamixel.config import DynamixelConfig
from srl.runtime.contracts.errors import DeviceError, DeviceLostError

PERIOD = 0.01
WORLD = {
    "world": "cell",
    "gravity": [0, 0, 0],
    "parts": {"arm": {"part": "dynamixel-chain", "axes": {name: dict(motor) for name, motor in THREE.items()}}},
}


def cycle(driver, command=None):
    now = time.monotonic_ns()
    driver.read(now)
    if command is not None:
        driver.command_arrays["position_command"][:] = command
        driver.write(now)
    time.sleep(PERIOD)


def opened(driver):
    """Opens it, as the runtime does: again and again."""

    def is_open():
        try:
            driver.open()
        except DeviceError:
            return False
        return True

    until(is_open, pause=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("protocol", [2, 1])
def test_a_bus_that_hangs_is_lost_and_plays_back_no_old_motion(protocol):
    base = config(protocol=protocol).model_dump(exclude_unset=True)
    with Peer("dynamixel", config=base, world=WORLD) as peer:
        driver = bound(Dynamixel("bus", DynamixelConfig.model_validate(base | {"port": peer.address})))
        opened(driver)
        until(lambda: driver.health.stamp >= 0, lambda: cycle(driver))
        start = driver.state_arrays["position"].copy()
        for _ in range(50):
            cycle(driver, start)
        assert driver.health.fault == ""
        peer.stop()
        far = start.copy()

        def onward():
            far[:2] += 0.002  # 0.2 rad/s that nobody carries out
            cycle(driver, far)

        with pytest.raises(DeviceLostError, match="no servo has answered for a second"):
            until(lambda: False, onward)
        driver.close()
        peer.cont()
        opened(driver)
        until(lambda: driver.health.stamp >= 0 and driver.health.unsent == 0, lambda: cycle(driver))
        for _ in range(50):
            cycle(driver)
        # The one command that was under way is all that came through.
        assert np.abs(driver.state_arrays["position"] - start).max() < 0.03
        assert far[0] - start[0] > 0.1
        assert driver.health.reconnects == 1
        driver.close()
