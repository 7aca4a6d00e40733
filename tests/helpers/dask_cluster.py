"""A Dask scheduler and its workers as processes, over loopback."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from pathlib import Path
from typing import Any, Self

from helpers.wait import until


class DaskCluster:
    """A scheduler; workers are added one by one. All end with the `with`."""

    def __init__(self, folder: Path, environment: dict[str, str], tls: Path | None = None) -> None:
        """`environment`: of all processes. `tls`: folder with ca.pem, certificate.pem and key.pem."""
        self._folder, self._environment = folder, environment
        folder.mkdir(parents=True, exist_ok=True)
        self._tls = [] if tls is None else [
            "--protocol", "tls", "--tls-ca-file", str(tls / "ca.pem"), "--tls-cert", str(tls / "certificate.pem"),
            "--tls-key", str(tls / "key.pem"),
        ]  # fmt: skip
        if tls is not None:
            self._environment = environment | {"DASK_DISTRIBUTED__COMM__REQUIRE_ENCRYPTION": "True"}
        self._processes: list[subprocess.Popen[bytes]] = []
        file = folder / "scheduler.json"
        self._start("scheduler", "--port", "0", "--no-show", "--scheduler-file", str(file))
        try:
            self.address = until(lambda: _address(file), what=self._reported, pause=0.02)
        except BaseException:
            self._end()
            raise

    def worker(self) -> subprocess.Popen[bytes]:
        """Starts a worker of one thread."""
        number = len(self._processes)
        return self._start("worker", self.address, "--nthreads", "1", "--no-nanny", "--name", f"w{number}")

    def _start(self, kind: str, *arguments: str) -> subprocess.Popen[bytes]:
        # Without these, Dask opens its page to the whole network.
        closed = ("--host", "127.0.0.1", "--dashboard-address", "127.0.0.1:0", "--no-dashboard")
        command = [sys.executable, "-m", f"distributed.cli.dask_{kind}", *arguments, *closed, *self._tls]
        with open(self._folder / "log", "ab") as log:
            process = subprocess.Popen(
                command, env=self._environment, cwd=self._folder, stdout=log, stderr=subprocess.STDOUT
            )
        self._processes.append(process)
        return process

    def _reported(self) -> str:
        return (self._folder / "log").read_text()

    def ready(self, workers: int) -> None:
        """Waits until so many workers are there."""
        until(lambda: self._reported().count("Register worker") >= workers, what=self._reported, pause=0.02)

    def stop_scheduler(self) -> None:
        """Kills the scheduler."""
        self._processes[0].kill()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    def _end(self) -> None:
        for process in reversed(self._processes):
            process.kill()
            process.wait()


def _address(file: Path) -> str:
    with contextlib.suppress(FileNotFoundError, ValueError):
        found: dict[str, Any] = json.loads(file.read_text())
        return str(found["address"])
    return ""
