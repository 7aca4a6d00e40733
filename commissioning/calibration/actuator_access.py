"""A calibration that moves something: the run is that of `srl jog`, and its rows are read from their ring.

What moves, and what doesn't any more when a key, the terminal or the device is lost, is `srl jog`'s alone.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from srl.commissioning.calibration.guide import QuitError
from srl.commissioning.calibration.keyed import Keyed
from srl.commissioning.calibration.panel import NO_JOINT, PanelScreen
from srl.commissioning.calibration.servos.procedure import Procedure
from srl.commissioning.calibration.sources import Rows, RowSource, Tap
from srl.commissioning.jog.profile_subset import ProfileSubset
from srl.commissioning.jog.session import Session
from srl.runtime.contracts.errors import HostError
from srl.runtime.ipc.ring import RingReader
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.service import arming

_LOOK: Final = 0.05  # s between two looks at the rows
_LOST: Final = "Nothing was written. Put the limb near its home and begin again"


class Drive(RowSource):
    """The run.

    Attributes:
        screen: that of the terminal's keys; None: the presses are those of the panel.
        folder: of its instance.
    """

    moves = True

    def __init__(
        self, subset: ProfileSubset, tap: Tap[Any], name: str, record: Path | None, view: bool,
        screen: Keyed | PanelScreen, report: Callable[[str], None],
    ) -> None:  # fmt: skip
        """Starts it and waits until it runs.

        Args:
            subset: what `srl jog` would run, and the marks' law.
            tap: where its signals are.
            name: the instance's.
            record: file of the recording.
            view: show it in the rerun viewer.
            screen: the terminal's other half, or the panel.
            report: takes a line of text before and after the terminal is taken.
        Raises:
            SrlError: it doesn't start.
        """
        self.screen: Keyed | None
        self.screen = keyed = None if isinstance(screen, PanelScreen) else screen
        self._panel = screen if isinstance(screen, PanelScreen) else None
        self._report = report
        self._rows: RingReader | None = None
        arm = arming.automatic(subset.graph, not subset.real)
        self._session = Session(
            subset, name, arm, False, report, panel=keyed is None, face=keyed, record=record, view=view
        )
        self._turns = self._session.turns()
        self._over = False
        self.folder = RunFolder.of(name)
        try:
            self._turn()
            supervisor = self._session.supervisor
            assert supervisor is not None
            assert supervisor.layout is not None
            self.channel_map = tap(supervisor.layout, subset.source.label)
            self._mark = [p["name"] for p in supervisor.layout.meta["parameters"]].index(self.channel_map.parameter)
            self._rows = RingReader(supervisor.run_folder.rows, width=supervisor.layout.width)
        except BaseException:
            self.close()
            raise

    @property
    def interrupted(self) -> bool:
        return self._session.interrupted

    def take(self) -> Rows:
        assert self._rows is not None
        until = time.monotonic() + _LOOK
        while time.monotonic() < until:
            self._turn()
        rows = self._rows.take()
        if self._rows.lost:
            raise HostError("rows", f"{self._rows.lost} were overwritten before they were read", "Free the processor")
        return rows

    def begin(self, procedure: Any) -> None:
        step: Procedure = procedure
        self._session.hold.guide(step.step.moves, time.monotonic())
        if self._panel is not None:
            self._panel.joint = NO_JOINT if step.step.moves is None else step.step.moves
        if self._session.desk is not None:
            self._session.desk.set(self._mark, float(step.step.mark))

    def wait(self) -> None:
        self.take()

    def close(self) -> None:
        """The limb brakes and the run ends."""
        try:
            self._session.end("the calibration is over")
            while not self._over:
                try:
                    next(self._turns)
                except StopIteration:
                    self._over = True
        finally:
            self._over = True
            if self._rows is not None:
                self._rows.close()
                self._rows = None
            if self.screen is not None:
                for text in self.screen.messages:
                    self._report(text)
                self.screen.messages.clear()

    def _turn(self) -> None:
        """One look of the run at terminal and loop. Raises QuitError: it is over."""
        try:
            next(self._turns)
        except StopIteration:
            self._over = True
            raise QuitError("calibration", f"it ended: {self._session.why or 'the run is over'}", _LOST) from None
        except BaseException:
            self._over = True
            raise
