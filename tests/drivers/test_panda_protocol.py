"""FCI on the wire: golden bytes (from panda-python 1.1.1 and pylibfranka 0.21.3), both directions, garbage."""

import struct

import numpy as np
import pytest
from helpers.fuzz import fuzz, size_of
from hypothesis import given
from hypothesis import strategies as st

from srl.drivers.panda import packets
from srl.drivers.panda import protocol as p
from srl.drivers.panda import requests as r
from srl.drivers.panda.packets import ERRORS, Controller, Generator
from srl.drivers.panda.protocol import Reply, ReplyParser, Request, RequestParser, Status

IDENTITY = (1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0)
DEVIATIONS = "0000000000002440 f6285c8fc2f50840 182d4454fb211940"


def torque_move(version):
    generator = Generator.JOINT_VELOCITY if version == 5 else Generator.NONE
    return r.Move(Controller.EXTERNAL, generator - 1)


@pytest.mark.parametrize(
    ("version", "number", "body", "golden", "size"),
    [
        (5, 0, r.Connect(5, 0xABCD), "00000000 00000000 10000000 0500 cdab", 16),
        (
            5,
            1,
            r.SetCollisionBehavior(*[tuple(1.0 + i for i in range(7))] * 4, *[tuple(1.0 + i for i in range(6))] * 4),
            "04000000 01000000 ac010000 000000000000f03f 0000000000000040",
            428,
        ),
        (
            5,
            2,
            r.SetJointImpedance((1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0)),
            "05000000 02000000 44000000 000000000000f03f",
            68,
        ),
        (
            5,
            4,
            r.SetGuidingMode((True, False, True, False, True, False), True),
            "07000000 04000000 13000000 01 00 01 00 01 00 01",
            19,
        ),
        (5, 5, r.SetEEToK(IDENTITY), "08000000 05000000 8c000000 000000000000f03f", 140),
        (
            5,
            7,
            r.SetLoad(0.5, (0.1, 0.2, 0.3), IDENTITY[:9]),
            "0a000000 07000000 74000000 000000000000e03f 9a9999999999b93f 9a9999999999c93f 333333333333d33f "
            "000000000000f03f",
            116,
        ),
        (5, 8, r.AutomaticErrorRecovery(), "0c000000 08000000 0c000000", 12),
        (5, 9, torque_move(5), f"01000000 09000000 44000000 02000000 01000000 {DEVIATIONS} {DEVIATIONS}", 68),
        (5, 10, r.Move(0, 1), f"01000000 0a000000 44000000 00000000 01000000 {DEVIATIONS}", 68),
        (5, 11, r.Move(1, 0), f"01000000 0b000000 44000000 01000000 00000000 {DEVIATIONS}", 68),
        (5, 12, r.StopMove(), "02000000 0c000000 0c000000", 12),
        (5, 13, r.LoadModelLibrary(0, 0), "0d000000 0d000000 0e000000 00 00", 14),
        (5, 14, r.GetCartesianLimit(3), "03000000 0e000000 10000000 03000000", 16),
        (5, 15, r.SetFilters((1.0,) * 5), "0b000000 0f000000 34000000 000000000000f03f", 52),
        (10, 0, r.Connect(10, 0xABCD), "00000000 00000000 10000000 0a00 cdab", 16),
        (10, 1, r.GetRobotModel(), "0b000000 01000000 0c000000", 12),
        (10, 2, r.SetJointImpedance((1.0,) * 7), "04000000 02000000 44000000", 68),
        (10, 3, r.SetCartesianImpedance((1.0,) * 6), "05000000 03000000 3c000000", 60),
        (10, 6, r.SetLoad(0.5, (0.1, 0.2, 0.3), IDENTITY[:9]), "09000000 06000000 74000000", 116),
        (10, 7, r.AutomaticErrorRecovery(), "0a000000 07000000 0c000000", 12),
        (
            10,
            8,
            torque_move(10),
            f"01000000 08000000 7d000000 02000000 04000000 {DEVIATIONS} {DEVIATIONS} 00" + "00" * 56,
            125,
        ),
        (10, 9, r.Move(0, 1), "01000000 09000000 7d000000 00000000 01000000", 125),
        (10, 11, r.StopMove(), "02000000 0b000000 0c000000", 12),
    ],
)
def test_requests_are_the_golden_ones_and_are_read_back(version, number, body, golden, size):
    data = p.encode_request(version, number, body)
    assert data.startswith(bytes.fromhex(golden))
    assert len(data) == size
    assert RequestParser(version).feed(data) == [Request(number, body)]


