"""The ring's driver on both of its twins, and the fake beside it."""

from __future__ import annotations

from collections.abc import Iterator
from threading import Event, Thread
from typing import Any

import pytest
from helpers.fuzz import fuzz, size_of
from helpers.twin import StillWorld, bound

from srl.drivers.evdev import Description
from srl.drivers.ring import Ring, RingConfig
from srl.drivers.ring.serial_ring import Line, Parser
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.sim.devices.ring.fake import FakeRing, FakeRingConfig
from srl.sim.devices.ring.twin import ring_twin

MS = 1_000_000
PRESSES = [[0.5, 0.9], [1.2, 1.25], [2.0, 2.01], [3.0, 3.5]]  # the third is shorter than the debouncing


class Pair:
    """The ring behind one of its doors, stepped by milliseconds."""

    def __init__(self, port: str, hold: bool = True, **options: Any) -> None:
        self.world = StillWorld()
        config = RingConfig(port=port, hold=hold)
        self.fake = bound(FakeRing("ring", config, self.world, FakeRingConfig(presses=PRESSES, **options)))
        self.twin: Any = ring_twin(self.fake)
        self.twin.open()
        self.driver: Ring = bound(Ring("ring", RingConfig(port=self.twin.address, hold=hold)))
        self.opened()
        self.fake.open()

    def opened(self) -> None:
        done = Event()
        server = Thread(target=lambda: [self.twin.service(0) for _ in iter(lambda: done.wait(0.001), True)])
        server.start()
        try:
            self.driver.open()
        finally:
            done.set()
            server.join()

    def until(self, seconds: float, read: bool = True) -> None:
        while self.world.time < seconds * 1e9:
            self.world.time += MS
            self.twin.service(self.world.time)
            if read:
                self.driver.read(self.world.time)
                self.fake.read(self.world.time)

    @property
    def presses(self) -> tuple[float, float]:
        return self.driver.state_arrays["presses"][0], self.driver.state_arrays["buttons"][0]


@pytest.fixture(params=["input", "/dev/ttyACM3"])
def pair(request: Any) -> Iterator[Pair]:
    made = Pair(request.param)
    yield made
    made.driver.close()
    made.twin.close()


def test_presses_are_counted_and_chatter_isnt(pair: Pair) -> None:
    for seconds, presses, down in [
        (0.4, 0, 0), (0.54, 1, 1), (0.95, 1, 0), (1.24, 2, 1), (1.5, 2, 0), (2.5, 2, 0), (3.2, 3, 1), (3.6, 3, 0)
    ]:  # fmt: skip
        pair.until(seconds)
        assert pair.presses == (presses, down), seconds
        fake = pair.fake.state_arrays
        assert (fake["presses"][0], fake["buttons"][0]) == (presses, down)
    assert pair.driver.health.errors == 0


def test_a_sleeping_remote_is_no_loss_and_wakes_up() -> None:
    pair = Pair("input", asleep=[[0.7, 2.5]])
    pair.until(0.6)
    assert pair.presses == (1, 1)
    pair.until(0.75)
    assert pair.presses == (1, 0)
    assert pair.driver.health.connected
    assert "asleep" in pair.driver.health.message
    pair.until(3.2)
    assert pair.driver.health.stamp == pair.world.time
    pair.until(4.6)
    pair.driver.read(pair.world.time)
    assert pair.driver.health.message == "awake"
    assert pair.driver.health.reconnects == 1
    pair.driver.close()
    pair.twin.close()


def test_a_remote_that_only_clicks_counts_clicks() -> None:
    pair = Pair("input", hold=False, bounce=0)
    pair.until(3.6)
    assert pair.presses == (4, 0)
    pair.driver.close()
    pair.twin.close()


def test_a_serial_ring_without_heartbeat_grows_old_and_a_pulled_one_is_lost() -> None:
    pair = Pair("/dev/ttyACM3")
    pair.until(0.6)
    assert pair.world.time - pair.driver.health.stamp <= 110 * MS
    pair.twin.muted = True
    pair.until(1.1)
    assert pair.world.time - pair.driver.health.stamp > 400 * MS
    pair.twin.close()
    with pytest.raises(DeviceLostError):
        pair.until(1.2)
    assert pair.presses == (1, 0)


def test_an_old_heartbeat_isnt_taken_for_fresh() -> None:
    pair = Pair("/dev/ttyACM3")
    pair.until(0.6)
    pair.until(1.6, read=False)  # the ring's lines wait in the port's buffer for a second
    last = pair.world.time
    pair.driver.read(last + 2_000 * MS)
    assert last + 2_000 * MS - pair.driver.health.stamp >= 1_900 * MS
    pair.driver.close()
    pair.twin.close()


