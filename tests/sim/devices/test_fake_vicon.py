"""The simulated cameras: what they see, when, with how much noise, and what they lose sight of."""

import numpy as np
import pytest
from helpers.sim import Elsewhere
from helpers.twin import bound
from helpers.vicon import PARTS, config, driver, fake
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from srl.drivers.vicon import Vicon
from srl.runtime.contracts.errors import DeviceError, DeviceLostError, WiringError
from srl.sim.devices.vicon.fake import FakeVicon

MS = 1_000_000
EXACT = {"noise": 0.0, "delay": 0.0}
STILL = {
    "wand": {"part": "mocap-body", "subject": "Wand", "at": {"position": [0.1, 0.2, 0.3]}},
    "other": {"part": "mocap-body", "at": {"position": [1.0, 0.0, 0.5]}},
}
WAND = {"segments": {"wand": "Wand/Wand"}, "markers": {"m": "Wand/M2"}, "unlabelled": 2}


def opened(device=None, parts=None, seed=1, **options):
    found = fake(device or config(**WAND), parts or STILL, seed, **options)
    bound(found)
    found.open()
    return found


def follow(found, seconds, period=10):
    """State arrays after each period, and stamps."""
    rows, stamps = [], []
    for _ in range(round(seconds * 1000 / period)):
        found.world.advance(found.world.time + period * MS)
        found.read(found.world.time)
        rows.append({name: values.copy() for name, values in found.state_arrays.items()})
        stamps.append(found.health.stamp)
    return rows, np.array(stamps)


def test_it_declares_what_the_driver_declares():
    found, real = opened(config(), PARTS), driver("tcp://h:801")
    assert found.states == real.states
    assert found.commands == real.commands == ()
    assert found.max_age == real.max_age
    assert FakeVicon.Config is Vicon.Config
    assert {signal.name.rpartition(".")[2] for signal in found.states} == set(Vicon.gives) - {"<name>.pose"}


def test_without_noise_it_sees_what_is():
    found = opened(**EXACT, reflections=[[1, 2, 3]])
    rows, stamps = follow(found, 0.1)
    truth = found.world.truth_arrays
    np.testing.assert_array_equal(rows[-1]["wand.pose"], truth["wand_pose"])
    np.testing.assert_array_equal(rows[-1]["pose"][0], truth["wand_pose"])
    np.testing.assert_array_equal(rows[-1]["markers"][0], truth["wand_markers"][1])
    np.testing.assert_array_equal(rows[-1]["unlabelled"], [[1, 2, 3], [0, 0, 0]])
    np.testing.assert_array_equal(rows[-1]["unlabelled_visible"], [1, 0])
    np.testing.assert_array_equal(stamps, np.arange(1, 11) * 10 * MS)


def test_noise_has_the_asked_spread():
    found = opened(noise=0.001, delay=0.0)
    rows, _ = follow(found, 8.0)
    p = np.array([row["wand.pose"][:3] for row in rows])
    q = np.array([row["wand.pose"][3:] for row in rows])
    np.testing.assert_allclose(p.std(0), 0.001, rtol=0.15)
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0)
    turned = Rotation.from_quat(q[:, [1, 2, 3, 0]]).as_rotvec()
    np.testing.assert_allclose(turned.std(0), 0.001 / 0.05, rtol=0.15)
    np.testing.assert_allclose(np.array([row["markers"][0] for row in rows]).std(0), 0.001, rtol=0.15)


