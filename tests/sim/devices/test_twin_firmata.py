"""The board's twin: the sheet's vectors, the servo rules, and our own driver moving the simulated finger."""

import math
from typing import Any

import numpy as np
import pytest
from helpers.sim import world
from helpers.twin import Bench, Client, bound
from helpers.wait import until

from srl.drivers.firmata import Firmata
from srl.drivers.firmata.config import FirmataConfig
from srl.drivers.firmata.protocol import Decoder, PinState, Text
from srl.runtime.contracts.errors import DeviceLostError
from srl.runtime.contracts.signals import Stop
from srl.sim.devices.firmata.fake import FakeFirmata, FakeFirmataConfig
from srl.sim.devices.firmata.twin import FirmataTwin

# Sheet firmata, §3: what a real Uno says.
BOOT = bytes.fromhex(
    "f9 02 05 f0 79 02 05 53 00 74 00 61 00 6e 00 64 00 61 00 72 00 64 00 46 00 69 00 72 00 6d 00 61 00 74 00"
    "61 00 2e 00 69 00 6e 00 6f 00 f7"
)
ANALOG_MAP = bytes.fromhex("f0 6a") + b"\x7f" * 14 + bytes.fromhex("00 01 02 03 04 05 f7")
DIGITAL, WITH_PWM = "00 01 0b 01 01 01 04 0e 7f", "00 01 0b 01 01 01 03 08 04 0e 7f"
WITH_ANALOG = "00 01 0b 01 01 01 02 0a 04 0e"
CAPABILITIES = bytes.fromhex(
    "f0 6c 7f 7f"
    + "".join(WITH_PWM if pin in (3, 5, 6, 9, 10, 11) else DIGITAL for pin in range(2, 14))
    + (WITH_ANALOG + "7f") * 4
    + (WITH_ANALOG + "06 01 7f") * 2
    + "f7"
)
PINS = {"abduction": 9, "flexion_1": 10, "flexion_2": 11, "flexion_3": 6}
BUTTONS = {"go": 2, "back": 3}
# Before attaching, as pyfirmata2 does it (§5): servo_config 544 to 2400, then value 0.
ATTACH = bytes.fromhex("f0 70 09 20 04 60 12 f7  e9 00 00")


def config(port: str = "/dev/null") -> FirmataConfig:
    servos = {name: {"pin": pin, "lower": -1.571, "upper": 1.571, "home": 0.35} for name, pin in PINS.items()}
    buttons = {name: {"pin": pin} for name, pin in BUTTONS.items()}
    return FirmataConfig.model_validate({"port": port, "servos": servos, "buttons": buttons})


def make(**options: Any) -> FirmataTwin:
    return FirmataTwin(FakeFirmata("finger", config(), world(), FakeFirmataConfig(**options)))


def pulses(twin: FirmataTwin) -> dict[str, Any]:
    found = twin.metrics()["pulses_us"]
    assert isinstance(found, dict)
    return found


def board(**options: Any) -> FirmataTwin:
    """A board past its boot, without a port."""
    twin = make(**options)
    twin.connected(0)
    assert twin.work(49_999_999) == b""
    assert twin.work(50_000_000) == BOOT
    return twin


def test_opening_the_port_resets_the_board_which_then_says_who_it_is():
    with Bench(make()) as bench:
        for _ in range(2):
            with Client(bench) as client:
                client.send(b"\xf9")  # lost: the board is booting
                bench.run(0.040)
                assert client.rest() == b""
                bench.run(0.020)
                assert client.rest() == BOOT
                client.send(ATTACH)
                assert pulses(bench.twin)["abduction"] == 544
            bench.run(0.010)
            assert pulses(bench.twin)["abduction"] == 544  # a board whose client left goes on
        client = Client(bench)
        assert pulses(bench.twin)["abduction"] is None  # reset
        client.close()


def test_answers_byte_for_byte():
    with Bench(make()) as bench, Client(bench) as client:
        bench.run(0.060)
        client.read(len(BOOT))
        for ask, answer in (
            ("f9", BOOT[:3]),
            ("f0 79 f7", BOOT[3:]),
            ("f0 6b f7", CAPABILITIES),
            ("f0 69 f7", ANALOG_MAP),
            ("f0 6d 09 f7", bytes.fromhex("f0 6e 09 01 00 f7")),
            ("f0 6d 10 f7", bytes.fromhex("f0 6e 10 02 00 f7")),
        ):
            assert client.ask(bytes.fromhex(ask), len(answer)).hex(" ") == answer.hex(" ")
        assert client.rest() == b""


