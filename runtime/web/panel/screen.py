"""The participant's screen, as a study uses it: it starts the page's process, and runs one trial after the other."""

from __future__ import annotations

import queue
from dataclasses import asdict
from typing import Any

from srl.runtime.contracts.errors import HostError
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.web.panel.client import END, PageProcess
from srl.runtime.web.panel.source import Source
from srl.runtime.web.panel.trial import ScreenTrial, Trial


class Screen(PageProcess):
    """A participant's screen of a running instance; a context manager. All its methods are for one thread."""

    called = "the participant's screen"

    def __init__(
        self,
        run_folder: RunFolder,
        signal: str,
        span: tuple[float, float] = (0.0, 1.0),
        held: str | None = None,
        port: int = 0,
    ) -> None:
        """Starts the page's process.

        Args:
            run_folder: the instance's folder.
            signal: one number of the loop's rows, "ikns.c".
            span: values of the signal that are shown as 0 and 1, in its unit.
            held: a signal that isn't zero, in any element, while the value is held.
            port: on 127.0.0.1; 0: any free one.
        Raises:
            RecordingError: there is no run, or its rows lack the signal.
            HostError: the port can't be had, or the process can't begin.
        """
        Source(run_folder, signal, span, held).close()  # its errors are raised here, in words
        options = ["--signal", signal, "--span", *map(repr, span), *(["--held", held] if held else [])]
        super().__init__(run_folder, options, port)

    def run_trial(self, trial: Trial, timeout: float | None = None) -> ScreenTrial:
        """Lets the participant begin a trial, and waits until it has ended.

        Args:
            trial: what is shown.
            timeout: s that it may take with all its pauses, until it is aborted. None: as long as it takes.
        Returns:
            What came of it. If it is `aborted` it can be run again.
        Raises:
            HostError: the page's process has ended.
        """
        self._send({"trial": asdict(trial)})
        try:
            found = self._answer("outcome", timeout)
        except queue.Empty:
            found = self._abort("the time for it was over")
        except KeyboardInterrupt:
            self._abort("the study was interrupted")
            raise
        return ScreenTrial.of(found)

    def _abort(self, why: str) -> Any:
        """Ends the trial, and takes its outcome: it must not be the next one's. Raises HostError."""
        self._send({"abort": why})
        try:
            return self._answer("outcome", END)
        except queue.Empty:
            raise HostError("the participant's screen", "its process doesn't answer", "Start it again") from None
