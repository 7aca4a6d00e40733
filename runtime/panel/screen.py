"""The participant's screen, as a study uses it: it starts the page's process, and runs one trial after the other."""

from __future__ import annotations

import json
import queue
import subprocess
import sys
import threading
import time
from dataclasses import asdict
from typing import Any, Self

from runtime.contracts.errors import HostError
from runtime.ipc.run_folder import RunFolder
from runtime.panel.source import Source
from runtime.panel.trial import ScreenTrial, Trial

START = 30.0  # s that the page's process may take to begin
END = 3.0  # s that it may take to end


class Screen:
    """A participant's screen of a running instance; a context manager. All its methods are for one thread.

    Attributes:
        address: what the participant's browser opens. It is good for one browser, once; `new_address` gives another.
    """

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
        command = [sys.executable, "-m", "runtime.panel", str(run_folder.path), "--signal", signal]
        command += ["--span", *map(repr, span), "--port", str(port), *(["--held", held] if held else [])]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True
        )
        self._answers: queue.Queue[dict[str, Any] | None] = queue.Queue()
        threading.Thread(target=self._listen, daemon=True).start()
        try:
            self.address = str(self._answer("address", START))
        except BaseException:
            self.close()
            raise

    @property
    def pid(self) -> int:
        """The page's process."""
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether the page's process is there."""
        return self._process.poll() is None

    def new_address(self) -> str:
        """Returns a new address, for another browser. The browser that takes it is the only one from then on."""
        self._send({"address": True})
        self.address = str(self._answer("address", START))
        return self.address

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

    def close(self) -> None:
        """Ends the page's process. It always succeeds."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.close()
        except OSError:  # it has ended
            pass
        for end in (self._process.terminate, self._process.kill):
            try:
                self._process.wait(END)
                return
            except subprocess.TimeoutExpired:
                end()
        self._process.wait()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as answers:
            for line in answers:
                self._answers.put(json.loads(line))
        self._answers.put(None)

    def _abort(self, why: str) -> Any:
        """Ends the trial, and takes its outcome: it must not be the next one's. Raises HostError."""
        self._send({"abort": why})
        try:
            return self._answer("outcome", END)
        except queue.Empty:
            raise HostError("the participant's screen", "its process doesn't answer", "Start it again") from None

    def _send(self, command: dict[str, Any]) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(command) + "\n")
            self._process.stdin.flush()
        except (OSError, ValueError):
            raise self._dead() from None

    def _answer(self, what: str, timeout: float | None) -> Any:
        """Waits for an answer. Raises queue.Empty: not in time; HostError."""
        deadline = None if timeout is None else time.monotonic() + timeout
        while True:
            rest = None if deadline is None else max(deadline - time.monotonic(), 0.0)
            answer = self._answers.get(timeout=rest)
            if answer is None:
                self._answers.put(None)  # for whoever asks next
                raise self._dead()
            if "error" in answer:
                raise HostError(*answer["error"])
            if what in answer:
                return answer[what]

    def _dead(self) -> HostError:
        return HostError("the participant's screen", "its process has ended", "Start it again; see what it printed")
