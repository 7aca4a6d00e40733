"""What reaches the request ring, and in which order."""

from __future__ import annotations

import json
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.bus import layout

from srl.runtime.bus.arrivals import ASIDE, QUERIES, SAMPLES, Arrivals, came
from srl.runtime.bus.requests import TIMEOUT, UNDERWAY, WAITING, Requests
from srl.runtime.bus.status import Counts
from srl.runtime.ipc.header import CYCLE, DEVICE, Latch, Origin, State
from srl.runtime.ipc.requests import Answer, RequestKind, RequestReader, RequestWriter
from srl.runtime.ipc.row import Row
from srl.runtime.profile.keys import Keys


class Query:
    """What of a zenoh query is used."""

    def __init__(self, key: str, payload: bytes | None = None) -> None:
        self.key_expr, self.encoding = key, "zenoh/bytes"
        self.payload = None if payload is None else self
        self._payload = payload
        self.answers: list[dict[str, Any]] = []
        self.dropped = 0
        self.attachment: Attachment | None = None

    def to_bytes(self) -> bytes:
        assert self._payload is not None
        return self._payload

    def reply(self, key: str, content: str, encoding: str) -> None:
        assert not self.dropped
        self.answers.append(json.loads(content))

    def drop(self) -> None:
        self.dropped += 1


class Attachment:
    def __init__(self, content: bytes) -> None:
        self._content = content

    def to_bytes(self, *_: object) -> bytes:
        return self._content


class Desk:
    def __init__(self, path: Path) -> None:
        RequestWriter.create(path / "requests.ring")
        self.layout = layout("sixth-finger", 100)
        self.sent = RequestReader(path / "requests.ring")
        self.counts, self.arrivals = Counts(), Arrivals()
        self.keys = Keys("sixth-finger")
        self.requests = Requests(
            self.layout, self.keys, RequestWriter(path / "requests.ring"), self.counts, self.arrivals
        )
        self.row = Row(self.layout)
        self.handlers = self.requests.handlers()
        self.turn()

    def ask(self, key: str, payload: bytes | None = None) -> Query:
        query = Query(key, payload)
        self.handlers[key](query)  # type: ignore[arg-type]
        return query

    def turn(
        self, number: int = 0, kind: RequestKind = RequestKind.NONE, answer: Answer = Answer.DONE, silent: bool = False
    ) -> None:
        """A row of the loop that took request `number`."""
        words = self.row.ints
        words[CYCLE.cycle] += 1
        words[CYCLE.state] = State.STOPPED
        words[CYCLE.request], words[CYCLE.request_kind], words[CYCLE.request_result] = (
            number,
            kind,
            answer,
        )
        words[CYCLE.request_origin] = Origin.BUS if number else Origin.NONE
        words[CYCLE.latches] = Latch.PERSON
        rows = self.row.words[np.newaxis].copy()
        self.requests.turn(rows, rows[-1], silent)


@pytest.fixture
def desk(tmp_path: Path) -> Desk:
    return Desk(tmp_path)


def test_a_stop_overtakes_and_cancels_what_would_move(desk: Desk) -> None:
    pull = desk.keys.parameter("object-mapping.pull")
    parameters = [desk.ask(pull, b"1") for _ in range(UNDERWAY + 2)]
    reset = desk.ask(desk.keys.command("reset"))
    stop = desk.ask(desk.keys.command("stop"))
    assert [r.kind for r in desk.sent.take()] == [RequestKind.PARAMETER] * UNDERWAY + [RequestKind.STOP]
    assert reset.dropped == 1
    assert "a stop came after it" in reset.answers[0]["error"]
    assert not stop.answers
    for number in range(1, UNDERWAY + 2):
        desk.turn(number, RequestKind.PARAMETER if number <= UNDERWAY else RequestKind.STOP)
    assert stop.answers == [{"ok": True, "state": "stopped"}]
    assert [r.kind for r in desk.sent.take()] == [RequestKind.PARAMETER] * 2
    assert [len(p.answers) for p in parameters] == [1] * UNDERWAY + [0, 0]


def test_a_flood_is_refused_before_the_ring_is_full(desk: Desk) -> None:
    queries = [desk.ask(desk.keys.command("stop")) for _ in range(WAITING + 10)]
    queries += [desk.ask(desk.keys.command("start")) for _ in range(WAITING + 10)]
    refused = [q for q in queries if q.answers]
    assert len(refused) == 20
    assert all("too many requests" in q.answers[0]["error"] for q in refused)


