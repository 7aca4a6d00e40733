"""RDT and the sensor's settings: the sheet's golden vectors, and a flood of garbage."""

import struct

import pytest
from helpers.fuzz import fuzz, size_of
from hypothesis import given
from hypothesis import strategies as st

from srl.drivers.ati_netft import settings, status
from srl.drivers.ati_netft.protocol import Parser, Record, Request, parse_request, record, request

GOLDEN = "ffffffff8000000080020000ffffffff00000002fffffffd00000004fffffffb00000006"
TWIN = "00000001000003e9000000000016e360ffd9da6000989680000186a0fffcf2c0000493e0"
PAGE = (
    b"<netft><prodname>Ethernet Axia</prodname><cfgcpf>1000000</cfgcpf><cfgcpt>1000000</cfgcpt>"
    b"<scfgfu>N</scfgfu><scfgtu>Nm</scfgtu></netft>"
)
int32 = st.integers(-(2**31), 2**31 - 1)
uint32 = st.integers(0, 2**32 - 1)


@pytest.mark.parametrize(
    ("command", "count", "golden"),
    [
        (Request.START, 0, "1234000200000000"),
        (Request.STOP, 7, "1234000000000007"),
        (Request.START_BUFFERED, 7, "1234000300000007"),
        (Request.RESET_LATCH, 7, "1234004100000007"),
        (Request.BIAS, 7, "1234004200000007"),
    ],
)
def test_requests_are_the_sheet_s(command, count, golden):
    assert request(command, count).hex() == golden
    assert parse_request(bytes.fromhex(golden)) == (command, count)


def test_records_are_the_sheet_s():
    assert Parser().feed(bytes.fromhex(GOLDEN)) == [Record(2**32 - 1, 2**31, 0x80020000, (-1, 2, -3, 4, -5, 6))]
    counts = (1500000, -2500000, 10000000, 100000, -200000, 300000)
    assert Parser().feed(bytes.fromhex(TWIN)) == [Record(1, 1001, 0, counts)]
    assert record(Record(1, 1001, 0, counts)).hex() == TWIN


@given(st.lists(st.tuples(uint32, uint32, uint32, st.tuples(*[int32] * 6)), min_size=1, max_size=40))
def test_any_records_come_back_also_several_in_one_datagram(values):
    records = [Record(*value) for value in values]
    assert Parser().feed(b"".join(record(r) for r in records)) == records


@given(st.binary(max_size=200))
def test_datagrams_of_a_wrong_size_are_counted_and_change_nothing(data):
    parser = Parser()
    found = parser.feed(data)
    assert (len(found) > 0) == (len(data) % 36 == 0 and len(data) > 0)
    assert (parser.frames, parser.errors) == (len(found), int(not found))
    assert parser.feed(bytes.fromhex(TWIN))[0].sample == 1001


def test_a_million_damaged_bytes():
    parser = Parser()
    fuzz(parser.feed, bytes.fromhex(GOLDEN) * 4)
    assert parser.errors > 1000
    assert size_of(parser) < 2000
    assert len(parser.feed(bytes.fromhex(TWIN))) == 1


@pytest.mark.parametrize("data", [b"", b"\x12\x34\0\2", b"\x12\x35\0\2\0\0\0\0", b"\x12\x34" + bytes(12)])
def test_what_is_no_request_isn_t_taken_for_one(data):
    assert parse_request(data) is None


# settings


def test_the_sheet_s_page():
    found = settings.parse_page(PAGE)
    assert (found.product, found.force, found.torque) == ("Ethernet Axia", 1e-6, 1e-6)
    assert (found.range, found.sample_rate, found.record_rate) == ((), None, None)


@pytest.mark.parametrize(
    ("force", "torque", "newton", "newton_metre"),
    [
        ("lbf", "lbf-in", 4.4482216152605, 0.1129848290276167),
        ("klbf", "lbf-ft", 4448.2216152605, 1.3558179483314004),
        ("kN", "kNm", 1e3, 1e3),
        ("kgf", "kg-cm", 9.80665, 0.0980665),
        ("gf", "N-mm", 0.00980665, 1e-3),
        ("N", "N-m", 1.0, 1.0),
    ],
)
def test_units_become_si(force, torque, newton, newton_metre):
    page = PAGE.replace(b">N<", f">{force}<".encode()).replace(b">Nm<", f">{torque}<".encode())
    found = settings.parse_page(page)
    assert found.force * 1e6 == pytest.approx(newton, rel=1e-12)
    assert found.torque * 1e6 == pytest.approx(newton_metre, rel=1e-12)


