"""The simulated arm: it obeys physics, its controller's limits and its safety, and silence stops it."""

import numpy as np
import pytest
from helpers.twin import bound
from helpers.ur import advance, make_fake, speed
from scipy.spatial.transform import Rotation

from srl.runtime.contracts.errors import DeviceError, DeviceLostError, WiringError
from srl.runtime.contracts.signals import Stop
from srl.sim.devices.ur.fake import Q

V = np.array([0.3, -0.2, 0.2, 0.1, -0.1, 0.5])


def following(fake, values):
    """What each cycle does: command `values`."""

    def each():
        fake.command_arrays[fake.commands[0].name][:] = values
        fake.write(fake.world.time)

    return each


def test_velocity_is_reached_by_the_controllers_acceleration_and_measured():
    fake = make_fake({"acceleration": 2.0})
    fake.open()
    advance(fake, 51, following(fake, V))
    assert fake.state_arrays["velocity"][5] == pytest.approx(0.2, abs=0.02)  # 2 rad/s^2 for 0.1 s
    advance(fake, 300, following(fake, V))
    np.testing.assert_allclose(fake.state_arrays["velocity"], V, atol=0.005)
    before = fake.state_arrays["position"].copy()
    advance(fake, 250, following(fake, V))
    np.testing.assert_allclose(fake.state_arrays["position"] - before, V / 2, atol=0.005)
    assert fake.health.fault == ""


def test_position_is_followed_with_a_lag_and_reached():
    fake = make_fake({"interface": "position"})
    fake.open()
    start = fake.controller.arm.position
    goal = start + 0.2 * V
    advance(fake, 5, following(fake, goal))
    assert np.abs(fake.state_arrays["position"] - start).max() < 0.02
    advance(fake, 700, following(fake, goal))
    np.testing.assert_allclose(fake.state_arrays["position"], goal, atol=1e-3)


@pytest.mark.parametrize("interface", ["velocity", "position"])
def test_silence_stops_the_arm_and_is_a_fault(interface):
    fake = make_fake({"interface": interface, "timeout": 0.03})
    fake.open()
    goal = V if interface == "velocity" else fake.controller.arm.position + 0.1
    advance(fake, 40, following(fake, goal))
    assert speed(fake) > 0.2
    advance(fake, 14)
    assert fake.health.fault == ""
    advance(fake, 250)
    assert "no command came for 0.03 s" in fake.health.fault
    assert speed(fake) < 0.01
    where = fake.controller.arm.position
    advance(fake, 50, following(fake, goal))  # nothing is obeyed until somebody resets
    np.testing.assert_allclose(fake.controller.arm.position, where, atol=1e-3)
    fake.recover(fake.world.time)
    advance(fake, 2)
    assert fake.health.fault == ""
    advance(fake, 30, following(fake, V if interface == "velocity" else where + 0.1))
    assert speed(fake) > 0.2


def test_stop_ramps_down_and_the_next_command_moves_again():
    fake = make_fake({"deceleration": 2.0})
    fake.open()
    advance(fake, 200, following(fake, V))
    fake.stop(Stop.HOLD)
    advance(fake, 60)
    assert 0.1 < speed(fake) < 0.4  # 0.5 rad/s at 2 rad/s^2 takes 0.25 s
    advance(fake, 200)
    assert speed(fake) < 0.005
    assert fake.health.fault == ""
    advance(fake, 100, following(fake, V))
    assert speed(fake) > 0.3


def push(fake, force):
    fake.cell.data.xfrc_applied[fake.cell.model.body("arm/flange").id, :3] = force


def test_a_push_is_felt_in_the_bases_axes():
    fake = make_fake()
    fake.open()
    advance(fake, 100)
    push(fake, (0.0, 20.0, -30.0))
    advance(fake, 300)
    wrench = fake.state_arrays["wrench"]
    np.testing.assert_allclose(wrench[:3], (0.0, 20.0, -30.0), atol=2.0)
    assert fake.health.fault == ""


def test_setting_a_payload_while_something_presses_hides_it_and_shows_it_when_it_is_gone():
    fake = make_fake()
    fake.open()
    push(fake, (0.0, 0.0, 50.0))
    advance(fake, 300)
    fake.controller.set_payload(0.0, (0.0, 0.0, 0.0))
    advance(fake, 50)
    np.testing.assert_allclose(fake.state_arrays["wrench"], 0.0, atol=2.0)
    push(fake, (0.0, 0.0, 0.0))
    advance(fake, 300)
    np.testing.assert_allclose(fake.state_arrays["wrench"][:3], (0.0, 0.0, -50.0), atol=3.0)


def test_a_payload_that_was_set_is_taken_off_the_wrench():
    fake = make_fake({"payload": 2.0, "payload_cog": (0.0, 0.0, 0.1)})
    fake.open()
    advance(fake, 300)  # nothing is mounted: what is taken off shows
    np.testing.assert_allclose(fake.state_arrays["wrench"][:3], (0.0, 0.0, 2 * 9.81), atol=1.0)


def test_a_payload_weighs_down_on_a_tilted_arm_too():
    tilted = {"arm": {"part": "ur16e", "at": {"rpy": [np.pi / 2, 0.0, 0.3]}}}
    fake = make_fake({"payload": 2.0, "payload_cog": (0.0, 0.0, 0.1)}, tilted)
    fake.open()
    advance(fake, 300)
    up = Rotation.from_euler("xyz", [np.pi / 2, 0.0, 0.3]).inv().apply([0.0, 0.0, 9.81])
    np.testing.assert_allclose(fake.state_arrays["wrench"][:3], 2 * up, atol=1.0)


