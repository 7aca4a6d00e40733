"""The live status line of `srl run`: rewritten in place on a terminal, now and then a line elsewhere."""

from __future__ import annotations

import shutil
import time
from typing import TextIO

from runtime.layout import Cause
from runtime.summary import Summary

_EVERY = 10.0  # s between lines where there is no terminal


class Status:
    """See the module's text."""

    def __init__(self, stream: TextIO, quiet: bool = False) -> None:
        """`quiet`: remarks only, no status."""
        self._stream, self._quiet = stream, quiet
        self._terminal = stream.isatty()
        self._shown = False
        self._next = 0.0

    def show(self, summary: Summary) -> None:
        """The present state in one line."""
        if self._quiet or summary.row is None:
            return
        if not self._terminal:
            if time.monotonic() < self._next:
                return
            self._next = time.monotonic() + _EVERY
        seconds, wall = summary.seconds()
        cause = Cause(summary.word("cause"))
        why = (
            f" ({cause.name.lower()} {summary.layout.culprit(cause, summary.word('culprit'))})".replace(" )", ")")
            if cause
            else ""
        )
        devices = "  ".join(
            f"{name} {d['state']}" + (f" {d['age_ms']:.0f} ms" if d["age_ms"] is not None else "")
            for name, d in summary.devices().items()
        )
        factor = f" x{seconds / wall:.1f}" if wall > 0 and seconds > 1.05 * wall else ""
        p50, p99 = (summary.cycle.percentile(share) / 1e3 for share in (0.5, 0.99))
        text = (
            f"{summary.state.name:<8}{why} {seconds:7.1f} s{factor}  cycle {p50:.0f} us (p99 {p99:.0f})  "
            f"overruns {summary.word('overruns')}  {devices}"
        )
        if self._terminal:
            width = shutil.get_terminal_size().columns - 1
            self._stream.write(f"\r\033[2K{text[:width]}")
            self._shown = True
        else:
            self._stream.write(f"{text}\n")
        self._stream.flush()

    def line(self, text: str) -> None:
        """A remark of its own, above the status."""
        if self._shown:
            self._stream.write("\r\033[2K")
        self._stream.write(f"srl: {text}\n")
        self._stream.flush()

    def end(self) -> None:
        """Leaves the last status standing."""
        if self._shown:
            self._stream.write("\n")
            self._stream.flush()
            self._shown = False
