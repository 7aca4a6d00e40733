"""A page's process, as whoever wants the page starts it and speaks to it."""

from __future__ import annotations

import json
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from typing import Any, ClassVar, Self

from srl.runtime.contracts.errors import HostError
from srl.runtime.ipc.run_folder import RunFolder

START = 30.0  # s that the page's process may take to begin
END = 3.0  # s that it may take to end


class PageProcess:
    """The process that serves a page of a running instance; a context manager. All its methods are for one thread.

    Attributes:
        address: what a browser opens. It is good for one browser, once; `new_address` gives another.
    """

    called: ClassVar = "the page"
    module: ClassVar = "srl.runtime.web.panel"

    def __init__(self, run_folder: RunFolder, options: Sequence[str] = (), port: int = 0) -> None:
        """Starts the process.

        Args:
            run_folder: the instance's folder.
            options: of `python -m MODULE`.
            port: on 127.0.0.1; 0: any free one.
        Raises:
            HostError: the port can't be had, or the process can't begin.
        """
        command = [sys.executable, "-m", self.module, str(run_folder.path), *options, "--port", str(port)]
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
        return HostError(self.called, "its process has ended", "Start it again; see what it printed")
