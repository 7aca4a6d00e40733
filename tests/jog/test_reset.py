"""A reset of a run of `srl jog`: refused where nothing knows where the limb is, the same on terminal and panel."""

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

from runtime.ipc import presses
from runtime.ipc.control_socket import LIFETIME
from runtime.ipc.run_folder import RunFolder
from runtime.ipc.words import CYCLE, DEVICE, LINK_ACTIVE, LINK_CONNECTED, State
from runtime.jog.cut import cut
from runtime.jog.hold import Hold
from runtime.jog.presses import Presses
from runtime.jog.session import Session
from runtime.profile import profile


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
        self.cut = cut(*profile.load(name, overrides), None, 0.1, True, panel=not terminal)
        self.session = Session(self.cut, name, True, (True, ""), False, lambda _: None, panel=not terminal)
        layout = self.cut.graph.layout
        self.row = np.zeros(layout.width, np.int64)
        self.row[CYCLE.state], self.row[CYCLE.wake] = State.STOPPED, 1234
        device = self.cut.graph.devices[self.cut.actuator.device].name
        self.words = self.row[layout.device(layout.devices.index(device))]
        self.desk: Any = Desk()

    def press_r(self) -> list[str]:
        self.session._take("r", self.desk, self.row)
        return list(self.session._said)

    def reset_on_the_panel(self, folder: RunFolder, since: int) -> dict[str, object] | None:
        found: list[dict[str, object] | None] = []
        asking = threading.Thread(target=lambda: found.append(presses.reset(folder, since)))
        with Presses(folder, len(self.cut.speed), Hold(tuple(self.cut.speed), 0.03)) as end:
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


def test_after_a_loss_the_reset_of_an_unmeasured_limb_is_refused(folder: RunFolder) -> None:
    lost = Run("finger-jog")
    lost.words[DEVICE.link] = LINK_CONNECTED
    answer = lost.reset_on_the_panel(folder, time.monotonic_ns())
    assert answer is not None
    assert not answer["ok"]
    assert "nothing measures where the limb is" in str(answer["error"])
    assert answer["state"] == "stopped"
    keyed = Run("finger-jog", terminal=True)
    keyed.words[DEVICE.link] = LINK_CONNECTED
    assert keyed.press_r() == [f"reset refused: {answer['error']}"]
    assert lost.desk.asked == keyed.desk.asked == []


def test_after_a_mere_stop_it_is_asked_for_as_of_what_was_seen(folder: RunFolder) -> None:
    stopped = Run("finger-jog")
    stopped.words[DEVICE.link] = LINK_CONNECTED | LINK_ACTIVE
    since = time.monotonic_ns() - LIFETIME // 2
    assert stopped.reset_on_the_panel(folder, since) == {"ok": True, "state": "active"}
    assert stopped.desk.asked == [("reset", since)]
    stopped = Run("finger-jog", terminal=True)
    stopped.words[DEVICE.link] = LINK_CONNECTED | LINK_ACTIVE
    assert stopped.press_r() == ["reset: done"]
    assert stopped.desk.asked == [("reset", 1234)]


def test_a_limb_that_is_measured_may_be_reset_after_a_loss(folder: RunFolder) -> None:
    lost = Run("servo-jog")
    lost.words[DEVICE.link] = LINK_CONNECTED
    assert lost.reset_on_the_panel(folder, time.monotonic_ns()) == {"ok": True, "state": "active"}


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
