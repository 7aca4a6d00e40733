"""Live parameters are parameters of the node: listed, described, read by anybody, and set where the profile says so."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from srl.runtime.contracts.errors import RequestError
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.messages import cdr
from srl.runtime.profile import profile, wiring
from srl.runtime.ros2.inbox import Inbox
from srl.runtime.ros2.names import PARAMETERS
from srl.runtime.ros2.parameters import DOUBLE, INTEGER, NOT_SET, Parameters

NAME = "mapping.drift_pull"


class Call:
    def __init__(self, payload: bytes) -> None:
        self.payload = payload
        self.answered: list[bytes] = []

    def answer(self, payload: bytes) -> None:
        self.answered.append(payload)


class Peer:
    """Who calls the services of a node without a router."""

    def __init__(self, may_change: bool) -> None:
        graph = wiring.build(*profile.load("sixth-finger"), [])
        Lockstep(graph).step()
        self.row = graph.row.words.copy()
        self.layout, self.inbox = graph.layout, Inbox()
        self.services: dict[str, Callable[[Any], None]] = {}
        self.changed: list[tuple[str, float]] = []
        self.name = type("Name", (), {"name": "sixth_finger"})
        Parameters(self, self.inbox, graph.layout, lambda: self.row, self.change if may_change else None)  # type: ignore[arg-type]

    def service(self, name: str, _: str, take: Callable[[Any], None]) -> None:
        self.services[name] = take

    def change(self, name: str, value: float) -> None:
        if value > 100.0:
            raise RequestError(name, f"{value:g} is above 100", "Stay below")
        self.changed.append((name, value))

    def call(self, name: str, kind: str, **request: Any) -> dict[str, Any]:
        call = Call(cdr.encode(f"{PARAMETERS}{kind}_Request", request))
        self.services[f"sixth_finger/{name}"](call)
        until = time.monotonic() + 10.0
        while not call.answered and time.monotonic() < until:
            time.sleep(0.001)
        return cdr.decode(f"{PARAMETERS}{kind}_Response", call.answered[0])

    def set(self, *given: tuple[str, int, float], atomically: bool = False) -> list[tuple[bool, str]]:
        """Each given: name, type, value."""
        empty: dict[str, Any] = {
            "bool_value": False, "integer_value": 0, "double_value": 0.0, "string_value": "", "byte_array_value": (),
            "bool_array_value": (), "integer_array_value": (), "double_array_value": (), "string_array_value": (),
        }  # fmt: skip
        parameters = [
            {"name": name, "value": empty | {"type": kind, "double_value": value, "integer_value": int(value)}}
            for name, kind, value in given
        ]
        if atomically:
            whole = self.call("set_parameters_atomically", "SetParametersAtomically", parameters=parameters)
            results = [whole["result"]]
        else:
            results = self.call("set_parameters", "SetParameters", parameters=parameters)["results"]
        return [(each["successful"], each["reason"]) for each in results]


@pytest.fixture
def peer() -> Iterator[Peer]:
    made = Peer(may_change=True)
    yield made
    made.inbox.close()


def test_they_are_listed_and_described_with_their_bounds(peer: Peer) -> None:
    listed = peer.call("list_parameters", "ListParameters", prefixes=[], depth=0)["result"]
    known = {entry["name"]: entry for entry in peer.layout.meta["parameters"]}
    assert listed["names"] == list(known)
    assert "mapping" in listed["prefixes"]
    (described,) = peer.call("describe_parameters", "DescribeParameters", names=[NAME])["descriptors"]
    (bounds,) = described["floating_point_range"]
    assert (described["type"], bounds["from_value"], bounds["to_value"]) == (
        DOUBLE, known[NAME]["lower"], known[NAME]["upper"],
    )  # fmt: skip
    assert known[NAME]["unit"] in described["description"]
    assert not described["read_only"]


@pytest.mark.parametrize(
    ("prefixes", "depth", "found"),
    [(["mapping"], 0, True), (["mapping"], 1, True), (["map"], 0, False), ([NAME], 0, True), ([], 1, False),
     ([], 2, True), (["other"], 0, False)],
)  # fmt: skip
def test_prefixes_and_depth_choose(peer: Peer, prefixes: list[str], depth: int, found: bool) -> None:
    names = peer.call("list_parameters", "ListParameters", prefixes=prefixes, depth=depth)["result"]["names"]
    assert (NAME in names) is found


def test_a_value_is_that_of_the_newest_row(peer: Peer) -> None:
    value, missing = peer.call("get_parameters", "GetParameters", names=[NAME, "no.such"])["values"]
    assert value["type"] == DOUBLE
    assert value["double_value"] == float(peer.layout.value(peer.row, NAME).item())
    assert missing["type"] == NOT_SET
    types = peer.call("get_parameter_types", "GetParameterTypes", names=[NAME, "no.such"])["types"]
    assert list(types) == [DOUBLE, NOT_SET]


def test_one_is_set_and_a_refusal_says_why(peer: Peer) -> None:
    assert peer.set((NAME, DOUBLE, 1.25), (NAME, INTEGER, 2)) == [(True, ""), (True, "")]
    assert peer.changed == [(NAME, 1.25), (NAME, 2)]
    for given, reason in (
        ((NAME, DOUBLE, 101.0), "above 100"), (("mapping.drift_pul", DOUBLE, 1.0), "Did you mean 'mapping.drift_pull'"),
        ((NAME, 4, 1.0), "takes a number"),
    ):  # fmt: skip
        ((done, why),) = peer.set(given)
        assert not done
        assert reason in why
    assert peer.set((NAME, DOUBLE, 1.0), atomically=True) == [(True, "")]
    assert not peer.set((NAME, DOUBLE, 1.0), (NAME, DOUBLE, 1.0), atomically=True)[0][0]
    assert len(peer.changed) == 3


def test_where_nothing_may_be_commanded_none_is_set() -> None:
    peer = Peer(may_change=False)
    try:
        ((done, why),) = peer.set((NAME, DOUBLE, 1.0))
        assert not done
        assert "bus.ros2.commands" in why
        (described,) = peer.call("describe_parameters", "DescribeParameters", names=[NAME])["descriptors"]
        assert described["read_only"]
    finally:
        peer.inbox.close()
