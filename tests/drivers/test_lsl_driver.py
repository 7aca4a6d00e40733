"""The driver `lsl` without liblsl: options, what a stream must be, samples into states, losses."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from helpers.run import refused
from helpers.zenoh import bound
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.control.emg.blocks import Stream
from srl.control.emg.processing import Filters
from srl.drivers.lsl import Lsl, LslConfig, wire
from srl.drivers.lsl.match import match
from srl.drivers.lsl.units import factor
from srl.drivers.rate import WINDOW, Rate
from srl.runtime.contracts.errors import DeviceError, DeviceLostError

SIGNALS: dict[str, Any] = {
    "emg": {"channels": {"biceps": "EMG 2", "triceps": "EMG 1"}, "unit": "V"},
    "samples": {"channels": {"biceps": "EMG 2", "triceps": "EMG 1"}, "unit": "V", "block": 4},
}
REPORT_EVERY: dict[str, Any] = {
    "name": "Amp", "type": "EMG", "source_id": "amp-7", "uid": "u1", "hostname": "lab", "rate": 1000.0, "count": 3,
    "labels": ["EMG 1", "EMG 2", "AUX"], "units": ["microvolts", "millivolts", "V"],
}  # fmt: skip
MS = 1_000_000


def config(**options: Any) -> LslConfig:
    given: dict[str, Any] = {"stream": {"source_id": "amp-7"}, "rate": 1000, "signals": SIGNALS} | options
    return LslConfig.model_validate(given)


# -- options


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"stream": {"type": "EMG"}}, "needs `source_id` or `name`"),
        ({"stream": {"name": "a'b\"c"}}, "both kinds of quotation marks"),
        ({"port": "tcp://127.0.0.1"}, "must read lsl://HOST"),
        ({"port": "lsl://lab-pc"}, "must be an address"),
        ({"port": "lsl://192.168.1.30"}, "unencrypted_network: true"),
        ({"signals": {"count": SIGNALS["emg"]}}, "not 'count'"),
        ({"signals": {"emg": {"channels": {"a": 0}, "unit": "V"}}}, "numbers begin at 1"),
        ({"signals": {"emg": {"channels": {"a": 2, "b": 2}, "unit": "V"}}}, "is there twice"),
        ({"signals": {"emg": {"channels": {"a": 2}, "unit": "V"}}}, "say how many the stream has"),
        ({"signals": {"emg": {"channels": {"a": 9}, "unit": "V"}}, "count": 8}, "9 is named, and the stream has 8"),
        ({"signals": {"emg": {"channels": {"a": "A"}, "unit": "uV"}}}, "'uV' isn't one of"),
        ({"signals": {"emg": {"channels": {"a": "A"}, "unit": "V", "sent": "degrees"}}}, "microvolts"),
        ({"rate": 0}, "samples of an irregular stream"),
    ],
)
def test_options_that_can_t_be_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words.replace("(", r"\(")):
        config(**options)


def test_states_are_named() -> None:
    driver = Lsl("amp", config())
    assert [(s.name, s.shape, s.labels, s.components) for s in driver.states] == [
        ("emg", (2,), ("biceps", "triceps"), ()),
        ("samples", (4, 2), (), (("biceps", "triceps"),)),
        ("count", (1,), (), ()),
    ]
    assert not driver.here  # anybody can pretend to be a stream: none of it releases a person's stop


# -- what a stream must be


def test_channels_go_by_name_and_become_si() -> None:
    picked = match("amp", config(), REPORT_EVERY)["emg"]
    np.testing.assert_array_equal(picked.columns, [1, 0])
    np.testing.assert_allclose(picked.factors, [1e-3, 1e-6])


@pytest.mark.parametrize(
    ("reported", "options", "words"),
    [
        ({"rate": 500.0}, {}, "rate is 500 Hz, the profile's 1000 Hz"),
        ({"rate": 0.0}, {}, "rate is irregular"),
        ({"count": 2}, {"count": 3}, "has 2 channels, the profile says 3"),
        ({"labels": ["EMG 1", "EMG 3", "AUX"]}, {}, "no channel 'EMG 2' for 'emg'.*EMG 3"),
        ({"labels": ["EMG 2", "EMG 2", "AUX"]}, {}, "2 channels of the stream are called 'EMG 2'"),
        ({"labels": []}, {}, "names none of its channels"),
        ({"units": ["degrees", "V", "V"]}, {}, "EMG 1 of 'emg' is in 'degrees', the profile wants 'V'"),
        ({"units": []}, {}, "a factor of a million"),
        ({}, {"signals": {"emg": SIGNALS["emg"] | {"sent": "volts"}}}, "in 'millivolts', the profile says 'volts'"),
    ],
)
def test_another_stream_is_refused(reported: dict[str, Any], options: dict[str, Any], words: str) -> None:
    with pytest.raises(DeviceError, match=words):
        match("amp", config(**options), REPORT_EVERY | reported)


def test_a_unit_that_isn_t_stated_is_the_profile_s_and_a_quaternion_has_none() -> None:
    sent = {"emg": SIGNALS["emg"] | {"sent": "microvolts"}}
    np.testing.assert_allclose(match("amp", config(signals=sent), REPORT_EVERY | {"units": []})["emg"].factors, 1e-6)
    axes = dict(zip(("x", "y", "z", "qw", "qx", "qy", "qz"), range(1, 8), strict=True))
    pose = config(signals={"pose": {"channels": axes, "unit": "m"}}, count=7)
    reported = REPORT_EVERY | {"count": 7, "labels": [], "units": ["mm"] * 3 + ["quaternion"] * 4}
    np.testing.assert_allclose(match("amp", pose, reported)["pose"].factors, [1e-3] * 3 + [1.0] * 4)


@pytest.mark.parametrize(
    ("word", "unit", "by"),
    [
        ("uV", "V", 1e-6),
        ("µV", "V", 1e-6),
        ("Degrees", "rad", np.pi / 180),
        ("g", "m/s2", 9.80665),
        ("pixels", "1", None),
    ],
)
def test_units(word: str, unit: str, by: float | None) -> None:
    assert factor(word, unit) == by


# -- the messages of its process


@settings(max_examples=30)
@given(st.integers(0, 2**60), st.integers(0, 2**62), st.floats(-1e6, 1e6), st.integers(1, 300), st.integers(1, 40))
def test_samples_there_and_back(number: int, arrived: int, offset: float, k: int, n: int) -> None:
    values = np.arange(k * n, dtype=float).reshape(k, n)
    messages = wire.data(wire.Data(number, arrived, offset, np.arange(k) / 7.0, values))
    assert max(map(len, messages)) < 1 << 16
    items = [item for item in map(wire.read, messages) if isinstance(item, wire.Data)]
    assert items[0].number == number
    assert {(item.arrived, item.offset) for item in items} == {(arrived, offset)}
    np.testing.assert_array_equal(np.concatenate([item.values for item in items]), values)
    np.testing.assert_array_equal(np.concatenate([item.stamps for item in items]), np.arange(k) / 7.0)
    assert [item.number for item in items] == [
        number + at for at in np.cumsum([0, *(len(i.stamps) for i in items)])[:-1]
    ]


class Helper:
    """The process' end, by hand."""

    def __init__(self, **options: Any) -> None:
        self.driver = Lsl("amp", config(**options))
        bound(self.driver)
        self.number, self.now = 0, 5_000 * MS
        ours, self.end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        ours.setblocking(False)
        self.driver._helper._end = ours
        self.driver._helper.ensure = lambda: None  # type: ignore[method-assign]
        self.driver.close = lambda: None  # type: ignore[method-assign]

    def say(self, *messages: bytes) -> None:
        for message in messages:
            self.end.send(message)

    def samples(self, values: Any, stamp: int | None = None, offset: float = 0.0, arrived: int | None = None) -> None:
        """Rows of EMG 1, EMG 2, AUX; the newest's stamp (ns)."""
        rows = np.array(values, float)
        newest = (self.now if stamp is None else stamp) * 1e-9
        stamps = newest - np.arange(len(rows))[::-1] * 1e-3
        self.say(*wire.data(wire.Data(self.number, arrived or self.now, offset, stamps, rows)))
        self.number += len(rows)

    def open(self) -> None:
        self.say(wire.words(b"R", REPORT_EVERY))
        self.now = time.monotonic_ns()
        self.samples([[1, 2, 3]])
        self.driver.open()


