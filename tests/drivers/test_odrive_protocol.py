"""CANSimple: golden vectors of the public client odrive-can 2.1.0 (its DBC files), and properties."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from srl.drivers.odrive import protocol, words
from srl.drivers.odrive.protocol import Command

finite = st.floats(-1e6, 1e6, width=32)
nodes = st.integers(0, 62)


@pytest.mark.parametrize(
    ("message", "identifier", "data"),
    [
        (protocol.set_state(1, 8), 0x27, "0800000000000000"),
        (protocol.set_state(1, 1), 0x27, "0100000000000000"),
        (protocol.set_mode(1, "position"), 0x2B, "0300000001000000"),
        (protocol.set_mode(1, "velocity"), 0x2B, "0200000001000000"),
        (protocol.set_mode(1, "torque"), 0x2B, "0100000001000000"),
        (protocol.input_position(1, 1.5, -2.0, 0.25), 0x2C, "0000c03f30f8fa00"),
        (protocol.input_velocity(1, -2.0, 0.5), 0x2D, "000000c00000003f"),
        (protocol.input_torque(1, -0.75), 0x2E, "000040bf00000000"),
        (protocol.set_limits(1, 20.0, 15.0), 0x2F, "0000a04100007041"),
        (protocol.velocity_gains(1, 0.16, 0.32), 0x3B, "0ad7233e0ad7a33e"),
        (protocol.clear(1, "0.5"), 0x38, ""),
        (protocol.clear(1, "0.6"), 0x38, "00"),
    ],
)
def test_golden_commands(message, identifier, data):
    assert message.arbitration_id == identifier
    assert bytes(message.data).hex() == data
    assert not message.is_extended_id
    assert not message.is_remote_frame


def test_golden_replies():
    assert protocol.pair(bytes.fromhex("0000a0bf0000003f")) == (-1.25, 0.5)
    assert protocol.pair(bytes.fromhex("cdccc0419a99993e")) == pytest.approx((24.1, 0.3))
    assert protocol.pair(bytes.fromhex("0000264200001042")) == (41.5, 36.0)
    assert protocol.pair(bytes.fromhex("0000803f3333733f")) == pytest.approx((1.0, 0.95))
    assert protocol.errors(bytes.fromhex("0000000000000001")) == (0, 1 << 24)


def test_golden_heartbeats():
    old = protocol.heartbeat(bytes.fromhex("0008000001010080"), "0.5")
    assert old == protocol.Heartbeat(error=0x800, state=1, procedure=0, elsewhere=1)
    new = protocol.heartbeat(bytes.fromhex("0000000101030000"), "0.6")
    assert new == protocol.Heartbeat(error=1 << 24, state=1, procedure=3, elsewhere=0)
    assert protocol.heartbeat(bytes.fromhex("0000000008000000"), "0.6").state == protocol.CLOSED_LOOP
    for beat, firmware in ((old, "0.5"), (new, "0.6")):
        assert beat.error == words.WATCHDOG[firmware]
        assert "watchdog" in words.in_words(beat.error, firmware)


def test_a_request_is_a_remote_frame():
    message = protocol.request(3, Command.BUS)
    assert (message.arbitration_id, message.is_remote_frame, bytes(message.data)) == (0x77, True, b"")


@given(nodes, finite, st.floats(-40, 40), st.floats(-40, 40))
def test_position_comes_back(node, turns, velocity, torque):
    message = protocol.input_position(node, turns, velocity, torque)
    assert protocol.split(message.arbitration_id) == (node, Command.INPUT_POSITION)
    place, forward, push = struct.unpack("<fhh", message.data)
    assert place == turns
    assert abs(forward / 1000 - max(-32.767, min(32.767, velocity))) < 0.000501
    assert abs(push / 1000 - max(-32.767, min(32.767, torque))) < 0.000501


@given(st.binary(max_size=9), st.sampled_from(["0.5", "0.6"]))
def test_any_bytes_are_taken_or_refused(data, firmware):
    for found in (protocol.pair(data), protocol.errors(data), protocol.version(data), protocol.serial_number(data)):
        assert found is None or len(data) >= 7
    assert protocol.heartbeat(data, firmware) is None or len(data) == 8
    values = protocol.pair(data)
    assert values is None or all(abs(value) < 1e9 for value in values)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_what_is_no_number_is_no_estimate(value):
    assert protocol.pair(struct.pack("<ff", value, 0.0)) is None
    assert protocol.pair(struct.pack("<ff", 0.0, value)) is None


@given(st.integers(0, 0xFFFFFFFF), st.sampled_from(["0.5", "0.6"]))
def test_every_error_has_words(error, firmware):
    text = words.in_words(error, firmware)
    assert bool(text) == bool(error)
    if rest := error & ~sum(words.ERRORS[firmware]):
        assert f"{rest:#x}" in text


def test_no_state_that_moves_the_axis_can_be_asked_for():
    for state in (0, 3, 4, 7, 11):
        with pytest.raises(ValueError, match="would move the axis"):
            protocol.set_state(1, state)


def test_an_endpoint_s_value_is_told_from_another_s():
    data = bytes.fromhex("00430100") + struct.pack("<f", 0.5)
    assert protocol.endpoint_value(data, 0x0143, 4) == struct.pack("<f", 0.5)
    assert protocol.endpoint_value(data, 0x0144, 4) is None
    assert protocol.endpoint_value(data[:6], 0x0143, 4) is None
    assert bytes(protocol.read_endpoint(2, 0x0143).data) == bytes.fromhex("00430100")
    assert bytes(protocol.write_endpoint(2, 0x0143, b"\1").data) == bytes.fromhex("0143010001")
