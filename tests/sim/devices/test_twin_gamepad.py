"""The gamepad's driver on its twin, and the fake beside it."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from helpers.twin import StillWorld, bound

from srl.drivers.evdev.records import EV_ABS, AxisInfo, Description, encode
from srl.drivers.gamepad import Gamepad, GamepadConfig
from srl.drivers.gamepad.driver import BUTTONS, HAT, STICKS, TRIGGERS
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.sim.devices.gamepad.fake import FakeGamepad, FakeGamepadConfig
from srl.sim.devices.gamepad.twin import GamepadTwin

SCRIPT: dict[str, Any] = {
    "axes": {"left_x": [[0, 0], [1, 1]], "left_y": [[0, 0], [1, -0.5]], "right_trigger": [[0, 0], [1, 1]]},
    "dpad": {"y": [[0, 0], [1, 1]]},
    "buttons": {"lb": [[0.2, 0.6]], "a": [[0.5, 2.0]]},
}


class Pair:
    """A fake, its twin, and the driver that talks to it."""

    def __init__(self, **options: Any) -> None:
        self.world = StillWorld()
        self.fake = bound(FakeGamepad("pad", GamepadConfig(), self.world, FakeGamepadConfig(**options)))
        self.twin = GamepadTwin(self.fake)
        self.twin.open()
        self.driver: Gamepad = bound(Gamepad("pad", GamepadConfig(port=self.twin.address)))
        self.now = 0

    def opened(self) -> Pair:
        from threading import Event, Thread

        done = Event()
        server = Thread(target=lambda: [self.twin.service(0) for _ in iter(lambda: done.wait(0.001), True)])
        server.start()
        try:
            self.driver.open()
        finally:
            done.set()
            server.join()
        self.fake.open()
        return self

    def at(self, seconds: float) -> Pair:
        self.now = self.world.time = round(seconds * 1e9)
        self.twin.service(self.now)
        self.driver.read(self.now)
        self.fake.read(self.now)
        return self

    def close(self) -> None:
        self.driver.close()
        self.twin.close()


@pytest.fixture
def pair() -> Iterator[Pair]:
    made = Pair(**SCRIPT).opened()
    yield made
    made.close()


def test_both_doors_say_the_same(pair: Pair) -> None:
    for seconds in np.linspace(0, 2, 41):
        pair.at(seconds)
        for name, values in pair.driver.state_arrays.items():
            np.testing.assert_allclose(values, pair.fake.state_arrays[name], atol=1.5e-3, err_msg=f"{name} {seconds}")
    assert pair.driver.state_arrays["axes"][:2] == pytest.approx([2 / 5**0.5, -1 / 5**0.5], abs=1e-3)
    assert pair.driver.state_arrays["axes"][5] == 1
    assert pair.driver.health.stamp == pair.now


def test_up_and_right_are_positive_and_the_dead_zone_is_cut_out(pair: Pair) -> None:
    pair.at(0.08)
    assert pair.driver.state_arrays["axes"].tolist() == [0, 0, 0, 0, 0, pytest.approx(0.08, abs=0.01)]
    pair.at(0.2)
    x, y = pair.driver.state_arrays["axes"][:2]
    assert np.hypot(x, y) == pytest.approx((np.hypot(0.2, 0.1) - 0.1) / 0.9, abs=1e-3)
    assert y < 0
    pair.at(1.0)
    assert pair.driver.state_arrays["dpad"].tolist() == [0, 1]


def test_unplugged_while_deflected_everything_is_neutral(pair: Pair) -> None:
    pair.at(1.0)
    assert pair.driver.state_arrays["axes"].any()
    pair.twin.close_node()
    with pytest.raises(DeviceLostError):
        pair.driver.read(pair.now)
    assert not any(values.any() for values in pair.driver.state_arrays.values())
    assert not pair.driver.health.connected
    with pytest.raises(DeviceError, match="there is no"):
        pair.driver.open()
    pair.twin.open()
    pair.opened().at(1.0)
    assert pair.driver.health.reconnects == 1
    assert pair.driver.state_arrays["axes"][5] == 0  # held while it was opened: it counts once it was let go


@pytest.mark.slow
def test_an_overflow_of_the_kernels_buffer_is_made_good_by_the_whole_state(pair: Pair) -> None:
    pair.at(0)
    for k in range(20_000):
        pair.world.time = round((k % 1000) * 1e6)
        pair.twin.service(pair.world.time)
    assert pair.twin.drops
    pair.world.time = round(1.5e9)
    for _ in range(200):
        pair.driver.read(1)
        pair.twin.service(1)
    pair.fake.read(1)
    assert pair.driver.health.resyncs
    np.testing.assert_allclose(pair.driver.state_arrays["axes"], pair.fake.state_arrays["axes"], atol=1.5e-3)
    assert pair.driver.state_arrays["buttons"].tolist() == pair.fake.state_arrays["buttons"].tolist()


def test_d_mode_is_refused_with_the_remedy() -> None:
    pair = Pair()
    pair.twin.d_mode = True
    with pytest.raises(DeviceError, match=r"in D mode\. Set the switch on its back to X"):
        pair.opened()
    assert not pair.driver.health.connected
    pair.close()


def test_another_device_is_refused_by_what_it_lacks(tmp_path: Any) -> None:
    path = str(tmp_path / "mouse")
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(path)
        listener.listen()
        driver = Gamepad("pad", GamepadConfig(port=path))
        from threading import Thread

        def serve() -> None:
            end, _ = listener.accept()
            end.sendall(Description("Mouse", "", 1, 2, 3, frozenset([0x110])).to_line() + encode(0, [(EV_ABS, 9, 4)]))
            end.recv(1)
            end.close()

        server = Thread(target=serve)
        server.start()
        with pytest.raises(DeviceError, match="'Mouse' isn't a pad in X mode: it lacks axis 0x00"):
            driver.open()
        server.join()


def test_nothing_plugged_in_is_said() -> None:
    with pytest.raises(DeviceError, match="no Logitech F310 is plugged in"):
        Gamepad("pad", GamepadConfig()).open()


def test_a_script_with_an_unknown_button_is_refused() -> None:
    with pytest.raises(ValueError, match="'start ' isn't one of a, b"):
        FakeGamepadConfig(buttons={"start ": [[0, 1]]})


def layout(**ranges: AxisInfo) -> Description:
    axes = {code: AxisInfo(0, -32768, 32767) for code in (*STICKS, *HAT)}
    axes |= {code: AxisInfo(0, 0, 255) for code in TRIGGERS}
    axes |= {int(name.removeprefix("axis"), 16): info for name, info in ranges.items()}
    return Description("Pad", "", 1, 2, 3, frozenset(BUTTONS.values()), frozenset(), axes)


def test_an_axis_without_room_to_both_sides_is_refused_and_others_don_t_matter() -> None:
    pad = Gamepad("pad", GamepadConfig(port="x"))
    for narrow in (AxisInfo(0, 0, 0), AxisInfo(0, 0, 1), AxisInfo(0, -1, 0), AxisInfo(0, 5, -5)):
        with pytest.raises(DeviceError, match="axis 0x10 has no range"):
            pad._check("x", layout(axis10=narrow))
    pad._check("x", layout(axis28=AxisInfo(0, 0, 0), axis2=AxisInfo(0, 0, 1)))


def test_somebody_can_hold_an_axis_in_place_of_its_script(pair: Pair) -> None:
    pair.at(1.0)
    before = pair.fake.state_arrays["axes"].copy()
    pair.fake.hold("right_trigger", 0.4)
    pair.at(1.5)
    after = pair.fake.state_arrays["axes"]
    assert after[5] == pytest.approx(0.4, abs=1 / 255)
    assert after[:5] == pytest.approx(before[:5])
    assert pair.driver.state_arrays["axes"][5] == after[5]