def test_a_command_of_the_other_protocol_is_refused():
    for version, body in ((5, r.GetRobotModel()), (10, r.SetFilters((1.0,) * 5)), (10, r.LoadModelLibrary(0, 0))):
        with pytest.raises(ValueError, match=type(body).__name__):
            p.encode_request(version, 0, body)


@pytest.mark.parametrize(
    ("version", "command", "status", "byte"),
    [
        (5, r.Move, Status.MOTION_STARTED, 1),
        (5, r.Move, Status.PREEMPTED, 2),
        (5, r.Move, Status.NOT_POSSIBLE, 3),
        (5, r.Move, Status.REFLEX_ABORTED, 6),
        (5, r.Move, Status.ABORTED, 9),
        (10, r.Move, Status.PREEMPTED, 2),
        (10, r.Move, Status.SAFETY_PREEMPTED, 3),
        (10, r.Move, Status.SAFETY_REJECTED, 4),
        (10, r.Move, Status.REFLEX_ABORTED, 8),
        (10, r.Move, Status.ABORTED, 11),
        (5, r.StopMove, Status.EMERGENCY_ABORTED, 2),
        (10, r.StopMove, Status.SAFETY_REJECTED, 2),
        (5, r.AutomaticErrorRecovery, Status.MANUAL_RECOVERY, 2),
        (10, r.AutomaticErrorRecovery, Status.MANUAL_RECOVERY, 3),
        (5, r.SetLoad, Status.INVALID_ARGUMENT, 2),
        (10, r.SetLoad, Status.SAFETY_REJECTED, 3),
        (5, r.LoadModelLibrary, Status.ERROR, 1),
    ],
)
def test_statuses_have_the_numbers_of_their_protocol(version, command, status, byte):
    reply = Reply(command, 7, status)
    data = p.encode_reply(version, reply)
    assert data == struct.pack("<IIIB", p.commands(version).index(command), 7, 13, byte)
    assert ReplyParser(version).feed(data) == [reply]


def test_the_answer_to_connect_names_the_robots_version():
    data = p.connect_reply(10, 0, accepted=False)
    assert data == bytes.fromhex("00000000 00000000 0f000000 01 0a00")
    (reply,) = ReplyParser(5).feed(data)
    assert (reply.status, reply.version) == (Status.INCOMPATIBLE_VERSION, 10)


def test_replies_of_any_length_are_taken_only_where_they_are_awaited():
    model = Reply(r.GetRobotModel, 1, Status.SUCCESS, b"<robot/>")
    data = p.encode_reply(10, model)
    assert ReplyParser(10, largest=100).feed(data) == [model]
    closed = ReplyParser(10)
    assert closed.feed(data) == []
    assert closed.resyncs == 1


def test_padding_behind_a_reply_is_no_content():
    padded = struct.pack("<IIIB3x", 1, 9, 16, 1)
    parser = ReplyParser(10)
    assert parser.feed(padded + padded) == [Reply(r.Move, 9, Status.MOTION_STARTED)] * 2
    assert parser.resyncs == 0


@pytest.mark.parametrize("version", packets.VERSIONS)
def test_unknown_statuses_are_errors(version):
    parser = ReplyParser(version)
    assert parser.feed(struct.pack("<IIIB", 1, 0, 13, 200)) == []
    assert (parser.errors, parser.frames) == (1, 0)


@pytest.mark.parametrize("version", packets.VERSIONS)
@given(cuts=st.lists(st.integers(1, 60)))
def test_messages_are_the_same_however_they_are_cut(version, cuts):
    bodies = [r.Connect(version, 1), torque_move(version), r.StopMove(), r.SetJointImpedance((0.5,) * 7)]
    data = b"".join(p.encode_request(version, n, body) for n, body in enumerate(bodies))
    parser, got = RequestParser(version), []
    for cut in cuts:
        got += parser.feed(data[:cut])
        data = data[cut:]
    got += parser.feed(data)
    assert [request.body for request in got] == bodies
    assert (parser.frames, parser.errors, parser.resyncs) == (4, 0, 0)


