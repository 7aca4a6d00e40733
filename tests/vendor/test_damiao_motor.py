"""damiao-motor's client, unchanged, against the twin of two Damiaos on python-can's virtual bus."""

from __future__ import annotations

import os

import numpy as np
import pytest
from helpers.ft import Server
from helpers.mit_can import TWO, cell, twin
from helpers.wait import until

damiao_motor = pytest.importorskip("damiao_motor")


def test_it_reads_arms_moves_and_disables_both_motors() -> None:
    channel = f"damiao{os.getpid()}"
    with Server(twin(bus=f"can://virtual/{channel}", world=cell(TWO, hanging=False, start=0.3))) as server:
        host = damiao_motor.DaMiaoController(channel=channel, bustype="virtual")
        try:
            shoulder = host.add_motor(1, 0x11, "8009")
            elbow = host.add_motor(2, 0x12, "4340")
            assert shoulder.get_register(21) == pytest.approx(12.5)
            assert (elbow.get_register(22), elbow.get_register(23)) == (pytest.approx(8), pytest.approx(28))
            elbow.set_can_timeout(800)
            assert elbow.get_register(9) == 16000
            elbow.ensure_control_mode("MIT")
            elbow.enable()
            until(lambda: elbow.get_states().get("status") == "ENABLED", elbow.request_motor_feedback)

            def push() -> None:
                elbow.send_cmd_mit(target_position=0.6, stiffness=40.0, damping=2.0)

            until(lambda: abs(float(server.world.truth_arrays["arm_position"][1]) - 0.6) < 0.02, push)
            until(lambda: abs(elbow.get_states()["pos"] - 0.6) < 0.03, push)
            assert server.world.truth_arrays["arm_position"][0] == pytest.approx(0.3, abs=0.2)  # free, and not told
            elbow.disable()
            until(lambda: elbow.get_states().get("status") == "DISABLED", elbow.request_motor_feedback)
        finally:
            host.shutdown()
        metrics = server.twin.metrics()
        assert metrics["enabled"] == [False, False]
        assert metrics["refused"] == {}
        assert np.isfinite(server.world.truth_arrays["arm_position"]).all()