def test_the_newest_setpoint_goes_out_once_a_cycle(desk: Desk) -> None:
    key = desk.keys.setpoint("client.force")
    queries = [desk.ask(key, f"[{value}, 0, 0]".encode()) for value in range(5)]
    assert all("a newer setpoint took its place" in q.answers[0]["error"] for q in queries[:-1])
    desk.turn()
    assert [r.values.tolist() for r in desk.sent.take()] == [[4, 0, 0]]
    desk.ask(key, b"[7, 0, 0]")
    desk.requests.turn(np.empty((0, desk.layout.width), np.int64), desk.row.words.copy(), False)
    assert desk.sent.take() == []  # the same cycle still
    desk.turn()
    assert [r.values.tolist() for r in desk.sent.take()] == [[7, 0, 0]]


@pytest.mark.parametrize("role", [None, "operator", "engineer"])
def test_a_setpoint_that_isnt_there_is_named_as_its_sender_named_it(desk: Desk, role: str | None) -> None:
    keys = Keys("sixth-finger", role)
    desk.requests.subscribers()[keys.setpoints](Query(keys.setpoint("client.torque"), b"[1, 2, 3]"))  # type: ignore[arg-type]
    assert "there is no setpoint 'client.torque'" in desk.counts.last_rejection


def test_a_setpoint_is_answered_once_the_loops_rows_hold_it(desk: Desk) -> None:
    query = desk.ask(desk.keys.setpoint("client.force"), b"[1, 2, 3]")
    client = desk.row.devices[desk.layout.devices.index("client")]
    desk.turn()  # it is sent
    desk.turn()
    assert not query.answers
    client[DEVICE.frames] += 1  # of another setpoint
    desk.turn()
    assert not query.answers
    desk.row.views["client.force"][:] = 1, 2, 3
    desk.turn()
    assert query.answers == [{"ok": True, "state": "stopped"}]
    assert query.dropped == 1
    assert not desk.requests.busy


