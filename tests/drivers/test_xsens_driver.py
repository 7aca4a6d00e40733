"""The driver against a simulated MVN: poses, angles, restarts, another person, partial samples, wrong settings."""

from __future__ import annotations

import socket

import numpy as np
import pytest
from helpers.xsens import mvn, opened, step
from pydantic import ValidationError

from srl.drivers.xsens_mvn import XsensMvn, protocol
from srl.drivers.xsens_mvn import driver as module
from srl.drivers.xsens_mvn.protocol import POSES, Pose
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.runtime.contracts.rotation import matrix

WANTED = {"joints": ["RightElbow", "LeftKnee"], "centre_of_mass": True}
FEW = {"segments": {"chest": "T8", "arm": "RightUpperArm"}}


@pytest.fixture(scope="module")
def whole():
    """A suit of everything."""
    with mvn(WANTED, {"datagrams": 3, "others": 1}) as bench:
        yield bench


@pytest.fixture
def system(whole):
    with opened(whole, WANTED) as driver:
        step(whole, driver, 3)
        yield whole, driver


@pytest.fixture(autouse=True)
def brisk(monkeypatch):
    """The twin's time is no wall clock: others are heard at once."""
    monkeypatch.setattr(module, "OTHERS", 0.02)


@pytest.fixture
def impatient(monkeypatch):
    """It doesn't wait long for what never comes."""
    monkeypatch.setattr(module, "FIRST", 0.3)


def shown(device, name):
    return np.array(device.state_arrays[name])


# -- what is read


def test_segments_are_where_the_simulated_person_has_them(system):
    bench, driver = system
    cell = bench.twin.mvn.cell
    step(bench, driver, 20)
    labels = driver.states[0].labels
    for segment, body in (("t8", "Spine3"), ("right_upper_arm", "RightArm"), ("left_foot", "LeftFoot")):
        found = shown(driver, "pose")[labels.index(segment)]
        at = cell.model.body(f"wearer/{body}").id
        np.testing.assert_allclose(found[:3], cell.data.xpos[at], atol=0.02)
        # Its x axis is the suit's z: ahead in the T-pose.
        suit = matrix(tuple(cell.data.xquat[at]))
        np.testing.assert_allclose(matrix(tuple(found[3:])), suit[:, [2, 0, 1]], atol=0.05)
    np.testing.assert_array_equal(shown(driver, "visible"), np.ones(23))


def test_joint_angles_and_centre_of_mass(system):
    bench, driver = system
    step(bench, driver, 10)
    cell = bench.twin.mvn.cell
    hips = cell.model.body("wearer/Hips").id
    np.testing.assert_allclose(shown(driver, "centre_of_mass"), cell.data.subtree_com[hips], atol=0.02)
    poses = {
        name: matrix(tuple(row[3:])) for name, row in zip(driver.states[0].labels, shown(driver, "pose"), strict=True)
    }
    between = poses["right_upper_arm"].T @ poses["right_fore_arm"]
    total = np.arccos((np.trace(between) - 1) / 2)
    # About z, then x, then y of the axes x forward, y up, z right; turned into the segment's they are the same motion.
    x, y, z = shown(driver, "joint_angles")[0]
    w = abs(np.prod(np.cos([x / 2, y / 2, z / 2])) - np.prod(np.sin([x / 2, y / 2, z / 2])))
    assert w == pytest.approx(np.cos(total / 2), abs=1e-3)


def test_the_stamp_is_the_recording_s_time(system):
    bench, driver = system
    step(bench, driver, 30, 0.001)
    twin = bench.twin
    assert driver.health.stamp == pytest.approx(twin.mvn.taken_at(twin.mvn.newest()), abs=2_000_000)


def test_a_delay_that_mvn_doesn_t_tell_is_subtracted(whole):
    with opened(whole, {"delay": 0.02}) as driver:
        step(whole, driver, 30, 0.001)
        assert driver.health.stamp == pytest.approx(
            whole.twin.mvn.taken_at(whole.twin.mvn.newest()) - 20_000_000, abs=2_000_000
        )


