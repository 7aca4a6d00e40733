"""The driver against a simulated Motive: what it reads, versions, restarts, hidden things, wrong settings."""

from __future__ import annotations

import socket

import numpy as np
import pytest
from helpers.natnet import BONES, TOOL, WANTED, motive, opened, step
from pydantic import ValidationError

from srl.drivers.natnet import NatNet, protocol
from srl.drivers.natnet.protocol import Message
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.runtime.contracts.rotation import matrix

POSE = [0.4, -0.2, 1.1, 0.5, 0.5, -0.5, 0.5]
ALL = [{"natnet": natnet, "multicast": multicast} for natnet in ("3.0", "4.0", "4.2") for multicast in (False, True)]


def shown(device, name):
    return np.array(device.state_arrays[name])


@pytest.fixture
def system():
    """A Motive with one rigid body of four markers, and the driver, open."""
    with motive() as bench, opened(bench) as driver:
        step(bench, driver)
        yield bench, driver


# -- what is read


@pytest.mark.parametrize("options", ALL, ids=lambda o: f"{o['natnet']}-{'multicast' if o['multicast'] else 'unicast'}")
@pytest.mark.parametrize("up", ["y", "z"])
def test_poses_and_markers_are_z_up_whatever_the_stream(options, up):
    """(1, 0, 0) turned by that quaternion is up; the truth is the simulated body."""
    config = WANTED | {"up": up}
    with motive(config, options) as bench, opened(bench, config) as driver:
        step(bench, driver, 3)
        np.testing.assert_allclose(shown(driver, "tool.pose"), POSE, atol=2e-3)
        truth = POSE[:3] + matrix(tuple(POSE[3:])) @ np.array([[0, 0, 0.05], [-0.03, 0, 0]]).T.T[0]
        np.testing.assert_allclose(shown(driver, "markers")[0], truth, atol=3e-3)
        np.testing.assert_array_equal(shown(driver, "marker_visible"), [1, 1])
        assert driver.metrics()["natnet"] == options["natnet"]


def test_the_stamp_is_the_time_of_exposure(system):
    bench, driver = system
    step(bench, driver, 50, 0.001)
    number = bench.twin.motive.newest()
    assert driver.health.stamp == pytest.approx(bench.twin.motive.taken_at(number), abs=1_100_000)  # the bench's step
    assert bench.now - driver.health.stamp >= 6_000_000


def test_cameras_without_stamps_count_with_the_option_s_latency():
    config = WANTED | {"latency": 0.004}
    with motive(config, {"usb": True}) as bench, opened(bench, config) as driver:
        step(bench, driver, 50, 0.001)
        taken = bench.twin.motive.taken_at(bench.twin.motive.newest())
        assert driver.health.stamp == pytest.approx(taken, abs=1_100_000)


def test_a_hidden_body_keeps_its_pose_and_the_device_ages(system):
    bench, driver = system
    bench.twin.motive.visible = lambda number: (np.array([False]), np.array([True, True, True, False]))
    stamp = driver.health.stamp
    step(bench, driver, 3)
    assert list(shown(driver, "visible")) == [0]
    assert list(shown(driver, "marker_visible")) == [1, 0]
    assert driver.health.stamp > stamp  # a marker is seen
    bench.twin.motive.visible = lambda number: (np.array([False]), np.zeros(4, bool))
    step(bench, driver, 3)
    stamp = driver.health.stamp
    step(bench, driver, 15)
    assert driver.health.stamp == stamp
    assert np.isnan(shown(driver, "tool.pose")).all()
    np.testing.assert_allclose(shown(driver, "pose")[0], POSE, atol=2e-3)


def test_unlabelled_markers_come_apart_from_the_labelled_ones():
    config = WANTED | {"unlabelled": 3}
    with motive(config, {"reflections": [[1.0, 2.0, 0.5]]}) as bench, opened(bench, config) as driver:
        step(bench, driver, 2)
        np.testing.assert_allclose(shown(driver, "unlabelled")[0], [1.0, 2.0, 0.5], atol=1e-6)
        assert list(shown(driver, "unlabelled_visible")) == [1, 0, 0]


# -- names