def test_another_device_is_refused() -> None:
    pair = Pair("/dev/ttyACM3")
    pair.driver.close()
    pair.twin.muted = True
    with pytest.raises(DeviceError, match="expected the ring's name, 'V ring1 1', got nothing"):
        pair.opened()
    pair.twin.close()
    with pytest.raises(DeviceError, match="no input device is called"):
        Ring("ring", RingConfig()).open()
    with pytest.raises(ValueError, match="isn't a regular expression"):
        RingConfig(match="(")


def test_a_million_damaged_bytes() -> None:
    parser = Parser()
    fuzz(parser.feed, b"V ring1 1\nH0 1000\nB1\nH1 4294967295\r\nB0\n" * 5)
    assert size_of(parser) < 5000
    parser.feed(b"\n")
    assert parser.feed(b"H1 4294967295\n") == [Line(b"H", 1.0, 4294967295)]
    for wrong in (b"H2 1\n", b"H1 4294967296\n", b"H1 -1\n", b"B2\n", b"H1 \n", b"b1\n"):
        assert parser.feed(wrong) == []


class Node:
    """An input node: its name, whether it may be opened, and whether it may be grabbed."""

    def __init__(self, name: str, allowed: bool = True, free: bool = True) -> None:
        self.description = Description(name)
        self.allowed, self.free = allowed, free
        self.opened = self.closed = 0

    def open(self, path: str, place: str, grab: bool = False) -> Node:
        if not self.allowed or (grab and not self.free):
            raise DeviceError(place, f"no permission to open {path}", "Wait for udev")
        self.opened += 1
        return self

    def await_description(self, timeout_s: float) -> Description:
        return self.description

    def read(self) -> list[Any]:
        if not self.free:
            raise DeviceLostError("ring", "it sleeps", "Press it")
        return []

    def close(self) -> None:
        self.closed += 1


@pytest.fixture
def nodes(monkeypatch: pytest.MonkeyPatch) -> dict[str, Node]:
    """What is in the input folder; a test changes it."""
    there: dict[str, Node] = {}
    monkeypatch.setattr("srl.drivers.ring.driver.discover", lambda: sorted(there))
    monkeypatch.setattr("srl.drivers.ring.driver.os.listdir", lambda _: sorted(there))
    monkeypatch.setattr(
        "srl.drivers.ring.driver.open_source", lambda path, *rest, **more: there[path].open(path, *rest, **more)
    )
    return there


def test_a_remote_whose_second_node_can_t_be_had_leaves_nothing_open(nodes: dict[str, Node]) -> None:
    nodes |= {"event1": Node("AB Shutter3"), "event2": Node("AB Shutter3", free=False)}
    ring = bound(Ring("ring", RingConfig()))
    with pytest.raises(DeviceError, match="event2"):
        ring.open()
    assert all(node.opened == node.closed for node in nodes.values())


def test_a_node_that_gets_its_rights_late_is_looked_into_again(nodes: dict[str, Node]) -> None:
    nodes["event1"] = Node("AB Shutter3")
    ring = bound(Ring("ring", RingConfig()))
    ring.open()
    nodes.pop("event1").free = False
    ring.read(0)
    assert "asleep" in ring.health.message
    nodes["event7"] = woken = Node("AB Shutter3", allowed=False)  # there, but udev hasn't been at it yet
    ring.read(1_000 * MS)
    woken.allowed = True
    ring.read(2_000 * MS)
    assert ring.health.message == "awake"
    ring.close()
    assert woken.opened == woken.closed


def test_what_isn_t_the_remote_is_looked_into_twice_and_no_more(nodes: dict[str, Node]) -> None:
    nodes["event1"] = Node("AB Shutter3")
    ring = bound(Ring("ring", RingConfig()))
    ring.open()
    nodes.pop("event1").free = False
    ring.read(0)
    nodes["event8"] = other = Node("keyboard")
    for k in range(1, 20):
        ring.read(k * 1_000 * MS)
    assert other.opened == other.closed == 2


def test_somebody_in_this_process_presses() -> None:
    world = StillWorld()
    fake = bound(FakeRing("ring", RingConfig(port="input"), world, FakeRingConfig()))
    fake.open()
    counts = []
    for k in range(100):
        world.time = k * 10_000_000
        fake.press(k in range(20, 35) or k in range(60, 70))
        fake.read(world.time)
        counts.append(float(fake.state_arrays["presses"][0]))
    assert (counts[15], counts[45], counts[-1]) == (0.0, 1.0, 2.0)