# -- losses


def test_partial_samples_are_none(system, monkeypatch):
    bench, driver = system
    plain = bench.twin.datagrams
    monkeypatch.setattr(bench.twin, "datagrams", lambda *a: plain(*a)[1:])  # the first of three never comes
    stamp = driver.health.stamp
    step(bench, driver, 20)
    assert driver.health.stamp == stamp
    assert driver.metrics()["incomplete"] >= 5
    monkeypatch.undo()
    step(bench, driver, 2)
    assert driver.health.stamp > stamp


def test_samples_that_overtake_each_other(system, monkeypatch):
    bench, driver = system
    sent = []
    monkeypatch.setattr(bench.twin._udp, "write", lambda data, peer: sent.append((data, peer)))
    bench.run(0.05)
    monkeypatch.undo()
    for data, peer in reversed(sent):
        bench.twin._udp.write(data, peer)
    driver.read(bench.now)
    assert driver.health.stamp == pytest.approx(bench.twin.mvn.taken_at(bench.twin.mvn.newest()), abs=12_000_000)
    assert driver.metrics()["late_samples"] > 0
    assert driver.metrics()["restarts"] == 0


def test_a_stream_that_restarts_goes_on(system):
    bench, driver = system
    bench.twin.offset = 5000
    step(bench, driver, 3)
    bench.twin.restart()
    step(bench, driver, 20)
    assert driver.metrics()["restarts"] == 1
    assert bench.now - driver.health.stamp < 30_000_000
    bench.twin.offset, bench.twin.origin = 0, 0


def test_another_person_s_stream_doesn_t_hide_that_this_one_is_lost(system):
    bench, driver = system
    bench.twin.silent = {0}
    try:
        with pytest.raises(DeviceLostError, match="nothing of this person"):
            step(bench, driver, 300)
    finally:
        bench.twin.silent = set()
    assert driver.metrics()["others"] > 100


def test_the_wrong_person_is_told(impatient):
    refused = pytest.raises(DeviceError, match="MVN sends character 2")
    with mvn({"character": 2} | FEW) as bench, refused, opened(bench, FEW):
        pass


def test_garbage_changes_nothing(system):
    bench, driver = system
    frames = driver.health.frames
    errors = driver.health.errors
    bad = protocol.encode(2, 10**6, 0, protocol.encode_poses([protocol.Pose(1, (0, 0, 1), (2, 0, 0, 0))]), 1)
    for data in (b"", b"MXTP", b"MXTP99" + bytes(30), bytes(5000), bad):
        bench.twin._udp.write(data, ("127.0.0.1", bench.twin._port))
    driver.read(bench.now + 1)
    assert driver.health.errors - errors == 5
    assert driver.health.frames == frames


def test_only_the_sender_s_datagrams_count(impatient, whole):
    with opened(whole, FEW | {"sender": "127.0.0.1"}) as driver:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.bind(("127.0.0.2", 0))
            other.sendto(b"MXTP02", ("127.0.0.1", whole.twin._port))
        step(whole, driver)
        assert driver.metrics()["foreign"] == 1
        assert driver.health.errors == 0
    with pytest.raises(DeviceError, match=r"none from 127.0.0.9"), opened(whole, FEW | {"sender": "127.0.0.9"}):
        pass


