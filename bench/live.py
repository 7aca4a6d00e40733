"""A run of the simulated sixth finger in real time, for what is measured beside it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from srl.runtime.ipc.header import State
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.ring import RingReader
from srl.runtime.ipc.run_folder import RunFolder

_NAME = "bench"


@contextmanager
def running(rate: int, *more: str) -> Iterator[RunFolder]:
    """A run of the simulated sixth finger, once it is active. `more`: arguments of `srl run`."""
    with tempfile.TemporaryDirectory(prefix="srl-") as scratch:
        os.environ["SRL_RUNTIME_DIR"] = scratch
        command = [sys.executable, "-m", "srl", "run", "sixth-finger", "--sim", "--instance", _NAME]
        process = subprocess.Popen([*command, "--set", f"rate={rate}", *more], stderr=subprocess.DEVNULL)
        folder = RunFolder(Path(scratch) / _NAME)
        try:
            while not _active(folder):
                if process.poll() is not None:
                    raise RuntimeError("the run has ended before it began")
                time.sleep(0.1)
            yield folder
        finally:
            process.send_signal(signal.SIGINT)
            process.wait()
            del os.environ["SRL_RUNTIME_DIR"]


def _active(folder: RunFolder) -> bool:
    if not (folder.layout.exists() and folder.rows.exists()):
        return False
    newest = RingReader(folder.rows).newest()
    return newest is not None and int(Layout.load(folder.layout).header(newest, "state")) == State.ACTIVE
