"""The driver against a scripted server: what it reads, and frames that are late, hidden, repeated."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.vicon_script import ARM, ARM_OPTIONS, MS, Server, frame, open_driver, pose, static, values

from srl.drivers.vicon import Vicon, blocks
from srl.drivers.vicon.protocol import Block
from srl.runtime.contracts.errors import DeviceLostError


@pytest.fixture
def arm():
    """A server with one arm, and the driver, open; the first frame was number 100."""
    server = Server(frame(100, poses={(1, 1): pose()}, static=static(ARM)))
    return server, open_driver(server)


# -- what is read


def test_poses_are_si_and_ordered_as_the_profile_names_them(arm):
    server, device = arm
    quarter = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    server.send(
        frame(
            101,
            poses={(1, 1): pose(10, 20, 30, quarter), (1, 2): pose(10, 20, 130, quarter)},
            markers=[(1, 1, 1.5, -2.5, 1000.25)],
            spots=[(1, 2, 3)],
        )
    )
    device.read(5_000 * MS)
    half = np.sqrt(0.5)
    np.testing.assert_allclose(values(device, "pose"), [[0.01, 0.02, z, half, 0, 0, half] for z in (0.03, 0.13)])
    np.testing.assert_array_equal(values(device, "link.pose"), values(device, "pose")[1])
    np.testing.assert_array_equal(values(device, "visible"), [1, 1])
    np.testing.assert_allclose(values(device, "markers")[0], [0.0015, -0.0025, 1.00025])
    np.testing.assert_array_equal(values(device, "marker_visible"), [1, 0])
    np.testing.assert_allclose(values(device, "unlabelled")[0], [0.001, 0.002, 0.003])
    np.testing.assert_array_equal(values(device, "unlabelled_visible"), [1, 0])
    assert device.health.stamp == 5_000 * MS


def test_it_declares_what_the_profile_asks_for():
    device = Vicon("mocap", Vicon.Config(port="tcp://h:801", segments={"hand": "H"}, frame="room"))
    assert [(s.name, s.shape, s.frame) for s in device.states] == [
        ("pose", (1, 7), "room"),
        ("visible", (1,), None),
        ("hand.pose", (7,), "room"),
    ]
    assert device.commands == ()
    assert device.fileno() is None
    made = Vicon("m", Vicon.Config(port="tcp://h:1", **ARM_OPTIONS))
    assert {s.name if "." not in s.name else "<name>.pose" for s in made.states} == set(Vicon.gives)


def test_it_subscribes_to_what_it_needs_and_asks_for_every_frame(arm):
    server, _ = arm
    (kind, wanted), request = server.heard()
    assert kind == Block.OBJECT_ENUMS
    assert blocks.enums(wanted) == {1, 2, 5, 6, 7, 9, 26, 37, 100004}
    assert request == (Block.REQUEST_FRAME, b"\1")


def test_closing_ends_the_stream(arm):
    server, device = arm
    server.heard()
    device.close()
    device.close()
    assert server.heard() == [(Block.REQUEST_FRAME, b"\0")]
    with pytest.raises(DeviceLostError):
        device.read(0)


def test_a_y_up_server_is_read_z_up():
    server = Server(frame(1, poses={(1, 1): pose()}, static=static(ARM, y_up=True)))
    device = open_driver(server)
    about_y = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]  # a quarter turn about the vertical
    server.send(frame(2, poses={(1, 1): pose(100, 200, 300, about_y)}, markers=[(1, 1, 100, 200, 300)]))
    device.read(MS)
    np.testing.assert_allclose(
        values(device, "base.pose"), [0.1, -0.3, 0.2, np.sqrt(0.5), 0, 0, np.sqrt(0.5)], atol=1e-12
    )
    np.testing.assert_allclose(values(device, "markers")[0], [0.1, -0.3, 0.2])


def test_quaternions_don_t_jump_between_their_two_signs(arm):
    server, device = arm
    last = None
    for k, angle in enumerate(np.linspace(0, 4 * np.pi, 60)):
        c, s = np.cos(angle), np.sin(angle)
        server.send(frame(101 + k, poses={(1, 1): pose(R=[[c, -s, 0], [s, c, 0], [0, 0, 1]])}))
        device.read((k + 1) * 10 * MS)
        q = values(device, "base.pose")[3:].copy()
        assert last is None or q @ last > 0.9
        last = q


def test_a_matrix_that_is_no_rotation_counts_as_occluded(arm):
    server, device = arm
    server.send(
        frame(101, poses={(1, 1): pose(5, 5, 5, np.zeros((3, 3))), (1, 2): (np.array([np.nan] * 3), np.eye(3))})
    )
    device.read(MS)
    np.testing.assert_array_equal(values(device, "visible"), [0, 0])
    np.testing.assert_array_equal(values(device, "pose"), [[0, 0, 0, 1, 0, 0, 0]] * 2)


# -- when it was taken, and whether it counts


def test_a_frame_that_waited_is_as_old_as_its_number_says(arm):
    server, device = arm
    for k in range(20):
        server.send(frame(101 + k, poses={(1, 1): pose(k)}))
        device.read((1000 + 10 * k) * MS)
    assert device.health.stamp == 1190 * MS
    for k in (20, 21, 22):  # the network holds three frames back and delivers them one by one, 400 ms late
        server.send(frame(101 + k, poses={(1, 1): pose(k)}))
        device.read((1600 + k) * MS)
        assert device.health.stamp == pytest.approx((1000 + 10 * k) * MS, abs=MS)  # a drift of clocks is allowed for


def test_a_backlog_is_drained_to_the_newest(arm):
    server, device = arm
    server.send(*(frame(101 + k, poses={(1, 1): pose(k)}) for k in range(500)))
    device.read(7_000 * MS)
    assert values(device, "base.pose")[0] == pytest.approx(0.499)
    assert device.health.frames == 502
    server.send(*(frame(601 + k, poses={(1, 1): pose()}) for k in range(10)))
    device.read(7_100 * MS)
    assert device.metrics()["missed_frames"] == 0
    server.send(frame(615, poses={(1, 1): pose()}))
    device.read(7_150 * MS)
    assert device.metrics()["missed_frames"] == 4


def test_what_the_server_says_of_its_latency_is_taken_off(arm):
    server, device = arm
    rng = np.random.default_rng(1)
    for k in range(50):  # exposed at 10 k ms, processed in 2 to 8 ms, sent at once
        latency = rng.uniform(0.002, 0.008)
        server.send(frame(101 + k, poses={(1, 1): pose(k)}, latency=latency))
        device.read(round((1 + 0.01 * k + latency) * 1e9))
        assert device.health.stamp == pytest.approx((1000 + 10 * k) * MS, abs=3000)


@pytest.mark.parametrize("latency", [-1.0, 5.0, float("nan"), float("inf")])
def test_a_latency_that_can_t_be_is_ignored(arm, latency):
    server, device = arm
    server.send(frame(101, poses={(1, 1): pose()}, latency=latency))
    device.read(9_000 * MS)
    assert device.health.stamp == 9_000 * MS


def test_a_repeated_frame_is_no_new_sample(arm):
    server, device = arm
    for k in range(5):  # a paused server goes on sending
        server.send(frame(101, poses={(1, 1): pose(1)}))
        device.read((1000 + 10 * k) * MS)
    assert device.health.stamp == 1000 * MS
    assert device.metrics()["repeated_frames"] == 4


@pytest.mark.parametrize("repeating", [False, True])
def test_a_count_that_stood_still_is_found_out_within_a_second(arm, repeating):
    server, device = arm
    for k in range(20):
        server.send(frame(101 + k, poses={(1, 1): pose(k)}))
        device.read((1000 + 10 * k) * MS)
    for k in range(800 * repeating):  # paused for 8 s
        server.send(frame(120, poses={(1, 1): pose(19)}))
        device.read((1200 + 10 * k) * MS)
    assert device.health.stamp == 1190 * MS
    ages = []
    for k in range(300):
        now = (9200 + 10 * k) * MS
        server.send(frame(121 + k, poses={(1, 1): pose(k)}))
        device.read(now)
        ages.append((now - device.health.stamp) // MS)
    assert min(ages[:99]) > 7900  # it might be true
    assert max(ages[102:]) < 5


def test_frames_that_catch_up_slowly_keep_their_age(arm):
    server, device = arm
    for k in range(20):
        server.send(frame(101 + k, poses={(1, 1): pose(k)}))
        device.read((1000 + 10 * k) * MS)
    held = 3000  # ms, then five frames come in the time of four
    for k in range(20, 1400):
        taken, now = 1000 + 10 * k, max(1000 + 10 * k, 1200 + held + 8 * (k - 20))
        server.send(frame(101 + k, poses={(1, 1): pose(k)}))
        device.read(now * MS)
        assert device.health.stamp == pytest.approx(taken * MS, abs=5 * MS)


def test_frame_numbers_wrap_and_start_again(arm):
    server, device = arm
    now = 1000 * MS
    for number in (2**32 - 2, 2**32 - 1, 0, 1, 2):
        server.send(frame(number, poses={(1, 1): pose(number % 7)}))
        device.read(now)
        assert device.health.stamp == now
        now += 10 * MS
    assert device.metrics()["missed_frames"] == 0
    server.send(frame(900_000, poses={(1, 1): pose()}))  # a jump: nothing to trust but the arrival
    device.read(now)
    server.send(frame(17, poses={(1, 1): pose()}))
    device.read(now + 10 * MS)
    assert device.health.stamp == now + 10 * MS


def test_what_is_occluded_keeps_its_pose_and_all_of_it_hidden_is_no_sample(arm):
    server, device = arm
    server.send(frame(101, poses={(1, 1): pose(1), (1, 2): pose(2)}, markers=[(1, 1, 1, 1, 1)]))
    device.read(1000 * MS)
    server.send(frame(102, poses={(1, 1): pose(3)}))
    device.read(1010 * MS)
    np.testing.assert_array_equal(values(device, "visible"), [1, 0])
    np.testing.assert_allclose(values(device, "pose")[:, 0], [0.003, 0.002])
    np.testing.assert_allclose(values(device, "markers")[0], [0.001] * 3)
    np.testing.assert_array_equal(values(device, "marker_visible"), [0, 0])
    assert device.health.stamp == 1010 * MS
    for k in range(3, 30):
        server.send(frame(100 + k, poses={}))
        device.read((1000 + 10 * (k - 1)) * MS)
    assert device.health.stamp == 1010 * MS  # by now the loop has called it stale
    assert device.health.connected
    assert device.metrics()["hidden_frames"] == 27
    server.send(frame(130, poses={(1, 2): pose(4)}))
    device.read(1290 * MS)
    assert device.health.stamp == pytest.approx(1290 * MS, abs=MS)


@pytest.mark.parametrize(
    ("required", "poses", "markers", "counts"),
    [
        (["link"], {(1, 1): pose()}, [], False),
        (["link"], {(1, 2): pose()}, [], True),
        (["base", "link"], {(1, 2): pose()}, [(1, 1, 0, 0, 0)], False),
        (["base", "second"], {(1, 1): pose()}, [(1, 1, 0, 0, 0)], False),
        (["base", "second"], {(1, 1): pose()}, [(1, 2, 0, 0, 0)], True),
    ],
)
def test_required_things_must_all_be_seen(required, poses, markers, counts):
    server = Server(frame(100, static=static(ARM)))
    device = open_driver(server, **ARM_OPTIONS, required=required)
    server.send(frame(101, poses=poses, markers=markers))
    device.read(1000 * MS)
    assert device.health.stamp == (1000 * MS if counts else -1)