@pytest.mark.parametrize(
    ("sent", "pulse"),
    [
        (ATTACH.hex(), 544),
        ("e9 2d 00", 1008),
        ("e9 5a 00", 1472),
        ("e9 07 01", 1936),
        ("e9 34 01", 2400),
        ("e9 7f 03", 2400),  # 511 is an angle beyond 180 degrees
        ("e9 1f 04", 2400),  # 543 too
        ("e9 20 04", 544),  # 544 is a pulse
        ("f0 6f 09 5c 0b f7", 1500),
        ("f0 6f 09 60 12 f7", 2400),
        ("f0 6f 09 38 17 f7", 2400),  # 3000 us
        ("f0 70 09 68 07 50 0f f7 e9 5a 00", 1500),  # 1000 to 2000 us, 90 degrees
        ("f0 70 09 68 07 50 0f f7 e9 00 00", 1000),
        ("f0 70 09 68 07 50 0f f7 e9 34 01", 2000),
        ("f0 70 09 68 07 50 0f f7 e9 60 12", 2000),
        ("f4 09 04", 1500),  # attached without a value: the middle
        ("f4 09 04 e9 34 01 f4 09 01 f4 09 04", 2400),  # attached again: the last one
        ("f4 09 04 e9 34 01 ff f4 09 04", 2400),  # also after a reset by message
        ("e9 34 01 f4 09 01", None),
        ("e9 34 01 ff", None),
    ],
)
def test_servo_pulses(sent, pulse):
    twin = board()
    twin.receive(ATTACH if not sent.startswith("f4") else b"", 0)
    twin.receive(bytes.fromhex(sent), 0)
    assert pulses(twin)["abduction"] == pulse
    assert {pulses(twin)[name] for name in ("flexion_1", "flexion_2", "flexion_3")} == {None}


def test_a_detached_servo_s_place_and_last_pulse_go_to_the_next_one_attached():
    twin = board()
    twin.receive(bytes.fromhex("f4 09 04 e9 34 01 f4 0a 04 ea 00 00 f4 09 01 f4 0b 04"), 0)
    assert pulses(twin) == {"abduction": None, "flexion_1": 544, "flexion_2": 2400, "flexion_3": None}


def test_at_most_twelve_servos():
    twin = board()
    assert twin.receive(b"".join(bytes((0xF4, pin, 4)) for pin in range(2, 14)), 0) == b""
    (text,) = Decoder().feed(twin.receive(b"\xf4\x0e\x04", 0))
    assert text == Text("Max servos attached")
    twin.receive(b"\xff", 0)
    assert twin.receive(b"\xf4\x0e\x04", 0) == b""


def test_unknown_modes_are_complained_about():
    assert Decoder().feed(board().receive(b"\xf4\x09\x22", 0)) == [Text("Unknown pin mode")]


@pytest.mark.parametrize(
    ("sent", "value"),
    [
        ("05 e9 06 00", 6),  # data nobody waits for
        ("e9 05 f9 0b", 5 | 11 << 7),  # a query in between doesn't cancel a command
        ("e9 05 f7 0b", 5 | 11 << 7),
        ("e9 05 f0 6d 0a f7 0b", 0x0A | 11 << 7),  # the sysex message overwrites the value's first half
        ("e9 05 e9 06 00", 6),  # another command does cancel it
        ("e9 05 ff f4 09 04 0b", 0),
        ("f0 70 09 20 f7 e9 06 00", 6),  # a sysex message cut short does nothing
        ("f0 e9 05 00 f7 e9 06 00", 6),  # within sysex everything is data
        ("f0 ff f7 e9 06 00", 6),
    ],
)
def test_commands_that_interrupt_each_other(sent, value):
    twin = board()
    twin.receive(bytes.fromhex("f4 09 04"), 0)
    twin.receive(bytes.fromhex(sent), 0)
    states = [m for m in Decoder().feed(twin.receive(b"\xf0\x6d\x09\xf7", 0)) if isinstance(m, PinState)]
    assert states == [PinState(9, 4, value)]


def test_buttons_report_at_once_and_at_every_change():
    with (
        Bench(make(presses={"go": ((0.2, 0.3),), "back": ((0.25, 0.35),)})) as bench,
        Client(bench) as client,
    ):
        bench.run(0.060)
        client.read(len(BOOT))
        assert client.ask(bytes.fromhex("f4 02 0b f4 03 0b d0 01"), 3) == b"\x90\x0c\x00"
        bench.run(0.130)
        assert client.rest() == b""
        bench.run(0.200)
        assert client.rest() == b"\x90\x08\0" + b"\x90\0\0" + b"\x90\x04\0" + b"\x90\x0c\0"
        client.send(b"\xd0\0")
        assert client.rest() == b""


def test_without_a_pull_up_a_button_s_pin_floats_low():
    twin = board()
    assert twin.receive(bytes.fromhex("f4 02 00 d0 01"), 0) == b"\x90\0\0"
    twin.receive(bytes.fromhex("90 04 00"), 0)  # the old way to a pull-up: 1 written to an input
    assert twin.work(60_000_000) == b"\x90\x04\0"


def test_analog_reports_come_once_per_sampling_interval():
    with Bench(make()) as bench, Client(bench) as client:
        bench.run(0.060)
        client.read(len(BOOT))
        client.send(bytes.fromhex("f0 7a 0a 00 f7 c1 01"))
        bench.run(1.0)
        assert abs(len(client.rest()) / 3 - 101) <= 2


