"""The server of the operator's panel: the live picture, the run's health, and requests with the rights of `srl`.

Any page that is let in may stop. Everything else takes control, which one page of all panels of the run has at a time,
and which a person takes on it. Every request goes the way that the command of its name goes: the loop checks it again,
and its answer is told.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
import time
from collections import deque
from collections.abc import Coroutine
from pathlib import Path
from typing import Any, ClassVar, Final

from srl.runtime.contracts.errors import SrlError
from srl.runtime.ipc import presses
from srl.runtime.ipc.control_socket import send_request
from srl.runtime.ipc.events import EventReader
from srl.runtime.ipc.header import CYCLE
from srl.runtime.ipc.layout import Layout, Words
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.web.operator import health, jogging
from srl.runtime.web.operator.control import LAPSE, Control
from srl.runtime.web.operator.event_words import described
from srl.runtime.web.operator.guiding import Guiding
from srl.runtime.web.operator.parameters import Parameters
from srl.runtime.web.panel.peer import BadMessageError, Peer, number
from srl.runtime.web.panel.picture import PictureServer

MOVES: Final = ("start", "reset")
FLOOD: Final = 400  # messages of a page within a second, above which it is let go; a held jog makes 60
LOOK: Final = 0.5  # s between looks whether the run takes presses
CHECK: Final = 0.5  # s between looks whether the control still stands
EVENTS: Final = 20  # events that are shown
_SECOND: Final = 1_000_000_000  # ns
_NO_ANSWER: Final = "the loop didn't answer within 2 s. Use the hardware stop; then look at `srl top`"
_ON_TERMINAL: Final = "this run is jogged on its terminal. Reset it there, with the key r"
_NO_CONTROL: Final = "this page doesn't have control. Take it first"


class OperatorServer(PictureServer):
    """Serves one instance's panel."""

    called: ClassVar = "the panel"

    def __init__(self, run_folder: RunFolder, recordings: Path) -> None:
        """`recordings`: the folder whose recordings are shown. Raises RecordingError: there is no run here."""
        super().__init__(run_folder)
        self._recordings = recordings
        self._parameters = Parameters(run_folder)
        self._holder: Peer | None = None
        self._checked = 0.0
        self._control = Control(run_folder)
        self._guiding = Guiding(run_folder)
        self._counts: dict[Peer, deque[float]] = {}
        self._tasks: set[asyncio.Task[None]] = set()
        self._busy: set[str] = set()  # requests that are under way: one of each kind
        self._newest: dict[str, tuple[Peer, float]] = {}  # by parameter: what waits for the change before
        self._of: Layout | None = None  # the layout that was told last
        self._joints: list[dict[str, Any]] = []
        self._takes, self._looked = False, 0.0
        self._events: EventReader | None = None
        self._messages: deque[dict[str, Any]] = deque(maxlen=EVENTS)
        self._count = 0  # events so far

    # What is told

    def scene_beside(self, layout: Layout) -> dict[str, Any]:
        if layout is not self._of:
            self._of = layout
            self._parameters.thread.submit(self._parameters.close)  # the next one is for this run's bus
            self._tell_all(self._guiding.forget())
        self._open_events()
        self._joints = jogging.joints(layout)
        return {"parameters": Parameters.described(layout), "joints": self._joints}

    def frame_beside(self, layout: Layout, row: Words, now: float) -> dict[str, Any]:
        if now >= self._looked:
            self._looked, self._takes = now + LOOK, jogging.takes_presses(self._folder)
            for event in self._events.take() if self._events is not None else ():
                self._count += 1
                self._messages.append(described(self._count, event))
        return {
            "health": health.state(layout, row), "devices": health.devices(layout, row),
            "values": Parameters.values(layout, row), "events": list(self._messages),
            "places": jogging.places(layout, row) if self._joints else [], "takes": bool(self._joints) and self._takes,
            "seen": int(row[CYCLE.wake]) // 1000, "told": now * 1e3,
        }  # fmt: skip

    def look(self) -> None:
        super().look()
        now = time.monotonic()
        self._tell_all(self._guiding.look(now))
        if self._holder is not None and now >= self._checked:
            self._checked = now + CHECK
            self._check_control(now)

    def _check_control(self, now: float) -> None:
        """Ends the control of a page that is silent, as its browser hangs, and of one that another panel has taken."""
        assert self._holder is not None
        silent = now - self._counts[self._holder][-1] > LAPSE
        if silent or not self._control.held:
            if silent:
                _answer(self._holder, "control", f"Control has ended: this page was silent for {LAPSE:g} s")
            self._give(None)
        else:
            self._control.live()

    def _tell_all(self, messages: list[dict[str, Any]]) -> None:
        for peer in self.peers if messages else ():
            for message in messages:
                peer.tell(message)

    # What a page says

    def joined(self, peer: Peer) -> None:
        super().joined(peer)
        for message in self._guiding.newest.values():
            peer.tell(message)
        self._counts[peer] = deque(maxlen=FLOOD)
        peer.tell({"kind": "control", "yours": False, "held": self._holder is not None})

    def left(self, peer: Peer) -> None:
        self._counts.pop(peer, None)
        if peer is self._holder:
            self._give(None)

    def heard(self, peer: Peer, message: dict[str, Any]) -> None:
        now = time.monotonic()
        times = self._counts[peer]
        if len(times) == FLOOD and now - times[0] < 1.0:
            raise BadMessageError("too many messages")
        times.append(now)
        match message.get("kind"):
            case "control":
                if not isinstance(message.get("take"), bool):
                    raise BadMessageError("'take' must be true or false")
                if message["take"]:
                    if why := self._control.take():
                        _answer(peer, "control", why)
                    else:
                        self._give(peer)
                elif peer is self._holder:
                    self._give(None)
            case "ask":
                self._ask(peer, message, now)
            case "set":
                self._set(peer, message)
            case "jog":
                self._jog(peer, message, now)
            case "guide":
                why = f"not done: {_NO_CONTROL}" if not self._has_control(peer) else self._guiding.press(message)
                if why:
                    _answer(peer, "guide", why)
            case "recordings":
                self._once("recordings", self._list(peer))
            case _:
                super().heard(peer, message)

    def _has_control(self, peer: Peer) -> bool:
        return peer is self._holder and self._control.held

    def _give(self, holder: Peer | None) -> None:
        self._holder = holder
        if holder is None:
            self._control.release()
        for peer in self.peers:
            peer.tell({"kind": "control", "yours": peer is holder, "held": holder is not None})

    def _ask(self, peer: Peer, message: dict[str, Any], now: float) -> None:
        what, seen = message.get("what"), number(message, "seen") * 1e3
        if what not in MOVES:
            raise BadMessageError("'what' must be start or reset")
        if not self._has_control(peer):
            _answer(peer, what, f"{what} refused: {_NO_CONTROL}")
        elif not self._once(what, self._asked(peer, what, min(int(seen), int(now * _SECOND)))):
            _answer(peer, what, f"{what}: one is under way")

    async def _asked(self, peer: Peer, what: str, since: int) -> None:
        if what == "reset" and self._joints:
            # `srl jog` refuses it where nothing measures the limb. Without its socket its terminal has the reset.
            if not jogging.takes_presses(self._folder):
                _answer(peer, what, f"{what} refused: {_ON_TERMINAL}")
                return
            found = await asyncio.to_thread(presses.reset, self._folder, since)
        else:
            found = await asyncio.to_thread(send_request, self._folder, what, since=since)
        if found is None:
            _answer(peer, what, f"{what}: {_NO_ANSWER}")
        elif found["ok"]:
            _answer(peer, what, "", f"{what}: done, {found['state']}")
        else:
            _answer(peer, what, f"{what} refused, {found['state']}: {found.get('error', '')}")

    def _set(self, peer: Peer, message: dict[str, Any]) -> None:
        name, value = message.get("name"), number(message, "value")
        known = {p["name"]: p for p in Parameters.described(self._view.layout)}
        if not isinstance(name, str) or name not in known:
            raise BadMessageError("there is no such parameter")
        lower, upper = (known[name][key] for key in ("lower", "upper"))
        if (lower is not None and value < lower) or (upper is not None and value > upper):
            bounds = " to ".join("any" if bound is None else f"{bound:g}" for bound in (lower, upper))
            _answer(peer, "set", f"{name}: {value:g} is out of bounds ({bounds})")
        elif not self._has_control(peer):
            _answer(peer, "set", f"{name}: {_NO_CONTROL}")
        else:
            self._newest[name] = peer, value  # one at a time; of those of a parameter that wait the newest
            self._once("set", self._change())

    async def _change(self) -> None:
        loop = asyncio.get_running_loop()
        while self._newest:
            name = next(iter(self._newest))
            peer, value = self._newest.pop(name)
            if not self._has_control(peer):
                continue  # it has lost the control meanwhile
            try:
                made = await loop.run_in_executor(self._parameters.thread, self._parameters.change, name, value)
                _answer(peer, "set", "", f"{name}: {made:g}")
            except SrlError as error:
                _answer(peer, "set", str(error))

    def _jog(self, peer: Peer, message: dict[str, Any], now: float) -> None:
        joint, way, heard = message.get("joint"), message.get("way"), number(message, "heard")
        count = len(self._joints)
        fine = message.get("fine", False)
        if type(joint) is not int or type(way) is not int or type(fine) is not bool:
            raise BadMessageError("a jog's joint, way or fine is of a wrong type")
        if way not in (-1, 0, 1) or not 0 <= joint < max(count, 1):
            raise BadMessageError("no joint, or no way")
        # The page answers each picture with a press. So a page, a line or a server that stalls makes no press, and
        # what waited somewhere is too old when it comes.
        age = now - heard / 1e3
        if count and 0.0 <= age <= presses.FRESH and self._has_control(peer):
            presses.send(self._folder, joint, way, round((heard / 1e3 + presses.FRESH) * _SECOND), fine)

    async def _list(self, peer: Peer) -> None:
        name = str(self._view.layout.meta.get("name", ""))
        # In a process of its own: reading hours of rows here could keep a stop waiting.
        reader = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "srl.runtime.web.operator.recording_list", str(self._recordings), name,
            stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.PIPE,
        )  # fmt: skip
        try:
            output, _ = await reader.communicate()
            found = json.loads(output)
        except ValueError:
            found = {"rows": [], "more": 0, "words": "They can't be read here. Try `srl recordings`"}
        finally:
            if reader.returncode is None:
                reader.kill()
        peer.tell({"kind": "recordings"} | found)

    def _once(self, what: str, work: Coroutine[Any, Any, None]) -> bool:
        """Begins work unless some of this kind is under way. Returns whether it begins."""
        if what in self._busy:
            work.close()
            return False
        self._busy.add(what)
        task = asyncio.create_task(work)
        self._tasks.add(task)

        def over(ended: asyncio.Task[None]) -> None:
            self._tasks.discard(ended)
            self._busy.discard(what)
            if not ended.cancelled():
                ended.result()

        task.add_done_callback(over)
        return True

    def _open_events(self) -> None:
        with contextlib.suppress(OSError, SrlError):
            opened = EventReader(self._folder.events)
            if self._events is not None:
                self._events.close()
            self._events = opened
            self._messages.clear()

    def close(self) -> None:
        self._control.release()
        self._guiding.close()
        self._parameters.thread.submit(self._parameters.close)
        self._parameters.thread.shutdown()
        if self._events is not None:
            self._events.close()
        super().close()


def _answer(peer: Peer, what: str, problem: str, done: str = "") -> None:
    peer.tell({"kind": "answer", "what": what, "ok": not problem, "words": problem or done})
