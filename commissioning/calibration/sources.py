"""Where a guided calibration's samples come from: a simulated wearer in this process, or a recording."""

from __future__ import annotations

import tempfile
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from srl.commissioning.calibration.guided import Procedure
from srl.commissioning.calibration.marks import MarkLaw
from srl.commissioning.calibration.profile_subset import build
from srl.commissioning.calibration.run_channels import RunChannels
from srl.commissioning.calibration.screen import Screen
from srl.runtime.contracts.errors import ProfileError, RecordingError
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.requests import RequestKind
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.profile.graph import Graph
from srl.runtime.profile.profile import Profile
from srl.runtime.profile.source import Source
from srl.runtime.recording.reader import read

Rows = NDArray[np.int64]
LOOK: Final = 0.2  # s of simulated time between two looks at the procedure
_CHUNKS: Final = 50  # that go to the file together: each write has columns of its own, which cost room
T = TypeVar("T", bound=RunChannels)
Tap = Callable[[Layout, str], T]
"""Finds a calibration's signals in the rows of a layout; the text is the place, for errors."""


class RowSource(ABC):
    """A running source of rows.

    Attributes:
        channel_map: where the calibration's signals are in them.
        folder: of its instance, where it is a run.
        screen: its own, where a terminal's keys move something; None: it has none.
        moves: whether somebody's presses move something meanwhile.
    """

    channel_map: RunChannels
    folder: RunFolder
    screen: Screen | None = None
    moves = False

    @property
    def interrupted(self) -> bool:
        """Whether a signal ended it."""
        return False

    @abstractmethod
    def take(self) -> Rows:
        """Returns the rows (k, width) since the last call; waits a little, so that none may have come."""

    @abstractmethod
    def begin(self, procedure: Procedure) -> None:
        """Its step begins: rows bear its mark from one of the next on, and a simulated wearer is instructed."""

    def wait(self) -> None:
        """Nothing is asked of the person for a moment; rows that come don't count."""

    @abstractmethod
    def close(self) -> None:
        """Ends it. What is recorded is whole afterwards."""


class Stepped(RowSource):
    """A system in lockstep, as fast as it goes."""

    def __init__(self, graph: Graph, tap: Tap[Any], place: str, report: Callable[[str], None]) -> None:
        """`place`: of the profile, for errors. Raises SrlError: a device can't be opened."""
        self._graph = graph
        self.channel_map = tap(graph.layout, place)
        self._lockstep = Lockstep(graph, report)
        self._count = max(round(LOOK * float(graph.profile.rate)), 1)

    @property
    def time(self) -> float:
        """s since its beginning."""
        return self._lockstep.count * self._lockstep.period * 1e-9

    def take(self) -> Rows:
        rows = np.empty((self._count, self._graph.layout.width), np.int64)
        for row in rows:
            again = self.channel_map.may_begin_again(self._graph.row.words)
            self._lockstep.step(RequestKind.RESET if again else RequestKind.NONE)
            row[:] = self._graph.row.words
        return rows

    def mark(self, procedure: Procedure) -> None:
        """Rows bear its step's mark from now on. Raises ProfileError: a run would refuse it."""
        mark, law = procedure.step.mark, self.channel_map.parameter.split(".")[0]
        marked = [each.controller for each in self._graph.laws if isinstance(each.controller, MarkLaw)]
        most = max((each.most for each in marked), default=0)
        if mark > most:
            problem = f"the mark {mark} is beyond the greatest of {law}, {most}: a run would refuse it"
            raise ProfileError(law, problem, f"Set `most` of {law} to the greatest mark of any plan")
        self._graph.row.views[self.channel_map.parameter][()] = mark

    def close(self) -> None:
        if self._graph.world is not None:
            self._graph.world.close()


class Simulated(Stepped):
    """The simulated wearer of a cut profile."""

    def __init__(
        self, checked: Profile, source: Source, tap: Tap[Any], report: Callable[[str], None], record: Path | None = None
    ) -> None:
        """`record`: the file for every row, if one is wanted.

        Raises:
            SrlError: the system can't be built, its world has no wearer, or the file can't be written.
        """
        graph = build(checked, source, True)
        world = graph.world
        if world is None or world.wearer is None:
            problem = "the simulated world has no wearer, or several"
            raise ProfileError(
                source.place("sim"), problem, "Add one that the calibration's page names, or calibrate a person"
            )
        self._wearer, self._place = world.wearer, source.place("sim")
        # The rows' time begins with the world; their date is today's.
        graph.layout.meta["wall"] = time.time_ns()
        super().__init__(graph, tap, source.label, report)
        self._file = None if record is None else RowFile(graph.layout, record)

    def take(self) -> Rows:
        rows = super().take()
        if self._file is not None:
            self._file.add(rows)
        return rows

    def begin(self, procedure: Procedure) -> None:
        self.mark(procedure)
        try:
            self._wearer.instruct(procedure.instruction())
        except ValueError as error:
            remedy = "Add one that the calibration's page names"
            raise ProfileError(self._place, f"this world's person can't do it: {error}", remedy) from None

    def close(self) -> None:
        super().close()
        if self._file is not None:
            self._file.close()


class RowFile:
    """A recording that this process writes itself."""

    def __init__(self, layout: Any, path: Path) -> None:
        from srl.runtime.recorder.stream import Stream
        from srl.runtime.recording.segments import check_target

        check_target(path)
        with tempfile.TemporaryDirectory(prefix="srl-") as scratch:
            layout.save(Path(scratch) / "layout.json")
            text = (Path(scratch) / "layout.json").read_text()
        self._stream, self._number, self._held = Stream(text), 0, list[Rows]()
        self._stream.recording.save(path)
        self._stream.prologue(None)

    def add(self, rows: Rows) -> None:
        self._held.append(rows)
        if len(self._held) >= _CHUNKS:
            self._write()

    def close(self) -> None:
        self._write()
        self._stream.recording.disconnect()

    def _write(self) -> None:
        if self._held:
            rows = np.concatenate(self._held)
            self._stream.rows(np.arange(self._number + 1, self._number + len(rows) + 1), rows)
            self._number += len(rows)
            self._held.clear()


def recorded(path: Path, tap: Tap[T]) -> tuple[T, Rows]:
    """The rows of a recording, and where its signals are. Raises RecordingError: rows are missing, or signals."""
    found = read(path)
    if found.missing:
        first, last = found.missing[0]
        raise RecordingError(str(path), f"rows {first} to {last} are missing", "Use a whole recording")
    return tap(found.layout, str(path)), found.rows