def test_samples_are_as_old_as_their_stamps():
    moving = {"wand": {"part": "mocap-body", "subject": "Wand", "motion": {"kind": "sine"}}}
    found = opened(config(**WAND, rate=60), moving, noise=0.0, delay=0.025, rate=60.0)
    truth = {}
    for k in range(1, 1000):
        found.world.advance(k * MS)
        truth[k] = found.world.truth_arrays["wand_pose"][:3].copy()
        found.read(k * MS)
        if k > 100:
            age = k * MS - found.health.stamp
            assert 25 * MS <= age < (25 + 18) * MS
            taken = -(-found.health.stamp // MS)  # the physics' step that it was taken at
            np.testing.assert_allclose(found.state_arrays["wand.pose"][:3], truth[taken], atol=1e-12)


def test_the_same_seed_gives_the_same_bits_at_any_loop_rate_and_after_a_restore():
    options = {"noise": 0.001, "dropout": 0.2, "marker_dropout": 0.2}
    at_100, _ = follow(opened(seed=3, **options), 1.0)
    found = opened(seed=3, **options)
    at_200, _ = follow(found, 1.0, period=5)
    for a, b in zip(at_100, at_200[1::2], strict=True):
        for name, values in a.items():
            np.testing.assert_array_equal(values, b[name])
    other, _ = follow(opened(seed=4, **options), 1.0)
    assert any((a["pose"] != b["pose"]).any() for a, b in zip(at_100, other, strict=True))
    found = opened(seed=3, noise=0.001, marker_dropout=0.2)
    follow(found, 0.5)
    state = found.world.save()
    first, _ = follow(found, 0.5)
    found.world.restore(state)
    second, _ = follow(found, 0.5)
    for a, b in zip(first, second, strict=True):
        assert a["visible"] == b["visible"]
        if a["visible"]:
            np.testing.assert_array_equal(a["pose"], b["pose"])


def test_a_hidden_subject_keeps_its_pose_and_the_sample_doesn_t_count():
    moving = {"wand": {"part": "mocap-body", "subject": "Wand", "motion": {"kind": "sine"}}}
    found = opened(config(**WAND), moving, **EXACT, occlusion={"Wand": [[0.2, 0.5]]})
    rows, stamps = follow(found, 0.7)
    seen = np.array([row["visible"][0] for row in rows])
    np.testing.assert_array_equal(seen, [*[1] * 19, *[0] * 30, *[1] * 21])
    np.testing.assert_array_equal([row["marker_visible"][0] for row in rows], seen)
    hidden = np.array([row["pose"][0] for row in rows])[18:49]
    assert (hidden == hidden[0]).all()
    alone = np.array([row["wand.pose"] for row in rows])  # without `visible` beside it: NaN says that it is none
    known = seen.copy()
    known[19:29] = 1  # it keeps its last pose for max_age, 0.1 s
    np.testing.assert_array_equal(np.isfinite(alone).all(axis=1), known == 1)
    assert (stamps[18:49] == 190 * MS).all()
    assert stamps[49] == 500 * MS


def test_a_segment_takes_three_of_its_markers():
    found = opened(**EXACT, occlusion={"Wand/M1": [[0.0, 9.0]], "Wand/M2": [[0.1, 9.0]]})
    rows, stamps = follow(found, 0.2)
    np.testing.assert_array_equal([row["visible"][0] for row in rows], [1] * 9 + [0] * 11)
    np.testing.assert_array_equal([row["marker_visible"][0] for row in rows], [1] * 9 + [0] * 11)
    assert stamps[-1] == 90 * MS


def test_required_things_decide_whether_a_sample_counts():
    both = {"segments": {"wand": "Wand", "other": "other"}}
    hidden = {"other": [[0.0, 9.0]]}
    assert follow(opened(config(**both), **EXACT, occlusion=hidden), 0.1)[1][-1] == 100 * MS
    both["required"] = ["wand", "other"]
    assert follow(opened(config(**both), **EXACT, occlusion=hidden), 0.1)[1][-1] == -1


def test_markers_drop_out_as_often_as_asked():
    found = opened(**EXACT, marker_dropout=0.25)
    rows, _ = follow(found, 10.0)
    assert np.mean([row["marker_visible"][0] for row in rows]) == pytest.approx(0.75, abs=0.05)
    with_all = opened(**EXACT, marker_dropout=1.0)
    rows, _ = follow(with_all, 0.2)
    assert not any(row["marker_visible"][0] or row["visible"][0] for row in rows)


def test_any_body_of_the_cell_can_be_a_subject():
    device = config(segments={"root": "Rig", "tip": "Rig/Tip"})
    found = opened(device, **EXACT, bodies={"Rig": {"Base": "wand/body", "Tip": "other/body"}})
    rows, _ = follow(found, 0.1)
    np.testing.assert_allclose(rows[-1]["pose"][:, :3], [[0.1, 0.2, 0.3], [1.0, 0.0, 0.5]], atol=1e-9)


def test_it_is_gone_in_its_loss_windows():
    found = opened(loss=[[0.1, 0.2]])
    found.world.advance(150 * MS)
    with pytest.raises(DeviceLostError):
        found.read(150 * MS)
    with pytest.raises(DeviceError, match="doesn't answer"):
        found.open()
    found.world.advance(200 * MS)
    found.open()
    assert found.health.reconnects == 1


@pytest.mark.parametrize(
    ("device", "message"),
    [
        ({"segments": {"a": "Hand"}}, r"no subject 'Hand'.*Known: Wand, other"),
        ({"segments": {"a": "Wand/Tip"}}, "no segment 'Tip'.*Known: Wand"),
        ({"markers": {"a": "Wand/X"}}, "no marker 'X'.*M1, M2, M3, M4"),
        ({"segments": {"a": "Wand"}, "rate": 200}, r"captures 100 frames.*sim\.devices\.mocap\.rate"),
    ],
)
def test_what_isn_t_there_is_refused_as_by_the_driver(device, message):
    with pytest.raises(DeviceError, match=message):
        opened(config(**device))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"occlusion": {"wand": [[0, 1]]}}, r"occlusion\.wand: no subject or marker.*Wand"),
        ({"occlusion": {"Wand/M9": [[0, 1]]}}, "no subject or marker"),
        ({"bodies": {"Rig": {"Base": "nobody"}}}, r"bodies\.Rig\.Base: the cell has no body 'nobody'"),
        ({"bodies": {"Wand": {"Base": "wand/body"}}}, "two subjects are called 'Wand'"),
        ({"part": "nothing"}, "no MocapSubject called 'nothing'"),
    ],
)
def test_options_that_don_t_fit_the_cell_are_errors(options, message):
    with pytest.raises(WiringError, match=message):
        opened(**options)


