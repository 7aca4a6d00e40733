"""Feetech's packets and registers against golden vectors that public clients made."""

import json

import numpy as np
import pytest
from helpers.shared import shared
from hypothesis import given
from hypothesis import strategies as st

from srl.drivers.feetech import protocol as p
from srl.drivers.feetech.faults import bits_in_words
from srl.drivers.feetech.table import SCS_GOAL, SCS_LOCK, TABLE, signed


def _one(name, value, id=1):
    register = TABLE[name]
    return p.write(id, register.address, register.encode(value))


def _all(name, values):
    register = TABLE[name]
    return p.sync_write(register.address, register.size, {id: register.encode(v) for id, v in values.items()})


def _acc_goal_time_speed(position, speed, acceleration):
    parts = {"acceleration": acceleration, "goal_position": position, "goal_time": 0, "goal_velocity": speed}
    return p.write(1, 41, b"".join(TABLE[name].encode(value) for name, value in parts.items()))


OURS = {
    "ping 1": lambda: p.ping(1),
    "torque on 1": lambda: _one("torque_enable", 1),
    "torque off 1": lambda: _one("torque_enable", 0),
    "128 to address 40 (recentre)": lambda: _one("torque_enable", 128),
    "unlock EEPROM (STS)": lambda: _one("lock", 0),
    "lock EEPROM (STS)": lambda: _one("lock", 1),
    "unlock EEPROM (SCS)": lambda: p.write(1, SCS_LOCK.address, SCS_LOCK.encode(0)),
    "goal 2048": lambda: _one("goal_position", 2048),
    "goal -100 (sign bit 15)": lambda: _one("goal_position", -100),
    "goal velocity -1000": lambda: _one("goal_velocity", -1000),
    "homing offset -85 (sign bit 11)": lambda: _one("homing_offset", -85),
    "read position": lambda: p.read(1, 56, 2),
    "read 56..70": lambda: p.read(1, 56, 15),
    "reg write goal 1000": lambda: p.reg_write(1, 42, TABLE["goal_position"].encode(1000)),
    "action": lambda: p.packet(p.BROADCAST, p.ACTION),
    "sync write goals 1:1024 2:2048 3:3072": lambda: _all("goal_position", {1: 1024, 2: 2048, 3: 3072}),
    "sync write torque off 1,2,3": lambda: _all("torque_enable", dict.fromkeys((1, 2, 3), 0)),
    "sync read 56,2 ids 1,2,3": lambda: p.group_read(56, 2, (1, 2, 3)),
    "sync read 56,4 ids 1,2,3": lambda: p.group_read(56, 4, (1, 2, 3)),
    "WritePosEx 2048 speed 1000 acc 50": lambda: _acc_goal_time_speed(2048, 1000, 50),
    "WriteSpec -1000 acc 50": lambda: _acc_goal_time_speed(0, -1000, 50),
    "SCS goal 512 (big-endian)": lambda: p.write(1, 42, SCS_GOAL.encode(512)),
    "SCS sync write 1:300 2:512 3:700": lambda: p.sync_write(
        42, 2, {1: SCS_GOAL.encode(300), 2: SCS_GOAL.encode(512), 3: SCS_GOAL.encode(700)}
    ),
    "reply position 2048": lambda: p.status(1, 0, TABLE["present_position"].encode(2048)),
    "reply overload, id 1": lambda: p.status(1, p.OVERLOAD),
}
DECODED = "reply 56..70: pos 2048, speed -50, load -100, 12.0 V, 37 C, moving 1, current -16"


def vectors():
    data = json.loads(shared("protocols/can_actuators.vectors.json").read_text())
    return {row["what"]: bytes.fromhex(row["data"]) for row in data["feetech"]}


def test_every_golden_packet_is_ours():
    golden = vectors()
    assert set(golden) == {*OURS, DECODED}
    for what, make in OURS.items():
        assert make() == golden[what], what


def test_the_golden_answer_is_decoded_with_its_signs():
    (status,) = p.Parser().statuses(vectors()[DECODED])
    assert (status.id, status.error) == (1, 0)
    found = {
        name: TABLE[name].decode(status.data, 56)
        for name in (
            "present_position", "present_velocity", "present_load", "present_voltage", "present_temperature",
            "moving", "present_current",
        )
    }  # fmt: skip
    assert list(found.values()) == [2048, -50, -100, 120, 37, 1, -16]


@given(st.sampled_from(sorted(TABLE)), st.integers(-70_000, 70_000))
def test_a_number_comes_back_or_is_refused(name, value):
    register = TABLE[name]
    low, high = register.span
    if low <= value <= high:
        assert register.decode(register.encode(value), register.address) == value
    else:
        with pytest.raises(ValueError, match="doesn't fit"):
            register.encode(value)


def test_what_a_public_client_sends_wrongly_cannot_be_sent():
    # Its WritePosEx makes 0xFF9C of -100, which a servo takes for -32668; SCS_TOSCS(-3000, 11) loses the sign.
    assert TABLE["goal_position"].encode(-100) == b"\x64\x80"
    assert TABLE["goal_position"].decode(b"\x9c\xff", 42) == -32668
    with pytest.raises(ValueError, match="doesn't fit"):
        TABLE["homing_offset"].encode(-3000)


def test_many_numbers_are_decoded_as_one_is():
    raw = np.arange(0, 0x10000, 37, dtype="<u2")
    expected = [TABLE["present_position"].decode(int(x).to_bytes(2, "little"), 56) for x in raw]
    assert signed(raw, 15).tolist() == expected


@given(st.dictionaries(st.integers(0, 252), st.integers(-28_672, 28_672), min_size=1, max_size=8), st.integers(0, 200))
def test_a_goal_that_was_cut_is_never_obeyed(goals, at):
    """Whatever was cut of a packet of goals, the filler completes it to one that a servo refuses."""
    frame = _all("goal_position", goals)
    cut = frame[: at % len(frame)]
    filler = p.filler(tuple(goals), frame)
    parser = p.Parser()
    assert [i for i in parser.instructions(cut + filler) if i.code == p.SYNC_WRITE] == []
    assert parser.instructions(frame + frame)[-1].code == p.SYNC_WRITE  # and what follows is taken


def test_a_fixed_filler_would_be_obeyed_now_and_then():
    """Why the filler is chosen: one byte for all cuts makes the sum right for some goals."""
    obeyed = 0
    for goal in range(0, 4096, 7):
        frame = _all("goal_position", {1: goal, 2: goal})
        for at in range(4, len(frame) - 1):
            obeyed += bool(p.Parser().instructions(frame[:at] + b"\x7e" * p.LONGEST))
    assert obeyed > 0


@pytest.mark.parametrize(
    ("bits", "words"),
    [(0, ""), (1, "voltage"), (2, "angle sensor"), (4, "overheating"), (8, "over-current"), (32, "overload")],
)
def test_error_bits_in_words(bits, words):
    assert words in bits_in_words(bits)
    assert bool(bits_in_words(bits)) == bool(bits)
    assert "0x50" in bits_in_words(bits | 0x50)
