"""The driver against a scripted glove on a real pty: from a silent port to a pulled plug."""

from __future__ import annotations

import os
import pty
import select
import threading
import time
import tty
from collections.abc import Callable

import numpy as np
import pytest
from helpers.dynamixel import waiting
from helpers.wait import until
from pydantic import ValidationError

from srl.drivers.cyberglove import CyberGlove, calibration, driver
from srl.runtime.contracts.errors import DeviceError, DeviceLostError

RAW = bytes(range(10, 230, 10))
MS = 1_000_000


class ScriptedGlove:
    """Speaks from the sheet's tables on the master side of a pty, in a thread of its own.

    Attributes:
        raw, status: what the next record carries.
        streaming: as the host asked. mute: sends no records all the same.
        answers: replies to whole commands; a missing one stays unanswered.
        seen: everything the host sent.
    """

    def __init__(self, sensors: int = 22, plug: int = 3, right: int = 1) -> None:
        self.master, slave = pty.openpty()
        tty.setraw(self.master)
        self.port = os.ttyname(slave)
        os.close(slave)
        self.raw = RAW[:sensors]
        self.status = 1
        self.status_on = False
        self.streaming = False
        self.mute = False
        self.seen = b""
        self.sensors = sensors
        self.answers: dict[bytes, bytes] = {
            b"?S": b"?S" + bytes([sensors, 0]),
            b"?G": b"?G" + bytes([plug, 0]),
            b"?R": b"?R" + bytes([right, 0]),
            b"N" + bytes([sensors]): b"N\0",
            b"D\0": b"D\0",
            b"U\x01": b"U\0",
            b"^c": b"",
            b"\x03": b"e?\0",
            b"S": b"",
        }
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def send(self, data: bytes) -> None:
        os.write(self.master, data)

    def power_cycle(self) -> None:
        self.streaming = self.status_on = False

    def unplug(self) -> None:
        """The master closes, as when a USB port disappears."""
        if not self._ended.is_set():
            self._ended.set()
            self._thread.join()
            os.close(self.master)

    def _run(self) -> None:
        pending = b""
        due = time.monotonic()
        while not self._ended.is_set():
            if select.select([self.master], [], [], 0.002)[0]:
                try:
                    pending += (new := os.read(self.master, 4096))
                    self.seen += new
                except OSError:  # nobody has the slave open
                    time.sleep(0.002)
            pending = self._obey(pending)
            if self.streaming and not self.mute and time.monotonic() >= due:
                due = time.monotonic() + 0.01
                self.send(b"S" + self.raw + bytes([self.status]) * self.status_on + b"\0")

    def _obey(self, pending: bytes) -> bytes:
        while pending:
            command = next((known for known in self.answers if pending.startswith(known)), None)
            if command is None:
                return pending if len(pending) < 2 else self._obey(pending[1:])
            if command in (b"^c", b"\x03"):
                self.streaming = False
            self.streaming |= command == b"S"
            self.status_on |= command == b"U\x01"
            self.send(self.answers[command])
            pending = pending[len(command) :]
        return pending


@pytest.fixture
def impatient(monkeypatch):
    """For what never answers: the driver waits less long."""
    monkeypatch.setattr(driver, "ANSWER", 0.2)


@pytest.fixture
def make_glove():
    made: list[ScriptedGlove] = []

    def make(**options) -> ScriptedGlove:
        made.append(ScriptedGlove(**options))
        return made[-1]

    yield make
    for glove in made:
        glove.unplug()


def driver_of(glove: ScriptedGlove | str, **options) -> CyberGlove:
    port = glove if isinstance(glove, str) else glove.port
    device = CyberGlove("glove", CyberGlove.Config(port=port, **options))
    device.bind({signal.name: np.zeros(signal.shape) for signal in device.states}, {})
    return device


def read_until(device: CyberGlove, done: Callable[[], bool], now: int, step: int = 10 * MS) -> int:
    """Cycles until `done`; returns the loop time after it."""

    def later() -> None:
        nonlocal now
        now += step

    until(lambda: (device.read(now), done())[1], later, what=lambda: str(device.health), pause=0.003)
    return now


def arrived(device: CyberGlove, size: int) -> None:
    """Waits until there are so many bytes to read."""
    until(lambda: waiting(device._link.fileno()) >= size)


def still(make_glove) -> tuple[ScriptedGlove, CyberGlove]:
    """A glove whose stream has paused, read to its end at the loop time of 1 ms."""
    glove = make_glove()
    device = driver_of(glove)
    device.open()
    read_until(device, lambda: device.health.stamp > 0, now=MS, step=0)
    glove.mute = True
    while select.select([device._link], [], [], 0.05)[0]:
        device.read(MS)
    return glove, device


def expected(raw: bytes) -> np.ndarray:
    out = np.empty(len(raw))
    calibration.default(len(raw)).angles(raw, out)
    return out