@pytest.mark.parametrize(
    ("wanted", "output"),
    [
        ({"segments": {"tool": "Dril"}}, "no subject 'Dril'.*'Drill'"),
        ({"segments": {"tool": "Drill/Tip"}}, "no segment 'Tip'"),
        ({"markers": {"a": "Drill/Z"}}, "no marker 'Z'.*A, B, C, D"),
        ({"segments": {"tool": "Drill"}, "rate": 240}, "captures 100 frames a second, the profile needs 240"),
    ],
)
def test_what_isn_t_there_is_refused_with_what_is(wanted, output):
    with motive() as bench, pytest.raises(DeviceError, match=f"(?s){output}"), opened(bench, wanted):
        pass


def test_two_assets_with_one_number_are_refused(monkeypatch):
    with motive() as bench:
        made, places = bench.twin._model()
        twice = made._replace(bodies=(*made.bodies, made.bodies[0]._replace(name="Other")))
        monkeypatch.setattr(bench.twin, "_model", lambda: (twice, places))
        with pytest.raises(DeviceError, match="'Drill' and 'Other' both have the streaming id 1"), opened(bench):
            pass


def test_an_asset_that_is_switched_off_is_hidden_and_back_when_it_is_on(system):
    bench, driver = system
    bench.twin.disable("Drill")
    step(bench, driver, 4)
    assert list(shown(driver, "visible")) == [0]
    assert "no tool" in driver.health.message
    bench.twin.enable("Drill")
    step(bench, driver, 4)
    assert list(shown(driver, "visible")) == [1]
    assert driver.health.message == ""


def test_a_target_has_one_name():
    with pytest.raises(ValidationError, match="two names"):
        NatNet.Config(port="udp://h", segments={"a": "Drill", "b": "Drill"})


# -- versions, restarts, order


def test_a_motive_that_was_restarted_in_another_version_is_read_in_that():
    with motive(options={"natnet": "4.1"}) as bench, opened(bench) as driver:
        step(bench, driver, 3)
        bench.twin.muted = True
        step(bench, driver, 60)
        bench.twin.restart("3.0")
        bench.twin.muted = False
        step(bench, driver, 100)
        assert driver.metrics()["natnet"] == "3.0"
        assert driver.health.resyncs == 1  # with it goes the proof of which axis is up
        assert bench.now - driver.health.stamp < 30_000_000
        np.testing.assert_allclose(shown(driver, "tool.pose"), POSE, atol=2e-3)


def test_frames_of_an_unknown_version_are_not_guessed(system):
    """The frames change before the server says so: they are counted, and used only when it has."""
    bench, driver = system
    for session in bench.twin._sessions.values():
        session.version = protocol.Version(3, 1)
    stamp = driver.health.stamp
    step(bench, driver, 8)
    assert driver.health.stamp == stamp
    assert driver.health.errors >= 8
    step(bench, driver, 80)  # it has asked again, and is answered in the new version
    assert driver.health.stamp > stamp


def test_datagrams_that_overtake_each_other(system, monkeypatch):
    bench, driver = system
    step(bench, driver, 20, 0.001)
    sent = []
    monkeypatch.setattr(bench.twin._data, "write", lambda data, peer: sent.append((data, peer)))
    bench.run(0.05)
    monkeypatch.undo()
    for data, peer in reversed(sent):
        bench.twin._data.write(data, peer)
    driver.read(bench.now)
    newest = driver.health.stamp
    assert newest == pytest.approx(bench.twin.motive.taken_at(bench.twin.motive.newest()), abs=1_100_000)
    assert driver.metrics()["late_frames"] == len(sent) - 1
    step(bench, driver, 3)
    assert driver.health.stamp > newest
    assert driver.metrics()["missed_frames"] == 0


def test_lost_frames_are_counted(system, monkeypatch):
    bench, driver = system
    monkeypatch.setattr(bench.twin._data, "write", lambda data, peer: None)
    step(bench, driver, 3)
    monkeypatch.undo()
    step(bench, driver, 2)
    assert driver.metrics()["missed_frames"] == 3


def test_garbage_and_other_senders_change_nothing(system):
    bench, driver = system
    step(bench, driver)
    local = driver._client._command.local
    frames = driver.health.frames
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.2", 0))
        other.sendto(protocol.packet(Message.FRAME, bytes(200)), local)
    for data in (b"", b"\7", b"\7\0\xff\xff", bytes(5000), protocol.packet(Message.MODEL, b"\1\0\0\0\1"), b"\1\0\0\0"):
        bench.twin._data.write(data, local)
    driver.read(bench.now + 1)
    assert driver.health.frames == frames
    assert driver.health.errors >= 5
    assert driver.metrics()["foreign"] == 1
    step(bench, driver, 3)
    assert driver.health.frames > frames


