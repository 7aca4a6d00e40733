"""Both protocols on the wire: the sheet's golden vectors, and streams cut and damaged at will."""

import pytest
from helpers.fuzz import fuzz, size_of
from hypothesis import given
from hypothesis import strategies as st

from srl.drivers.dynamixel import protocol2
from srl.drivers.servo_bus import protocol1
from srl.drivers.servo_bus.packets import BROADCAST, Instruction, Status

# Sheet dynamixel, §7: made with dynamixel-sdk 4.1.0 (TX), or decoded by it (replies).
SENT2 = [
    ("fffffd0001030001194e", protocol2.ping(1)),
    ("fffffd00020300011972", protocol2.ping(2)),
    ("fffffd00fe0300013142", protocol2.ping(BROADCAST)),
    ("fffffd0001060003400000dee6", protocol2.write(1, 64, b"\0")),
    ("fffffd0001060003400001db66", protocol2.write(1, 64, b"\1")),
    ("fffffd00010600030b00102163", protocol2.write(1, 11, b"\x10")),
    ("fffffd0001090003740000fcffffdc85", protocol2.write(1, 116, (-1024).to_bytes(4, "little", signed=True))),
    ("fffffd00010700036600d4fe40df", protocol2.write(1, 102, (-300).to_bytes(2, "little", signed=True))),
    ("fffffd000106000362000568e4", protocol2.write(1, 98, b"\5")),
    ("fffffd0001070002840004001d15", protocol2.read(1, 132, 4)),
    ("fffffd00010700027e001500353b", protocol2.read(1, 126, 21)),
    ("fffffd00010300082f4e", protocol2.reboot(1)),
    ("fffffd00010800100144584c22b1dc", protocol2.packet(1, protocol2.CLEAR, b"\x01DXL\x22")),
    ("fffffd000104000602abe6", protocol2.packet(1, protocol2.FACTORY_RESET, b"\2")),
    ("fffffd00010900047400e8030000832e", protocol2.packet(1, protocol2.REG_WRITE, bytes.fromhex("7400e8030000"))),
    ("fffffd00fe0300052ac2", protocol2.packet(BROADCAST, protocol2.ACTION)),
    (
        "fffffd00fe160083740004000100040000020008000003000c00002449",
        protocol2.sync_write(116, 4, {k: (1024 * k).to_bytes(4, "little") for k in (1, 2, 3)}),
    ),
    ("fffffd00fe0d008366000200016400029cffe1db", protocol2.sync_write(102, 2, {1: b"\x64\0", 2: b"\x9c\xff"})),
    ("fffffd00fe0d00834000010001010201030197d1", protocol2.sync_write(64, 1, dict.fromkeys((1, 2, 3), b"\1"))),
    ("fffffd00fe090082840004000102cefa", protocol2.group_read(132, 4, (1, 2))),
    ("fffffd00fe0a00827e000a00010203591b", protocol2.group_read(126, 10, (1, 2, 3))),
    ("fffffd00fe09008a8400040001024d72", protocol2.fast_sync_read(132, 4, (1, 2))),
    ("fffffd00010a00037400fffffdfd0021e7", protocol2.write(1, 116, bytes.fromhex("fffffd00"))),
    (
        "fffffd00010f00036800fffffdfdfffffdfd00005490",
        protocol2.write(1, 104, bytes.fromhex("fffffdfffffd0000")),
    ),
]
HEARD2 = [
    ("fffffd00010700550037012a9ac0", Status(1, 0, False, bytes.fromhex("37012a"))),
    ("fffffd000104005500a10c", Status(1, 0, False, b"")),
    ("fffffd000108005500ffffffff9638", Status(1, 0, False, b"\xff" * 4)),
    ("fffffd000109005500fffffdfd01dd1c", Status(1, 0, False, bytes.fromhex("fffffd01"))),
    ("fffffd000105005580209921", Status(1, 0, True, b"\x20")),
    ("fffffd000104005507b08c", Status(1, protocol2.ACCESS, False, b"")),
    ("fffffd000104005506b50c", Status(1, protocol2.LIMIT, False, b"")),
    ("fffffd000104005504ba8c", Status(1, protocol2.RANGE, False, b"")),
]
FAST = [
    ("fffffd00fe11005500010004000014c300021f080000f9a4", [(1, 1024), (2, 2079)]),
    ("fffffd00fe1900550003a6000000840800071f08000016ca0004ff030000d19e", [(3, 166), (7, 2079), (4, 1023)]),
]
SENT1 = [
    ("ffff010201fb", protocol1.ping(1)),
    ("ffff0104031801de", protocol1.write(1, 24, b"\1")),
    ("ffff0105031e0008d0", protocol1.write(1, 30, b"\x00\x08")),
    ("ffff01050347320479", protocol1.write(1, 71, b"\x32\x04")),
    ("ffff0104022402d2", protocol1.read(1, 36, 2)),
    ("fffffe0a831e0201000402000845", protocol1.sync_write(30, 2, {1: b"\0\4", 2: b"\0\x08"})),
    ("fffffe0e831e040100046400020008c80013", protocol1.sync_write(30, 4, {1: b"\0\4\x64\0", 2: b"\0\x08\xc8\0"})),
    ("ffff0105041ef401e2", protocol1.packet(1, protocol1.REG_WRITE, b"\x1e\xf4\x01")),
    ("fffffe0205fa", protocol1.packet(BROADCAST, protocol1.ACTION)),
]
HEARD1 = [
    ("ffff010200fc", Status(1, 0, False, b"")),
    ("ffff0104000008f2", Status(1, 0, False, b"\x00\x08")),
    ("ffff010a000008320464007825b5", Status(1, 0, False, bytes.fromhex("0008320464007825"))),
    ("ffff010224d8", Status(1, protocol1.HEAT | protocol1.OVERLOAD, False, b"")),
]


