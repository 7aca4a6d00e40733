"""One run of `srl jog`: the cut profile as a run of its own, the terminal's keys to its law, its rows to the screen."""

from __future__ import annotations

import signal
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator
from functools import partial
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np

from srl.commissioning.jog.hold import Hold
from srl.commissioning.jog.panel import Panel
from srl.commissioning.jog.presses import Presses
from srl.commissioning.jog.profile_subset import PRESS, WAY, ProfileSubset
from srl.commissioning.jog.screen import View, lines
from srl.commissioning.jog.terminal import Terminal
from srl.runtime.contracts.files import encoded
from srl.runtime.ipc import latches
from srl.runtime.ipc.control_socket import LIFETIME, send_request
from srl.runtime.ipc.header import CYCLE, Cause, Latch, State
from srl.runtime.ipc.launch import Launch
from srl.runtime.ipc.requests import RequestKind, RequestWriter
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.service.end_signals import EndSignals
from srl.runtime.service.helpers import helpers
from srl.runtime.service.persistent_latches import PersistentLatches
from srl.runtime.service.summary import WELL
from srl.runtime.service.supervisor import Supervisor, state_dir

FRESH: Final = 0.03  # s that a press lives on its way to the loop, and a period and a half at least
_TELL: Final = 0.02  # s between two words to the loop
_DRAW: Final = 0.1  # s between two pictures
_AGAIN: Final = 0.1  # s between two requests for the same stop
_ANSWER: Final = 0.1  # s that an answer of the loop may take
_LIFE: Final = 2_000_000_000  # ns that a parameter's change may wait for a cycle
_KEPT: Final = 6  # messages on the screen


class Face(Protocol):
    """What a guide puts on the terminal in place of the joints' table."""

    def key(self, key: str, state: State) -> bool:
        """Takes a key; returns whether it was for the guide. Then it moves nothing, and the joint brakes."""

    def lines(self, view: View, width: int, height: int) -> list[str]:
        """What is shown on a terminal of this size; `view`: the joints' table and the run's state."""

    def say(self, text: str) -> None:
        """Takes a message."""


