"""Runs tasks in processes of this machine."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections import Counter, deque
from collections.abc import Generator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any, Final

from srl.runtime.ipc.child import end_with_parent
from srl.studies.tasks.task import LOST
from srl.studies.tasks.worker import perform

TRIES: Final = 3  # times that a worker may die of one task


def cores() -> int:
    """The cores that this process may use."""
    return len(os.sched_getaffinity(0))


class LocalEngine:
    """Worker processes, started anew (never forked from a process with threads).

    A worker that dies breaks the pool: it is built again, and the tasks that were running are run once more, one at a
    time, so that a task which kills its worker is found and given up, and no other one with it.
    """

    def __init__(self, workers: int = 0) -> None:
        """`workers`: processes; 0: one a core."""
        self.workers = workers or cores()

    def run(self, orders: Mapping[str, dict[str, Any]]) -> Generator[list[tuple[str, dict[str, Any]]]]:
        """Runs orders by key; yields keys and answers in the order in which they come, several at a time."""
        waiting, suspects, deaths = deque(orders), deque[str](), Counter[str]()
        while waiting or suspects:
            one = bool(suspects)
            running: dict[Future[dict[str, Any]], str] = {}
            with _pool(1 if one else self.workers) as pool:
                try:
                    while (suspects if one else waiting) or running:
                        queue = suspects if one else waiting
                        # None waits in the pool's own queue: what hasn't begun can't be to blame.
                        while queue and len(running) < (1 if one else self.workers):
                            key = queue.popleft()
                            try:
                                running[pool.submit(perform, orders[key])] = key
                            except BrokenProcessPool:
                                queue.appendleft(key)
                                raise
                        done, _ = wait(running, return_when=FIRST_COMPLETED)
                        broken = [f for f in done if isinstance(f.exception(), BrokenProcessPool)]
                        answers = [(running.pop(f), f.result()) for f in done if f not in broken]
                        if answers:
                            yield answers
                        if broken:
                            raise BrokenProcessPool
                except BrokenProcessPool:
                    for future, key in running.items():
                        if future.done() and future.exception() is None:
                            yield [(key, future.result())]
                            continue
                        deaths[key] += 1
                        if deaths[key] < TRIES:
                            suspects.append(key)
                        else:
                            yield [(key, _lost(orders[key]))]


def _lost(order: dict[str, Any]) -> dict[str, Any]:
    error = f"its worker died {TRIES} times: killed, out of memory, or a crash in a library"
    return {
        "state": LOST, "values": {}, "error": error, "seconds": 0.0, "worker": "", "environment": order["environment"],
    }  # fmt: skip


class _pool:  # noqa: N801
    """A pool of processes that end with the `with`, whatever they are doing."""

    def __init__(self, workers: int) -> None:
        self._before = set(multiprocessing.active_children())
        self._pool = ProcessPoolExecutor(
            workers, multiprocessing.get_context("spawn"), initializer=_begin, initargs=(os.getpid(),)
        )

    def __enter__(self) -> ProcessPoolExecutor:
        return self._pool

    def __exit__(self, *_: object) -> None:
        ours = set(multiprocessing.active_children()) - self._before
        self._pool.shutdown(wait=False, cancel_futures=True)
        for process in ours:
            process.terminate()
        for process in ours:
            process.join()


def _begin(client: int) -> None:
    """A worker's first instructions: Ctrl-C is for the client, and nobody works for a client that has died."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent(signal.SIGKILL)
    if os.getppid() != client:
        os._exit(1)
