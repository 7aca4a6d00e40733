"""A person's calibration: the cut profile runs as a service of its own, and its rows are read from their ring."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from srl.commissioning.calibration.guided import Procedure
from srl.commissioning.calibration.sources import Rows, RowSource, Tap
from srl.runtime.contracts.errors import HostError
from srl.runtime.contracts.files import encoded
from srl.runtime.contracts.wearer import Instruction
from srl.runtime.ipc import latches
from srl.runtime.ipc.control_socket import send_request
from srl.runtime.ipc.header import CYCLE, Cause, State
from srl.runtime.ipc.launch import Launch
from srl.runtime.ipc.requests import RequestKind, RequestWriter
from srl.runtime.ipc.ring import RingReader
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.profile.source import Source
from srl.runtime.service import persistent_latches
from srl.runtime.service.helpers import helpers
from srl.runtime.service.supervisor import Supervisor, state_dir

_LIFE: Final = 2_000_000_000  # ns that a change of the mark may wait for a cycle
_LOOK: Final = 0.05  # s between two looks at the rows
_AGAIN: Final = 1.0  # s between two resets of a run whose mocap was lost


class Live(RowSource):
    """The run of a cut profile.

    It begins with the latches that stand from the instance's runs, but leaves their file as it is: what stopped the
    limb is the limb's own run's to end.

    Attributes:
        folder: of its instance.
        supervisor: its supervisor, for `pass_to`.
    """

    def __init__(
        self, source: Source, tap: Tap[Any], instance: str, record: Path | None, view: bool,
        report: Callable[[str], None], sim: bool = False, twins: Collection[str] = (),
        instruct: Callable[[Instruction], None] | None = None,
    ) -> None:  # fmt: skip
        """Starts it and waits until it runs.

        Args:
            source: of the cut profile.
            tap: where its signals are.
            instance: its name.
            record: file of the recording.
            view: show it in the rerun viewer.
            report: takes a line of text.
            sim: run on the simulated devices, in real time.
            twins: its devices that are on their twins.
            instruct: tells the simulated person beside them what to do.
        Raises:
            SrlError: it doesn't start.
        """
        self.folder = RunFolder.of(instance)
        self.folder.claim()
        self._report, self._instruct = report, instruct
        self._reset, self._last_text = 0.0, ""
        self._rows: RingReader | None = None
        self._over = False
        try:
            launch = Launch(
                source.label,
                source.text,
                list(source.overrides),
                str(source.files.folder),
                encoded(source.files.kept),
                [] if sim else None,
                False,
                None,
                True,
                latches.names(persistent_latches.read(state_dir(instance), report)),
                record is not None,
                twins=sorted(twins),
            )
            self.supervisor = Supervisor(
                self.folder, launch, state_dir(instance), helpers(self.folder, None, record, view), report
            )
            self.supervisor.start()
            while self.supervisor.step() and not self.supervisor.running:
                pass
            if not self.supervisor.running or self.supervisor.layout is None:
                raise self.supervisor.error or HostError(instance, "the run ended before it began", "Try `srl run`")
            layout = self.supervisor.layout
            self.channel_map = tap(layout, source.label)
            names = [p["name"] for p in layout.meta["parameters"]]
            self._target = names.index(self.channel_map.parameter)
            self._rows = RingReader(self.folder.rows, width=layout.width)
            self._requests = RequestWriter(self.folder.requests)
        except BaseException:
            self._end()
            raise

    def take(self) -> Rows:
        assert self._rows is not None
        until = time.monotonic() + _LOOK
        while time.monotonic() < until:
            if not self.supervisor.step():
                self._over = True
                how = self.supervisor.death.how if self.supervisor.death else "the run has ended"
                raise self.supervisor.error or HostError(self.folder.path.name, how, "Begin again; nothing was written")
        for event in self.supervisor.events.take() if self.supervisor.events is not None else ():
            if self.channel_map.parameter not in event.text:  # each step sets the mark
                self._report(event.text)
        rows = self._rows.take()
        if self._rows.lost:
            raise HostError("rows", f"{self._rows.lost} were overwritten before they were read", "Free the processor")
        if len(rows):
            self._tell(rows[-1])
            if self.channel_map.may_begin_again(rows[-1]):
                self._begin_again(int(rows[-1][CYCLE.wake]))
        return rows

    def begin(self, procedure: Procedure) -> None:
        expires = time.monotonic_ns() + _LIFE
        self._requests.send(RequestKind.PARAMETER, expires, self._target, np.array([float(procedure.step.mark)]))
        if self._instruct is not None:
            self._instruct(procedure.instruction())

    def wait(self) -> None:
        self.take()

    def close(self) -> None:
        self._requests.close()
        self._end()

    def _tell(self, row: NDArray[np.int64]) -> None:
        """Says once what has stopped the run, and what to do."""
        state, cause = State(int(row[CYCLE.state])), Cause(int(row[CYCLE.cause])).name.lower().replace("_", " ")
        text = ""
        if self.channel_map.lost(row):
            text = "a device is lost: it goes on by itself once it is there again"
        elif state is State.STOPPED:
            kept = ", ".join(latches.names(int(row[CYCLE.latches]))) or "nothing"
            name = self.folder.path.name
            text = f"stopped ({cause}; latched: {kept}), so nothing counts: `srl reset {name}` goes on, q ends"
        if text and text != self._last_text:
            self._report(text)
        self._last_text = text

    def _begin_again(self, seen: int) -> None:
        """Ends the stop after a loss of the mocap; not one that came after `seen`, CLOCK_MONOTONIC ns of the row."""
        if time.monotonic() >= self._reset + _AGAIN:
            self._reset = time.monotonic()
            send_request(self.folder, "reset", timeout=0.0, since=seen)

    def _end(self) -> None:
        supervisor = getattr(self, "supervisor", None)
        try:
            if supervisor is not None and supervisor.loop is not None:
                supervisor.end()
                while not self._over and supervisor.step():
                    pass
                for name in supervisor.finish():
                    self._report(f"{name} could not finish its work")
            if self._rows is not None:
                self._rows.close()
        finally:
            self.folder.release()
