"""What the process of a page does: it serves, and obeys whoever started it (`srl.runtime.web.panel.client`).

It takes commands from its standard input, one JSON object a line: {"address": true}; for the participant's screen
{"trial": {...}}, {"abort": "why"}, too. It answers on its standard output: {"address": URL}, {"outcome": {...}},
{"error": [place, problem, remedy]}. It ends when its input ends: so it never outlives the process that started it.
"""

from __future__ import annotations

import asyncio
import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from srl.runtime.contracts.errors import SrlError
from srl.runtime.web.panel.pages import PageServer
from srl.runtime.web.panel.server import Server
from srl.runtime.web.panel.trial import ScreenTrial, Trial

LINE = 8 << 20  # bytes of a command, at most
_SAYS = threading.Lock()  # an outcome is written by a thread: it is long


def run(made: Callable[[], PageServer], port: int) -> int:
    """Serves the page that `made` makes until the input ends. Exit code 2: it can't be made, or has no port."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that started this one
    try:
        asyncio.run(_serve(made(), port))
    except SrlError as error:
        _say({"error": [error.place, error.problem, error.remedy]})
        return 2
    return 0


async def _serve(server: PageServer, port: int) -> None:
    loop = asyncio.get_running_loop()
    tasks: set[asyncio.Task[None]] = set()

    def ended(outcome: ScreenTrial) -> None:
        task = asyncio.create_task(asyncio.to_thread(_say, {"outcome": outcome.content}))
        tasks.add(task)
        task.add_done_callback(tasks.discard)

    if isinstance(server, Server):
        server.session.ended = ended
    commands = asyncio.StreamReader(limit=LINE)
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(commands), sys.stdin)
    over = asyncio.Event()
    loop.add_signal_handler(signal.SIGTERM, over.set)
    async with server.serving(port) as follower:
        _say({"address": server.address()})
        ends = [asyncio.create_task(_obey(server, commands)), asyncio.create_task(over.wait()), follower]
        done, _ = await asyncio.wait(ends, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()  # raises what a task failed with


async def _obey(server: PageServer, commands: asyncio.StreamReader) -> None:
    while line := await commands.readline():
        command: dict[str, Any] = json.loads(line)
        if "address" in command:
            _say({"address": server.address()})
        elif isinstance(server, Server) and "trial" in command:
            server.session.offer(Trial(**command["trial"]), time.monotonic())
        elif isinstance(server, Server) and "abort" in command:
            server.session.abort(command["abort"], time.monotonic())


def _say(message: dict[str, Any]) -> None:
    with _SAYS:
        try:
            sys.stdout.write(json.dumps(message) + "\n")
            sys.stdout.flush()
        except BrokenPipeError:  # nobody reads any more: the end of the input says so, too
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