def test_a_world_without_parts_is_refused():
    with pytest.raises(WiringError, match="world: cell"):
        FakeVicon("mocap", config(**WAND), Elsewhere(), FakeVicon.Options())
    with pytest.raises(ValidationError, match="times must rise"):
        FakeVicon.Options.model_validate({"occlusion": {"Wand": [[2, 1]]}})


def test_an_upper_body_is_a_subject_of_several_segments_with_its_markers() -> None:
    seen_by = config(segments={"fore": "wearer/right_forearm"}, markers={"relb": "wearer/RELB"})
    parts = {"wearer": {"part": "upper-body", "at": {"position": [0.0, 0.0, 1.1]}}, **STILL}
    made = opened(seen_by, parts, occlusion={"wearer/RWRA": [[0.45, 1.0]]}, part="wearer", **EXACT)
    states, _ = follow(made, 0.4)
    world = made.world
    assert states[-1]["markers"][0] == pytest.approx(world.data.site("wearer/RELB").xpos, abs=1e-9)
    assert states[-1]["pose"][0, :3] == pytest.approx(world.data.body("wearer/right_forearm").xpos, abs=1e-9)
    segments = {s.name: s for s in made.scene.subjects[0].segments}
    assert segments["torso"].parent == 0
    assert segments["right_hand"].parent == segments["right_forearm"].id
    # Two of the forearm's three markers don't show it; the others see nothing of that.
    follow(made, 0.1)
    seen, _ = made.visible(made.newest())
    hidden = [name for name, shown in zip(segments, seen, strict=True) if not shown]
    assert hidden == ["right_forearm"]
