"""rerun's own server of a live viewer, on 127.0.0.1. It needs nothing of rerun's Python, so it is there at once."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path

from runtime.contracts.errors import RecordingError

HOST = "127.0.0.1"
GRPC_PORT, WEB_PORT = 9876, 9090  # rerun's own ports, used if they are free
# Runs a program that ends when the process that started it dies, in whatever way (PR_SET_PDEATHSIG is 1, SIGTERM
# 15). `preexec_fn` is not used, as this process has threads.
_MORTAL = "import ctypes, os, sys; ctypes.CDLL(None).prctl(1, 15); os.execv(sys.argv[1], sys.argv[1:])"


class ViewerServer:
    """Runs `rerun --serve-web` bound to the loopback interface.

    `rr.serve_grpc` and `rr.serve_web_viewer` aren't used: they listen on every interface.

    Attributes:
        url: of the viewer, for a browser.
        grpc: where the viewer's data are sent to.
    """

    def __init__(self) -> None:
        """Starts the server, and returns before it listens.

        Raises:
            RecordingError: it can't be started.
        """
        self._port, web = _free_port(GRPC_PORT), _free_port(WEB_PORT)
        self.grpc = f"rerun+http://{HOST}:{self._port}/proxy"
        self.url = f"http://{HOST}:{web}/?url=rerun%2Bhttp://{HOST}:{self._port}/proxy"
        command = [sys.executable, "-ISc", _MORTAL, _executable(), "--serve-web", "--bind", HOST]
        command += ["--port", str(self._port), "--web-viewer-port", str(web), "--server-memory-limit", "512MB"]
        self._process = subprocess.Popen(
            command,
            env={**os.environ, "CI": "1"},  # rerun sends no usage statistics then
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    @property
    def alive(self) -> bool:
        """False once it has ended."""
        return self._process.poll() is None

    def await_start(self) -> None:
        """Waits until it listens, at most 10 s. Raises RecordingError if it doesn't."""
        if not self._listens(10.0):
            self._process.kill()
            raise RecordingError("rerun", "the viewer's server doesn't start", "Try `rerun --serve-web` by hand")

    def _listens(self, seconds: float) -> bool:
        end = time.monotonic() + seconds
        while time.monotonic() < end and self.alive:
            try:
                socket.create_connection((HOST, self._port), 1.0).close()
                return True
            except OSError:
                time.sleep(0.05)
        return False

    def close(self) -> None:
        """Ends it."""
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
