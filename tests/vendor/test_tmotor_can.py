"""TMotorCANControl's client against the twin of an AK80-9, its calls of `sudo ip link` taken out."""

from __future__ import annotations

import os
from typing import Any

import can
import pytest
from helpers.ft import Server
from helpers.mit_can import cell, twin
from helpers.wait import until

pytest.importorskip("TMotorCANControl")

MOTOR: dict[str, dict[str, Any]] = {"knee": {"model": "AK80-9", "kp": 20, "kd": 1}}


def test_it_enables_moves_and_lets_go(monkeypatch: pytest.MonkeyPatch) -> None:
    channel = f"tmotor{os.getpid()}"
    monkeypatch.setattr(os, "system", lambda _: 0)
    monkeypatch.setattr(can.interface, "Bus", lambda **_: can.Bus(channel, interface="virtual"))
    from TMotorCANControl.mit_can import TMotorManager_mit_can

    with Server(twin(MOTOR, "v2", cell(MOTOR, hanging=False), f"can://virtual/{channel}")) as server:
        # Its limit is of the raw byte, which is 40 K more by the maker's manual.
        with TMotorManager_mit_can(motor_type="AK80-9", motor_ID=1, max_mosfett_temp=200) as motor:
            motor.set_impedance_gains_real_unit(K=20.0, B=1.0)
            motor.set_output_angle_radians(0.4)
            until(lambda: abs(float(server.world.truth_arrays["arm_position"][0]) - 0.4) < 0.03, motor.update)
            until(lambda: abs(motor.get_output_angle_radians() - 0.4) < 0.03, motor.update)
            assert server.twin.metrics()["enabled"] == [True]
        until(lambda: server.twin.metrics()["enabled"] == [False])
        frames = server.twin.metrics()["frames"]
        assert frames["enable"] >= 1
        assert frames["disable"] >= 1