@pytest.mark.parametrize("sensors", [18, 22])
def test_it_identifies_itself_and_streams(make_glove, sensors):
    glove = make_glove(sensors=sensors)
    device = driver_of(glove, sensors=sensors)
    position, buttons = device.states
    assert (position.shape, position.unit, len(position.labels)) == ((sensors,), "rad", sensors)
    assert (buttons.shape, buttons.unit, device.commands) == ((1,), "1", ())
    device.open()
    assert device.health.connected
    assert "uncalibrated" in device.health.message
    assert device.health.stamp == -1
    now = read_until(device, lambda: device.health.stamp > 0, now=5 * MS)
    assert device.health.stamp == now
    np.testing.assert_array_equal(device.state_arrays["position"], expected(RAW[:sensors]))
    assert device.state_arrays["buttons"][0] == 0
    glove.status = 3
    glove.raw = bytes([200] * sensors)
    angles = device.state_arrays["position"]
    now = read_until(device, lambda: np.array_equal(angles, expected(glove.raw)), now)
    read_until(device, lambda: device.state_arrays["buttons"][0] == 1, now)
    assert (device.health.errors, device.health.resyncs) == (0, 0)
    device.close()
    assert not device.health.connected
    until(lambda: not glove.streaming)


def test_a_persons_calibration_is_used(make_glove, tmp_path):
    file = tmp_path / "p07.yaml"
    lines = "\n".join(f"  {name}: {{gain: 0.02, offset: 100}}" for name in driver.LABELS[22])
    file.write_text(f"person: P07\ndate: 2026-02-17\nhand: right\nsensors:\n{lines}\n")
    device = driver_of(make_glove(), calibration=file)
    device.open()
    read_until(device, lambda: device.health.stamp > 0, now=MS)
    np.testing.assert_allclose(device.state_arrays["position"], 0.02 * (np.array(list(RAW)) - 100.0))
    assert device.health.message == ""
    device.close()


def test_raw_gives_the_counts_and_no_angles(make_glove):
    device = driver_of(make_glove(), raw=True)
    assert [(s.name, s.unit) for s in device.states] == [("raw", "count"), ("buttons", "1")]
    device.open()
    read_until(device, lambda: device.health.stamp > 0, now=MS)
    assert device.state_arrays["raw"].tolist() == list(RAW)
    assert device.health.message == ""
    device.close()


def test_a_calibration_of_the_other_hand_or_none_is_refused_before_the_port_is_touched(tmp_path):
    file = tmp_path / "left.yaml"
    lines = "\n".join(f"  {name}: {{gain: 0.02, offset: 100}}" for name in driver.LABELS[22])
    file.write_text(f"person: P07\ndate: 2026-02-17\nhand: left\nsensors:\n{lines}\n")
    with pytest.raises(DeviceError, match="left hand"):
        driver_of("/dev/none", calibration=file).open()
    with pytest.raises(ValidationError, match=r"there is no file .*no\.yaml"):
        driver_of("/dev/none", calibration=tmp_path / "no.yaml")


def test_without_a_new_record_the_stamp_and_the_angles_stay(make_glove):
    _, device = still(make_glove)
    before = device.state_arrays["position"].copy()
    for later in range(10, 60, 10):
        device.read(later * MS)
    assert device.health.stamp == MS
    np.testing.assert_array_equal(device.state_arrays["position"], before)
    device.close()


def test_a_backlog_is_drained_to_the_newest(make_glove):
    glove, device = still(make_glove)
    frames = device.health.frames
    for value in range(1, 101):
        glove.send(b"S" + bytes([value] * 22) + b"\x01\0")
    arrived(device, 2500)
    device.read(2 * MS)
    assert device.health.frames == frames + 100
    np.testing.assert_array_equal(device.state_arrays["position"], expected(bytes([100] * 22)))
    device.close()


def test_half_records_and_garbage_in_mid_stream(make_glove):
    glove, device = still(make_glove)
    record = b"S" + bytes([99] * 22) + b"\x01\0"
    for now, part in ((2 * MS, record[:10]), (3 * MS, record[10:])):
        assert device.health.stamp == MS
        glove.send(part)
        arrived(device, len(part))
        device.read(now)
    assert device.health.stamp == 3 * MS
    np.testing.assert_array_equal(device.state_arrays["position"], expected(bytes([99] * 22)))
    glove.send(b"\xff\x00GGG\x00 garbage S?")
    glove.mute = False
    read_until(device, lambda: device.health.stamp > 3 * MS, 4 * MS)
    np.testing.assert_array_equal(device.state_arrays["position"], expected(RAW))
    assert (device.health.errors, device.health.resyncs) == (1, 1)
    device.close()


