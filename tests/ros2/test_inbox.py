"""A stop waits for nothing, and what came before it isn't carried out; floods are cut, and hold nobody up."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import pytest
from helpers.wait import until

from srl.runtime.ros2.inbox import MOST, Inbox, Item


@pytest.fixture
def inbox() -> Iterator[Inbox]:
    made = Inbox()
    yield made
    made.close()


def test_a_stop_waits_for_no_request(inbox: Inbox) -> None:
    going, done = threading.Event(), []
    ask = inbox.requests(lambda item: going.wait(20) and None)
    for _ in range(50):
        ask("reset")
    inbox.stops(lambda item: done.append(item.what))("stop")
    until(lambda: done == ["stop"], what="the stop")
    going.set()


def test_what_came_before_a_stop_is_known_to_be_overtaken(inbox: Inbox) -> None:
    held, seen = threading.Event(), []

    def work(item: Item) -> None:
        held.wait(20)
        seen.append((item.what, inbox.overtaken(item)))

    ask = inbox.requests(work)
    ask("before")
    ask("waiting")
    inbox.stops(lambda item: None)("stop")
    ask("after")
    held.set()
    until(lambda: len(seen) == 3, what="all")
    assert seen == [("before", True), ("waiting", True), ("after", False)]


def test_of_a_flood_the_newest_is_taken_and_requests_are_cut(inbox: Inbox) -> None:
    held, values, asked = threading.Event(), [], []
    inbox.requests(lambda item: held.wait(20) and None)("block")
    setpoint = inbox.newest(lambda item: values.append(item.what))
    ask = inbox.requests(lambda item: asked.append(item.what))
    begin = time.monotonic()
    for number in range(20_000):
        setpoint(number)
        ask(number)
    assert time.monotonic() - begin < 15.0, "zenoh's threads aren't held up"
    held.set()
    until(lambda: values and asked, what="both")
    setpoint("last")
    until(lambda: values[-1] == "last", what="the last")
    assert values[0] == 19_999
    assert len(asked) <= MOST


def test_a_request_that_fails_ends_nothing(inbox: Inbox) -> None:
    done = []
    inbox.stops(lambda item: 1 / 0 and None)("stop")
    inbox.stops(lambda item: done.append(item.what))("again")
    until(lambda: done == ["again"], what="the second")
