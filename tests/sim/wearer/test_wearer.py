"""The simulated person: scripted and recorded motion."""

import numpy as np
import pytest
from helpers.shared import shared
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.interpolate import PchipInterpolator

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.models.human_hand import JOINTS, RANGES
from srl.sim.wearer import ScriptedWearer, WearerConfig, load_wearer, make_wearer
from srl.sim.wearer.motion import Curve, SampledWearer, join, minimum_jerk

FLEXION = [JOINTS.index(f"{finger}_mcp_flexion") for finger in ("index", "middle", "ring", "little")]


def sampled(wearer, duration=None, dt=0.01):
    times = np.arange(0.0, duration or wearer.duration, dt)
    return np.array([wearer.target(float(t)) for t in times])


def check_is_a_hand_in_motion(q, dt=0.01, fastest=40.0):
    assert (q >= RANGES[:, 0]).all()
    assert (q <= RANGES[:, 1]).all()
    assert np.abs(np.diff(q, axis=0)).max() / dt < fastest


def test_the_script_grasps_again_and_again():
    wearer = ScriptedWearer(7, period=2.0)
    q = sampled(wearer, 20.0)
    check_is_a_hand_in_motion(q, fastest=12.0)
    mean = q[:, FLEXION].mean(1).reshape(10, -1)
    assert (mean[:, 0] < 0.2).all()
    assert (mean.max(1) > 0.6).all()
    assert len(set(mean.max(1).round(6))) == 10  # never twice the same
    starts = [int(np.argmax(np.abs(q[:, j] - q[0, j]) > 0.01)) for j in FLEXION]
    assert len(set(starts)) > 1  # fingers set off one after another
    assert wearer.duration == np.inf


def test_the_script_is_a_function_of_seed_and_time_alone():
    a, b = ScriptedWearer(1), ScriptedWearer(1)
    times = [0.3, 17.2, 1.9, 400.0, 0.3]
    forward = [a.target(t) for t in times]
    backward = [b.target(t) for t in reversed(times)][::-1]
    np.testing.assert_array_equal(forward, backward)
    assert not np.array_equal(a.target(1.9), ScriptedWearer(2).target(1.9))


def test_speed_and_period_scale_time():
    slow, fast = ScriptedWearer(1, period=4.0), ScriptedWearer(1, period=4.0, speed=2.0)
    np.testing.assert_allclose(fast.target(1.0), slow.target(2.0))


@given(st.integers(3, 30), st.integers(1, 4), st.data())
def test_curves_are_those_of_scipys_pchip_inside_and_flat_at_the_ends(n, m, data):
    time = np.cumsum(data.draw(arrays(float, n, elements=st.floats(0.01, 1.0))))
    values = data.draw(arrays(float, (n, m), elements=st.floats(-3, 3, width=16)))
    t = np.linspace(time[0], time[-1], 200)
    ours, theirs = Curve(time, values).at(t), PchipInterpolator(time, values)(t)
    inner = (t >= time[1]) & (t <= time[-2])
    np.testing.assert_allclose(ours[inner], theirs[inner], atol=1e-9)
    assert ours.min() >= values.min() - 1e-9
    assert ours.max() <= values.max() + 1e-9
    np.testing.assert_allclose(Curve(time, values).at(time), values, atol=1e-12)


def test_joined_stretches_are_half_a_second_apart_and_without_a_jump():
    time = np.arange(50) / 100
    parts = [(time + 7, np.full((50, 20), 0.1)), (time, np.full((50, 20), 0.7))]
    t, q = join(parts)
    assert (np.diff(t) > 0).all()
    assert t[-1] - t[0] == pytest.approx(2 * 0.49 + 0.5)
    assert np.abs(np.diff(q, axis=0) / np.diff(t)[:, None]).max() < 1.875 * 0.6 / 0.5 + 1e-6
    assert minimum_jerk(np.array([-1.0, 0.0, 0.5, 1.0, 2.0])).tolist() == [0, 0, 0.5, 1, 1]


def test_a_loop_comes_back_smoothly_and_a_recording_ends_standing():
    time = np.linspace(0, 1, 101)
    q = np.linspace(0, 0.5, 101)[:, None] * np.ones(20)
    once, loop = SampledWearer(time, q, speed=2.0), SampledWearer(time, q, loop=True)
    assert once.duration == 0.5
    np.testing.assert_allclose(once.target(99.0), np.clip(0.5, *RANGES.T))
    assert loop.duration == np.inf
    check_is_a_hand_in_motion(sampled(loop, 6.0), fastest=3.0)
    np.testing.assert_allclose(loop.target(0.4), loop.target(0.4 + 3 * 1.5), atol=1e-12)