def test_a_setpoint_that_the_loop_does_not_take_is_not_said_to_be_taken(
    desk: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    query = desk.ask(desk.keys.setpoint("client.force"), b"[1, 2, 3]")
    desk.turn()
    now = time.monotonic_ns()
    monkeypatch.setattr(time, "monotonic_ns", lambda: now + 2 * TIMEOUT)
    desk.turn()
    assert "the loop gave no answer" in query.answers[0]["error"]
    assert query.dropped == 1


def test_no_setpoint_waits_for_a_dead_loop(desk: Desk) -> None:
    desk.ask(desk.keys.setpoint("client.force"), b"[1, 2, 3]")
    desk.turn(silent=True)
    desk.turn()
    assert desk.sent.take() == []
    desk.turn(silent=True)
    query = desk.ask(desk.keys.setpoint("client.force"), b"[1, 2, 3]")
    assert query.answers[0]["ok"] is False


@pytest.mark.parametrize(
    ("answer", "output"),
    [
        (Answer.REFUSED_STATE, "not possible while stopped"),
        (Answer.REFUSED_FAULT, "still there"),
        (Answer.REFUSED_VALUE, "out of bounds"),
        (Answer.EXPIRED, "too late"),
        (Answer.REFUSED_LATCH, r"may not release what stands (person). Run `srl reset sixth-finger` on its machine"),
        (Answer.REFUSED_RATE, "more than 5 a second"),
        (Answer.OVERTAKEN, "a stop came after it"),
    ],
)
def test_every_answer_of_the_loop_has_words(desk: Desk, answer: Answer, output: str) -> None:
    query = desk.ask(desk.keys.command("reset"))
    desk.turn(1, RequestKind.RESET, answer)
    assert query.dropped == 1
    assert output in query.answers[0]["error"]
    assert query.answers[0]["state"] == "stopped"


def test_every_query_is_answered_at_the_end(desk: Desk) -> None:
    queries = [desk.ask(desk.keys.command(name)) for name in ("start", "reset", "stop")]
    desk.requests.end()
    assert all(q.dropped == 1 and q.answers for q in queries)


def test_a_crowd_leaves_room_for_a_stop_and_what_came_before_it_moves_nothing(desk: Desk) -> None:
    """What came before the stop is refused, though it is handled after it."""
    keys = {name: desk.keys.command(name) for name in ("start", "reset", "stop")}
    into = {name: desk.arrivals.into(desk.handlers[keys[name]]) for name in ("start", "reset")}  # type: ignore[arg-type]
    crowd = [Query(keys["reset"]) for _ in range(2 * SAMPLES)]
    for query in crowd:
        into["reset"](query)
    desk.arrivals.into_stops(desk.handlers[keys["stop"]], keys["stop"])(Query(keys["stop"]))  # type: ignore[arg-type]
    desk.arrivals.handle(1.0)
    assert [r.kind for r in desk.sent.take()] == [RequestKind.STOP]
    assert all("a stop came after it" in query.answers[0]["error"] for query in crowd[:SAMPLES])
    desk.arrivals.handle(0.0)
    into["start"](Query(keys["start"]))
    desk.arrivals.handle(1.0)
    assert [r.kind for r in desk.sent.take()] == [RequestKind.START]


@pytest.mark.parametrize(("late", "moved"), [(True, []), (False, [RequestKind.RESET])])
def test_what_is_passed_on_counts_from_when_it_came_to_who_passes_it_on(
    desk: Desk, late: bool, moved: list[RequestKind]
) -> None:
    """A node has two ways to the bus: its stop may be there before the reset that came to it earlier."""
    reset, stop = desk.keys.command("reset"), desk.keys.command("stop")
    query, before = Query(reset), time.monotonic_ns()
    desk.arrivals.into_stops(desk.handlers[stop], stop)(Query(stop))  # type: ignore[arg-type]
    desk.arrivals.handle(0.0)
    desk.sent.take()
    query.attachment = Attachment(came(before if late else time.monotonic_ns() + 10**12))
    desk.arrivals.into(desk.handlers[reset])(query)  # type: ignore[arg-type]
    desk.arrivals.handle(1.0)
    assert [r.kind for r in desk.sent.take()] == moved
    assert bool(query.answers) is late


def test_a_flood_of_wildcards_takes_no_stops_room_and_overtakes_nothing(desk: Desk) -> None:
    key, start = desk.keys.command("stop"), desk.keys.command("start")
    arrive = desk.arrivals.into_stops(desk.handlers[key], key)  # type: ignore[arg-type]
    desk.arrivals.into(desk.handlers[start])(Query(start))  # type: ignore[arg-type]
    flood = [Query("srl/**") for _ in range(2 * QUERIES)]
    for query in flood:
        arrive(query)
    desk.arrivals.handle(1.0)
    assert [r.kind for r in desk.sent.take()] == [RequestKind.START], "nobody has asked for a stop"
    arrive(stop := Query(key))
    assert not stop.dropped, "there is room for a stop"
    desk.arrivals.handle(0.0)
    assert [r.kind for r in desk.sent.take()] == [RequestKind.STOP]
    assert "not a wildcard" in flood[0].answers[0]["error"]


def test_who_only_reads_takes_no_room_and_comes_last() -> None:
    arrivals, done, dropped = Arrivals(), [], []
    read = arrivals.into(lambda _: done.append("read"), aside=True)
    for _ in range(2 * QUERIES):
        query = Query("srl/left/as/observer/cmd/stop")
        query.drop = lambda: dropped.append(1)  # type: ignore[method-assign]
        read(query)
    setpoint = arrivals.into(lambda _: done.append("setpoint"))
    for _ in range(SAMPLES // 2):
        setpoint(object())
    arrivals.handle(0.0)
    assert done == ["setpoint"] * (SAMPLES // 2) + ["read"] * ASIDE
    assert len(dropped) == QUERIES


def test_a_signal_at_the_end_of_a_wait_doesnt_hold_the_bus_for_ever() -> None:
    arrivals = Arrivals()

    def outlast(*_: object) -> None:
        time.sleep(0.1)  # nothing of the timeout is left when the handler returns
        arrivals.wake()

    before = signal.signal(signal.SIGALRM, outlast)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.02)
        arrivals.handle(0.05)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def test_a_request_that_fails_ends_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    arrivals, done = Arrivals(), []
    arrivals.into(lambda what: 1 / what)(0)
    arrivals.into(done.append)("next")
    arrivals.handle(1.0)
    assert done == ["next"]
    assert "ZeroDivisionError" in capsys.readouterr().err
