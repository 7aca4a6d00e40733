"""The simulated board: pulses, frames, limpness, buttons."""

from itertools import permutations

import numpy as np
import pytest
from helpers.sim import MS, Elsewhere, bind, world
from hypothesis import given
from hypothesis import strategies as st

from srl.drivers.firmata import Firmata
from srl.runtime.contracts.errors import DeviceError, DeviceLostError, WiringError
from srl.runtime.contracts.signals import Stop
from srl.sim.devices.firmata.fake import FakeFirmata

JOINTS = ("abduction", "flexion_1", "flexion_2", "flexion_3")
CONFIG = {
    "port": "/dev/ttyACM0",
    "servos": {
        name: {
            "pin": pin,
            "min_us": 1000,
            "max_us": 2000,
            "lower": -1.2,
            "upper": 1.2,
            "home": 0.0,
            "trim_us": 13 * k,
        }
        for k, (name, pin) in enumerate(zip(JOINTS, (9, 10, 11, 6), strict=True))
    },
    "buttons": {"stop": {"pin": 2}, "go": {"pin": 3, "debounce": 0.05}},
}
STILL = {"gravity": (0, 0, 0), "wearer": {"period": 1000.0}}


def board(w, config=CONFIG, **options):
    config = FakeFirmata.Config.model_validate(config)
    fake = bind(FakeFirmata("finger", config, w, FakeFirmata.Options.model_validate(options)))
    fake.open()
    return fake


def command(fake, *angles):
    fake.command_arrays["position_command"][:] = angles
    fake.write(fake.world.time)


def test_it_declares_what_the_driver_declares():
    fake, real = board(world()), Firmata("finger", Firmata.Config.model_validate(CONFIG))
    assert fake.states == real.states
    assert fake.commands == real.commands
    assert fake.max_age == real.max_age
    np.testing.assert_array_equal(fake.home["position_command"], real.home["position_command"])
    for edge in ("lower", "upper"):
        ours, theirs = (getattr(d.limits["position_command"], edge) for d in (fake, real))
        np.testing.assert_array_equal(ours, theirs)
    assert FakeFirmata.Config is Firmata.Config
    assert fake.fileno() is None


@given(st.lists(st.floats(-2, 2), min_size=4, max_size=4))
def test_servos_get_whole_microseconds_within_their_bounds(angles):
    w = WORLD
    w.restore(FRESH)  # what a servo holds decides, by its dead band, whether it takes the next pulse
    fake = board(w, delay=0.0)
    command(fake, *angles)
    w.advance(w.time + 25 * MS)
    pulses = list(fake.metrics()["pulses_us"].values())
    held = w.servo_targets()
    for i, (angle, pulse) in enumerate(zip(angles, pulses, strict=True)):
        assert isinstance(pulse, int)
        expected = np.clip(1500 + 13 * i + angle * 1000 / 2.4, 1000 + 13 * i, 2000 + 13 * i)
        assert abs(pulse - expected) <= 0.5 + 1e-9
        assert held[i] == pytest.approx((pulse - 1500 - 13 * i) * 2.4 / 1000, abs=1e-12)


WORLD = world(**STILL)
FRESH = WORLD.save()


def test_a_command_waits_for_its_delay_and_the_next_pulse():
    w = world(**STILL)
    fake = board(w, delay=0.003)
    command(fake, 0, 0, 0, 0)
    w.advance(110 * MS)
    command(fake, 0, 0, 0, 1.0)  # arrives at 113 ms, the pulse after that starts at 120 ms
    seen = {}
    for k in range(111, 160):
        w.advance(k * MS)
        seen[k] = w.servo_targets()[3] > 0.5
    assert not seen[120]
    assert seen[121]
    w.advance(178 * MS)
    command(fake, 0, 0, 0, 0.5)  # arrives at 181 ms: misses the pulse at 180
    w.advance(200 * MS)
    assert w.servo_targets()[3] > 0.9
    w.advance(201 * MS)
    assert w.servo_targets()[3] == pytest.approx(0.5, abs=2e-3)
    w.advance(800 * MS)
    assert w.finger_position()[3] == pytest.approx(0.5, abs=0.02)


def test_changes_below_the_dead_band_are_ignored():
    w = world(**STILL)
    fake = board(w)
    command(fake, 0, 0, 0, 0)
    w.advance(500 * MS)
    held = w.servo_targets()[3]
    command(fake, 0, 0, 0, 0.0048)  # two pulses' widths of 1 us: less than the servo's 0.0068 rad
    w.advance(1000 * MS)
    assert fake.metrics()["pulses_us"]["flexion_3"] == 1541
    assert w.servo_targets()[3] == held
    command(fake, 0, 0, 0, 0.02)
    w.advance(1500 * MS)
    assert w.servo_targets()[3] > held


def test_servos_are_limp_until_the_first_write_and_after_limp():
    w = world(**STILL)
    fake = board(w)
    fake.read(0)
    w.advance(100 * MS)
    assert np.isnan(w.servo_targets()).all()
    command(fake, *[0.3] * 4)
    w.advance(200 * MS)
    assert np.isfinite(w.servo_targets()).all()
    fake.stop(Stop.HOLD)
    w.advance(300 * MS)
    np.testing.assert_allclose(w.servo_targets(), 0.3, atol=2e-3)
    fake.stop(Stop.LIMP)
    fake.stop(Stop.LIMP)
    w.advance(400 * MS)
    assert np.isnan(w.servo_targets()).all()
    assert list(fake.metrics()["pulses_us"].values()) == [None] * 4
    command(fake, *[0.1] * 4)
    w.advance(500 * MS)
    np.testing.assert_allclose(w.servo_targets(), 0.1, atol=2e-3)