RECORDINGS = {
    "cyberglove_adroit_door/door_demos.npz": (79.0, 0.6),
    "cyberglove_adroit_door/door_demos.npz#episode=3": (2.99, 0.6),
    "sensor_glove/floete_07022021_01": (25.8, 0.6),
    "sensor_glove/sax_07022021_01": (16.3, 0.3),
    "axis_neuron_bvh/left_arm_fingers_yxz.bvh": (17.24, 1.2),
    "axis_neuron_bvh/fullbody_walk_yxz.bvh": (3.54, 0.2),
}


@pytest.mark.parametrize("name", RECORDINGS)
def test_real_recordings_move_the_hand_as_hands_move(name):
    path = shared("data/" + name.partition("#")[0])
    mark = name.partition("#")[1] + name.partition("#")[2]
    wearer = make_wearer(WearerConfig(recording=f"{path}{mark}"), seed=0)
    duration, way = RECORDINGS[name]
    assert wearer.duration == pytest.approx(duration, abs=0.1)
    q = sampled(wearer)
    check_is_a_hand_in_motion(q)
    assert np.ptp(q[:, FLEXION], axis=0).max() > way
    quick = load_wearer(f"{path}{mark}", speed=2.0)
    np.testing.assert_allclose(quick.target(0.5), wearer.target(1.0))


def test_door_episodes_are_played_in_turn_with_their_own_samples():
    path = shared("data/cyberglove_adroit_door/door_demos.npz")
    file = np.load(path)
    first = file["hand_position"][file["episode"] == 3]
    names = list(file["hand_joint_names"])
    wearer = load_wearer(path, episode=3)
    for joint, source in (
        ("index_pip_flexion", "FFJ1"),
        ("little_mcp_flexion", "LFJ2"),
        ("ring_dip_flexion", "RFJ0"),
    ):
        j = JOINTS.index(joint)
        expected = np.clip(first[:, names.index(source)], *RANGES[j])
        found = [wearer.target(k / 100)[j] for k in range(len(first))]
        np.testing.assert_allclose(found, expected, atol=1e-6)


def test_topics_keep_their_own_time_stamps():
    folder = shared("data/sensor_glove/floete_07022021_01")
    stamps, angles = np.loadtxt(
        folder / "_force_joints_hand_index_finger_joint_2.csv", delimiter=",", skiprows=1, dtype=float
    ).T
    starts = []
    for file in folder.glob("_force_joints_*.csv"):
        starts.append(float(file.read_text().splitlines()[1].split(",")[0]))
    wearer = load_wearer(folder)
    time = (stamps - max(starts)) * 1e-9
    inside = (time > 0) & (time < wearer.duration)
    j = JOINTS.index("index_pip_flexion")
    found = [wearer.target(t)[j] for t in time[inside]]
    assert np.abs(np.array(found) - np.maximum(angles[inside], 0)).max() < np.deg2rad(2)  # 100 Hz between samples


