"""A reset of a run of `srl jog`: refused by the loop where nothing knows where the limb is, whoever asks."""

from __future__ import annotations

import json
import socket
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.wait import until

from srl.commissioning.jog.hold import Hold
from srl.commissioning.jog.presses import Presses
from srl.commissioning.jog.profile_subset import subset
from srl.commissioning.jog.session import Session
from srl.runtime.ipc import presses
from srl.runtime.ipc.control_socket import LIFETIME
from srl.runtime.ipc.header import CYCLE, DEVICE, LINK_ACTIVE, LINK_CONNECTED, Latch, Origin, State
from srl.runtime.ipc.requests import Answer, Request, RequestKind
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.loop.cycle import Cycle
from srl.runtime.loop.guards import limits_of
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.profile import profile, wiring
from srl.runtime.profile.graph import Graph


class Desk:
    """Takes what would go to the loop."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, int]] = []

    def begin(self, what: str, since: int) -> dict[str, Any]:
        self.asked.append((what, since))
        return {"ok": True, "state": "active"}


class Run:
    """A stopped run of a limb that nothing measures. `terminal`: has the keys."""

    def __init__(self, name: str, *overrides: str, terminal: bool = False) -> None:
        self.subset = subset(*profile.load(name, overrides), None, 0.1, [], panel=not terminal)
        self.session = Session(self.subset, name, (True, ""), False, lambda _: None, panel=not terminal)
        layout = self.subset.graph.layout
        self.row = np.zeros(layout.width, np.int64)
        self.row[CYCLE.state], self.row[CYCLE.wake] = State.STOPPED, 1234
        device = self.subset.graph.devices[self.subset.actuator.device].name
        self.words = self.row[layout.device(layout.devices.index(device))]
        self.desk: Any = Desk()

    def press_r(self) -> list[str]:
        self.session._take("r", self.desk, self.row)
        return list(self.session._messages)

    def reset_on_the_panel(self, folder: RunFolder, since: int) -> dict[str, object] | None:
        found: list[dict[str, object] | None] = []
        asking = threading.Thread(target=lambda: found.append(presses.reset(folder, since)))
        with Presses(folder, len(self.subset.speed), Hold(tuple(self.subset.speed), 0.03)) as end:
            asking.start()

            def served() -> bool:
                end.pressed()
                end.resets(lambda expires: self.session._reset(self.desk, self.row, expires))
                return bool(found)

            until(served)
            asking.join()
        return found[0]


@pytest.fixture
def folder(tmp_path: Path) -> RunFolder:
    return RunFolder(tmp_path)


def lockstep(graph: Graph) -> Lockstep:
    """A simulated run, with clients that are there and have sent nothing yet."""
    clients = graph.row.devices[len(graph.devices) :]
    clients[:, DEVICE.link], clients[:, DEVICE.stamp] = LINK_CONNECTED, -1
    return Lockstep(graph)


class Loop:
    """The loop of a simulated jog run, which has begun to move. `origin`: whoever asks, it judges alike."""

    def __init__(self, name: str, *overrides: str) -> None:
        self.subset = subset(*profile.load(name, overrides), None, 0.1, [])
        self.run = lockstep(self.subset.graph)
        self.link = self.subset.graph.row.devices[
            self.subset.actuator.device : self.subset.actuator.device + 1, DEVICE.link
        ]
        self.until(State.ACTIVE)

    def until(self, state: State) -> None:
        for _ in range(300):
            if self.step() is state:
                return
        raise AssertionError(f"never {state.name}")

    def step(self, kind: RequestKind = RequestKind.NONE, origin: Origin = Origin.LOCAL) -> State:
        self.run.sense()
        return self.run.act(kind, origin)

    def lose(self) -> None:
        """The cable is out for a moment."""
        self.run.sense()
        self.link &= ~LINK_CONNECTED
        self.run.act()
        self.link |= LINK_CONNECTED
        self.until(State.STOPPED)

    def ask(self, kind: RequestKind = RequestKind.RESET, origin: Origin = Origin.LOCAL) -> Answer:
        self.step(kind, origin)
        return Answer(int(self.subset.graph.row.ints[CYCLE.request_result]))


@pytest.mark.parametrize("origin", [Origin.LOCAL, Origin.INPUT])
def test_after_a_loss_no_reset_sends_an_unmeasured_limb_home(origin: Origin) -> None:
    lost = Loop("finger-jog")
    lost.lose()
    for _ in range(3):
        assert lost.ask(origin=origin) is Answer.REFUSED_UNMEASURED
        assert lost.step() is State.STOPPED


def test_nor_after_a_limp_stop() -> None:
    limp = Loop("finger-jog", "stop.finger=limp")
    limp.step(RequestKind.STOP)
    limp.until(State.STOPPED)
    assert limp.ask() is Answer.REFUSED_UNMEASURED


def test_after_a_mere_stop_or_with_feedback_it_begins_again() -> None:
    held = Loop("finger-jog")
    held.step(RequestKind.STOP)
    held.until(State.STOPPED)
    assert held.ask() is Answer.DONE
    measured = Loop("servo-jog")
    measured.lose()
    assert measured.ask() is Answer.DONE


def test_a_whole_profile_goes_home_unless_it_says_otherwise() -> None:
    graphs = [wiring.build(*profile.load("finger-jog", given), []) for given in ([], ["reset.unmeasured=refuse"])]
    answers = []
    for graph in graphs:
        run = lockstep(graph)
        for k in range(200):
            run.sense()
            if k == 100:
                graph.row.devices[0, DEVICE.link] &= ~LINK_CONNECTED
            run.act(RequestKind.RESET if k == 199 else RequestKind.NONE)
            if k == 100:
                graph.row.devices[0, DEVICE.link] |= LINK_CONNECTED
        answers.append(Answer(int(graph.row.ints[CYCLE.request_result])))
    assert answers == [Answer.DONE, Answer.REFUSED_UNMEASURED]


def test_a_switch_that_this_run_does_not_read_keeps_its_stop() -> None:
    switch = "emergency=[{signal: client.position, element: distal}]"
    found = subset(*profile.load("servo-jog", [switch]), None, 0.1, [])
    assert found.left_out
    cycle = Cycle(found.graph, limits_of(found.graph), True, Latch.EMERGENCY)
    for kind in (RequestKind.RESET, RequestKind.START):
        assert cycle.check(0, Request(1, kind, 0, 0, np.empty(0), Origin.LOCAL)) is Answer.REFUSED_KEPT
        assert cycle.machine.state is State.STOPPED


def test_it_is_asked_for_for_as_of_what_was_seen(folder: RunFolder) -> None:
    stopped = Run("finger-jog")
    stopped.words[DEVICE.link] = LINK_CONNECTED | LINK_ACTIVE
    since = time.monotonic_ns() - LIFETIME // 2
    assert stopped.reset_on_the_panel(folder, since) == {"ok": True, "state": "active"}
    assert stopped.desk.asked == [("reset", since)]
    stopped = Run("finger-jog", terminal=True)
    stopped.words[DEVICE.link] = LINK_CONNECTED | LINK_ACTIVE
    assert stopped.press_r() == ["reset: done"]
    assert stopped.desk.asked == [("reset", 1234)]


@pytest.mark.parametrize("expires", [None, "soon", True, 1.0])
def test_a_reset_that_does_not_say_until_when_it_counts_is_none(folder: RunFolder, expires: object) -> None:

    run = Run("finger-jog")
    with (
        Presses(folder, 1, Hold(("a",), 0.03)) as end,
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender,
    ):
        sender.sendto(json.dumps({"ask": "reset", "expires": expires}).encode(), str(folder.press_socket))
        end.pressed()
        end.resets(lambda until_: run.session._reset(run.desk, run.row, until_))
    assert not run.desk.asked