def test_two_that_send_the_same_person_are_never_mixed(impatient, whole, monkeypatch):
    """Without `sender`: the first counts, the second is told; at an opening with both nobody can tell whose it is."""
    with (
        opened(whole, FEW) as driver,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as replay,
    ):
        other.bind(("127.0.0.2", 0))
        replay.bind(("127.0.0.1", 0))  # MVN's own computer plays a recording, too
        here = ("127.0.0.1", whole.twin._port)
        poses = [Pose(n, (2.0, 2.0, 1.5), (1.0, 0.0, 0.0, 0.0)) for n in range(1, 24)]
        seen, before = [], driver.metrics()["foreign"]
        for k in range(30):
            data = protocol.encode(POSES, 90_000 + k, 90_000 + 10 * k, protocol.encode_poses(poses), 23)
            (other if k % 2 else replay).sendto(data, here)
            step(whole, driver)
            seen.append(shown(driver, "chest.pose")[0])
        assert max(seen) < 1.0
        assert "127.0.0.2 port" in driver.health.message
        assert "is left out: 127.0.0.1 port" in driver.health.message
        assert driver.metrics()["foreign"] - before == 30
        driver.close()
        plain = whole.twin._send
        monkeypatch.setattr(whole.twin, "_send", lambda *a: (plain(*a), other.sendto(data, here)))
        with whole.serving(), pytest.raises(DeviceError, match=r"which is the wearer's.*set 'sender'"):
            driver.open()
        monkeypatch.setattr(whole.twin, "_send", lambda *a: other.sendto(data, here))
        with whole.serving(), pytest.raises(DeviceError, match=r"127.0.0.1 was the first"):
            driver.open()


# -- wrong settings


def test_the_wrong_up_axis_is_told_and_nothing_is_used():
    with mvn(FEW, {"y_up": True}) as bench:
        with opened(bench, FEW) as driver:
            step(bench, driver, 5)
            assert driver.health.stamp < 0
            assert "check 'up: z'" in driver.health.message
        with opened(bench, FEW | {"up": "y", "forward": "z"}) as driver:
            step(bench, driver, 5)
            assert driver.health.stamp >= 0
            chest = bench.twin.mvn.cell.model.body("wearer/Spine3").id
            np.testing.assert_allclose(shown(driver, "chest.pose")[:3], bench.twin.mvn.cell.data.xpos[chest], atol=0.02)


def test_centimetres_are_told_and_nothing_is_used(whole, monkeypatch):
    plain = whole.twin._pose
    monkeypatch.setattr(
        whole.twin, "_pose", lambda n, row: (p := plain(n, row))._replace(position=tuple(100 * v for v in p.position))
    )
    with opened(whole, FEW) as driver:
        step(whole, driver, 3)
        assert driver.health.stamp < 0
        assert "centimetres" in driver.health.message


def test_types_that_aren_t_ticked_are_told(impatient, whole, monkeypatch):
    plain = whole.twin.datagrams
    monkeypatch.setattr(whole.twin, "datagrams", lambda *a: plain(*a)[:-1])
    with pytest.raises(DeviceError, match=r"doesn't send: Center of Mass"), opened(whole, WANTED):
        pass
    monkeypatch.setattr(whole.twin, "datagrams", lambda *a: plain(*a)[-1:])
    with pytest.raises(DeviceError, match=r"not: Position \+ Orientation"), opened(whole, FEW):
        pass


@pytest.mark.parametrize(
    ("options", "output"),
    [
        ({"segments": {"a": "RightArm"}}, "no segment 'RightArm'"),
        ({"joints": ["Elbow"]}, "no joint 'Elbow'"),
        ({"segments": {"a": "T8", "b": "T8"}}, "named twice"),
        ({"markers": {"a": "b/c"}}, "markers"),
        ({"segments": {"Chest": "T8"}}, "can't be a name"),
        ({"up": "y"}, "`up: y` needs 'forward'.*'forward: z' if z grows"),
        ({"forward": "x"}, "'forward' is for `up: y`"),
    ],
)
def test_options_that_can_t_be(options, output):
    with pytest.raises(ValidationError, match=output):
        XsensMvn.Config(port="udp://:9763", **options)


def test_a_taken_port_is_told(whole):
    with opened(whole, FEW), pytest.raises(DeviceError, match="taken by another program"):
        XsensMvn("two", XsensMvn.Config(port=whole.address)).open()
