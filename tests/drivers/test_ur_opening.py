"""Opening a UR on its twin: who the arm is, what is refused, power, and programs that others left."""

import socket
import threading

import numpy as np
import pytest
from helpers.ur import Rig, advance, make_fake, speed
from helpers.wait import until

from srl.drivers.ur import Ur, UrConfig
from srl.drivers.ur.status import RobotMode
from srl.runtime.contracts.errors import DeviceError
from srl.runtime.contracts.signals import Stop
from srl.runtime.contracts.wearer import Lead
from srl.sim.parts.robots.arm import ArmPart

V = np.array([0.3, -0.2, 0.2, 0.1, -0.1, 0.5])


@pytest.fixture
def rig():
    with Rig() as rig:
        yield rig


def refused(words, config=None, prepare=lambda twin: None, **options):
    """Opening must fail with these words, and leave nothing open."""
    with Rig(config, **options) as rig:
        prepare(rig.twin)
        with pytest.raises(DeviceError, match=words) as caught:
            rig.open()
        assert rig.driver.fileno() is None
        assert not rig.driver.health.connected
        assert caught.value.remedy
        rig.driver.close()


def test_open_says_who_the_arm_is_and_moves_nothing(rig):
    before = rig.fake.controller.arm.position
    driver = rig.open()
    assert driver.metrics()["identity"] == "UR16 20195500001, PolyScope 5.11.0"
    assert driver.health.connected
    assert driver.health.fault == ""
    for _ in range(200):
        rig.cycle()
    np.testing.assert_allclose(rig.fake.controller.arm.position, before, atol=1e-4)
    assert driver.health.fault == ""


def test_an_arm_that_is_only_read_gets_nothing_and_may_be_in_local_control():
    with Rig({"interface": "none", "payload": 2.0, "power_on": True}, start="power-off") as rig:
        rig.twin.dashboard.remote = False
        driver = rig.open()
        assert driver.commands == ()
        controller, stamp = rig.fake.controller, driver.health.stamp
        for _ in range(5):
            rig.cycle()
        assert "POWER_OFF): switch the arm on" in driver.health.message
        assert driver.health.stamp == stamp  # nobody measures these angles
        controller.robot_mode = RobotMode.RUNNING  # by the pendant
        for count in range(30):
            if count == 20:
                controller.protective_stop("a hand")
            rig.cycle()
            driver.write(rig.now)
            driver.stop(Stop.HOLD)
            driver.recover(rig.now)
            assert driver.health.fault == ""
        assert "protective stop" in driver.health.message
        assert driver.health.stamp > stamp
        # The newest packet may still be under way.
        until(lambda: np.allclose(driver.state_arrays["position"], controller.arm.position, atol=1e-9), rig.cycle)
        assert driver.stop_frames(Stop.HOLD) == ()
        with rig.bench.running():
            driver.close()
        assert set(rig.twin.dashboard.seen) <= {"PolyscopeVersion", "get robot model", "get serial number", "quit"}
        assert (rig.twin.programs, rig.twin.errors, set(rig.twin.rtde.seen)) == ([], [], {"V", "v", "O", "S"})


@pytest.mark.slow
def test_a_simulated_arm_that_a_person_leads_is_read_on_the_way():
    fake = make_fake({"interface": "none"}, {"arm": {"part": "ur16e", "guided": True}})
    fake.open()
    wearer, at = fake.cell.part(ArmPart, "arm", None).wearer, []
    wearer.instruct(Lead(1))
    advance(fake, 1600, lambda: at.append(fake.state_arrays["position"].copy()))
    assert wearer.done
    assert np.abs(at[-1] - at[0]).max() > 0.1
    np.testing.assert_allclose(at[-1], wearer.at(fake.world.time * 1e-9), atol=0.01)
    assert (fake.controller.stops, fake.health.fault) == ([], "")
    fake.write(fake.world.time)  # nothing to write
    fake.controller.power_off()
    advance(fake, 1)
    stamp = fake.health.stamp
    advance(fake, 3)
    assert fake.health.stamp == stamp
    assert "POWER_OFF" in fake.health.message


def test_a_cb3_is_refused():
    def old(twin):
        twin.dashboard.polyscope = "URSoftware 3.15.4.106291 (Nov 16 2020)"

    refused("not to a CB3", prepare=old)


def test_an_rtde_of_another_series_is_refused():
    refused("speaks to the e-Series", prepare=lambda twin: setattr(twin.rtde, "version", (3, 15, 4, 0)))


def test_a_name_that_nobody_has_is_refused():
    with pytest.raises(DeviceError, match="no host is called"):
        Ur("arm", UrConfig(port="tcp://no-such-arm.invalid")).open()


def test_local_control_is_refused():
    refused("local control", prepare=lambda twin: setattr(twin.dashboard, "remote", False))


def test_another_model_is_refused():
    refused("is a UR10, the profile says UR16e", prepare=lambda twin: setattr(twin.dashboard, "model", "UR10"))


def test_another_arm_is_refused():
    refused("serial number is 20195500001, the profile says 42", {"serial": "42"})


def test_an_arm_without_power_is_refused():
    refused("robot mode POWER_OFF", start="power-off")


def test_measured_torques_need_a_newer_controller():
    refused("doesn't give measured torques", {"effort": "measured"})


@pytest.mark.slow
def test_a_program_of_others_is_not_replaced():
    class Other:
        name = "pick_and_place"

        def cycle(self):
            return True

    refused("another program runs", prepare=lambda twin: twin.controller.run(Other()))


def test_two_drivers_of_one_arm_are_one_too_many(rig):
    rig.open()
    second = rig.another()
    with rig.bench.running(), pytest.raises(DeviceError, match="another client holds the arm's inputs"):
        second.open()
    second.close()
    rig.follow(V, 100)
    assert speed(rig.fake) > 0.3


def test_a_program_that_a_killed_driver_left_waiting_is_ended(rig):
    rig.open()
    rig.driver._link.close()
    rig.bench.run(0.01)
    assert rig.twin.controller.program is not None
    rig.driver = rig.another()
    rig.open()
    assert rig.twin.programs == ["srl_control"] * 2
    rig.follow(V, 100)
    assert speed(rig.fake) > 0.3


def test_nobody_there_is_refused_with_a_remedy():
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    driver = Ur("arm", UrConfig(port=f"tcp://127.0.0.1:{port}?dashboard={port}&script={port}"))
    with pytest.raises(DeviceError, match=r"dashboard .* can't be reached"):
        driver.open()


def test_another_service_at_the_dashboards_port_is_refused():
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]

        def greet():
            link, _ = server.accept()
            link.sendall(b"SSH-2.0-OpenSSH_9.2\r\n")

        thread = threading.Thread(target=greet)
        thread.start()
        driver = Ur("arm", UrConfig(port=f"tcp://127.0.0.1?dashboard={port}"))
        with pytest.raises(DeviceError, match=r"expected the greeting .* got 'SSH"):
            driver.open()
        thread.join()


def test_power_on_brings_the_arm_up():
    with Rig({"power_on": True}, start="power-off") as rig:
        rig.open()
        assert rig.fake.controller.robot_mode is RobotMode.RUNNING
        assert {"power on", "brake release"} <= set(rig.twin.dashboard.seen)
        rig.follow(V, 100)
        assert speed(rig.fake) > 0.3