def write_csv(path, header, rows):
    lines = [",".join(header), *(",".join(str(value) for value in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n")
    return path


def test_csv_by_model_names_sensors_and_degrees_agree(tmp_path):
    time = np.arange(0, 1, 0.05)
    q = np.zeros((time.size, 20))
    q[:] = np.deg2rad(10) + 0.2 * np.sin(2 * np.pi * time)[:, None] * np.linspace(0.2, 1, 20)
    q[:, [4, 8, 12, 16]] *= [1, 0, -1, -1.5]
    radians = write_csv(tmp_path / "a.csv", ["time", *JOINTS], np.column_stack([time, q]))
    degrees = write_csv(
        tmp_path / "b.csv",
        ["note", *(f"{joint}_deg" for joint in JOINTS), "time_ms"],
        np.column_stack([time * 0, np.rad2deg(q), time * 1000]),
    )
    from srl.sim.wearer.joints import to_glove

    sensors = np.array([to_glove(row) for row in q])
    glove = write_csv(tmp_path / "c.csv", ["t", *(f"s{i}_rad" for i in range(22))], np.column_stack([time, sensors]))
    expected = sampled(load_wearer(radians), dt=0.02)
    for path in (degrees, glove):
        np.testing.assert_allclose(sampled(load_wearer(path), dt=0.02), expected, atol=1e-9)
    np.savez(tmp_path / "d.npz", time=time, position=q, names=np.array(JOINTS))
    np.testing.assert_allclose(sampled(load_wearer(tmp_path / "d.npz"), dt=0.02), expected, atol=1e-12)


def test_a_glove_of_18_sensors_flexes_the_dip_joints_by_two_thirds(tmp_path):
    from srl.drivers.cyberglove.protocol import LABELS

    values = np.zeros((3, 18))
    values[:, LABELS[18].index("ring_pij")] = 0.9
    time = [0.0, 0.5, 1.0]
    by_number = write_csv(tmp_path / "n.csv", ["time", *(f"s{i}" for i in range(18))], np.column_stack([time, values]))
    by_label = write_csv(tmp_path / "l.csv", ["time", *LABELS[18]], np.column_stack([time, values]))
    for path in (by_number, by_label):
        q = load_wearer(path).target(0.5)
        assert q[JOINTS.index("ring_pip_flexion")] == pytest.approx(0.9)
        assert q[JOINTS.index("ring_dip_flexion")] == pytest.approx(0.6)
        assert np.count_nonzero(q) == 2


HEADER = ["time", *JOINTS]
GOOD = [[k / 10, *[0.1] * 20] for k in range(5)]


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("none.csv", None, "no such file"),
        ("a.mat", "x", "no kind of hand recording"),
        ("a.csv", [["when", *JOINTS], *GOOD], "line 1.*time columns"),
        ("a.csv", [["time", *(f"x{i}" for i in range(20))], *GOOD], "line 1.*known joints"),
        ("a.csv", [HEADER, *GOOD[:2], [0.2, *[0.1] * 19]], "line 4.*20 fields.*21"),
        ("a.csv", [HEADER, *GOOD[:2], [0.2, *[0.1] * 19, "nan"]], "line 4, column 'little_dip_flexion'"),
        ("a.csv", [HEADER, *GOOD[:2], [0.2, "", *[0.1] * 19]], "line 4, column 'thumb_tm_abduction'"),
        ("a.csv", [HEADER, *GOOD[:3], [0.2, *[0.1] * 20]], "line 5, column 'time'"),
        ("a.csv", [HEADER, [0, *[0.1] * 20], [1e-6, *[0.1] * 20]], "10 kHz"),
        ("a.csv", [HEADER, *GOOD[:1]], "1 sample"),
        ("a.csv", [[]], "line 1"),
        ("a.npz", "not a zip file", "NPZ"),
        ("a.bvh", "HIERARCHY\nROOT Hips\n{\nOFFSET 0 0\n", "line 4.*Expected 3"),
    ],
)
def test_a_wrong_file_is_refused_with_place_and_remedy(tmp_path, name, content, words):
    path = tmp_path / name
    if isinstance(content, str):
        path.write_text(content)
    elif content is not None:
        write_csv(path, content[0], content[1:])
    with pytest.raises(RecordingError, match=f"(?s){name}.*{words}") as caught:
        load_wearer(path)
    assert caught.value.remedy


def test_wrong_npz_folder_and_selector_are_refused(tmp_path):
    np.savez(tmp_path / "a.npz", time=np.arange(3.0), position=np.zeros((3, 20)))
    with pytest.raises(RecordingError, match="'names' is missing"):
        load_wearer(tmp_path / "a.npz")
    np.savez(tmp_path / "a.npz", time=np.arange(3.0), position=np.zeros((4, 20)), names=np.array(JOINTS))
    with pytest.raises(RecordingError, match="shape"):
        load_wearer(tmp_path / "a.npz")
    np.savez(tmp_path / "a.npz", time=np.arange(3.0), position=np.zeros((3, 20)), names=np.array(JOINTS))
    for spec, episode in (
        ("a.npz#episode=1", None),
        ("a.npz#take=1", None),
        ("a.npz#episode=0", 1),
        ("a.npz", 2),
    ):
        with pytest.raises(RecordingError):
            load_wearer(f"{tmp_path}/{spec}", episode=episode)
    (tmp_path / "topics").mkdir()
    with pytest.raises(RecordingError, match="topic"):
        load_wearer(tmp_path / "topics")
    for k, finger in enumerate(("index", "middle", "ring", "pinkie", "thumb")):
        file = tmp_path / "topics" / f"x_{finger}_finger_joint_1.csv"
        file.write_text("rosbagTimestamp,data\n" + "".join(f"{k * 10**9 + i * 10**7},0.1\n" for i in range(20)))
    with pytest.raises(RecordingError, match="no time in common"):
        load_wearer(tmp_path / "topics")


def test_the_thumb_opposes_the_fingers_when_doors_are_opened():
    q = sampled(load_wearer(shared("data/cyberglove_adroit_door/door_demos.npz")))
    grip = q[:, JOINTS.index("index_pip_flexion")]
    across, lifted, bent = (q[:, JOINTS.index(f"thumb_{j}")] for j in ("tm_abduction", "tm_flexion", "ip_flexion"))
    assert np.corrcoef(across, grip)[0, 1] < -0.3  # negative abduction turns it across the palm
    assert np.corrcoef(lifted, grip)[0, 1] > 0.3
    assert np.corrcoef(bent, grip)[0, 1] > 0.3
