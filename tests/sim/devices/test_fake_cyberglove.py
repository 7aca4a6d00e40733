"""The simulated glove: what it measures, when, and when it is gone."""

import numpy as np
import pytest
from helpers.sim import MS, Elsewhere, bind, world
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pydantic import ValidationError

from srl.drivers.cyberglove import CyberGlove, calibration
from srl.drivers.cyberglove.protocol import LABELS
from srl.runtime.contracts.errors import DeviceError, DeviceLostError, ProfileError, WiringError
from srl.runtime.models.human_hand import RANGES
from srl.sim.devices.cyberglove.fake import FakeCyberGlove
from srl.sim.wearer.joints import to_glove, to_model

EXACT = {"noise": 0.0, "delay": 0.0, "quantise": False}


def glove(w, sensors=22, **options):
    config = FakeCyberGlove.Config(port="/dev/ttyUSB0", sensors=sensors)
    fake = bind(FakeCyberGlove("glove", config, w, FakeCyberGlove.Options.model_validate(options)))
    fake.open()
    return fake


def follow(w, fake, milliseconds, period=10, offset=0):
    """Positions and stamps (world time) after each period."""
    rows, stamps = [], []
    for _ in range(milliseconds // period):
        w.advance(w.time + period * MS)
        fake.read(w.time + offset)
        rows.append(fake.state_arrays["position"].copy())
        stamps.append(fake.health.stamp - offset)
    return np.array(rows), np.array(stamps)


@pytest.mark.parametrize("sensors", [18, 22])
def test_it_declares_what_the_driver_declares(sensors):
    config = CyberGlove.Config(port="/dev/ttyUSB0", sensors=sensors)
    fake, real = glove(world(), sensors), CyberGlove("glove", config)
    assert fake.states == real.states
    assert fake.commands == real.commands == ()
    assert fake.max_age == real.max_age
    assert FakeCyberGlove.Config is CyberGlove.Config
    assert fake.fileno() is None


def test_raw_gives_the_counts_and_no_angles():
    w = world()
    config = FakeCyberGlove.Config(port="/dev/ttyUSB0", raw=True)
    fake = bind(FakeCyberGlove("glove", config, w, FakeCyberGlove.Options(noise=0.0, delay=0.0)))
    assert fake.states == CyberGlove("glove", config).states
    fake.open()
    w.advance(1000 * MS)
    fake.read(w.time)
    counts = calibration.default(22).raw(to_glove(w.truth_arrays["hand_position"]))
    assert set(fake.state_arrays) == {"raw", "buttons"}
    np.testing.assert_array_equal(fake.state_arrays["raw"], counts)
    assert fake.health.message == ""


def test_a_hidden_characteristic_is_read_with_the_calibration_that_the_profile_names():
    w = world()
    index = LABELS[22].index("index_mpj")
    own, plain = (
        glove(w, noise=0.0, delay=0.0, characteristic={"index_mpj": {"gain": -0.02, "offset": 190}}),
        glove(w, noise=0.0, delay=0.0),
    )
    w.advance(1000 * MS)
    for fake in (own, plain):
        fake.read(w.time)
    true = to_glove(w.truth_arrays["hand_position"])[index]
    count = round(190 - true / 0.02)
    assert own.state_arrays["position"][index] == calibration.default(22).table[index, count]
    others = np.arange(22) != index
    np.testing.assert_array_equal(own.state_arrays["position"][others], plain.state_arrays["position"][others])
    with pytest.raises(ProfileError, match="a glove of 22 sensors has none of this name"):
        glove(world(), characteristic={"toe": {"gain": 1.0, "offset": 0.0}})


@given(arrays(float, 20, elements=st.floats(0, 1)))
def test_sensors_are_the_inverse_of_the_sheets_mapping(share):
    q = RANGES[:, 0] + share * np.ptp(RANGES, axis=1)
    q[8] = 0.0  # the middle finger's abduction is the mapping's zero
    np.testing.assert_allclose(to_model([f"s{i}" for i in range(22)], to_glove(q)[None])[0], q, atol=1e-12)


def test_it_measures_the_hand_as_it_is_after_contact():
    ball = {
        "part": "object",
        "shape": "sphere",
        "size": [0.07],
        "mass": 0.1,
        "at": {"position": [0, 0.085, -0.055]},
        "held_until": None,
    }
    w = world(parts={"ball": ball})
    fake = glove(w, **EXACT)
    follow(w, fake, 2000)
    np.testing.assert_allclose(fake.state_arrays["position"], to_glove(w.truth_arrays["hand_position"]))
    middle_mpj = LABELS[22].index("middle_mpj")
    assert fake.state_arrays["position"][middle_mpj] < w.hand.wearer.target(2.0)[9] - 0.1


def test_a_sample_is_as_old_as_its_stamp_says():
    w = world()
    fake = glove(w, noise=0.0, quantise=False, delay=0.025, rate=90.0)
    offset = 123_456_789_000
    truth = {}
    for k in range(1, 1501):
        w.advance(k * MS)
        truth[w.time] = to_glove(w.hand.position())
        if k % 10 == 0:
            fake.read(w.time + offset)
            stamp = fake.health.stamp - offset
            if stamp < 0:
                continue
            age = w.time - stamp
            assert 25 * MS <= age <= 25 * MS + 1e9 / 90 + 1
            number = round(stamp * 90 / 1e9)
            assert stamp == number * 10**9 // 90  # the glove's own schedule, in rationals
            if stamp > MS:
                nearest = truth[round(stamp / MS) * MS]
                assert np.abs(fake.state_arrays["position"] - nearest).max() < 0.02


def test_noise_has_the_asked_spread_and_angles_are_those_of_bytes():
    w = world(wearer={"period": 1000.0})
    rows, _ = follow(w, glove(w, noise=0.01, delay=0.0, quantise=False), 4000)
    spread = (rows - rows.mean(0)).std(0)
    np.testing.assert_allclose(spread, 0.01, rtol=0.2)
    w = world()
    coarse, _ = follow(w, glove(w, noise=0.0, delay=0.0), 1000)
    w = world()
    fine, _ = follow(w, glove(w, **EXACT), 1000)
    table = calibration.default(22).table[:, 1:]
    for sensor in range(22):
        assert np.isin(coarse[:, sensor], table[sensor]).all()
        inside = (fine[:, sensor] > table[sensor].min()) & (fine[:, sensor] < table[sensor].max())
        step = np.abs(np.diff(table[sensor])).max()
        assert np.abs(coarse - fine)[inside, sensor].max(initial=0.0) <= 0.51 * step


def test_the_same_seed_gives_the_same_bits_at_any_loop_rate_and_after_a_restore():
    options = {"noise": 0.01, "dropout": 0.2}
    runs = []
    for period in (10, 5):
        w = world(seed=5)
        rows, _ = follow(w, glove(w, **options), 1000, period=period)
        runs.append(rows[:: 10 // period] if period == 10 else rows[1::2])
    np.testing.assert_array_equal(*runs)
    w = world(seed=6)
    assert not np.array_equal(follow(w, glove(w, **options), 1000)[0], runs[0])
    w = world(seed=5)
    fake = glove(w, **options)
    follow(w, fake, 500)
    state = w.save()
    first, stamps = follow(w, fake, 400)
    w.restore(state)
    again, stamps_again = follow(w, fake, 400)
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(stamps, stamps_again)


@pytest.mark.parametrize("seconds", [1.2, 1.4, 2.7])
def test_noise_is_the_samples_own_whatever_was_asked_for_before(seconds):
    w = world(wearer={"period": 1000.0})
    forward, backward = (glove(w, delay=0.0, noise=0.01) for _ in range(2))
    w.advance(round(seconds * 1e9))
    numbers = range(forward.newest() - 30, forward.newest() + 1)
    rows = [forward.sample(number) for number in numbers]
    np.testing.assert_array_equal(rows, [backward.sample(number) for number in numbers[::-1]][::-1])
    assert len({row[5] for row in rows}) == len(rows)


def test_nothing_is_lost_before_the_first_sample():
    w = world()
    fake = glove(w)
    fake.read(0)
    assert (fake.health.frames, fake.health.errors, fake.health.stamp) == (0, 0, -1)


def test_drop_outs_are_counted_and_leave_the_last_sample():
    w = world()
    fake = glove(w, dropout=0.3, noise=0.0)
    _, stamps = follow(w, fake, 5000)
    health = fake.health
    assert health.frames + health.errors == pytest.approx(500, abs=2)
    assert 0.2 < health.errors / 500 < 0.4
    assert np.diff(stamps).min() == 0
    assert glove(world(), dropout=1.0).health.stamp == -1


def test_a_lost_glove_is_lost_until_it_is_back_and_opened_again():
    w = world()
    fake = glove(w, loss=[[0.5, 0.8]])
    follow(w, fake, 490)
    w.advance(500 * MS)
    for _ in range(2):
        with pytest.raises(DeviceLostError, match="gone"):
            fake.read(w.time)
    assert not fake.health.connected
    fake.close()
    with pytest.raises(DeviceError, match="doesn't answer"):
        fake.open()
    w.advance(800 * MS)
    with pytest.raises(DeviceLostError):
        fake.read(w.time)  # there again, but nobody has opened it
    fake.open()
    fake.read(w.time)
    assert fake.health.connected
    assert fake.health.reconnects == 1
    assert w.time - fake.health.stamp < 20 * MS


def test_the_wrist_switch_is_on_when_the_script_says():
    w = world()
    fake = glove(w, switch=[[0.1, 0.2]], delay=0.0)
    on = []
    for _ in range(30):
        w.advance(w.time + 10 * MS)
        fake.read(w.time)
        on.append(fake.state_arrays["buttons"][0])
    assert on == [0.0] * 9 + [1.0] * 10 + [0.0] * 11


@pytest.mark.parametrize("options", [{"loss": [[1.0, 0.5]]}, {"rate": 0}, {"delay": 0.7}, {"colour": 1}])
def test_wrong_options_are_refused(options):
    with pytest.raises(ValidationError):
        FakeCyberGlove.Options.model_validate(options)


def test_a_world_without_a_hand_is_refused():
    with pytest.raises(WiringError, match="has no part for this fake"):
        glove(Elsewhere())
