"""The live viewer: rerun's own server on 127.0.0.1, shown in a browser. It gets a thinned stream."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from runtime.contracts.errors import RecordingError
from runtime.ipc.layout import Words
from runtime.recorder.stream import Stream
from runtime.recorder.tail import Batch

HOST = "127.0.0.1"
GRPC_PORT, WEB_PORT = 9876, 9090  # rerun's own ports, used if they are free
RATE = 100.0  # rows/s of the loop's clock that a viewer gets
# Runs a program that ends when the process that started it dies, in whatever way (PR_SET_PDEATHSIG is 1, SIGTERM
# 15). `preexec_fn` is not used, as this process has threads.
_MORTAL = "import ctypes, os, sys; ctypes.CDLL(None).prctl(1, 15); os.execv(sys.argv[1], sys.argv[1:])"


class Viewer:
    """Runs `rerun --serve-web` bound to the loopback interface.

    `rr.serve_grpc` and `rr.serve_web_viewer` aren't used: they listen on every interface.
    """

    def __init__(self, text: str, newest: Words | None) -> None:
        """Starts the server. `text` is the layout's JSON, `newest` a row (width,) if there is one.

        Raises:
            RecordingError: the server doesn't start.
        """
        grpc, web = _free_port(GRPC_PORT), _free_port(WEB_PORT)
        self.url = f"http://{HOST}:{web}/?url=rerun%2Bhttp://{HOST}:{grpc}/proxy"
        command = [sys.executable, "-ISc", _MORTAL, _executable(), "--serve-web", "--bind", HOST]
        command += ["--port", str(grpc), "--web-viewer-port", str(web), "--server-memory-limit", "512MB"]
        self._process = subprocess.Popen(
            command,
            env={**os.environ, "CI": "1"},  # rerun sends no usage statistics then
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        if not _listens(grpc, 10.0):
            self._process.kill()
            raise RecordingError("rerun", "the viewer's server doesn't start", "Try `rerun --serve-web` by hand")
        self._stream = Stream(text)
        self._stream.recording.connect_grpc(f"rerun+http://{HOST}:{grpc}/proxy")
        self._stream.prologue(newest, live=True)
        self._period = int(1e9 / RATE)
        self._bin = -1

    @property
    def alive(self) -> bool:
        """False once its server has ended."""
        return self._process.poll() is None

    def show(self, batch: Batch) -> None:
        """Shows the first row of each 1/RATE s, and all events."""
        if len(batch.rows):
            bins = self._stream.layout.word(batch.rows, "now") // self._period
            keep = bins != np.append(self._bin, bins[:-1])
            self._bin = int(bins[-1])
            self._stream.rows(batch.sequence[keep], batch.rows[keep])
        self._stream.events(batch.numbers, batch.events)

    def close(self) -> None:
        """Ends the server, once it has received what was sent."""
        if self.alive:
            self._stream.recording.disconnect()
        self._process.terminate()
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()


def _executable() -> str:
    """The path of rerun's own binary. Its Python wrapper is not used, as it would take the signals for the binary."""
    spec = find_spec("rerun_cli")
    path = Path(spec.origin).parent / "rerun" if spec is not None and spec.origin else None
    if path is None or not path.exists():
        raise RecordingError("rerun", f"its viewer isn't installed beside {sys.executable}", "Install rerun-sdk anew")
    return str(path)


def _free_port(wanted: int) -> int:
    for port in (wanted, 0):
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((HOST, port))
            except OSError:
                continue
            return int(probe.getsockname()[1])
    raise RecordingError(HOST, "no port is free", "End other programs")


def _listens(port: int, seconds: float) -> bool:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        try:
            socket.create_connection((HOST, port), 1.0).close()
            return True
        except OSError:
            time.sleep(0.05)
    return False
