"""Numbers on a serial line: what is a sample and what isn't, whoever sends it; and the twin of such a board."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.twin import Bench
from helpers.wait import until
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from srl.drivers.serial_lines import SerialLines, SerialLinesConfig
from srl.drivers.serial_lines.protocol import Parser, encode
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.sim.devices.examples import THING
from srl.sim.devices.serial_lines.fake import FakeSerialLines
from srl.sim.devices.serial_lines.twin import BOOT, SerialLinesTwin
from srl.sim.devices.shared.numbers import FakeNumbersOptions
from srl.sim.world.cell import Cell, CellConfig
from srl.testing import bound

SIGNALS = {"force": {"elements": {"toe": 1, "heel": 2}, "unit": "N", "gain": 0.5, "offset": {"toe": -1.0, "heel": 0.0}}}


def config(**changes: Any) -> SerialLinesConfig:
    given = {"port": "/dev/null", "columns": 3, "signals": SIGNALS} | changes
    return SerialLinesConfig.model_validate(given)


TEXT, NMEA = config(), config(checksum="xor", prefix="$F,")
SUM = config(checksum="sum", separator=" ")
BINARY = config(format="binary", header="AA55", fields="<hhB", checksum="sum")
PLAIN = config(format="binary", header="A55A", fields=">fif")


@pytest.mark.parametrize(
    ("setting", "data", "numbers"),
    [
        (TEXT, b"10, 20.5,-3e1\r\n", [10.0, 20.5, -30.0]),
        (NMEA, b"$F,1,2,3*5A\n", [1.0, 2.0, 3.0]),  # F ^ , ^ 1 ^ , ^ 2 ^ , ^ 3, as in NMEA 0183
        (SUM, b"1 2 3*D6\n", [1.0, 2.0, 3.0]),  # 0x31+0x20+0x32+0x20+0x33
        (BINARY, bytes.fromhex("AA55 0A00 F6FF 07 06"), [10.0, -10.0, 7.0]),  # 0A+F6+FF+07 = 206
        (PLAIN, bytes.fromhex("A55A 3FC00000 FFFFFFFE 00000000"), [1.5, -2.0, 0.0]),
    ],
)
def test_bytes_written_by_hand(setting: SerialLinesConfig, data: bytes, numbers: list[float]) -> None:
    parser = Parser(setting)
    if setting.format == "text":
        parser.feed(b"cut\n")  # the first line may have been begun before
    assert parser.feed(data) == [numbers], parser.why
    assert parser.errors == 0


@pytest.mark.parametrize("setting", [TEXT, NMEA, SUM, BINARY, PLAIN])
def test_what_is_encoded_is_found_wherever_it_is_cut(setting: SerialLinesConfig) -> None:
    samples = [[1.0, -2.0, 3.0], [100.0, 0.0, 7.0], [-5.0, 44.0, 0.0]]
    data = b"".join(encode(setting, sample) for sample in samples)
    for at in range(len(data)):
        parser = Parser(setting)
        parser.feed(b"\n" if setting.format == "text" else b"")
        assert parser.feed(data[:at]) + parser.feed(data[at:]) == samples


@pytest.mark.parametrize("setting", [TEXT, NMEA, SUM, BINARY, PLAIN])
@given(data=st.binary(max_size=200))
def test_any_bytes_raise_nothing(setting: SerialLinesConfig, data: bytes) -> None:
    for sample in Parser(setting).feed(data + b"\n"):
        assert len(sample) == 3


@pytest.mark.parametrize("setting", [NMEA, SUM, BINARY])
def test_a_flipped_bit_is_no_sample(setting: SerialLinesConfig) -> None:
    frame = encode(setting, [11.0, 22.0, 33.0])
    for at in range(len(frame)):
        for bit in range(8):
            parser = Parser(setting)
            parser.feed(b"\n" if setting.format == "text" else b"")
            for found in parser.feed(frame[:at] + bytes((frame[at] ^ 1 << bit,)) + frame[at + 1 :] + b"\n"):
                assert found == [11.0, 22.0, 33.0]  # it was a byte around it: \r, or the case of a hex digit


@pytest.mark.parametrize(
    "line", [b"1,2", b"1,2,3,4", b"1,2,x", b"1,2,", b"1,2,nan", b"1,2,inf", b"1_0,2,3", b"\xff,2,3", b"1,2,0x3"]
)
def test_a_line_of_another_form_is_an_error(line: bytes) -> None:
    parser = Parser(TEXT)
    parser.feed(b"\n")
    assert parser.feed(line + b"\n") == []
    assert parser.errors == 1


def test_a_line_without_end_is_given_up() -> None:
    parser = Parser(TEXT)
    parser.feed(b"\n")
    for _ in range(100):
        parser.feed(b"1" * 100)
    assert parser.errors
    assert parser.feed(b"\n1,2,3\n")[-1:] == [[1.0, 2.0, 3.0]]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"columns": 1}, "column 2 is named"), ({"separator": "e"}, "part of a number"),
        ({"format": "binary", "header": "AA"}, "isn't < or >"), ({"counter": 4}, "column 4 is named"),
        ({"format": "binary", "header": "AA", "fields": "<hh"}, "2 numbers"),
        ({"format": "binary", "header": "AAAA", "fields": "<hhh"}, "two bytes that differ"),
        ({"format": "binary", "fields": "<hhh"}, "where a frame begins"), ({"header": "AA"}, "binary format"),
        ({"signals": {"Force": SIGNALS["force"]}}, "signal's name"),
        ({"signals": {"f": {"elements": {"a": 1}, "unit": "N", "gain": 0}}}, "gain: 0"),
        ({"signals": {"f": {"elements": {"a": 1}, "unit": "N", "gain": {"b": 1.0}}}}, "the elements are a"),
        ({"signals": {"f": {"elements": {"a": 1}, "unit": "N", "lower": 2, "upper": 1}}}, "less than upper"),
    ],
)  # fmt: skip
def test_options_that_dont_fit_are_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        config(**changes)


class Rig:
    """The driver on the twin of a board, in lockstep."""

    def __init__(self, believed: dict[str, Any] | None = None, **changes: Any) -> None:
        """`believed`: what the driver's profile says otherwise than the board does."""
        given = {"counter": 3, "checksum": "sum"} | changes
        made = config(**given)
        self.fake = FakeSerialLines(
            "toe", made, Cell(CellConfig.model_validate({"parts": THING}), 1), FakeNumbersOptions(low=1.0, high=9.0)
        )
        self.twin = SerialLinesTwin(self.fake)
        self.bench = Bench(self.twin)
        self.driver = bound(SerialLines("toe", config(**given | {"port": self.twin.address} | (believed or {}))))
        with self.bench.running():
            self.driver.open()

    def cycle(self, count: int = 1) -> None:
        for _ in range(count):
            sent = self.twin.metrics()["bytes_out"]
            self.bench.run(0.01)
            if self.twin.metrics()["bytes_out"] != sent:  # a pty delivers in its own time
                before = self.driver.health.frames + self.driver.health.errors
                until(
                    lambda before=before: self.driver.health.frames + self.driver.health.errors > before,
                    lambda: self.driver.read(self.bench.now), pause=0.0,
                )  # fmt: skip
            else:
                self.driver.read(self.bench.now)


