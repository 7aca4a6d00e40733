"""New addresses of pages that are being served, for who asks on this machine: `srl panel --again`.

Each page's server listens on a Unix socket in the run folder, page0.sock to page7.sock: the first that is free. It
answers a request of its own user alone, as the kernel tells it, with the page's name and a new address. That one is
worth as much as the first: the browser that takes it is the only one from then on. A connection that requests nothing
(another page that looks for a free socket) leaves the address as it is.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import socket
import struct
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Final

from srl.runtime.ipc.run_folder import RunFolder

PAGES: Final = 8  # of one run
TIMEOUT: Final = 5.0  # s for an answer
_REQUEST: Final = b"?"
_CREDENTIALS: Final = struct.Struct("3i")  # process, user, group


def _paths(run: RunFolder) -> list[Path]:
    return [run.path / f"page{number}.sock" for number in range(PAGES)]


@asynccontextmanager
async def answering(run: RunFolder, called: str, address: Callable[[], str]) -> AsyncIterator[None]:
    """Answers meanwhile. Where no socket can be had there is no answer, and the page goes on.

    Args:
        run: the instance's folder.
        called: the page's name, for people.
        address: makes a new address.
    """

    async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        end = writer.get_extra_info("socket")
        _, user, _ = _CREDENTIALS.unpack(end.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size))
        with contextlib.suppress(OSError, TimeoutError):
            asked = user == os.geteuid() and await asyncio.wait_for(reader.read(1), TIMEOUT) == _REQUEST
            if asked:
                writer.write(json.dumps({"page": called, "address": address()}).encode())
                await writer.drain()
            writer.close()
            await writer.wait_closed()

    bound = _bound(run)
    if bound is None:
        yield
        return
    server = await asyncio.start_unix_server(answer, sock=bound[0])
    try:
        yield
    finally:
        server.close()
        bound[1].unlink(missing_ok=True)


def ask(run: RunFolder) -> list[tuple[str, str]]:
    """Asks the pages of a run for new addresses. Returns the name and the address of each."""
    found = []
    for path in _paths(run):
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_CLOEXEC) as end:
            end.settimeout(TIMEOUT)
            try:
                end.connect(str(path))
                end.sendall(_REQUEST)
                answer = json.loads(b"".join(iter(lambda: end.recv(4096), b"")))
                found.append((str(answer["page"]), str(answer["address"])))
            except (OSError, ValueError):  # none is there, or it has just ended
                continue
    return found


def _bound(run: RunFolder) -> tuple[socket.socket, Path] | None:
    for path in _paths(run):
        made = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_CLOEXEC)
        try:
            if _left(path):
                path.unlink(missing_ok=True)
            made.bind(str(path))
        except OSError:  # another page's, or no room for the path
            made.close()
            continue
        return made, path
    return None


def _left(path: Path) -> bool:
    """Whether a socket is there to which nobody listens: its server was killed."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as end:
        try:
            end.connect(str(path))
        except ConnectionRefusedError:
            return True
        except OSError:
            pass
        return False
