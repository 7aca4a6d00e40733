"""rerun's web viewer, out of rerun's own binary: so it fits the version that writes the data, and needs no network."""

from __future__ import annotations

import http.client
import os
import socket
import subprocess
import sys
import time
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from srl.runtime.contracts.errors import RecordingError

HOST: Final = "127.0.0.1"
TIMEOUT: Final = 30.0  # s for the binary to serve; it has 290 MB to be read
_LISTENS: Final = "0A"  # TCP_LISTEN in /proc/net/tcp
_MEMORY: Final = "1MB"  # that its server may keep: it gets no data
# Runs a program that ends when the process that started it dies, in whatever way (PR_SET_PDEATHSIG is 1, SIGKILL 9).
# `preexec_fn` is not used, as this process has threads.
_MORTAL: Final = "import ctypes, os, sys; ctypes.CDLL(None).prctl(1, 9); os.execv(sys.argv[1], sys.argv[1:])"


@dataclass(frozen=True)
class Assets:
    """The viewer: its JavaScript, which makes the object `wasm_bindgen`, and its WebAssembly."""

    script: bytes
    wasm: bytes


def executable() -> str:
    """The path of rerun's binary. Raises RecordingError: it isn't there."""
    spec = find_spec("rerun_cli")
    path = Path(spec.origin).parent / "rerun" if spec is not None and spec.origin else None
    if path is None or not path.exists():
        raise RecordingError("rerun", f"its viewer isn't installed beside {sys.executable}", "Install rerun-sdk anew")
    return str(path)


def extract() -> Assets:
    """Takes the viewer out of rerun's binary, which serves it for a moment on 127.0.0.1 and gets no data.

    Raises:
        RecordingError: it isn't there, doesn't serve, or the port is another user's.
    """
    port, data = _free_ports()
    command = [sys.executable, "-ISc", _MORTAL, executable(), "--serve-web", "--bind", HOST, "--port", str(data)]
    command += ["--web-viewer-port", str(port), "--server-memory-limit", _MEMORY]
    process = subprocess.Popen(
        command,
        env={**os.environ, "CI": "1"},  # rerun sends no usage statistics then
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        end = time.monotonic() + TIMEOUT
        # Another user could have taken the port meanwhile, and hand us a script that stops the limb.
        while (owner := listener(port)) is None:
            if time.monotonic() > end or process.poll() is not None:
                raise RecordingError("rerun", "its viewer can't be had", "Try `rerun --serve-web --bind 127.0.0.1`")
            time.sleep(0.02)
        if owner != os.geteuid():
            raise RecordingError(f"{HOST}:{port}", "another user's program took this port", "Start the run again")
        return Assets(_fetched(port, "re_viewer.js"), _fetched(port, "re_viewer_bg.wasm"))
    finally:
        process.kill()
        process.wait()


def listener(port: int) -> int | None:
    """The user who listens on a TCP port of 127.0.0.1 or of all addresses; None: nobody. Another's before ours."""
    users = set()
    for line in Path("/proc/net/tcp").read_text().splitlines()[1:]:
        _, local, _, state, _, _, _, user, *_ = line.split()
        address, _, number = local.partition(":")
        if state == _LISTENS and int(number, 16) == port and address in ("0100007F", "00000000"):
            users.add(int(user))
    return next(iter(users - {os.geteuid()} or users), None)


def _fetched(port: int, name: str) -> bytes:
    connection = http.client.HTTPConnection(HOST, port, timeout=TIMEOUT)
    try:
        connection.request("GET", f"/{name}")
        answer = connection.getresponse()
        content = answer.read()
    except (OSError, http.client.HTTPException) as error:
        raise RecordingError("rerun", f"its viewer can't be had: {error}", "Install rerun-sdk anew") from None
    finally:
        connection.close()
    if answer.status != 200 or not content:
        raise RecordingError("rerun", f"its viewer has no {name}", "Install the rerun-sdk that pyproject.toml names")
    return content


def _free_ports() -> tuple[int, int]:
    with socket.socket() as one, socket.socket() as other:
        for probe in (one, other):
            probe.bind((HOST, 0))
        return int(one.getsockname()[1]), int(other.getsockname()[1])