@pytest.mark.slow
@pytest.mark.parametrize("version", packets.VERSIONS)
def test_a_flood_of_damage_leaves_both_parsers_able_to_read(version):
    requests = b"".join(
        p.encode_request(version, n, body) for n, body in enumerate((torque_move(version), r.StopMove()))
    )
    replies = b"".join(
        p.encode_reply(version, Reply(command, 3, Status.SUCCESS)) for command in (r.Move, r.StopMove, r.SetLoad)
    )
    for parser, good, pad in ((RequestParser(version), requests, 428), (ReplyParser(version), replies, 169)):
        fuzz(parser.feed, good, total=1_000_000)
        assert parser.resyncs > 100
        assert size_of(parser) < 40_000  # mostly the tables it points to
        # 0xff can't be part of a header: it ends what a false header still waits for.
        parser.feed(b"\xff" * pad)
        before = parser.frames
        assert len(parser.feed(good)) == parser.frames - before > 0
        assert parser.feed(good)[-1] == type(parser)(version).feed(good)[-1]


@pytest.mark.parametrize(
    ("version", "size", "offsets"),
    [
        (5, 2373, {"O_T_EE": 8, "tau_J": 1016, "q": 1184, "dq": 1296, "tau_ext_hat_filtered": 1672,
                   "O_F_ext_hat_K": 1728, "theta": 2168, "motion_generator_mode": 2280, "controller_mode": 2281,
                   "errors": 2282, "reflex_reason": 2323, "robot_mode": 2364, "control_command_success_rate": 2365}),
        (10, 1377, {"O_T_EE": 8, "tau_J": 512, "q": 596, "dq": 652, "tau_ext_hat_filtered": 840,
                    "O_F_ext_hat_K": 868, "theta": 1088, "accelerometer_top": 1144, "motion_generator_mode": 1288,
                    "errors": 1290, "reflex_reason": 1331, "robot_mode": 1372, "control_command_success_rate": 1373}),
    ],
)  # fmt: skip
def test_the_state_has_the_sheets_offsets(version, size, offsets):
    layout = packets.state_dtype(version)
    assert layout.itemsize == size
    assert layout.fields is not None
    assert {name: layout.fields[name][1] for name in offsets} == offsets


def test_commands_are_the_golden_ones():
    torque = packets.command_record(5)
    torque["message_id"] = 0x11223304
    assert torque.tobytes() == bytes.fromhex("0433221100000000") + bytes(362)
    velocity = packets.command_record(5)
    velocity["message_id"] = 0x11223309
    velocity["dq_c"][:3] = 0.1, 0.2, 0.3
    data = velocity.tobytes()
    assert data.startswith(bytes.fromhex("0933221100000000") + bytes(56))
    assert data[64:88] == bytes.fromhex("9a9999999999b93f 9a9999999999c93f 333333333333d33f")
    finished = packets.command_record(10)
    finished["torque_command_finished"] = True
    assert finished.tobytes() == bytes(370) + b"\x01"
    assert packets.command_dtype(5).fields["tau_J_d"][1] == 314
    assert packets.command_dtype(5).fields["motion_generation_finished"][1] == 313


@pytest.mark.parametrize("version", packets.VERSIONS)
def test_datagrams_are_read_back_and_wrong_sizes_refused(version):
    state = packets.state_record(version)
    state["message_id"] = 42
    state["q"] = np.arange(7)
    state["errors"] = packets.error_bits(["joint_reflex", "power_limit_violation"])
    data = state.tobytes()
    got = packets.decode_state(version, data + b"later")
    assert got is not None
    assert got["q"].tolist() == list(range(7))
    assert packets.error_names(got["errors"].tobytes()) == ("joint_reflex", "power_limit_violation")
    assert packets.decode_state(version, data[:-1]) is None
    command = packets.command_record(version).tobytes()
    assert packets.decode_command(version, command) is not None
    assert packets.decode_command(version, command + b"x") is None


def test_the_error_bits_stand_where_the_sheet_says():
    assert len(ERRORS) == 41
    for index, word in ((0, "joint_position"), (6, "joint_reflex"), (14, "velocity_disc"), (15, "acceleration_disc"),
                        (25, "communication_constraints"), (32, "torque_discontinuity"), (35, "instability"),
                        (40, "base_acceleration")):  # fmt: skip
        assert word in ERRORS[index]
