"""The base's driver refuses the wrong robot, notices a loss, and comes back."""

from __future__ import annotations

import os
import signal
import time
from typing import Any

import pytest
from helpers.base import robot
from helpers.zenoh import lost, reopened

from srl.drivers.base import driver
from srl.runtime.contracts.errors import DeviceError


@pytest.mark.slow
def test_a_bridge_that_restarts_is_lost_and_comes_back() -> None:
    with robot() as r:
        r.base.open()
        r.drive()
        r.served.do(r.twin.close)
        assert "closed" in lost(r.base)
        with pytest.raises(DeviceError, match="no connection"):
            r.base.open()
        r.served.do(r.twin.open)
        reopened(r.base)
        assert r.base.health.reconnects == 1
        r.drive()


@pytest.mark.slow
def test_a_bridge_that_hangs_is_lost_and_comes_back() -> None:
    with robot() as r:
        r.base.open()
        r.drive()
        r.twin.muted = True
        assert "no odometry" in lost(r.base)
        assert r.base.health.stamp < time.monotonic_ns()
        r.twin.muted = False
        reopened(r.base)
        r.drive()


@pytest.mark.slow
def test_a_killed_zenoh_process_is_lost_and_comes_back() -> None:
    with robot() as r:
        r.base.open()
        r.drive()
        os.kill(r.base._link.pid(), signal.SIGKILL)  # type: ignore[arg-type]
        assert "process" in lost(r.base)
        reopened(r.base)
        r.drive()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "other", "output"),
    [
        ({}, {"message": "TwistStamped"}, "message: TwistStamped"),
        ({"middleware": "rmw_zenoh"}, {"message": "TwistStamped"}, "message: TwistStamped"),
        ({"middleware": "rmw_zenoh"}, {"namespace": "other"}, "subscribes"),
        ({}, {"odometry": "odom"}, "robot/robotnik_base_control/odom"),
        ({}, {"child_frame": "robot_laser_link"}, "robot_laser_link"),
        ({"child_frame": "base_link"}, {"child_frame": "robot_base_footprint"}, "base_footprint"),
    ],
)
def test_the_wrong_robot_is_refused(
    options: dict[str, Any], other: dict[str, Any], output: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(driver, "FIRST", 1.5)
    with robot(robot=other, **options) as r, pytest.raises(DeviceError) as caught:
        r.base.open()
    assert output in str(caught.value)
    assert caught.value.place == "base"
