"""The command channel of a simulated Franka robot survives any bytes."""

from __future__ import annotations

from collections import Counter

import pytest
from helpers import panda as helpers_panda
from helpers.fuzz import mutations
from hypothesis import given
from hypothesis import strategies as st

from srl.drivers.panda.protocol import encode_request
from srl.drivers.panda.requests import AutomaticErrorRecovery, Body, Connect, Move, SetLoad, StopMove
from srl.sim.devices.panda.twin_requests import Session

ROBOT = helpers_panda.Cabinet().robot
SEEN: Counter[str] = Counter()


@given(st.binary(max_size=300))
def test_any_bytes_are_survived(data: bytes) -> None:
    session = Session(ROBOT, SEEN)
    session.receive(encode_request(5, 0, Connect(5, 4)))
    session.receive(data)
    session.due()
    ROBOT.receive(data)
    session.close()


@pytest.mark.slow
def test_a_million_damaged_bytes_are_survived() -> None:
    session = Session(ROBOT, SEEN)
    session.receive(encode_request(5, 0, Connect(5, 4)))
    requests: list[Body] = [StopMove(), Move(2, 1), SetLoad(1.0, (0.0,) * 3, (0.0,) * 9), AutomaticErrorRecovery()]
    good = b"".join(encode_request(5, i, request) for i, request in enumerate(requests))
    for piece in mutations(good, 1, 1_000_000):
        session.receive(piece)
        session.due()
        ROBOT.step()
    ROBOT.controller.stop_move()
    session.due()
    answers = session.receive(bytes(500) + encode_request(5, 7, StopMove()) * 30)
    assert answers
    session.close()
