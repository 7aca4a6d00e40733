"""A recorded device: its samples, intervals and ages again; what happens at the end."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.run import call, summary
from helpers.zenoh import Still, bound

from srl.drivers.replay import Replay, ReplayConfig, track
from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.errors import DeviceError, DeviceLostError, RecordingError
from srl.runtime.contracts.terms import POINT, POSE
from srl.runtime.ipc.header import LINK_CONNECTED
from srl.runtime.ipc.layout import Layout
from srl.runtime.recording.reader import Recording, read
from srl.sim.devices.replay.fake import FakeReplay, FakeReplayOptions

MS = 1_000_000


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """3 s of the sixth finger."""
    folder = tmp_path_factory.mktemp("replay")
    call(folder, "run", "sixth-finger", "--sim", "--fast", "--duration", "3", "--record", "run.rrd")
    return folder / "run.rrd"


def made_up() -> tuple[Layout, np.ndarray]:
    """Rows at 100 Hz of a device of 50 Hz whose samples are 5 ms old; silent from 0.5 to 0.7 s."""
    layout = Layout(["glove", "finger"])
    layout.add("glove.position", "state", (2,), "rad", labels=("a", "b"))
    layout.add("glove.buttons", "state", (1,), "1")
    rows = np.zeros((100, layout.width), np.int64)
    index = {name: i for i, name in enumerate(layout.int_names)}
    stamp = -1
    for k, row in enumerate(rows):
        now = 10**12 + k * 10 * MS
        if k % 2 == 0 and not 50 <= k < 70:
            stamp = now - 5 * MS
        row[index["now"]], row[index["glove.stamp"]], row[index["glove.link"]] = now, stamp, LINK_CONNECTED
        row[layout.ints :].view(np.float64)[:] = k, -k, k % 3
    return layout, rows


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> None:
    layout, rows = made_up()
    recording = Recording(Path("made.rrd"), layout, np.arange(1, len(rows) + 1), rows, [], [], 0)

    def load(path: str, device: str, start: float) -> track.Track:
        return track.Track(recording, device, start, path)

    monkeypatch.setattr("srl.drivers.replay.driver.load", load)


def replay(**options: Any) -> Replay:
    device = Replay("glove", ReplayConfig(**({"recording": "made.rrd", "device": "glove"} | options)))
    bound(device)
    return device


def test_what_an_earlier_version_did_not_name_is_named() -> None:
    layout = Layout(["mocap"])
    for name, shape in (("wand.pose", (7,)), ("pose", (2, 7)), ("markers", (2, 3)), ("emg", (2, 5)), ("count", (1,))):
        layout.add(f"mocap.{name}", "state", shape, "m")
    rows = np.zeros((3, layout.width), np.int64)
    rows[:, layout.int_names.index("now")] = rows[:, layout.int_names.index("mocap.stamp")] = range(1, 4)
    rows[:, layout.int_names.index("mocap.link")] = LINK_CONNECTED
    found = track.Track(Recording(Path("x.rrd"), layout, np.arange(1, 4), rows, [], [], 0), "mocap", 0.0, "x.rrd")
    assert not any(signal.naming_fault() for signal in found.signals)
    assert [signal.labels for signal in found.signals] == [POSE, (), (), (), ()]
    assert [signal.slots for signal in found.signals] == [False, True, True, True, False]
    assert [signal.components for signal in found.signals][1:3] == [(POSE,), (POINT,)]


@pytest.mark.usefixtures("made")
def test_samples_come_at_their_intervals_as_old_as_they_were() -> None:
    device = replay()
    assert [(s.name, s.shape, s.unit, s.labels) for s in device.states] == [
        ("position", (2,), "rad", ("a", "b")), ("buttons", (1,), "1", ()),
    ]  # fmt: skip
    device.open()
    start = 77 * 10**9
    for k in range(50):
        device.read(start + k * 10 * MS)
        sample = k - k % 2
        assert device.state_arrays["position"].tolist() == [sample, -sample]
        assert device.health.stamp == start + sample * 10 * MS - 5 * MS
    assert device.health.frames == 25
    for k in range(50, 70):  # it was silent then
        device.read(start + k * 10 * MS)
        assert device.health.stamp == start + 48 * 10 * MS - 5 * MS
    device.read(start + 70 * 10 * MS + 1)
    assert device.state_arrays["position"][0] == 70
    # A slow loop gets the newest and counts them all.
    device.read(start + 80 * 10 * MS)
    assert device.state_arrays["position"][0] == 80
    assert device.health.frames == 31


@pytest.mark.usefixtures("made")
def test_the_end() -> None:
    start, after = 10**9, 10**9 + 1000 * MS
    lose = replay()
    lose.open()
    lose.read(start)
    with pytest.raises(DeviceLostError, match="over"):
        lose.read(after)
    assert not lose.health.connected
    lose.close()
    with pytest.raises(DeviceError, match="over"):
        lose.open()

    hold = replay(at_end="hold")
    hold.open()
    hold.read(start)
    hold.read(after)
    assert (hold.health.stamp, hold.state_arrays["position"][0]) == (after, 98.0)

    loop = replay(at_end="loop")
    loop.open()
    loop.read(start)
    loop.read(start + 1000 * MS)
    assert loop.state_arrays["position"][0] == 0.0
    assert loop.health.stamp == start + 1000 * MS - 5 * MS
    loop.read(start + 2040 * MS)
    assert loop.state_arrays["position"][0] == 4.0


@pytest.mark.usefixtures("made")
def test_it_begins_where_it_is_told_and_again_when_opened_again() -> None:
    device = replay(start=0.3)
    for begin in (5 * 10**9, 50 * 10**9):
        device.open()
        device.read(begin)
        assert device.state_arrays["position"][0] == 30.0
        device.read(begin + 100 * MS)
        assert device.state_arrays["position"][0] == 40.0
        device.close()
    assert device.health.reconnects == 1
    with pytest.raises(DeviceLostError):
        device.read(0)


@pytest.mark.usefixtures("made")
@pytest.mark.parametrize(
    ("options", "output"), [({"device": "glov"}, "Did you mean 'glove'"), ({"start": 5.0}, "no sample after 5 s")]
)
def test_what_is_not_there_is_said(options: dict[str, Any], output: str) -> None:
    with pytest.raises(RecordingError, match=output):
        replay(**options)


def test_a_missing_file_is_said(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="no such file"):
        replay(recording=str(tmp_path / "none.rrd"))


@pytest.mark.usefixtures("made")
def test_the_fake_plays_on_world_time() -> None:
    config = ReplayConfig(recording="made.rrd", device="glove", at_end="hold")
    world = Still()
    fake: Driver = bound(FakeReplay("glove", config, world, FakeReplayOptions(loss=((0.2, 0.3),))))
    fake.open()
    offset = 5 * 10**9
    for k in range(20):
        world.advance(k * 10 * MS)
        fake.read(offset + world.time)
        assert fake.health.stamp == offset + (k - k % 2) * 10 * MS - 5 * MS
    world.advance(200 * MS)
    with pytest.raises(DeviceLostError):
        fake.read(offset + world.time)
    with pytest.raises(DeviceError):
        fake.open()
    world.advance(400 * MS)
    fake.open()
    fake.read(offset + world.time)
    assert fake.state_arrays["position"][0] == 40.0  # it went on meanwhile


@pytest.mark.slow
def test_a_run_with_a_recorded_glove_commands_what_was_commanded(recording: Path, tmp_path: Path) -> None:
    """Real driver and fake, in the place of the device that was recorded."""
    device = f"devices.glove={{driver: replay, recording: {recording}, device: glove, at_end: hold}}"
    call(
        tmp_path, "run", "sixth-finger", "--set", device, "--sim", "--fast",
        "--duration", "2.5", "--record", "again.rrd",
    )  # fmt: skip
    first, again = read(recording), read(tmp_path / "again.rrd")
    name = "finger.position_command"
    one, other = first.value(name), again.value(name)
    best = min(  # of both the first samples don't count, and the replay begins some cycles before or after the other
        float(np.abs(one[5 + shift : 205 + shift] - other[5:205]).max()) for shift in range(-5, 6)
    )
    assert best < 0.02
    done = call(tmp_path, "run", "sixth-finger", "--set", device, "--sim", "finger", "--duration", "2", "--json")
    found = summary(done)
    assert found["devices"]["glove"]["errors"] == 0
    call(tmp_path, "replay", "again.rrd")
