"""The driver of MIT-mode actuators on a bus: against its twin, and against a bus that fails."""

from __future__ import annotations

import itertools
import math
import os
import time
from collections.abc import Iterator
from pathlib import Path

import can
import numpy as np
import pytest
from helpers.ft import Server, bound
from helpers.mit_can import AK, TWO, Limb, cell, config, twin
from helpers.wait import until

from srl.drivers.mit_can import MitCan, protocol
from srl.drivers.mit_can.line import REFUSED
from srl.drivers.mit_can.protocol import Impedance
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.runtime.contracts.signals import Stop
from srl.runtime.ipc.stop_slots import StopSlots
from srl.runtime.service.actuators import Actuators

_buses = itertools.count()


def driver(address: str, **options: object) -> MitCan:
    made = bound(MitCan("arm", config(port=address, watchdog=5.0, **options)))  # a machine this busy needs patience
    assert isinstance(made, MitCan)
    made.patience = 40.0
    return made


def cycle(arm: MitCan, command: object = None) -> None:
    arm.read(time.monotonic_ns())
    if command is not None:
        arm.command_arrays["position_command"][:] = command
        arm.write(time.monotonic_ns())
    arm._faults.silent.clear()  # nor is a motor silent here because its twin's thread didn't run


@pytest.fixture
def server() -> Iterator[Server]:
    bus = f"can://virtual/mit{os.getpid()}.{next(_buses)}"
    with Server(twin(bus=bus, world=cell(hanging=False, start=0.2))) as running:
        yield running


def held(arm: MitCan) -> np.ndarray:  # type: ignore[type-arg]
    arm.open()
    where = arm.state_arrays["position"].copy()
    until(lambda: bool(np.isfinite(arm.sent_arrays["position_command"]).all()), lambda: cycle(arm, where))
    return where


def test_it_reads_and_holds_its_twin_over_a_bus(server: Server) -> None:
    arm = driver(server.twin.address)
    assert held(arm) == pytest.approx(0.2, abs=1e-3)
    assert server.twin.metrics()["enabled"] == [True, True]
    for _ in range(5):
        cycle(arm, 0.2)
        time.sleep(0.002)
    until(lambda: bool(np.abs(arm.state_arrays["position"] - 0.2).max() < 0.02), lambda: cycle(arm, 0.2))
    assert server.world.truth_arrays["arm_position"] == pytest.approx(0.2, abs=0.02)
    assert arm.health.fault == ""
    arm.stop(Stop.LIMP)
    until(lambda: server.twin.metrics()["enabled"] == [False, False], lambda: arm.stop(Stop.LIMP))
    arm.close()
    arm.close()


def test_the_supervisor_stops_every_motor_of_the_bus_after_the_loop_s_death(tmp_path: Path) -> None:
    """Over multicast, which takes a stop frame as a socket of SocketCAN does: one a write."""
    for category, limp in ((Stop.DAMP, False), (Stop.LIMP, True)):
        with Server(twin(world=cell(hanging=False, start=0.2))) as server:
            arm = driver(server.twin.address)
            held(arm)
            slots, reports = StopSlots.create(tmp_path / category), list[str]()
            supervisor = Actuators(slots, reports.append)
            descriptor = arm.fileno()
            assert descriptor is not None
            supervisor.hold(0, "arm", os.dup(descriptor))
            assert slots.write(0, arm.stop_frames(category))
            arm._line.link.close()  # type: ignore[union-attr]  # it died: nothing of it is sent any more
            motors = server.twin.drives.motors
            assert motors.kp.min() >= 0
            supervisor.stop()
            if limp:
                until(lambda server=server: server.twin.metrics()["enabled"] == [False, False])
            else:
                until(lambda motors=motors: bool((motors.kp == 0).all() and (motors.kd > 1.9).all()))
            supervisor.stop()
            assert not reports
            supervisor.close()


def test_hold_s_stop_frames_are_the_last_positions_at_rest_with_all_their_stiffness() -> None:
    with Server(twin(world=cell(hanging=False))) as server:
        arm = driver(server.twin.address, ramp=0.0)
        where = held(arm)
        frames = arm.stop_frames(Stop.HOLD)
        assert frames is arm.stop_frames(Stop.HOLD)
        assert len(frames) == 2
        link = arm._line.link  # type: ignore[union-attr]
        for i, (motor, frame) in enumerate(zip(arm.config.motors.values(), frames, strict=True)):
            data = protocol.command(Impedance(float(where[i]), kp=motor.kp, kd=motor.kd), arm._axes.spans[i])
            assert link.stop_frame(can.Message(arbitration_id=motor.id, data=data, is_extended_id=False)) == frame
        arm.close()
        assert arm.fileno() is None