def test_crc():
    assert protocol2.crc16(b"123456789") == 0xFEE8
    assert protocol2.crc16(b"6789", protocol2.crc16(b"12345")) == 0xFEE8


@pytest.mark.parametrize(("vector", "ours"), SENT2 + SENT1)
def test_what_is_sent_is_what_the_vendor_sends(vector, ours):
    assert ours.hex() == vector


def test_bulk_read_of_protocol_1_lists_size_id_address():
    assert protocol1.group_read(36, 2, (1,)).hex() == protocol1.packet(BROADCAST, 0x92, b"\0\2\1\x24").hex()
    vector = bytes.fromhex("fffffe09920002012408022411")
    assert protocol1.Parser().instructions(vector) == [Instruction(BROADCAST, 0x92, bytes.fromhex("00020124080224"))]


@pytest.mark.parametrize(("vector", "expected"), HEARD2)
def test_answers_of_protocol_2(vector, expected):
    assert protocol2.Parser().statuses(bytes.fromhex(vector)) == [expected]
    error = expected.error | protocol2.ALERT * expected.alert
    assert protocol2.status(expected.id, error, expected.data).hex() == vector


@pytest.mark.parametrize(("vector", "expected"), HEARD1)
def test_answers_of_protocol_1(vector, expected):
    assert protocol1.Parser().statuses(bytes.fromhex(vector)) == [expected]
    assert protocol1.status(expected.id, expected.error, expected.data).hex() == vector


@pytest.mark.parametrize(("vector", "values"), FAST)
def test_the_common_answer_to_a_fast_sync_read(vector, values):
    (common,) = protocol2.Parser().statuses(bytes.fromhex(vector))
    parts = protocol2.split_fast(common, 4)
    assert [(part.id, int.from_bytes(part.data, "little")) for part in parts] == values
    assert protocol2.fast_status([(id, 0, value.to_bytes(4, "little")) for id, value in values]).hex() == vector
    assert protocol2.split_fast(common, 5) == []


