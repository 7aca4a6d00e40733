"""The UR driver's losses, faults and recoveries against the twin, in lockstep."""

import struct

import numpy as np
import pytest
from helpers.ur import Rig, speed

from srl.drivers.ur import registers
from srl.drivers.ur.handshake import Handshake
from srl.drivers.ur.registers import ScriptState
from srl.runtime.contracts.errors import DeviceError, DeviceLostError

V = np.array([0.3, -0.2, 0.2, 0.1, -0.1, 0.5])


@pytest.fixture
def rig():
    with Rig() as rig:
        yield rig


def test_a_lost_link_is_opened_again_and_the_old_program_is_gone(rig):
    driver = rig.open()
    rig.follow(V, 100)
    rig.twin.close()
    with pytest.raises(DeviceLostError):
        driver.read(rig.now)
    assert not driver.health.connected
    rig.twin.open()
    rig.bench.run(1.0)  # the old program ends by its time-out
    assert speed(rig.fake) < 0.005
    rig.open()
    assert driver.health.reconnects == 1
    rig.follow(V, 100)
    assert speed(rig.fake) > 0.3
    assert rig.twin.programs == ["srl_control"] * 2


def test_a_program_obeys_only_the_driver_that_sent_it(rig):
    rig.open()
    rig.follow(V, 200)
    rig.twin.registers.inputs.ints[registers.NONCE] += 1  # another driver's commands
    rig.bench.run(0.2)
    assert speed(rig.fake) < 0.01
    rig.bench.run(0.6)
    assert rig.twin.registers.outputs.ints[registers.STATE] == ScriptState.ABANDONED
    rig.until(lambda: rig.driver.health.fault == "the control program has ended", cycles=5)


@pytest.mark.slow
def test_a_protective_stop_is_a_fault_and_recovery_waits_its_5_s(rig):
    driver = rig.open()
    rig.follow(V, 200)
    began = rig.now
    rig.fake.controller.protective_stop("test")
    rig.follow(V, 20)
    assert driver.health.fault.startswith("protective stop")
    rig.until(lambda: speed(rig.fake) < 0.005)
    driver.recover(rig.now)
    driver.recover(rig.now)
    rig.cycle()
    assert driver.health.fault.startswith("recovering: protective stop")
    rig.until(lambda: not driver.health.fault, write=True)
    assert rig.now - began >= 5_000_000_000
    assert rig.twin.dashboard.seen.count("unlock protective stop") == 1
    rig.follow(V, 200)
    assert speed(rig.fake) > 0.3


@pytest.mark.slow
def test_an_arm_in_a_protective_stop_is_opened_with_its_fault(rig):
    rig.fake.controller.protective_stop("test")
    rig.bench.run(0.01)
    driver = rig.open()
    rig.cycle()
    assert driver.health.fault.startswith("protective stop")
    rig.follow(V, 5)
    assert rig.twin.programs == []
    driver.recover(rig.now)
    rig.until(lambda: not driver.health.fault)
    rig.follow(V, 200)
    assert speed(rig.fake) > 0.3


def test_a_recovery_that_fails_says_why_and_may_be_tried_again():
    with Rig({"power_on": True}) as rig:
        driver = rig.open()
        rig.fake._events = lambda at: None
        rig.fake.controller.emergency = True
        rig.follow(V, 10)
        assert driver.health.fault.startswith("emergency stop")
        driver.recover(rig.now)
        rig.until(lambda: "recovery failed" in driver.health.fault)
        rig.fake.controller.emergency = False
        rig.until(lambda: "POWER_OFF" in driver.health.fault)
        driver.recover(rig.now)
        rig.until(lambda: not driver.health.fault)
        rig.follow(V, 200)
        assert speed(rig.fake) > 0.3


def test_without_power_on_a_person_has_to_switch_the_arm_on(rig):
    driver = rig.open()
    rig.fake.controller.power_off()
    rig.until(lambda: "robot mode POWER_OFF" in driver.health.fault)
    driver.recover(rig.now)
    rig.until(lambda: "recovery failed" in driver.health.fault)
    assert "power on" not in rig.twin.dashboard.seen


def test_a_safeguard_stop_ends_by_itself_and_nothing_moves_on(rig):
    driver = rig.open()
    rig.fake._events = lambda at: None
    rig.follow(V, 200)
    rig.fake.controller.safeguard = True
    rig.follow(V, 100)
    assert driver.health.fault.startswith("safeguard stop")
    assert speed(rig.fake) < 0.01
    rig.fake.controller.safeguard = False
    where = rig.fake.controller.arm.position
    for _ in range(100):
        rig.cycle()
    np.testing.assert_allclose(rig.fake.controller.arm.position, where, atol=1e-3)
    assert driver.health.fault == ""


@pytest.mark.slow
def test_a_reduced_speed_is_told(rig):
    driver = rig.open()
    rig.fake.controller.slider = 0.5
    rig.follow(V, 500)
    assert driver.health.message == "speed scaled to 50%"
    assert driver.state_arrays["speed_scaling"][0] == pytest.approx(0.5)
    rig.fake.controller.slider = 1.0
    rig.follow(V, 500)
    assert driver.health.message.startswith("UR16")


def test_a_remark_of_the_controllers_is_passed_on_and_garbage_is_counted(rig):
    driver = rig.open()
    connection = rig.twin.rtde._connections[0]
    rig.twin.rtde.remark("payload looks wrong", 2)
    connection.client.write(b"\xff\xff\x55\x01garbage" + struct.pack(">HB", 9, 77) + b"\xff" * 6)
    rig.cycle()
    rig.cycle()
    assert driver.health.message == "payload looks wrong"
    assert driver.health.resyncs == 1
    assert driver.health.errors == 1
    rig.follow(V, 100)
    assert speed(rig.fake) > 0.3


def test_a_first_sample_that_is_not_finite_leaves_nothing_of_the_connection_before(rig, monkeypatch):
    driver = rig.open()
    rig.follow(V, 20)
    start = Handshake.start
    monkeypatch.setattr(
        Handshake, "start", lambda *call: (m := start(*call))._replace(body=m.body[:1] + b"\xff" * (len(m.body) - 1))
    )
    with pytest.raises(DeviceError, match="isn't finite"):
        rig.open()
    assert not driver.health.connected
    assert driver.fileno() is None
