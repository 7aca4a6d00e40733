"""The qbrobotics protocol: the sheet's golden vectors, the parser, the parameter list."""

import pytest
from helpers.fuzz import fuzz, size_of
from hypothesis import given
from hypothesis import strategies as st

from srl.drivers.softhand.protocol import (
    Cmd,
    Frame,
    Limits,
    Parser,
    Settings,
    activate,
    frame,
    int16s,
    parameters,
    parse_settings,
    set_inputs,
    set_watchdog,
)

REPLY = bytes.fromhex("3a3a0108841f40ff3800001c")
frames = st.builds(Frame, st.integers(0, 254), st.integers(0, 255), st.binary(max_size=60))


@pytest.mark.parametrize(
    ("made", "golden"),
    [
        (activate(1, True), "3a3a0103800383"),
        (activate(1, False), "3a3a0103800080"),
        (activate(33, True), "3a3a2103800383"),
        (set_inputs(1, 0), "3a3a0106820000000082"),
        (set_inputs(1, 8000), "3a3a0106821f400000dd"),
        (set_inputs(1, 19000), "3a3a0106824a380000f0"),
        (set_inputs(1, -200, 300), "3a3a010682ff38012c68"),
        (frame(1, Cmd.PING), "3a3a01020000"),
        (frame(1, Cmd.GET_ACTIVATE), "3a3a01028181"),
        (frame(1, Cmd.GET_INPUTS), "3a3a01028383"),
        (frame(1, Cmd.GET_MEASUREMENTS), "3a3a01028484"),
        (frame(1, Cmd.GET_CURRENTS), "3a3a01028585"),
        (frame(1, Cmd.GET_BOTH), "3a3a01028686"),
        (frame(1, Cmd.GET_VELOCITIES), "3a3a01028989"),
        (set_watchdog(1, 250), "3a3a01038f7df2"),
        (frame(1, Cmd.SET_BAUDRATE, b"\x03"), "3a3a0103900393"),
        (frame(1, Cmd.SET_BAUDRATE, b"\x0d"), "3a3a0103900d9d"),
        (frame(1, Cmd.GET_INFO, b"\0\0"), "3a3a010406000006"),
        (frame(1, Cmd.STORE), "3a3a01020303"),
    ],
)
def test_frames_are_the_sheet_s(made, golden):
    assert made.hex() == golden


def test_the_reply_is_the_sheet_s():
    (found,) = Parser().feed(REPLY)
    assert (found.id, found.command, int16s(found.data)) == (1, Cmd.GET_MEASUREMENTS, (8000, -200, 0))


@given(st.lists(frames, max_size=8), st.data())
def test_frames_come_back_however_they_are_cut(sent, data):
    wire = b"".join(frame(*one) for one in sent)
    parser, found, at = Parser(), [], 0
    while at < len(wire):
        size = data.draw(st.integers(1, 20))
        found += parser.feed(wire[at : at + size])
        at += size
    assert found == sent
    assert (parser.frames, parser.errors) == (len(sent), 0)


@given(st.binary(max_size=300))
def test_after_any_garbage_good_frames_are_found(garbage):
    parser = Parser()
    parser.feed(garbage)
    found = []
    for _ in range(14):  # a false header may claim up to 128 bytes
        found += parser.feed(REPLY)
    assert found[-1] == Frame(1, Cmd.GET_MEASUREMENTS, REPLY[5:-1])
    assert parser.feed(REPLY) == [found[-1]]


def test_a_wrong_checksum_is_counted_and_dropped():
    parser = Parser()
    assert parser.feed(REPLY[:-1] + b"\x1d") == []
    assert parser.feed(REPLY) == [Frame(1, Cmd.GET_MEASUREMENTS, REPLY[5:-1])]
    assert (parser.frames, parser.errors, parser.resyncs) == (1, 1, 1)


def test_a_million_damaged_bytes():
    parser = Parser()
    fuzz(parser.feed, REPLY * 6 + frame(1, Cmd.GET_BOTH, bytes(10)) * 6)
    assert parser.frames > 1000
    assert parser.errors > 1000
    assert size_of(parser) < 4000
    for _ in range(14):
        parser.feed(REPLY)
    assert len(parser.feed(REPLY)) == 1


@given(st.integers(-32768, 32766), st.integers(1, 65535), st.integers(1, 254), st.integers(0, 255))
def test_limits_and_control_mode_are_found_in_the_parameter_list(low, span, hand, control):
    limits = Limits(low, min(low + span, 32767))
    wire = parameters(hand, limits, control)
    assert parse_settings(wire, hand) == Settings(limits, control)
    assert parse_settings(b"::\x01junk" + wire + b"more", hand) == Settings(limits, control)
    assert parse_settings(wire, hand + 1) is None


@given(st.binary(max_size=300), st.integers(0, 250))
def test_whatever_else_comes_gives_no_limits(garbage, at):
    wire = bytearray(parameters(1, Limits(0, 19000)))
    assert parse_settings(garbage, 1) is None
    wire[at % len(wire)] ^= 1 << at % 8
    assert parse_settings(bytes(wire), 1) in (None, Settings(Limits(0, 19000), 0))
    assert parse_settings(bytes(wire[: at % len(wire)]), 1) is None


def test_limits_that_can_t_be_are_none():
    assert parse_settings(parameters(1, Limits(5, 5)), 1) == Settings(None, 0)
    assert parse_settings(parameters(1, Limits(0, 40000)), 1) == Settings(None, 0)
