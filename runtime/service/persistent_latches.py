"""Latches that outlive a run: the file in an instance's state folder from which its next run begins.

While a run on real actuators is under way, the file also holds RESTART: so it is there if the run ends badly, even
with the host. A reset releases it, and only the good end of a run that released it takes it away.
"""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Callable
from pathlib import Path

from srl.runtime.contracts.errors import HostError
from srl.runtime.ipc import latches
from srl.runtime.ipc.header import CYCLE, Latch
from srl.runtime.ipc.ring import RingReader

_NAME = "latches.json"
_OLD = "running"  # the mark of srl 0.1.0: a run that didn't end well
WRITING = 10.0  # s that the last writing may take


def read(state: Path, report: Callable[[str], None]) -> Latch:
    """The latches that an instance's last run left in its state folder; `report` is told of a damaged file."""
    path, old = state / _NAME, (state / _OLD).exists()
    try:
        listed = json.loads(path.read_text())["latches"]
        if not isinstance(listed, list):
            raise TypeError  # a text is a list of letters, an empty one would be no latch
        found = latches.of_names(listed)
    except FileNotFoundError:
        found = latches.NONE
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        report(
            f"{path} can't be read ({type(error).__name__}), so this run begins as after a person's stop and "
            "a bad end: look at the limb, then `srl reset`"
        )
        return Latch.PERSON | Latch.RESTART
    return found | Latch.RESTART if old else found


class PersistentLatches:
    """One run's view of the file; see the module's docstring.

    Attributes:
        latches: what stood when the run began.
    """

    def __init__(self, state: Path, report: Callable[[str], None]) -> None:
        """Reads the file, then marks the run as under way.

        Args:
            state: the instance's state folder.
            report: takes a line of text.
        Raises:
            HostError: the file can't be written.
        """
        self._path, self._report = state / _NAME, report
        self.latches = read(state, report)
        self._now = self.latches  # of the newest row
        self._ring: RingReader | None = None
        self._wanted: Latch | None = None
        self._changed, self._closing = threading.Condition(), False
        try:
            state.mkdir(parents=True, exist_ok=True)
            self._write(self.latches | Latch.RESTART)
            (state / _OLD).unlink(missing_ok=True)
        except OSError as error:
            raise HostError(
                str(state), f"the state folder can't be written: {error.strerror}", "Set XDG_STATE_HOME to one of yours"
            ) from None
        # A disk may take seconds, and whoever follows the rows also watches the loop.
        self._writer = threading.Thread(target=self._keep, name="standing", daemon=True)
        self._writer.start()

    @property
    def began(self) -> bool:
        """Whether the loop was followed: before that nothing can have moved."""
        return self._ring is not None

    def follow(self, rows: RingReader) -> None:
        """Looks at the newest row, and has its latches written if they changed. Never waits for the disk.

        `rows` are the supervisor's own: at a loss of the run folder nothing has to be opened.
        """
        self._ring = rows
        row = rows.newest()
        if row is None or (found := Latch(int(row[CYCLE.latches])) & latches.LASTING) == self._now:
            return
        self._now = found
        with self._changed:
            self._wanted = self._now | Latch.RESTART
            self._changed.notify()

    def close(self, well: bool) -> None:
        """Writes the last state. `well`: the run ended well, or never began to move anything."""
        if self._ring is not None:
            self.follow(self._ring)
        with self._changed:
            self._wanted = self._now if well else self._now | Latch.RESTART
            self._closing = True
            self._changed.notify()
        self._writer.join(WRITING)

    def _keep(self) -> None:
        """Runs in the thread: writes what is wanted, the newest last."""
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._wanted is not None)
                wanted, closing = self._wanted, self._closing
                self._wanted = None
            assert wanted is not None
            try:
                self._write(wanted)
            except OSError as error:
                self._report(f"{self._path} can't be written: {error.strerror}; the next run may begin in the stop")
            if closing:
                return

    def _write(self, wanted: Latch) -> None:
        """Replaces the file, or removes it if nothing stands, so that a power cut leaves the old or the new one."""
        folder = os.open(self._path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            if wanted:
                scratch = self._path.with_suffix(".new")
                with open(scratch, "w") as file:
                    json.dump({"latches": latches.names(wanted)}, file)
                    file.flush()
                    os.fsync(file.fileno())
                scratch.replace(self._path)
            else:
                self._path.unlink(missing_ok=True)
            os.fsync(folder)
        finally:
            os.close(folder)