def test_a_cubemars_position_holds_good_for_the_supervisor_only_as_long_as_it_surely_holds() -> None:
    with Server(twin(world=cell(hanging=False))) as server:
        arm = driver(server.twin.address)
        assert all(math.isinf(arm.frames_good_for(category)) for category in Stop), "a Damiao ignores it once it let go"
        arm.close()
    ak = MitCan("arm", config(AK, "v2"))
    assert ak.frames_good_for(Stop.HOLD) == 0.05
    assert ak.frames_good_for(Stop.DAMP) == ak.frames_good_for(Stop.LIMP) == math.inf
    ak = MitCan("arm", config(AK, "v2", interface="torque"))
    assert ak.frames_good_for(Stop.HOLD) == math.inf, "they damp"


def test_a_bus_that_takes_nothing_is_given_up_with_its_remedy(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    arm = driver(server.twin.address)
    where = held(arm)
    monkeypatch.setattr(arm._line.link, "write", lambda message: False)  # type: ignore[union-attr]
    arm.sent_arrays["position_command"][:] = np.nan
    arm.command_arrays["position_command"][:] = where
    now = time.monotonic_ns()
    arm.write(now)
    assert np.isnan(arm.sent_arrays["position_command"]).all()
    with pytest.raises(DeviceLostError, match="take the interface down and up"):
        arm.write(now + REFUSED + 1)
    assert not arm.health.connected
    arm.close()


def test_a_frame_that_the_bus_refuses_leaves_neither_a_stop_frame_nor_a_speed(monkeypatch: pytest.MonkeyPatch) -> None:
    limb = Limb(world=cell(hanging=False), ramp=0.0).open()
    where, arm = limb.hold(), limb.fake.driver
    link = arm._line.link  # type: ignore[union-attr]
    write, held = link.write, [motor.held for motor in arm._motors]
    heard: list[bytes] = []
    monkeypatch.setattr(link, "write", lambda message: message.arbitration_id == 2 and write(message))
    limb.fake.sent_arrays[limb.name][:] = np.nan
    limb.run(0.008, where + 0.1)  # so far away that a speed of it would be 50 rad/s
    sent = limb.fake.sent_arrays[limb.name]
    assert np.isnan(sent[0])
    assert sent[1] == where[1] + 0.1
    assert arm._motors[0].held == held[0]
    assert arm._motors[1].held != held[1]

    def noted(message: can.Message) -> bool:
        if message.arbitration_id == 1:
            heard.append(bytes(message.data))
        return True

    monkeypatch.setattr(link, "write", noted)
    limb.run(0.002, where)  # the guard goes on from what was sent
    speed = protocol.parse_command(heard[-1], arm._axes.spans[0]).velocity
    assert abs(speed) < 0.1


def test_a_second_motor_that_answers_with_the_same_id_is_a_fault() -> None:
    limb = Limb(world=cell(hanging=False)).open()
    where, drives = limb.hold(), limb.drives
    limb.run(0.5, where)
    assert not limb.fault
    drives.ids[1], drives.replies[1] = drives.ids[0], drives.replies[0]  # its neighbour stands where it does itself
    limb.run(0.1, where, until=lambda: "two motors answer as 'shoulder'" in limb.fault)
    assert "two motors answer as 'shoulder' (id 1)" in limb.fault
    limb.run(0.02, stop=Stop.DAMP)
    assert limb.truth() == pytest.approx(where, abs=0.01)


def test_bus_off_is_a_loss() -> None:
    bus = f"mit{os.getpid()}.{next(_buses)}"
    with Server(twin(bus=f"can://virtual/{bus}", world=cell(hanging=False))) as server:
        arm = driver(server.twin.address)
        held(arm)
    with can.Bus(bus, interface="virtual") as wire:
        wire.send(can.Message(is_error_frame=True, arbitration_id=0x40))
    with pytest.raises(DeviceLostError, match="bus-off"):
        arm.read(time.monotonic_ns())
    assert not arm.health.connected
    arm.close()


def test_a_missing_bus_and_a_bus_without_motors() -> None:
    with pytest.raises(DeviceError, match="can't be opened"):
        driver("can://socketcan/can77").open()
    nobody = driver(f"can://virtual/nobody{os.getpid()}")
    nobody.patience = 1.0
    with pytest.raises(DeviceError, match="no motor answers"):
        nobody.open()


def test_seven_motors_take_what_the_sheet_says() -> None:
    seven = {f"j{k}": TWO["elbow"] for k in range(7)}
    traffic = driver("can://socketcan/can0?x=1", motors=dict(config(seven).model_dump()["motors"])).traffic
    assert traffic is not None
    assert traffic.bus == "can://socketcan/can0"
    assert int(traffic.bitrate / traffic.per_cycle) == 529