def test_ratings_and_rates_where_the_page_has_them():
    more = b"<cfgmr>580;580;1160;20;20;20</cfgmr><runrate>7812.5</runrate><comrdtrate>1000</comrdtrate></netft>"
    found = settings.parse_page(PAGE.replace(b"</netft>", more).replace(b">Nm<", b">Nmm<"))
    assert found.range == (580, 580, 1160, 0.02, 0.02, 0.02)
    assert (found.sample_rate, found.record_rate) == (7812.5, 1000)


@pytest.mark.parametrize(
    ("page", "words"),
    [
        (b"<html><body>router</body></html>", "root is <html>"),
        (b"nonsense", "isn't XML"),
        (b"", "isn't XML"),
        (PAGE.replace(b"cfgcpf", b"other"), "no <cfgcpf>"),
        (PAGE.replace(b">1000000<", b">0<"), "counts per force are 0"),
        (PAGE.replace(b">1000000<", b">1e-310<"), "counts per force are 1e-310"),
        (PAGE.replace(b">1000000<", b">many<"), "counts per force are nan"),
        (PAGE.replace(b">N<", b">stone<"), "unit 'stone' isn't known"),
        (b"<!DOCTYPE x [<!ENTITY a 'b'>]>" + PAGE, "isn't a Net F/T"),
        (PAGE + b" " * 70000, "isn't a Net F/T"),
    ],
)
def test_other_pages_are_refused_in_words(page, words):
    with pytest.raises(ValueError, match=words):
        settings.parse_page(page)


@given(st.binary(max_size=400))
def test_no_page_raises_anything_else(data):
    for page in (data, PAGE[: len(data)] + data, PAGE.replace(b"1000000", data)):
        try:
            settings.parse_page(page)
        except ValueError:
            pass


def test_the_sheet_s_answer_to_read_calibration():
    golden = bytes.fromhex("12340203000f4240000f4240006400640064006400640064")
    assert bytes.fromhex("01" + "00" * 19) == settings.READ_CALIBRATION
    assert settings.calibration(1_000_000, 1_000_000, [100] * 6) == golden
    found = settings.parse_calibration(golden)
    assert (found.force, found.torque) == (1e-6, 1e-6)
    pounds = golden[:2] + b"\1\1" + golden[4:]
    assert settings.parse_calibration(pounds).torque == pytest.approx(0.1129848290276167e-6)


@pytest.mark.parametrize("answer", [b"", b"\x12\x34", bytes(24), struct.pack(">HBBII6H", 0x1234, 9, 3, 1, 1, *[1] * 6)])
def test_other_answers_are_refused(answer):
    with pytest.raises(ValueError, match="its"):
        settings.parse_calibration(answer)


# status


def test_status_words_by_family():
    assert status.family("Ethernet Axia80-M20") == "axia"
    assert status.family("Net F/T") == "net-box"
    assert status.errors(0x80020000, "net-box") == ("transducer saturated or A/D error",)
    assert status.errors(0xC0000000, "axia") == ("force or torque out of range",)
    assert status.errors(0x88000000, "axia") == ("gage out of range",)
    assert status.errors(0x80000004, "axia") == ("broken gage",)
    for family in ("axia", "net-box"):
        assert status.errors(0, family) == ()
        assert status.errors(0x80010000, family) == ()  # the latch alone is a remark
    assert status.errors(0x90000000, "axia") == ()  # the test bit
    assert status.errors(0x80000008, "axia") == ()  # busy
    assert status.errors(0x80000000, "axia") == ("an error it doesn't name",)


@given(uint32, st.sampled_from(["axia", "net-box"]))
def test_whatever_is_not_harmless_has_words(bits, family):
    harmless = {"axia": 1 << 16 | 1 << 3 | 1 << 28, "net-box": 1 << 16}[family]
    assert bool(status.errors(bits, family)) == bool(bits & ~harmless & ~(1 << 31) or bits == 1 << 31)