@pytest.fixture
def rig() -> Any:
    made = Rig(rate=100)
    yield made
    made.driver.close()
    made.twin.close()


def test_the_driver_gives_what_the_board_measures(rig: Rig) -> None:
    rig.cycle(50)
    force = rig.driver.state_arrays["force"]
    number = rig.fake.newest()
    assert rig.driver.health.frames > 40
    assert (force > 0.9).all()
    np.testing.assert_allclose(force, rig.fake.samples[number], atol=1e-8)
    assert 0 <= rig.bench.now - rig.driver.health.stamp < 25_000_000
    assert rig.driver.metrics()["gaps"] == 0


def test_garbled_samples_are_counted_and_missing_ones_are_known(rig: Rig) -> None:
    rig.cycle(20)
    rig.twin.garbled = 3
    rig.cycle(20)
    assert rig.driver.health.errors >= 3
    assert rig.driver.metrics()["gaps"] == 3
    assert rig.driver.health.message == ""


def test_a_board_that_hangs_is_a_loss(rig: Rig) -> None:
    rig.cycle(20)
    rig.twin.muted = True
    with pytest.raises(DeviceLostError, match="no sample for 1 s"):
        rig.cycle(150)


def test_values_beyond_their_bounds_are_no_sample() -> None:
    rig = Rig({"signals": {"force": SIGNALS["force"] | {"upper": 0.5}}}, rate=100)
    try:
        rig.cycle(10)
        assert rig.driver.health.stamp == -1
        assert "isn't between" in rig.driver.health.message
    finally:
        rig.driver.close()
        rig.twin.close()


def test_values_that_stand_still_are_no_sample_where_that_is_said() -> None:
    rig = Rig(frozen=0.2, rate=100)
    try:
        rig.cycle(10)
        rig.fake._options = FakeNumbersOptions(low=3.0, high=3.0)
        rig.cycle(60)
        assert rig.driver.health.message == "its numbers stand still to the last digit"
        assert rig.bench.now - rig.driver.health.stamp > 200_000_000
    finally:
        rig.driver.close()
        rig.twin.close()


def test_another_rate_is_a_loss() -> None:
    rig = Rig({"rate": 50}, rate=100)
    try:
        with pytest.raises(DeviceLostError, match="100 samples a second, and the profile says 50"):
            rig.cycle(500)
    finally:
        rig.driver.close()
        rig.twin.close()


def test_another_baud_rate_is_named() -> None:
    """As a wrong rate looks: bytes that are no text."""
    fake = FakeSerialLines("toe", config(), Cell(CellConfig.model_validate({"parts": THING}), 1), FakeNumbersOptions())
    twin = SerialLinesTwin(fake)
    bench = Bench(twin)
    twin._frame = lambda values: b"\xf8\x80\xfe\n"  # type: ignore[method-assign]
    driver = SerialLines("toe", config(port=twin.address, start=1.0))
    try:
        with bench.running(), pytest.raises(DeviceError, match="is the baud rate right"):
            driver.open()
        twin.muted = True
        with bench.running(), pytest.raises(DeviceError, match="nothing came within 1 s"):
            driver.open()
    finally:
        twin.close()
    assert BOOT < 1e9