def test_a_fast_answer_is_never_unstuffed():
    packet = protocol2.fast_status([(1, 0, bytes.fromhex("fffffdfd"))])
    (common,) = protocol2.Parser().statuses(packet)
    assert protocol2.split_fast(common, 4)[0].data == bytes.fromhex("fffffdfd")


def test_the_hosts_own_echo_is_no_answer():
    parser = protocol2.Parser()
    answer = bytes.fromhex("fffffd00010700550037012a9ac0")
    assert [s.id for s in parser.statuses(protocol2.ping(1) + answer)] == [1]
    assert (parser.errors, parser.resyncs) == (0, 0)


bodies = st.binary(max_size=40) | st.lists(
    st.sampled_from([b"\xff\xff\xfd", b"\xff\xff\xfd\xfd", b"\xff", b"\xfd", b"\x00", b"\x55"]), max_size=12
).map(b"".join)
CASES = [
    (protocol2, lambda id, data: protocol2.packet(id, protocol2.WRITE, data)),
    (protocol1, lambda id, data: protocol1.packet(id, protocol1.WRITE, data)),
]


@pytest.mark.parametrize(("protocol", "make"), CASES, ids=["2", "1"])
@given(sent=st.lists(st.tuples(st.integers(0, 252), bodies), min_size=1, max_size=6), data=st.data())
def test_packets_come_through_however_the_stream_is_cut(protocol, make, sent, data):
    stream = b"".join(make(id, body) for id, body in sent)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=8)))
    parser, found = protocol.Parser(), []
    for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        found += parser.instructions(stream[start:end])
    assert [(p.id, p.code, p.data) for p in found] == [(id, 3, body) for id, body in sent]
    assert (parser.frames, parser.errors, parser.resyncs) == (len(sent), 0, 0)


@pytest.mark.parametrize(("protocol", "make"), CASES, ids=["2", "1"])
@given(noise=st.binary(max_size=60), body=bodies)
def test_after_noise_a_good_packet_is_found_again(protocol, make, noise, body):
    parser = protocol.Parser()
    parser.instructions(noise)
    parser.forget()  # as before every request
    assert parser.instructions(make(7, body))[-1] == Instruction(7, 3, body)


@given(st.integers(0, 8 * 40 - 1))
def test_a_flipped_bit_is_never_accepted(bit):
    packet = bytearray(protocol2.status(3, 0, bytes(29)))
    assert len(packet) == 40
    packet[bit // 8] ^= 1 << bit % 8
    parser = protocol2.Parser()
    assert parser.statuses(bytes(packet)) == []


@pytest.mark.parametrize(
    ("protocol", "good"),
    [
        (protocol2, b"".join(bytes.fromhex(v) for v, _ in HEARD2)),
        (protocol1, b"".join(bytes.fromhex(v) for v, _ in HEARD1)),
    ],
    ids=["2", "1"],
)
def test_a_million_damaged_bytes(protocol, good):
    parser = protocol.Parser()
    assert fuzz(parser.statuses, good) >= 1_000_000
    assert parser.frames > 1000
    assert parser.errors > 100
    assert size_of(parser) < 20_000
    parser.forget()
    assert parser.statuses(good)[-1] == protocol.Parser().statuses(good)[-1]


@pytest.mark.parametrize("cut", range(1, 20))
def test_the_driver_s_filler_ends_any_packet_cut_short_without_harm(cut):
    from helpers.dynamixel import config

    from srl.drivers.dynamixel.family import family

    for protocol, module in ((1, protocol1), (2, protocol2)):
        f = family(config(protocol=protocol))
        goals = f.again()
        stop = f.frame("torque_enable", 0)
        parser = module.Parser()
        taken = parser.instructions(goals[: min(cut, len(goals) - 1)] + f.filler + stop + stop)
        assert taken[-2:] == module.Parser().instructions(stop + stop)
        assert len(taken) == 2