class Session:
    """The run; see the module's docstring.

    Attributes:
        supervisor: its supervisor, once it has begun.
        desk: its requests, while the joints can move.
        hold: the chosen joint and the presses.
        why: what ended it; "" for nothing.
        code: 0, or 1 after a fault; once it is over.
        interrupted: whether a signal has ended it.
    """

    def __init__(
        self, subset: ProfileSubset, name: str, arm: tuple[bool, str], step: bool,
        say: Callable[[str], None], panel: bool = False, face: Face | None = None, record: Path | None = None,
        view: bool = False,
    ) -> None:  # fmt: skip
        """
        Args:
            subset: the profile.
            name: the instance's.
            arm: whether motion may begin without a start, and what is said if not.
            step: a held key moves once.
            say: takes a line of text while the terminal isn't taken.
            panel: presses on the operator's panel in place of the terminal's keys.
            face: what is shown in place of the joints' table.
            record: file of the recording; None: none.
            view: show the recording in the rerun viewer.
        """
        self._face, self._record, self._view = face, record, view
        self.supervisor: Supervisor | None = None
        self.desk: Desk | None = None
        self.code = 0
        self._panel = panel
        self._subset, self._name, self._say = subset, name, say
        # Somebody has to read that a switch can't stop this run.
        self._automatic, self._advice = arm[0] and not subset.left_out, arm[1]
        fresh = max(FRESH, 1.5 / float(subset.profile.rate))
        self.hold = Hold(tuple(subset.speed), fresh, step)
        self._messages: deque[str] = deque(maxlen=_KEPT)
        self.why = ""
        self.interrupted = False

    def run(self) -> int:
        """Runs until a key, a signal or the loss of the terminal ends it. Returns 0, or 1 after a fault.

        Raises:
            SrlError: it can't begin.
        """
        for _ in self.turns():
            pass
        return self.code

    def end(self, why: str) -> None:
        """The limb brakes and the run ends; `turns` goes on until it is over."""
        self.why = self.why or why

    def turns(self) -> Iterator[Any]:
        """The run, a look at the terminal and the loop at a time. Yields the newest row; None before the first.

        Whoever doesn't take them in time stops the limb, as a terminal that falls silent does.

        Raises:
            SrlError: it can't begin.
        """
        where, state = RunFolder.of(self._name), state_dir(self._name)
        terminal = Presses(where, len(self._subset.speed), self.hold) if self._panel else Terminal()
        with EndSignals() as signals:
            where.claim()
            where.press_socket.unlink(missing_ok=True)  # of a run that was killed: the panel would believe it
            kept: PersistentLatches | None = None
            supervisor: Supervisor | None = None
            well = False
            before = signal.signal(signal.SIGTSTP, self._suspended)
            try:
                if self._subset.real:  # only what stopped a real limb outlives its run
                    kept = PersistentLatches(state, self._say)
                found = [] if kept is None else latches.names(kept.latches)
                source = self._subset.source
                launch = Launch(
                    source.label, source.text, list(source.overrides), str(source.files.folder),
                    encoded(source.files.kept), self._subset.sim, False, None, self._automatic, found,
                    self._record is not None, twins=sorted(self._subset.twins),
                )  # fmt: skip
                # No bus: the terminal is the only one who may write the requests.
                beside = helpers(where, None, self._record, self._view)
                self.supervisor = supervisor = Supervisor(where, launch, state, beside, self._report)
                signals.pass_to(partial(self._interrupted, supervisor))
                well = yield from self._supervised(supervisor, kept, terminal)
            finally:
                signal.signal(signal.SIGTSTP, before)
                if kept is not None:
                    ran = kept.began or (supervisor is not None and supervisor.death is not None)
                    kept.close(well or not ran)
                where.release()
        self.code = 0 if well else 1

    def _interrupted(self, supervisor: Supervisor) -> None:
        self.interrupted = True
        supervisor.end()

    def _suspended(self, *_: object) -> None:
        self.why = "it was about to be suspended"

    def _report(self, text: str) -> None:
        if self._face is not None:
            self._face.say(text)
        elif self._panel:
            self._say(text)
        else:
            self._messages.append(text)

    def _supervised(
        self, supervisor: Supervisor, kept: PersistentLatches | None, terminal: Terminal | Presses
    ) -> Generator[Any, None, bool]:
        """Starts the supervisor and runs it until the end. Returns whether the run ended well."""
        row = None
        supervisor.start()
        try:
            self._say(f"{self._name}: the devices are opened")
            while supervisor.step() and not supervisor.running:
                if self.why:
                    supervisor.end()
            if supervisor.running:
                row = yield from self._moved(supervisor, kept, terminal)
        finally:
            # After an error here, too, the limb comes to its stop before this process ends.
            supervisor.end()
            while supervisor.loop is not None and supervisor.loop.poll() is None and supervisor.step():
                pass
            supervisor.finish()
        if supervisor.rows is not None:
            row = supervisor.rows.newest()
        for text in self._messages:
            self._say(text)
        if supervisor.error is not None:
            raise supervisor.error
        if self.why:
            self._say(f"ended: {self.why}")
        if supervisor.death is not None:
            self._say(f"{supervisor.death.how}: find the cause before the next run, which begins in the stop")
            return False
        if row is None:
            return True
        left = latches.names(int(row[CYCLE.latches]) & latches.LASTING)
        if kept is not None and left:
            self._say(f"the next run of '{self._name}' begins stopped ({', '.join(left)}), until `srl reset`")
        return Cause(int(row[CYCLE.cause])) in WELL

    def _moved(
        self, supervisor: Supervisor, kept: PersistentLatches | None, terminal: Terminal | Presses
    ) -> Generator[Any, None, Any]:
        """Takes the terminal until the run is over. Returns the newest row."""
        assert supervisor.layout is not None
        assert supervisor.rows is not None
        self.desk = desk = Desk(supervisor, self.hold)
        panel = Panel(self._subset, supervisor.layout, self._name)
        if self._advice:
            self._report(self._advice)
        for name in self._subset.left_out:
            self._report(f"left out: the emergency input '{name}' can't stop this run")
        drawn, row = 0.0, None
        try:
            with terminal:
                while supervisor.step():
                    if kept is not None:
                        kept.follow(supervisor.rows)
                    row = supervisor.rows.newest() if row is None else self._newer(supervisor, row)
                    for key in terminal.pressed():
                        self._take(key, desk, row)
                    if isinstance(terminal, Presses):
                        terminal.resets(partial(self._reset, desk, row))
                    self.why = self.why or terminal.gone
                    if self.why:
                        desk.end()
                    desk.tell(row)
                    if supervisor.events is not None:
                        for event in supervisor.events.take():
                            self._report(event.text)
                    if row is not None and not self._panel and time.monotonic() >= drawn + _DRAW:
                        drawn = time.monotonic()
                        terminal.show(self._picture(panel, row, *terminal.size))
                    yield row
        finally:
            self.desk = None
            desk.close()
        return row

    def _picture(self, panel: Panel, row: Any, width: int, height: int) -> list[str]:
        view = panel.view(row, self.hold.joint, tuple(self._messages))
        return lines(view, width, height) if self._face is None else self._face.lines(view, width, height)

    @staticmethod
    def _newer(supervisor: Supervisor, row: Any) -> Any:
        newest = supervisor.rows.newest() if supervisor.rows is not None else None
        return row if newest is None else newest

    def _take(self, key: str, desk: Desk, row: Any) -> None:
        if key in ("focus", "focus lost"):
            return
        state = None if row is None else State(int(row[CYCLE.state]))
        guided = self._face is not None and state is not None and self._face.key(key, state)
        self.hold.key("guided" if guided else key, time.monotonic())
        if guided:
            self.hold.rest()
            return
        if key in ("space", "esc"):
            desk.stop()
        elif key in ("q", "Q"):
            self.why = "q was pressed"
        elif (key, state) in (("s", State.READY), ("r", State.STOPPED)):
            what = "start" if key == "s" else "reset"
            answer = self._reset(desk, row) if key == "r" else desk.begin(what, int(row[CYCLE.wake]))
            if answer is None:
                self._report(f"{what}: no answer in time")
            else:
                self._report(f"{what}: done" if answer["ok"] else f"{what} refused: {answer.get('error', '')}")

    @staticmethod
    def _reset(desk: Desk, row: Any, expires: int | None = None) -> dict[str, Any] | None:
        """Asks the loop for a reset, which judges it. Returns the answer; None: none in time.

        `expires`, CLOCK_MONOTONIC ns: of a reset on the panel, which counts from the picture that was seen there.
        """
        if row is None:
            return None
        return desk.begin("reset", int(row[CYCLE.wake]) if expires is None else expires - LIFETIME)


