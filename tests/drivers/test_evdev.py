"""Linux input records: the sheet's vectors, reports, overflow, and a million damaged bytes."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest
from helpers.fuzz import fuzz, size_of
from hypothesis import given
from hypothesis import strategies as st

from srl.drivers.evdev import RECORD, AxisInfo, Description, Parser, encode, open_source
from srl.runtime.contracts.errors import DeviceError, DeviceLostError

AT = 1_700_000_000_123_456_000
HEAD = "00f153650000000040e2010000000000"
VECTORS = {  # sheet part D: (type, code, value)
    "0100300101000000": (1, 0x130, 1),
    "0100300100000000": (1, 0x130, 0),
    "01003c0101000000": (1, 0x13C, 1),
    "030000000080ffff": (3, 0, -32768),
    "03000000ff7f0000": (3, 0, 32767),
    "030001000080ffff": (3, 1, -32768),
    "03000500ff000000": (3, 5, 255),
    "03001000ffffffff": (3, 0x10, -1),
    "0300110001000000": (3, 0x11, 1),
    "0100730001000000": (1, 115, 1),
    "0100730002000000": (1, 115, 2),
    "01001c0001000000": (1, 28, 1),
    "01004a0101000000": (1, 330, 1),
}
SYN = bytes.fromhex(HEAD + "0000000000000000")
DROPPED = bytes.fromhex(HEAD + "0000030000000000")
SCAN = bytes.fromhex(HEAD + "04000400e9000c00")


@pytest.mark.parametrize(("record", "event"), VECTORS.items())
def test_the_sheets_records(record: str, event: tuple[int, int, int]) -> None:
    data = bytes.fromhex(HEAD + record)
    assert Parser().feed(SCAN + data + SYN) == [[(AT, *event)]]
    assert encode(AT, [event]) == data + SYN


@given(st.lists(st.tuples(st.sampled_from([1, 3]), st.integers(0, 767), st.integers(-(2**31), 2**31 - 1)), min_size=1))
def test_what_is_encoded_is_read_however_it_is_cut(changes: list[tuple[int, int, int]]) -> None:
    parser, data, found = Parser(), encode(AT, changes), []
    for at in range(0, len(data), 7):
        found += parser.feed(data[at : at + 7])
    assert [tuple(event[1:]) for event in found[0]] == changes
    assert (len(found), parser.frames, parser.errors) == (1, 1, 0)


def test_what_came_with_an_overflow_isnt_believed() -> None:
    press = bytes.fromhex(HEAD + "0100300101000000")
    parser = Parser()
    assert parser.feed(press + DROPPED + press + SYN) == []
    assert (parser.drops, parser.lost) == (1, True)
    assert len(parser.feed(press + SYN)) == 1


def test_a_million_damaged_bytes() -> None:
    parser = Parser()
    good = encode(AT, [(1, 0x130, 1), (3, 0, -5)]) * 20 + DROPPED + SYN
    fuzz(parser.feed, good)
    assert size_of(parser) < 200_000
    parser.feed(bytes(RECORD.size - len(parser._rest)))  # the kernel hands out whole records
    parser.feed(SYN)
    assert len(parser.feed(encode(AT, [(1, 0x130, 1)]))) == 1


def test_a_description_survives_its_line() -> None:
    pad = Description("Päd", "a:b", 1, 2, 3, frozenset([1, 2]), frozenset([2]), {0: AxisInfo(-1, -5, 5, 1, 2, 3)})
    assert Description.from_line(pad.to_line()) == pad
    assert pad.state() == [(1, 1, 0), (1, 2, 1), (3, 0, -1)]
    for wrong in (b"", b"{}", b"[]", b"null", b'{"name": 1}', b"\xff"):
        with pytest.raises(ValueError, match=r".*"):
            Description.from_line(wrong)


def test_what_isnt_an_input_device_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DeviceError, match="there is no"):
        open_source(str(tmp_path / "event9"), "pad")
    plain = tmp_path / "plain"
    plain.write_text("no device")
    before = len(os.listdir("/proc/self/fd"))
    with pytest.raises(DeviceError, match="isn't an input device"):
        open_source(str(plain), "pad")
    assert len(os.listdir("/proc/self/fd")) == before
    path = str(tmp_path / "socket")
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(path)
        with pytest.raises(DeviceError, match="nobody serves"):
            open_source(path, "pad")
        listener.listen()
        source = open_source(path, "pad")
        end, _ = listener.accept()
        with pytest.raises(DeviceError, match="doesn't describe itself"):
            source.await_description(0.05)
        end.sendall(b"garbage\n")
        with pytest.raises(DeviceLostError, match="isn't an input device's twin"):
            source.await_description(5)
        source.close()
        source.close()
        end.close()
