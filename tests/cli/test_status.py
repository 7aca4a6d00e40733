"""The status line of `srl run`."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from helpers.bus import layout

from runtime.cli.console import Console
from runtime.cli.status import Status
from runtime.ipc.ring import RingReader, RingWriter
from runtime.ipc.words import CYCLE, Cause, Latch, State
from runtime.service.summary import Summary


def test_it_says_what_keeps_the_stop(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    made = layout("sixth-finger", 100)
    with RingWriter.create(tmp_path / "rows.ring", made.width, 8) as ring:
        words = np.zeros(made.width, np.int64)
        words[[CYCLE.state, CYCLE.cause, CYCLE.culprit]] = State.STOPPED, Cause.REQUEST, -1
        words[CYCLE.latches] = Latch.PERSON | Latch.FAULT
        ring.append(words)
        summary = Summary(made, RingReader(tmp_path / "rows.ring"))
        summary.update()
        Status(Console(sys.stderr)).show(summary)
    assert "STOPPED  (request) latched: person, fault" in capfd.readouterr().err
