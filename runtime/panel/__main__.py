"""`python -m runtime.panel RUN_FOLDER [--signal SIGNAL]`: the page's process, which `runtime.panel.client` starts.

With `--signal` the page is the participant's screen, without it the picture of the run. The process takes commands from
its standard input, one JSON object a line: {"address": true}; for the screen {"trial": {...}}, {"abort": "why"}, too.
It answers on its standard output: {"address": URL}, {"outcome": {...}}, {"error": [place, problem, remedy]}. It ends
when its input ends: so it never outlives the process that started it.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import signal
import sys
import threading
import time
from pathlib import Path
from typing import Any

from runtime.contracts.errors import SrlError
from runtime.ipc.run_folder import RunFolder
from runtime.panel.pages import PageServer
from runtime.panel.picture import PictureServer
from runtime.panel.server import Server
from runtime.panel.source import Source
from runtime.panel.trial import ScreenTrial, Trial

LINE = 8 << 20  # bytes of a command, at most
_SAYS = threading.Lock()  # an outcome is written by a thread: it is long


def main() -> int:
    """Serves until the input ends. Exit code 2: the signal, the run or the port isn't there."""
    parser = argparse.ArgumentParser(prog="python -m runtime.panel")
    parser.add_argument("run_folder", type=Path)
    parser.add_argument("--signal")
    parser.add_argument("--span", type=float, nargs=2, default=(0.0, 1.0))
    parser.add_argument("--held")
    parser.add_argument("--port", type=int, default=0)
    options = parser.parse_args()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that started this one
    try:
        run_folder = RunFolder(options.run_folder)
        if options.signal is None:
            asyncio.run(_serve(PictureServer(run_folder), options.port))
        else:
            source = Source(run_folder, options.signal, tuple(options.span), options.held)
            asyncio.run(_serve(Server(run_folder, source), options.port))
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


if __name__ == "__main__":
    sys.exit(main())