def test_silence_is_a_loss(system):
    bench, driver = system
    bench.twin.muted = True
    with pytest.raises(DeviceLostError, match="no frame for 2 s"):
        step(bench, driver, 300)
    assert not driver.health.connected


def test_a_take_that_is_played_moves_nobody(system):
    bench, driver = system
    step(bench, driver)
    stamp = driver.health.stamp
    bench.twin.playing = True
    step(bench, driver, 5)
    assert driver.health.stamp == stamp
    assert "plays a take" in driver.health.message
    bench.twin.playing = False
    step(bench, driver, 2)
    assert driver.health.stamp > stamp


# -- skeletons and wrong settings

PERSON = {"wearer": {"part": "body", "script": "still"}}
PERSON_WANTED = {"segments": {"chest": "Anna/Chest", "arm": "Anna/RUArm"}}


@pytest.fixture(scope="module")
def person():
    with motive(PERSON_WANTED, {"bodies": {"Anna": BONES}}, PERSON) as bench:
        yield bench


def test_a_skeleton_s_bones_are_read_by_name(person):
    with opened(person, PERSON_WANTED) as driver:
        step(person, driver, 3)
        data, model = person.twin.motive.cell.data, person.twin.motive.cell.model
        for row, body in enumerate(("wearer/Spine3", "wearer/RightArm")):
            np.testing.assert_allclose(shown(driver, "pose")[row][:3], data.xpos[model.body(body).id], atol=2e-3)
        assert driver.health.stamp >= 0


def test_the_wrong_up_axis_is_told_and_nothing_is_used(person):
    with opened(person, PERSON_WANTED | {"up": "z"}) as driver:
        step(person, driver, 5)
        assert driver.health.stamp < 0
        assert "check 'up: z'" in driver.health.message
        assert list(shown(driver, "visible")) == [0, 0]


def test_bones_relative_to_their_parents_are_told_and_not_used(person, monkeypatch):
    made, _ = person.twin._model()
    bones = {bone.id: bone for bone in made.skeletons[0][2]}
    whole = person.twin._seen

    def relative(number, values):
        seen, sets = whole(number, values)
        for of, chain in seen.skeletons.items():
            seen.skeletons[of] = [
                bone._replace(position=bones[bone.id & 0xFFFF].offset) if bones[bone.id & 0xFFFF].parent else bone
                for bone in chain
            ]
        return seen, sets

    monkeypatch.setattr(person.twin, "_seen", relative)
    with opened(person, PERSON_WANTED) as driver:
        step(person, driver, 5)
        assert driver.health.stamp < 0
        assert "Skeleton Coordinates to Global" in driver.health.message


def test_millimetres_are_refused(monkeypatch):
    with motive() as bench:
        plain = bench.twin._answer
        wrong = protocol.packet(Message.RESPONSE, bytes.fromhex("0000803f"))

        def answer(text, peer, session):
            if text == "UnitsToMillimeters":
                bench.twin._command.write(wrong, peer)
            else:
                plain(text, peer, session)

        monkeypatch.setattr(bench.twin, "_answer", answer)
        with pytest.raises(DeviceError, match=r"lengths in 1 mm.*scale to 1"), opened(bench):
            pass


def test_nobody_there_and_an_address_that_is_none():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    for url, output in (
        (f"udp://127.0.0.1:{port}", "nobody listens there"),
        ("tcp://127.0.0.1", "isn't udp://HOST"),
        ("udp://", "isn't udp://HOST"),
        ("udp://127.0.0.1:99999", "isn't udp://HOST"),
        ("udp://no.such.host.invalid", "no host is called"),
    ):
        with pytest.raises(DeviceError, match=output):
            NatNet("mocap", NatNet.Config(port=url, segments={"a": "A"})).open()


def test_multicast_is_taken_from_the_group_on_the_server_s_network_alone():
    with motive(options={"multicast": True}) as bench, opened(bench) as driver:
        link = driver._client._data
        assert link.local == ("239.255.42.99", bench.twin._data.port)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.sendto(b"unicast to the port", ("127.0.0.1", link.local[1]))
        step(bench, driver, 2)
        assert driver.health.errors == 0
        assert TOOL["subject"] == "Drill"