def test_the_sysex_limit_is_counted():
    twin = board()
    twin.receive(b"\xf0" + b"\x79" * 65 + b"\xf7", 0)
    assert twin.metrics()["too_long"] == 1


# -- our own driver


def driver_at(bench: Bench) -> Firmata:
    driver = Firmata("finger", config(bench.twin.address))
    bound(driver, driver.home)
    return driver


def command(driver: Firmata, bench: Bench, angles: Any) -> None:
    """One command, delivered and answered at the same instant of simulated time."""
    driver.command_arrays["position_command"][:] = angles
    driver.write(bench.now)
    until(lambda: not driver._waiting, lambda: (bench.twin.service(bench.now), driver.read(bench.now)))


def test_our_driver_moves_the_finger_as_the_fake_does():
    """Both doors, equal worlds, equal commands: equal trajectories, and the finger gets where it is sent."""
    twin = make()
    other = FakeFirmata("finger", config(), world(), FakeFirmataConfig())
    bound(other, other.home)
    with Bench(twin) as bench:
        driver = driver_at(bench)
        with bench.running(frozen=True):
            driver.open()
        other.open()
        bench.now = 0
        path = []
        for k in range(150):
            s = min(k / 80, 1.0)
            angles = [0.3 * s, 0.35 + 0.6 * s, 0.35 + 0.3 * math.sin(4 * s), 0.35 - 0.2 * s]
            command(driver, bench, angles)
            other.command_arrays["position_command"][:] = angles
            other.write(other.world.time)
            bench.run(0.010)
            other.world.advance(bench.now)
            np.testing.assert_array_equal(
                bench.world.truth_arrays["finger_position"], other.world.truth_arrays["finger_position"]
            )
            path.append(bench.world.truth_arrays["finger_position"].copy())
        assert np.ptp(path, axis=0).min() > 0.15
        targets = [*twin.board.servos.targets().values()]
        np.testing.assert_allclose(targets, angles, atol=0.0068 + 0.0009)  # the dead band and a microsecond
        np.testing.assert_allclose(path[-1], angles, atol=0.05)  # gravity and friction against the position loop
        driver.stop(Stop.LIMP)
        until(lambda: set(pulses(twin).values()) == {None}, lambda: bench.twin.service(bench.now))
        bench.run(0.050)
        assert np.isnan([*twin.board.servos.targets().values()]).all()
        bench.run(0.5)
        assert np.abs(bench.world.truth_arrays["finger_position"] - path[-1]).max() > 0.1  # it hangs
        driver.close()


def test_our_driver_sees_a_board_that_restarts_and_one_that_hangs():
    with Bench(make()) as bench:
        driver = driver_at(bench)
        with bench.running():
            driver.open()
        command(driver, bench, 0.35)
        bench.twin.muted = True
        driver.command_arrays["position_command"][:] = 0.5
        driver.write(bench.now)
        bench.run(0.020)
        driver.read(bench.now)
        assert driver.health.unsent > 0
        bench.twin.muted = False
        bench.twin.restart()
        bench.run(0.060)
        with pytest.raises(DeviceLostError, match="restarted by itself"):
            until(lambda: False, lambda: driver.read(bench.now))
        assert set(pulses(bench.twin).values()) == {None}
        driver.close()


def test_a_board_that_is_pulled_out_goes_on_and_is_reset_when_opened_again():
    twin = make(loss=((6.0, 6.5),))
    with Bench(twin) as bench:
        driver = driver_at(bench)
        with bench.running():
            driver.open()
        assert bench.now < 6_000_000_000
        command(driver, bench, 0.5)
        bench.run(6.01 - bench.now * 1e-9)
        with pytest.raises(DeviceLostError):
            driver.read(bench.now)
        assert set(pulses(twin).values()) != {None}
        np.testing.assert_allclose([*twin.board.servos.targets().values()], 0.5, atol=0.001)
        driver.close()
        bench.run(0.5)
        driver = driver_at(bench)
        with bench.running():
            driver.open()
        assert set(pulses(twin).values()) == {None}
        driver.close()


def test_figures_and_log_tell_when_servos_were_commanded():
    twin = make()
    twin.keep_log = True
    with Bench(twin) as bench, Client(bench) as client:
        bench.run(0.060)
        client.send(ATTACH)
        at = bench.now
        bench.run(0.010)
        client.send(b"\xe9\x5a\x00\xff")
        metrics, log = twin.metrics(), twin.log()
        assert metrics["last_command_ns"] == at + 10_000_000
        assert metrics["messages"] == {"sysex": 1, "analog_write": 2, "reset": 1}
        assert bytes(log["rx"]) == ATTACH + b"\xe9\x5a\x00\xff"
        np.testing.assert_array_equal(log["rx_ns"][[0, -1]], [at, bench.now])
        np.testing.assert_array_equal(log["pulse_us"], [1500, 544, 1472, np.nan])
        np.testing.assert_array_equal(log["servo_ns"], [at, at, bench.now, bench.now])