@pytest.fixture
def helper() -> Iterator[Helper]:
    made = Helper()
    made.open()
    yield made
    made.end.close()
    made.driver._helper.let_go()


def test_samples_become_states(helper: Helper) -> None:
    d, state = helper.driver, helper.driver.state_arrays
    d.read(helper.now)
    np.testing.assert_allclose(state["emg"], [2e-3, 1e-6])
    started = state["count"][0]
    helper.now += 10 * MS
    helper.samples([[k, -k, 0] for k in range(10, 16)], stamp=helper.now - 3 * MS, offset=1e-3)
    d.read(helper.now)
    np.testing.assert_allclose(state["samples"][:, 1], np.arange(12, 16) * 1e-6)
    assert state["count"][0] == started + 6
    assert d.health.stamp == pytest.approx(helper.now - 2 * MS, abs=1000)
    assert (d.health.frames, d.health.errors) == (7, 0)


def test_a_gap_is_one_for_the_law_that_filters(helper: Helper) -> None:
    d, state = helper.driver, helper.driver.state_arrays
    law = Stream(2, Filters(rate=1000, band=(20, 450), band_order=4, cutoff=5, cutoff_order=2))

    def brought() -> Any:
        d.read(helper.now)
        return law.take(state["samples"], float(state["count"][0]))

    assert brought() is None
    helper.samples([[1, 2, 3]] * 3)
    assert len(brought()) == 3
    helper.number += 2  # two samples for which the pipe had no room
    helper.samples([[1, 2, 3]] * 2)
    assert brought() is None
    helper.samples([[1, 2, 3], [np.nan, 2, 3], [1, 2, 3]])
    assert brought() is None
    helper.samples([[1, 2, 3]])
    assert len(brought()) == 1