@pytest.mark.parametrize("unplugged", [b"\x00\0", b"\x01eg\0"], ids=["status", "remark"])
def test_a_glove_pulled_from_its_interface_goes_stale_until_it_is_back(make_glove, unplugged):
    glove, device = still(make_glove)
    record = b"S" + bytes([50] * 22) + unplugged
    for now in (2 * MS, 3 * MS):
        glove.send(record)
        arrived(device, len(record))
        device.read(now)
        assert "plugged" in device.health.message
    assert device.health.stamp == MS
    assert device.health.frames >= 3
    np.testing.assert_array_equal(device.state_arrays["position"], expected(RAW))
    glove.mute = False
    read_until(device, lambda: device.health.stamp > MS, 4 * MS)
    assert "plugged" not in device.health.message
    device.close()


def test_a_glove_that_lost_its_settings_is_asked_again_once_a_second(make_glove):
    glove, device = still(make_glove)
    glove.power_cycle()
    asked = len(glove.seen)
    for later in range(0, 2500, 10):  # 2.5 s of the loop's time
        device.read((1 + later) * MS)
    request = b"N\x16D\0U\x01S"
    until(lambda: len(glove.seen) - asked >= 2 * len(request))
    assert glove.seen[asked:] == 2 * request
    assert device.metrics()["restarts"] == 2
    assert "asked for again 2 times" in device.health.message
    glove.mute = False
    read_until(device, lambda: device.health.stamp > 2500 * MS, 2510 * MS)
    np.testing.assert_array_equal(device.state_arrays["position"], expected(RAW))
    device.close()


# -- what is not a glove, or not this one


@pytest.mark.parametrize(
    ("options", "config", "match"),
    [
        ({"sensors": 18}, {}, "18 sensors, the profile says 22.*Set 'sensors: 18'"),
        ({"plug": 1}, {}, "isn't plugged into its interface"),
        ({"plug": 2}, {}, "hasn't initialised itself"),
        ({"right": 0}, {}, "this is a left glove.*Set 'hand: left'"),
        ({}, {"hand": "left"}, "this is a right glove"),
    ],
)
def test_a_glove_that_does_not_fit_is_refused(make_glove, options, config, match):
    glove = make_glove(**options)
    device = driver_of(glove, **config)
    with pytest.raises(DeviceError, match=rf"glove \({glove.port}\): .*{match}"):
        device.open()
    assert not device.health.connected
    with pytest.raises(DeviceLostError):
        device.read(0)


def test_a_left_glove_is_accepted_where_the_profile_says_so(make_glove):
    device = driver_of(make_glove(right=0), hand="left")
    device.open()
    device.close()


@pytest.mark.usefixtures("impatient")
def test_a_silent_port_is_named(make_glove):
    glove = make_glove()
    glove.answers = {}
    with pytest.raises(DeviceError, match=r"answer to b'\?S', got nothing"):
        driver_of(glove).open()


@pytest.mark.usefixtures("impatient")
def test_another_device_is_shown_by_its_bytes(make_glove):
    glove = make_glove()
    glove.answers = {b"?S": bytes.fromhex("f9 02 05 f0 79 02 05 f7")}  # a Firmata board's greeting
    with pytest.raises(DeviceError, match="got the bytes f9 02 05 f0 79"):
        driver_of(glove).open()


@pytest.mark.usefixtures("impatient")
def test_a_device_that_never_stops_talking_is_refused(make_glove):
    glove = make_glove()
    del glove.answers[b"^c"], glove.answers[b"\x03"]
    glove.streaming = True
    with pytest.raises(DeviceError, match="keeps sending"):
        driver_of(glove).open()


def test_a_stream_left_on_by_another_program_is_stopped_first(make_glove):
    glove = make_glove()
    glove.streaming = True
    device = driver_of(glove)
    device.open()
    read_until(device, lambda: device.health.stamp > 0, now=MS)
    assert device.health.errors == 0
    device.close()


@pytest.mark.usefixtures("impatient")
def test_a_glove_that_answers_but_does_not_stream_is_refused(make_glove):
    glove = make_glove()
    glove.mute = True
    with pytest.raises(DeviceError, match="doesn't stream: it sent nothing"):
        driver_of(glove).open()


# -- loss


def test_an_unplugged_port_is_a_loss_and_another_opens(make_glove, monkeypatch):
    glove, device = still(make_glove)
    glove.unplug()
    with pytest.raises(DeviceLostError, match="hung up"):
        device.read(20 * MS)
    assert not device.health.connected
    device.close()
    device.close()
    with pytest.raises(DeviceError, match="there is no port"):
        device.open()
    back = make_glove()
    monkeypatch.setattr(device, "port", back.port)  # a pty has another name when it comes back
    device.open()
    assert device.health.reconnects == 1
    read_until(device, lambda: device.health.stamp >= 200 * MS, now=200 * MS)
    device.close()


def test_the_same_port_opens_again_after_close(make_glove):
    device = driver_of(make_glove())
    for turn in range(1, 4):
        device.open()
        read_until(device, lambda turn=turn: device.health.stamp >= turn * 100 * MS, now=turn * 100 * MS)
        device.close()
    assert device.health.reconnects == 2
