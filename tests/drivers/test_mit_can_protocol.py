"""MIT mode's frames against encoders of others, and what no frame may ever be.

The hex strings are those of damiao-motor 1.0.6 (the same as lerobot's, openarm_can's and DM_Control_Python's),
mini-cheetah-motor-driver-socketcan 0.4.3, motor-python 0.0.11 and epically-powerful (V3).
"""

from __future__ import annotations

from math import isnan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from srl.drivers.mit_can import protocol
from srl.drivers.mit_can.models import MODELS, Range
from srl.drivers.mit_can.protocol import FIELD, SPECIAL, WORD, Impedance, command, parse_command

AK80_9, AK80_9_V3 = Range(12.5, 50, 18), Range(12.56, 65, 18)
AK60_6, DM4310, DM8009 = Range(12.5, 45, 15), Range(12.5, 30, 10), Range(12.5, 45, 54)
ZERO, MIXED = Impedance(), Impedance(1.0, -2.0, 50.0, 1.5, 3.0)
DAMP, HOLD = Impedance(kd=2.0), Impedance(0.5, kp=20.0, kd=0.5)
NEGATIVE = Impedance(-3.14159, 10.0, 5.0, 0.05, -1.25)
SPANS = st.sampled_from([r for m in MODELS.values() for rs in m.ranges.values() for r in rs])
ANY = st.floats(-1e6, 1e6)


@pytest.mark.parametrize(
    ("span", "wanted", "data"),
    [
        (AK80_9, ZERO, "7fff7ff0000007ff"),
        (AK80_9, MIXED, "8a3c7ad1994cc954"),
        (AK80_9, DAMP, "7fff7ff0006667ff"),
        (AK80_9, HOLD, "851e7ff0a31997ff"),
        (AK80_9, NEGATIVE, "5fd4999028028771"),
        (AK60_6, MIXED, "8a3c7a41994cc999"),
        (DM4310, ZERO, "7fff7ff0000007ff"),
        (DM4310, MIXED, "8a3c7771994cca65"),
        (DM4310, DAMP, "7fff7ff0006667ff"),
        (DM4310, HOLD, "851e7ff0a31997ff"),
        (DM8009, MIXED, "8a3c7a41994cc871"),
    ],
)
def test_commands_are_those_of_other_encoders(span: Range, wanted: Impedance, data: str) -> None:
    assert command(wanted, span).hex() == data


@pytest.mark.parametrize(
    ("wanted", "data"),
    [
        (ZERO, "0000007fff7ff7ff"),
        (MIXED, "1994cc8a307c0954"),
        (DAMP, "0006667fff7ff7ff"),
        (HOLD, "0a319985177ff7ff"),
    ],
)
def test_v3_has_the_gains_first(wanted: Impedance, data: str) -> None:
    assert command(wanted, AK80_9_V3, v3=True).hex() == data


def test_the_largest_command_has_one_step_less_stiffness_than_others_give() -> None:
    most = Impedance(12.5, 30, 500, 5, 10)
    assert command(most, DM4310).hex() == "fffffffffeffffff"  # theirs: all f, a torque step from "set zero"


@given(SPANS, ANY, ANY, ANY, ANY, ANY, st.booleans())
def test_no_command_is_a_special_frame_and_none_spills(
    span: Range, p: float, v: float, kp: float, kd: float, t: float, v3: bool
) -> None:
    data = command(Impedance(p, v, kp, kd, t), span, v3)
    assert data not in SPECIAL
    assert len(data) == 8
    back = parse_command(data, span, v3)

    def near(got: float, asked: float, low: float, high: float, full: int) -> bool:
        clamped = min(max(asked, low), high)
        return clamped - 2.01 * (high - low) / full <= got <= clamped + 1e-9

    assert near(back.position, p, -span.position, span.position, WORD)
    assert near(back.velocity, v, -span.velocity, span.velocity, FIELD)
    assert near(back.kp, kp, 0, 500, FIELD)
    assert near(back.kd, kd, 0, 5, FIELD)
    assert near(back.torque, t, -span.torque, span.torque, FIELD)


@given(SPANS, st.floats(-1, 1), st.floats(-1, 1))
def test_the_sign_of_a_torque_is_never_turned(span: Range, p: float, t: float) -> None:
    back = parse_command(command(Impedance(p * span.position, torque=t * span.torque), span), span)
    step = 2 * span.torque / FIELD
    assert back.torque * t >= 0 or abs(back.torque) <= step