def test_nan_in_a_channel_that_nobody_wants_is_nothing(helper: Helper) -> None:
    helper.samples([[1, 2, np.nan]])
    helper.driver.read(helper.now)
    assert helper.driver.health.errors == 0


def test_nan_that_is_wanted_comes_through_and_else_makes_it_stale(helper: Helper) -> None:
    d = helper.driver
    d.read(helper.now)
    stamp = d.health.stamp
    helper.now += 10 * MS
    helper.samples([[np.inf, 2, 3]])
    d.read(helper.now)
    assert d.health.stamp == stamp
    assert d.health.message == "no number (NaN) in samples: triceps"
    eyes = Helper(signals={"gaze": {"channels": {"left": "EMG 1"}, "unit": "V", "nan": True}})
    eyes.open()
    eyes.samples([[np.nan, 2, 3]])
    eyes.driver.read(eyes.now)
    assert np.isnan(eyes.driver.state_arrays["gaze"][0])
    assert eyes.driver.health.errors == 0


def test_stamps_of_the_future_are_no_samples(helper: Helper) -> None:
    d = helper.driver
    d.read(helper.now)
    stamp = d.health.stamp
    helper.samples([[9, 9, 9]], stamp=helper.now + 500 * MS)
    d.read(helper.now)
    assert (d.health.stamp, d.health.errors) == (stamp, 1)
    assert "of the future" in d.health.message
    helper.samples([[9, 9, 9]], stamp=helper.now + 50 * MS)
    d.read(helper.now)
    assert d.health.stamp == helper.now  # no sample is newer than its arrival


def test_an_old_sample_is_old(helper: Helper) -> None:
    d = helper.driver
    d.read(helper.now)
    later = helper.now + 700 * MS
    helper.samples([[1, 2, 3]], stamp=helper.now + MS, arrived=later)
    d.read(later)
    assert later - d.health.stamp == pytest.approx(699 * MS, abs=1000)


@pytest.mark.parametrize("kind", ["words", "end", "silence"])
def test_losses_are_told(helper: Helper, kind: str) -> None:
    d = helper.driver
    d.read(helper.now)
    reported = {"words": "the stream has ended", "end": "its LSL process has ended", "silence": "nothing came for 1 s"}
    if kind == "words":
        helper.say(wire.words(b"X", {"problem": reported[kind], "remedy": "Start it"}))
    elif kind == "end":
        helper.end.close()
    else:
        d.read(helper.now + 999 * MS)
        helper.now += 1001 * MS
    with pytest.raises(DeviceLostError, match=reported[kind]):
        d.read(helper.now)
    assert not d.health.connected


@pytest.mark.parametrize(("share", "wrong"), [(0.7, True), (0.9, False), (1.1, False), (1.4, True)])
def test_a_rate_that_isn_t_what_it_says(share: float, wrong: bool) -> None:
    rate = Rate(1000.0)
    step = WINDOW // 10
    found = [rate.wrong(round(i * 200 * share), i * step) for i in range(25)]
    assert any(each is not None for each in found) == wrong
    if wrong:
        assert next(each for each in found if each is not None) == pytest.approx(1000 * share, rel=0.02)


@pytest.mark.parametrize("age", [1.6e9, -30.0])
def test_a_sender_s_own_clock_is_refused(age: float) -> None:
    helper = Helper()
    helper.say(wire.words(b"R", REPORT_EVERY))
    helper.now = time.monotonic_ns()
    helper.samples([[1, 2, 3]], offset=-age)
    with pytest.raises(DeviceError, match="aren't of LSL's clock"):
        helper.driver.open()


def test_an_emg_calibration_of_another_rate_is_refused() -> None:
    """Its filters are of samples at that rate: at another one an activation would mean something else."""
    output = refused("check", "emg-lsl", "--set", "devices.emg.rate=1000")
    assert "its calibration was made with emg.rate 2000.0, now it is 1000.0" in output