class Desk:
    """What the terminal says to the loop: presses, a stop, a start or reset, the end."""

    def __init__(self, supervisor: Supervisor, hold: Hold) -> None:
        assert supervisor.layout is not None
        self._supervisor, self.hold, self._folder = supervisor, hold, supervisor.run_folder
        names = [entry["name"] for entry in supervisor.layout.meta["setpoints"]]
        self._way, self._press = names.index(WAY), names.index(PRESS)
        self._requests = RequestWriter(self._folder.requests)
        self._reported = self._asked = 0.0
        self._since = 0  # CLOCK_MONOTONIC ns: when the stop was asked for first
        self._number = -1.0
        self._stop = self._over = False

    def tell(self, row: Any) -> None:
        """Tells the loop of the keys: a new press at once, that the terminal is there every `_TELL`."""
        now = time.monotonic()
        way, press = self.hold.at(now)
        if now >= self._reported + _TELL or (press[0] and press[0] != self._number):
            self._reported, self._number = now, float(press[0])
            expires = round(self.hold.expires(now) * 1e9)
            self._requests.send(RequestKind.SETPOINT, expires, self._way, way)
            self._requests.send(RequestKind.SETPOINT, expires, self._press, press)
        if self._stop and now >= self._asked + _AGAIN:
            if not self._asked:
                self._since = time.monotonic_ns()
            self._asked = now
            send_request(self._folder, "stop", timeout=0.0)
        elif self._stop and row is not None and int(row[CYCLE.latches]) & Latch.PERSON:
            # A row from before the stop may show the latch that a reset has just released.
            self._stop = int(row[CYCLE.wake]) <= self._since

    def set(self, parameter: int, value: float) -> None:
        """Sets a parameter of the run, by its number."""
        expires = time.monotonic_ns() + _LIFE
        self._requests.send(RequestKind.PARAMETER, expires, parameter, np.array([value]))

    def stop(self) -> None:
        """A person's stop: it is asked for until a row says that it stands."""
        self._stop, self._asked = True, 0.0

    def begin(self, what: str, since: int) -> dict[str, Any] | None:
        """Asks for a start or reset. Returns the answer, None if none came in time.

        `since`, CLOCK_MONOTONIC ns: of the row that was seen; a stop after it refuses.
        """
        return send_request(self._folder, what, timeout=_ANSWER, since=since)

    def end(self) -> None:
        """The limb brakes and the run ends."""
        if not self._over:
            self._over = True
            self.hold.key("end", time.monotonic())
            self._supervisor.end()

    def close(self) -> None:
        """Lets go of the requests' file."""
        self._requests.close()