@pytest.mark.parametrize("wrong", [float("nan"), float("inf"), float("-inf")])
def test_what_is_not_finite_is_refused(wrong: float) -> None:
    for field in ("position", "velocity", "kp", "kd", "torque"):
        with pytest.raises(ValueError, match="finite"):
            command(Impedance(**{field: wrong}), DM4310)


def test_replies_are_read_as_others_read_them() -> None:
    state = protocol.damiao_reply(bytes.fromhex("118a3c7ae8ab2d30"), DM4310)
    assert (state.position, state.velocity) == pytest.approx((0.9996566720073243, -1.1941391941391934))
    assert state.torque == pytest.approx(0.8376068376068382)
    assert (state.code, state.stage, state.temperature, state.hottest) == (1, 45, 48, 48)
    lost = protocol.damiao_reply(bytes.fromhex("d180007ff7ff2a2c"), DM4310)
    assert lost.code == 0xD
    assert "watchdog" in protocol.in_words(lost.code, True)
    ak = protocol.ak_reply(bytes.fromhex("018a3c7ae8ab2d00"), AK80_9)
    assert (ak.position, ak.velocity) == pytest.approx((0.9996566720073243, -1.9902319902319903))
    assert ak.torque == pytest.approx(1.5076923076923094)
    assert (ak.temperature, ak.code) == (45 - 40, 0)
    for shorter in ("018a3c7ae8ab", "018a3c7ae8ab30"):  # V1; the reference firmware, which tells its supply's voltage
        found = protocol.ak_reply(bytes.fromhex(shorter), AK80_9)
        assert (found.position, found.torque, found.code) == (ak.position, ak.torque, 0)
        assert isnan(found.temperature)


def test_half_a_step_is_no_motion() -> None:
    state = protocol.parse_reply(bytes.fromhex("017fff7ff7ff"), DM4310)
    assert state.velocity < 0
    assert protocol.dead(state.velocity, DM4310.velocity) == 0
    assert protocol.dead(3 * state.velocity, DM4310.velocity) != 0


@given(SPANS, st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1))
def test_what_a_drive_packs_is_read_back(span: Range, p: float, v: float, t: float) -> None:
    truth = p * span.position, v * span.velocity, t * span.torque
    state = protocol.parse_reply(protocol.pack_reply(1, *truth, span, b"\x40\x00"), span)
    steps = (2 * span.position / WORD, 2 * span.velocity / FIELD, 2 * span.torque / FIELD)
    for got, asked, step in zip((state.position, state.velocity, state.torque), truth, steps, strict=True):
        assert asked - step * 1.001 <= got <= asked + 1e-9


def test_a_v3_status_is_in_degrees_and_electrical_turns() -> None:
    state = protocol.v3_status(bytes.fromhex("0384ff9c01f42d00"), 21, 9.0, 0.5)
    assert state.position == pytest.approx(1.5707963)  # 90 deg
    assert state.velocity == pytest.approx(-1000 / 21 / 9 * 0.10471976)  # -1000 electrical rpm
    assert (state.torque, state.temperature, state.code) == (pytest.approx(2.5), 45, 0)  # 5 A
    packed = protocol.pack_status(state.position, state.velocity, state.torque, 45, 0, 21, 9.0, 0.5)
    assert packed.hex() == "0384ff9c01f42d00"


def test_registers_are_those_of_other_clients() -> None:
    assert protocol.read_register(1, 10).hex() == "0100330a00000000"
    assert protocol.read_register(1, 21).hex() == "0100331500000000"
    assert protocol.write_register(1, 9, 2000).hex() == "01005509d0070000"
    assert protocol.write_register(1, 10, 1).hex() == "0100550a01000000"
    assert protocol.ask_state(1).hex() == "0100cc0000000000"
    assert protocol.parse_register(bytes.fromhex("0100331500004841"), 1) == (21, 12.5)
    assert protocol.parse_register(bytes.fromhex("0100331500004841"), 2) is None
    assert protocol.parse_register(bytes.fromhex("118a3c7ae8ab2d30"), 1) is None
    assert [frame[-1] for frame in (protocol.CLEAR, protocol.ENABLE, protocol.DISABLE, protocol.SET_ZERO)] == [
        0xFB, 0xFC, 0xFD, 0xFE,
    ]  # fmt: skip
