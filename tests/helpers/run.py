"""Running `srl` as its users do: as a process, with a runtime folder of its own."""

from __future__ import annotations

import contextlib
import io
import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from helpers.wait import until
from srl.runtime.cli import main
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.ring import RingReader
from srl.runtime.ipc.run_folder import RunFolder


def _first() -> list[str]:
    """As the service's unit, a run comes before the tests on a busy machine, where the user may have it so.

    The supervisor ends a loop that a host holds up for over 120 ms.
    """
    nice = shutil.which("nice")
    if nice is None or subprocess.run([nice, "-n", "-5", "true"], capture_output=True, check=False).stderr:
        return []
    return [nice, "-n", "-5"]


_FIRST = _first()


def srl(*arguments: str) -> list[str]:
    """The command line."""
    return [*_FIRST, sys.executable, "-m", "srl", *arguments]


def environment(folder: Path) -> dict[str, str]:
    """Runtime and state folders of the test's own."""
    return os.environ | {"SRL_RUNTIME_DIR": str(folder / "run"), "STATE_DIRECTORY": str(folder / "state")}


def call(folder: Path, *arguments: str, code: int | None = 0, timeout: float = 250) -> subprocess.CompletedProcess[str]:
    """Runs it to its end and checks the exit code."""
    done = subprocess.run(
        srl(*arguments),
        env=environment(folder),
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
    )
    assert code is None or done.returncode == code, f"exit {done.returncode}\n{done.stdout}\n{done.stderr}"
    assert "Traceback" not in done.stderr, done.stderr
    return done


def refused(*arguments: str) -> str:
    """What it says of arguments that it refuses, in this process: a start for each would take seconds."""
    with contextlib.redirect_stderr(io.StringIO()) as output:
        assert main(arguments) == 2
    return output.getvalue()


def summary(done: subprocess.CompletedProcess[str]) -> dict[str, Any]:
    """The JSON object of `--json`."""
    found: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    return found


def alive(pid: int) -> bool:
    """Whether a process is there and not merely waiting to be reaped."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):  # the latter: it ended between the file's opening and its reading
        return False


@contextlib.contextmanager
def ended(command: list[str], **given: Any) -> Iterator[subprocess.Popen[str]]:
    """A command in the background with its output in pipes; with what it started, it ends with the `with`."""
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True, **given
    )
    with process:
        try:
            yield process
        finally:
            # The group is there for as long as one of its processes.
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)


class Running:
    """`srl run` in the background; ends it at the end."""

    def __init__(self, folder: Path, *arguments: str, instance: str = "sixth-finger") -> None:
        self.folder = folder
        self.run_folder = RunFolder(folder / "run" / instance)
        for old in (self.run_folder.layout, self.run_folder.rows):
            old.unlink(missing_ok=True)  # a crash before left them: they aren't this run's
        self.process = subprocess.Popen(
            srl("run", *arguments, "--json"), env=environment(folder), cwd=folder,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        self._reader: RingReader | None = None
        self._layout: Layout | None = None

    def __enter__(self) -> Running:
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
            try:
                self.process.communicate(timeout=30)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.communicate()

    def until(self, condition: Callable[[], bool], what: str, timeout: float = 40.0) -> None:
        """Waits for a condition while it runs."""

        def lives() -> None:
            if self.process.poll() is not None:
                out, err = self.process.communicate()
                raise AssertionError(f"the run ended before {what}:\n{out}\n{err}")

        until(condition, lives, what=what, timeout=timeout, pause=0.02)

    def started(self) -> None:
        """Waits for the first rows."""
        self.until(
            lambda: self.run_folder.layout.exists() and self.run_folder.rows.exists() and self.reader.head > 0,
            "the first row",
        )

    @property
    def layout(self) -> Layout:
        """The rows' layout."""
        if self._layout is None:
            self._layout = Layout.load(self.run_folder.layout)
        return self._layout

    @property
    def reader(self) -> RingReader:
        """A reader of the rows."""
        if self._reader is None:
            self._reader = RingReader(self.run_folder.rows)
        return self._reader

    def header(self, name: str) -> int:
        """An int64 word of the newest row."""
        row = self.reader.newest()
        return -1 if row is None else int(self.layout.header(row, name))

    def children(self) -> dict[str, int]:
        """Process ids of loop, bus, recorder and viewer."""
        found = {}
        for path in Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text().split():
            try:
                line = Path(f"/proc/{path}/cmdline").read_bytes().decode().split("\0")
            except (FileNotFoundError, ProcessLookupError):  # it has just ended
                continue
            for name in ("loop", "bus", "ros2", "recorder", "viewing", "foxglove"):
                if {f"srl.runtime.{name}", f"srl.runtime.web.{name}"} & set(line):
                    found[name] = int(path)
        return found

    def finish(self, code: int | None = 0, timeout: float = 60.0) -> dict[str, Any]:
        """Waits for the run's own end; returns the summary."""
        out, err = self.process.communicate(timeout=timeout)
        assert code is None or self.process.returncode == code, f"exit {self.process.returncode}\n{out}\n{err}"
        self.stderr = err
        found: dict[str, Any] = json.loads(out.strip().splitlines()[-1])
        return found
