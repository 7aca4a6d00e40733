"""The live status line of `srl run`: rewritten in place on a terminal, otherwise printed every 10 s.

`working` is the sign of life of commands that compute for more than a moment, without rows.
"""

from __future__ import annotations

import contextlib
import shutil
import sys
import time
from collections.abc import Iterator

from srl.runtime.cli.console import Console
from srl.runtime.ipc import latches
from srl.runtime.ipc.events import Level
from srl.runtime.ipc.header import Cause
from srl.runtime.service.summary import Summary

_EVERY = 10.0  # s between lines where there is no terminal


class Status:
    """The status line; see the module's docstring."""

    def __init__(self, console: Console, quiet: bool = False) -> None:
        """`quiet`: messages only, no status."""
        self._console, self._quiet = console, quiet
        self._shown = False
        self._next = 0.0

    def mark(self, summary: Summary) -> None:
        """The messages that follow carry this state as fields of the journal."""
        if summary.row is None:
            return
        cause = Cause(summary.header("cause"))
        self._console.fields = {
            "SRL_INSTANCE": str(summary.layout.meta["name"]),
            "SRL_CYCLE": str(summary.header("cycle")),
            "SRL_STATE": summary.state.name.lower(),
            "SRL_CAUSE": cause.name.lower(),
        }

    def show(self, summary: Summary) -> None:
        """Shows the present state in one line."""
        if summary.row is None or self._quiet:
            return
        if not self._console.terminal:
            if time.monotonic() < self._next:
                return
            self._next = time.monotonic() + _EVERY
        text = _line(summary)
        if self._console.terminal:
            self.wait(text)
        else:
            self._console.say(text, Level.INFO)

    def wait(self, text: str) -> None:
        """Shows on a terminal what goes on while there are no rows: a sign of life, rewritten in place."""
        if self._console.terminal and not self._quiet:
            width = shutil.get_terminal_size().columns - 1
            self._console.write(f"\r\033[2K{text[:width]}")
            self._shown = True

    def clear(self) -> None:
        """Takes the line away."""
        if self._shown:
            self._console.write("\r\033[2K")
            self._shown = False

    def line(self, text: str, level: Level = Level.WARNING) -> None:
        """Writes a message on a line of its own, above the status."""
        if self._shown:
            self._console.write("\r\033[2K")
        self._console.say(text, level)

    def end(self) -> None:
        """Ends the status line, so that the last status stays visible."""
        if self._shown:
            self._console.write("\n")
            self._shown = False


def _line(summary: Summary) -> str:
    seconds, wall = summary.seconds()
    cause = Cause(summary.header("cause"))
    fault_source = summary.layout.fault_source(cause, summary.header("fault_source"))
    why = f" ({cause.name.lower()} {fault_source})".replace(" )", ")") if cause else ""
    if latched := latches.names(summary.header("latches")):
        why += f" latched: {', '.join(latched)}"
    devices = "  ".join(
        f"{name} {d['state']}" + (f" {d['age_ms']:.0f} ms" if d["age_ms"] is not None else "")
        for name, d in summary.devices().items()
    )
    factor = f" x{seconds / wall:.1f}" if wall > 0 and seconds > 1.05 * wall else ""
    p50, p99 = (summary.cycle.percentile(share) / 1e3 for share in (0.5, 0.99))
    return (
        f"{summary.state.name:<8}{why} {seconds:7.1f} s{factor}  cycle {p50:.0f} us (p99 {p99:.0f})  "
        f"overruns {summary.header('overruns')}  {devices}"
    )


@contextlib.contextmanager
def working(text: str) -> Iterator[None]:
    """Shows on a terminal that a command is at work, and takes the line away at the end. Nothing elsewhere."""
    if not sys.stderr.isatty():
        yield
        return
    from rich.console import Console as Terminal

    with Terminal(stderr=True).status(text):
        yield
