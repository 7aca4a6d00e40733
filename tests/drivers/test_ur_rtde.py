"""RTDE's messages: the sheet's golden vectors, recipes, and a parser that nothing upsets."""

import struct

import pytest
from helpers.fuzz import fuzz, size_of
from hypothesis import given
from hypothesis import strategies as st

from srl.drivers.ur import registers, rtde
from srl.drivers.ur.handshake import Handshake
from srl.drivers.ur.recipe import NOT_FOUND, Recipe, input_type, output_type, register
from srl.drivers.ur.rtde import Kind, Message, Parser
from srl.runtime.contracts.errors import DeviceError

DATA = bytes.fromhex("001455 01 40d0070d2f1a9fbe 3ff0000000000000")
CONTROLLER = bytes.fromhex("0013 76 00000005 00000008 00000000 00000000")
OUTPUTS = bytes.fromhex("00294f407f400000000000") + b"timestamp,actual_q,robot_mode,"
SERVO = bytes.fromhex(
    "0060 55 02 0000000b 3fb999999999999a bff8000000000000 3ff8000000000000 bff8000000000000 bff8000000000000"
    "3fc999999999999a 3fe0000000000000 3fd0000000000000 3f60624dd2f1a9fc 3fb999999999999a 4072c00000000000"
)
SPEED = bytes.fromhex(
    "0048 55 0d 00000009 3fb999999999999a 3fc999999999999a 3fd3333333333333 bfb999999999999a bfc999999999999a"
    "bfd3333333333333 3fe0000000000000 3f60624dd2f1a9fc"
)


def client(*recipes: tuple[int, Recipe]) -> Parser:
    parser = Parser(rtde.ANSWERS)
    for number, recipe in recipes:
        parser.data[number] = recipe.message_size
    return parser


def test_requests_are_those_of_the_sheet():
    assert rtde.ask_protocol() == bytes.fromhex("00 05 56 00 02")
    assert rtde.ask_controller() == bytes.fromhex("00 03 76")
    assert rtde.start() == bytes.fromhex("00 03 53")
    assert rtde.pause() == bytes.fromhex("00 03 50")
    assert rtde.ask_outputs(500.0, ["timestamp", "actual_q", "robot_mode", ""]) == OUTPUTS


def test_answers_are_those_of_the_sheet():
    assert rtde.accepted(Kind.PROTOCOL) == bytes.fromhex("00 04 56 01")
    assert rtde.accepted(Kind.START) == bytes.fromhex("00 04 53 01")
    assert rtde.accepted(Kind.PAUSE) == bytes.fromhex("00 04 50 01")
    assert rtde.version((5, 8, 0, 0)) == CONTROLLER
    assert rtde.recipe(Kind.INPUTS, 1, ["UINT32", "DOUBLE"]) == bytes.fromhex("00114901") + b"UINT32,DOUBLE"
    assert rtde.recipe(Kind.OUTPUTS, 1, ["DOUBLE", "VECTOR6D"]) == bytes.fromhex("00134f01") + b"DOUBLE,VECTOR6D"


def test_data_is_unpacked_as_the_vendors_test_says():
    recipe = Recipe(["timestamp", "speed_scaling"], ["DOUBLE", "DOUBLE"])
    (message,) = client((1, recipe)).feed(DATA)
    found = recipe.unpack(message.body)
    assert found == {"timestamp": pytest.approx(16412.206, abs=1e-3), "speed_scaling": 1.0}


@pytest.mark.parametrize(
    ("packet", "names", "values"),
    [
        (
            SERVO,
            ["input_int_register_0", *(f"input_double_register_{k}" for k in range(11))],
            [11, 0.1, -1.5, 1.5, -1.5, -1.5, 0.2, 0.5, 0.25, 0.002, 0.1, 300.0],
        ),
        (
            SPEED,
            ["input_int_register_0", *(f"input_double_register_{k}" for k in range(8))],
            [9, 0.1, 0.2, 0.3, -0.1, -0.2, -0.3, 0.5, 0.002],
        ),
        (bytes.fromhex("000a 55 02 0000000d 0808"),
         ["input_int_register_23", "standard_digital_output_mask", "standard_digital_output"], [13, 8, 8]),
        (bytes.fromhex("0014 55 04 00000016 00000001 3fe0000000000000"),
         ["input_int_register_23", "speed_slider_mask", "speed_slider_fraction"], [22, 1, 0.5]),
    ],
)  # fmt: skip
def test_ur_rtdes_own_packets_are_read_and_written_byte_by_byte(packet, names, values):
    recipe = Recipe(names, [input_type(name) for name in names])
    parser = Parser(rtde.REQUESTS)
    parser.data[packet[3]] = recipe.message_size
    (message,) = parser.feed(packet)
    assert list(recipe.unpack(message.body).values()) == pytest.approx(values)
    assert rtde.message(Kind.DATA, packet[3:4] + recipe.pack(values)) == packet


def test_vectors_and_integers_are_packed_without_gaps():
    recipe = Recipe(["a", "b", "c", "d"], ["UINT8", "VECTOR6INT32", "BOOL", "VECTOR3D"])
    values = [3, (1, -2, 3, -4, 5, -6), True, (0.5, -0.5, 2.0)]
    packed = recipe.pack(values)
    assert len(packed) == recipe.size == 1 + 24 + 1 + 24
    assert list(recipe.unpack(b"\x01" + packed).values()) == values


