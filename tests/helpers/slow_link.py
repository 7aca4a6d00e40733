"""A relay of TCP connections whose bytes come late, by as much as is said on its stdin: a network that is slow.

Where the kernel has netem, `tc qdisc add dev X root netem delay 20ms 60ms` does the like; many have not.
"""

from __future__ import annotations

import asyncio
import contextlib
import random
import subprocess
import sys
from pathlib import Path
from typing import Self


class SlowLink:
    """The relay as a process, in a network namespace; ends with the `with`."""

    def __init__(self, namespace: str, listens: tuple[str, int], target: tuple[str, int]) -> None:
        words = [*listens, *target]
        self._process = subprocess.Popen(
            ["ip", "netns", "exec", namespace, sys.executable, str(Path(__file__)), *map(str, words)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert self._process.stdout is not None
        assert self._process.stdout.readline() == "ready\n"

    def delay(self, seconds: float, jitter: float = 0.0) -> None:
        """From now on bytes take so long, and up to `jitter` s more, either way; their order stays."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{seconds} {jitter}\n")
        self._process.stdin.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.communicate()


class _Relay:
    def __init__(self, target: tuple[str, int]) -> None:
        self.target = target
        self.delay = self.jitter = 0.0
        self.random = random.Random(1)

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        there, back = await asyncio.open_connection(*self.target)
        await asyncio.gather(self.pump(reader, back), self.pump(there, writer))

    async def pump(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        waiting: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue()
        given = asyncio.create_task(self.give(waiting, writer))
        last, clock = 0.0, asyncio.get_running_loop().time
        with contextlib.suppress(OSError):
            while data := await reader.read(65536):
                last = max(last, clock() + self.delay + self.random.uniform(0.0, self.jitter))
                waiting.put_nowait((last, data))
        waiting.put_nowait((last, b""))
        await given

    async def give(self, waiting: asyncio.Queue[tuple[float, bytes]], writer: asyncio.StreamWriter) -> None:
        clock = asyncio.get_running_loop().time
        with contextlib.suppress(OSError):
            while (item := await waiting.get())[1]:
                await asyncio.sleep(max(item[0] - clock(), 0.0))
                writer.write(item[1])
                await writer.drain()
        writer.close()


async def _main(host: str, port: str, to: str, at: str) -> None:
    relay = _Relay((to, int(at)))
    server = await asyncio.start_server(relay.serve, host, int(port))
    output = asyncio.StreamReader()
    await asyncio.get_running_loop().connect_read_pipe(lambda: asyncio.StreamReaderProtocol(output), sys.stdin)
    print("ready", flush=True)
    async with server:
        while line := await output.readline():
            relay.delay, relay.jitter = map(float, line.split())


if __name__ == "__main__":
    asyncio.run(_main(*sys.argv[1:]))