def test_a_board_that_is_lost_holds_and_one_that_is_opened_again_has_reset():
    w = world(**STILL)
    fake = board(w, loss=[[0.5, 0.7]])
    command(fake, *[0.3] * 4)
    w.advance(500 * MS)
    for call in (fake.read, fake.write):
        with pytest.raises(DeviceLostError, match="gone"):
            call(w.time)
    fake.stop(Stop.LIMP)  # reaches nobody
    fake.close()
    with pytest.raises(DeviceError, match="doesn't answer"):
        fake.open()
    w.advance(700 * MS)
    np.testing.assert_allclose(w.servo_targets(), 0.3, atol=2e-3)
    fake.open()
    assert fake.health.reconnects == 1
    w.advance(800 * MS)
    assert np.isnan(w.servo_targets()).all()
    fake.read(w.time)
    assert fake.health.stamp == w.time


def test_a_value_that_is_not_finite_moves_nothing():
    w = world(**STILL)
    fake = board(w)
    command(fake, *[0.3] * 4)
    command(fake, np.nan, np.inf, 0.2, 0.3)
    w.advance(100 * MS)
    np.testing.assert_allclose(w.servo_targets(), [0.3, 0.3, 0.2, 0.3], atol=2e-3)


def test_buttons_follow_the_script_once_their_debounce_has_passed():
    w = world()
    fake = board(w, presses={"stop": [[0.1, 0.2]], "go": [[0.1, 0.13], [0.15, 0.3], [0.32, 0.4]]})
    levels = {}
    for k in range(1, 61):
        w.advance(k * 10 * MS)
        fake.read(w.time)
        levels[k * 10] = tuple(fake.state_arrays["buttons"])
        assert fake.button(0) == (100 <= k * 10 < 200)
    assert [t for t, (stop, _) in levels.items() if stop] == list(range(120, 220, 10))
    # `go`: 30 ms are too short for its 50 ms, and so is the gap of 20 ms.
    assert [t for t, (_, go) in levels.items() if go] == list(range(200, 450, 10))


def test_the_board_itself_as_a_twin_uses_it():
    w = world(**STILL)
    fake = board(w, delay=0.0, frame_rate=50.0)
    fake.attach(3, 1100, 1900)
    w.advance(25 * MS)
    assert fake.metrics()["pulses_us"]["flexion_3"] == 1500
    assert w.servo_targets()[3] == pytest.approx(-39 * 2.4e-3, abs=1e-9)
    fake.set_pulse(3, 2300)  # clipped by the bounds of attach
    w.advance(50 * MS)
    assert w.servo_targets()[3] == pytest.approx((1900 - 1539) * 2.4e-3, abs=1e-9)
    fake.detach(3)
    w.advance(75 * MS)
    assert np.isnan(w.servo_targets()[3])


def test_a_board_that_does_not_fit_the_world_is_refused():
    named = CONFIG | {"servos": {f"{name}x": servo for name, servo in CONFIG["servos"].items()}}
    with pytest.raises(WiringError, match=r"turn abductionx, .*the world has abduction, flexion_1"):
        board(world(), named)
    with pytest.raises(WiringError, match="turn flexion_1, flexion_1"):
        board(world(), joints={"abduction": "flexion_1"})
    with pytest.raises(WiringError, match="no servo 'e'"):
        board(world(), joints={"e": "abduction"})
    with pytest.raises(WiringError, match="no button 'stopp'"):
        board(world(), presses={"stopp": [[0, 1]]})
    two = world(fingers=[{}, {"name": "other"}], **STILL)
    fake = board(two, joints={name: f"other_{name}" for name in JOINTS})
    command(fake, *[0.3] * 4)
    two.advance(100 * MS)
    assert np.isnan(two.servo_targets()[:4]).all()
    assert np.isfinite(two.servo_targets()[4:]).all()


@pytest.mark.parametrize("order", [*permutations(JOINTS)])
def test_a_servo_turns_the_joint_it_is_named_after(order):
    w = world(**STILL)
    fake = board(w, CONFIG | {"servos": {name: CONFIG["servos"][name] for name in order}})
    command(fake, *(0.5 if name == "abduction" else 0.0 for name in order))
    w.advance(300 * MS)
    turned = w.servos.targets()
    assert turned == pytest.approx({name: 0.5 * (name == "abduction") for name in JOINTS}, abs=2e-3)


def test_one_board_turns_joints_of_two_fingers_and_two_boards_share_one():
    w = world(fingers=[{}, {"name": "other"}], **STILL)
    servos = CONFIG["servos"]
    first = {"finger_abduction": servos["abduction"], "other_flexion_1": servos["flexion_1"]}
    second = {"finger_flexion_1": servos["abduction"], "finger_flexion_2": servos["flexion_1"]}
    boards = [board(w, CONFIG | {"servos": own}) for own in (first, second)]
    for fake, angles in zip(boards, ((0.2, 0.3), (0.4, 0.5)), strict=True):
        command(fake, *angles)
    w.advance(200 * MS)
    held = {name: target for name, target in w.servos.targets().items() if np.isfinite(target)}
    meant = {"finger_abduction": 0.2, "other_flexion_1": 0.3, "finger_flexion_1": 0.4, "finger_flexion_2": 0.5}
    assert held == pytest.approx(meant, abs=2e-3)


def test_a_world_without_a_finger_is_refused():
    with pytest.raises(WiringError, match="the world has none"):
        board(world(fingers=[]))
    with pytest.raises(WiringError, match="world: cell"):
        board(Elsewhere())