def test_our_command_is_a_data_message_of_our_recipe():
    recipe = Recipe(registers.INPUTS, registers.INPUT_TYPES)
    values = (0.1, -0.2, 0.3, -0.4, 0.5, -0.6)
    packet = registers.command(3, 77, registers.Mode.FOLLOW, 2**31 - 1, 25, values)
    assert packet == rtde.message(Kind.DATA, b"\x03" + recipe.pack([77, 1, 2**31 - 1, 25, *values]))
    assert len(packet) == registers.SIZE == recipe.message_size


@pytest.mark.parametrize(
    ("name", "wanted"),
    [
        ("actual_q", "VECTOR6D"), ("joint_mode", "VECTOR6INT32"), ("safety_status_bits", "UINT32"),
        ("actual_digital_input_bits", "UINT64"), ("output_int_register_47", "INT32"), ("payload_cog", "VECTOR3D"),
        ("output_double_register_0", "DOUBLE"), ("output_bit_register_127", "BOOL"),
        ("output_int_register_48", NOT_FOUND), ("actual_Q", NOT_FOUND), ("", NOT_FOUND),
    ],
)  # fmt: skip
def test_types_of_outputs(name, wanted):
    assert output_type(name) == wanted


def test_only_inputs_can_be_claimed():
    assert input_type("input_double_register_24") == "DOUBLE"
    assert input_type("output_double_register_24") == NOT_FOUND
    assert input_type("actual_q") == NOT_FOUND
    assert register("input_bit_register_64") == ("input", "bit", 64)


def test_a_remark_is_taken_apart():
    (message,) = client().feed(rtde.remark("arm stopped", "safety", 2))
    assert rtde.text(message.body) == ("arm stopped", "safety", 2)
    assert rtde.text(b"\x05abc\x00\x01") is None


def test_messages_are_joined_however_they_are_split():
    recipe = Recipe(["timestamp", "speed_scaling"], ["DOUBLE", "DOUBLE"])
    stream = CONTROLLER + DATA + rtde.remark("a", "b", 3) + DATA
    whole = client((1, recipe)).feed(stream)
    assert [message.kind for message in whole] == [118, 85, 77, 85]
    parser = client((1, recipe))
    assert [message for byte in stream for message in parser.feed(bytes([byte]))] == whole
    assert (parser.frames, parser.errors, parser.resyncs) == (4, 0, 0)


@given(st.lists(st.sampled_from([DATA, DATA[:7], DATA[7:], DATA + DATA, rtde.remark("a", "b", 3), b"\0", b""])))
def test_a_message_alone_is_what_feed_finds(chunks):
    recipe = Recipe(["timestamp", "speed_scaling"], ["DOUBLE", "DOUBLE"])
    one, other = client((1, recipe)), client((1, recipe))
    for chunk in chunks:
        body = one.sole(chunk)
        found = one.feed(chunk) if body is None else [Message(Kind.DATA, body)]
        assert found == other.feed(chunk)
    assert (one.frames, one.errors, one.resyncs) == (other.frames, other.errors, other.resyncs)


@given(st.binary(max_size=200))
def test_the_next_good_messages_are_found_behind_any_garbage(garbage):
    recipe = Recipe(["timestamp", "speed_scaling"], ["DOUBLE", "DOUBLE"])
    parser = client((1, recipe))
    parser.only(rtde.STREAM)
    # A header that happens to fit hides at most as many bytes as a message of its kind has: the longest, 516.
    found = parser.feed(garbage + DATA * 40)
    assert found[-1] == Message(Kind.DATA, DATA[3:])
    assert parser.frames == len(found)


def test_a_header_that_lies_about_its_length_costs_no_good_message_behind_it():
    recipe = Recipe(["timestamp", "speed_scaling"], ["DOUBLE", "DOUBLE"])
    parser = client((1, recipe))
    liar = struct.pack(">HB", 40, ord("M")) + b"\xff" * 20
    assert [m.body for m in parser.feed(liar + DATA + DATA) if m.kind == Kind.DATA] == [DATA[3:]] * 2
    assert parser.errors == 1
    assert parser.resyncs == 1


@pytest.mark.parametrize("sizes", [rtde.ANSWERS, rtde.REQUESTS, rtde.STREAM])
def test_a_million_mutated_bytes_neither_raise_nor_pile_up(sizes):
    parser = Parser(sizes)
    parser.data[1] = len(DATA)
    fuzz(parser.feed, CONTROLLER + DATA + rtde.remark("words", "source", 1) + OUTPUTS + DATA, total=350_000)
    assert size_of(parser) < 20_000
    last = parser.feed(DATA * 220)[-1]
    assert last == Message(Kind.DATA, DATA[3:])


def test_an_answer_that_is_not_text_is_refused_with_words():
    class Link:
        url = "tcp://nowhere"

        def write_all(self, data, timeout):
            pass

        def read_wait(self, timeout):
            return rtde.message(Kind.OUTPUTS, b"\x01\xff\xfe,\xff")

    with pytest.raises(DeviceError, match="RTDE answers"):
        Handshake(Link(), "arm").outputs(500.0, ["timestamp", "actual_q"], ["DOUBLE", "VECTOR6D"])