@pytest.mark.slow
def test_too_great_a_force_is_a_protective_stop_that_a_person_ends():
    fake = make_fake(force_limit=60.0)
    fake.open()
    advance(fake, 200, following(fake, V))
    push(fake, (0.0, 0.0, 80.0))
    advance(fake, 200, following(fake, V))
    assert fake.health.fault.startswith("protective stop")
    assert speed(fake) < 0.02
    push(fake, (0.0, 0.0, 0.0))
    began = fake.controller.locked_until - 2500
    fake.recover(fake.world.time)
    advance(fake, 1)
    assert fake.health.fault.startswith("recovering")
    advance(fake, 3000, following(fake, V))
    assert fake.health.fault == ""
    assert fake.controller.cycles > began + 2500
    assert speed(fake) > 0.3


def test_a_joint_faster_than_its_limit_is_a_protective_stop():
    fake = make_fake()
    fake.open()
    advance(fake, 300, following(fake, (2.6, 0, 0, 0, 0, 0)))
    assert fake.health.fault.startswith("protective stop")
    assert "shoulder_pan is faster" in fake.controller.stops[-1]


def test_the_emergency_stop_switches_off_and_brakes_hold():
    fake = make_fake({"power_on": True}, emergency=[[0.2, 0.6]])
    fake.open()
    advance(fake, 150, following(fake, V))
    assert fake.health.fault.startswith("emergency stop")
    advance(fake, 50)
    assert speed(fake) < 0.02
    where = fake.controller.arm.position
    fake.recover(fake.world.time)
    advance(fake, 5)
    assert "recovery failed" in fake.health.fault
    advance(fake, 200)
    assert "POWER_OFF" in fake.health.fault
    np.testing.assert_allclose(fake.controller.arm.position, where, atol=0.01)
    fake.recover(fake.world.time)
    advance(fake, 500)
    assert fake.health.fault == ""


def test_a_safeguard_stop_ends_by_itself_and_nothing_moves_on():
    fake = make_fake(safeguard=[[0.2, 0.4]])
    fake.open()
    advance(fake, 150, following(fake, V))
    assert fake.health.fault.startswith("safeguard stop")
    advance(fake, 100)
    assert fake.health.fault == ""
    assert speed(fake) < 0.01


def test_the_slider_slows_and_is_reported():
    fake = make_fake(slider=0.5)
    fake.open()
    advance(fake, 300, following(fake, V))
    np.testing.assert_allclose(fake.state_arrays["velocity"], V / 2, atol=0.01)
    assert fake.state_arrays["speed_scaling"][0] == 0.5


def test_an_arm_without_power_is_refused_unless_the_profile_switches_it_on():
    fake = make_fake(start="power-off")
    with pytest.raises(DeviceError, match="POWER_OFF"):
        fake.open()
    advance_world = make_fake({"power_on": True}, start="power-off")
    advance_world.open()
    advance(advance_world, 300, following(advance_world, V))
    assert speed(advance_world) > 0.3


def test_buttons_are_digital_inputs():
    fake = make_fake({"buttons": {"go": 3, "halt": 16}}, presses={"halt": [[0.1, 0.2]]})
    fake.open()
    advance(fake, 40)
    assert fake.state_arrays["buttons"].tolist() == [0, 0]
    advance(fake, 30)
    assert fake.state_arrays["buttons"].tolist() == [0, 1]
    advance(fake, 60)
    assert fake.state_arrays["buttons"].tolist() == [0, 0]


def test_a_button_that_isnt_there_cant_be_pressed():
    with pytest.raises(WiringError, match="no button"):
        make_fake(presses={"halt": [[0.1, 0.2]]})


def test_samples_are_late_noisy_and_stamped_when_they_were_taken():
    fake = make_fake(delay=0.01, noise=1.0)
    fake.open()
    advance(fake, 200)
    assert fake.world.time - fake.health.stamp == 10_000_000
    spread = [fake.sample(number)[Q][0] for number in range(100, 190)]
    assert 3e-6 < np.std(spread) < 3e-5


def test_a_loss_is_a_loss_and_the_arm_stops_meanwhile():
    fake = make_fake(loss=[[0.3, 0.8]])
    fake.open()
    with pytest.raises(DeviceLostError):
        advance(fake, 200, following(fake, V))
    with pytest.raises(DeviceError):
        fake.open()
    fake.world.advance(790_000_000)
    assert speed(fake) < 0.01
    fake.world.advance(810_000_000)
    fake.open()
    assert fake.health.reconnects == 1
    advance(fake, 100, following(fake, V))
    assert speed(fake) > 0.3


def test_the_same_seed_gives_the_same_bits_and_a_saved_world_goes_on_from_there():
    def run(fake, cycles):
        rows = []
        advance(fake, cycles, lambda: (following(fake, V)(), rows.append(fake.state_arrays["position"].copy())))
        return np.array(rows)

    one, two = make_fake(noise=1.0), make_fake(noise=1.0)
    for fake in (one, two):
        fake.open()
    assert run(one, 100).tobytes() == run(two, 100).tobytes()
    saved = one.world.save()
    first = run(one, 100)
    one.world.restore(saved)
    bound(one, {})
    again = run(one, 100)
    assert again.tobytes() == first.tobytes()


def test_the_flange_sensor_shows_no_more_than_its_range_and_the_stop_knows_of_more():
    fake = make_fake()
    fake.open()
    push(fake, (0.0, 0.0, 200.0))
    advance(fake, 300)
    axes = fake.controller.arm.flange()[0].T @ fake.controller.wrench[:3]
    assert np.abs(axes).max() == pytest.approx(160.0, abs=1e-6)
    assert fake.health.fault == ""
    push(fake, (0.0, 0.0, 270.0))
    advance(fake, 300)
    assert fake.health.fault.startswith("protective stop")
