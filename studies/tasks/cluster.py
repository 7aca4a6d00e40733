"""Runs tasks on the workers of a Dask scheduler."""

from __future__ import annotations

import ipaddress
import logging
import pkgutil
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlsplit

from srl.runtime.contracts.errors import HostError, RequestError
from srl.studies.tasks.environment import differences, environment
from srl.studies.tasks.task import LOST
from srl.studies.tasks.worker import PROTOCOL, ProgramError, perform

CONNECT: Final = 10.0  # s for the scheduler to answer, and for a first worker to be there
ALONE: Final = 60.0  # s without any worker, then the study ends; it can be resumed
_LOOK: Final = 5.0  # s between two looks at the workers
_FILES: Final = {"tls_ca_file": "ca.pem", "tls_client_cert": "certificate.pem", "tls_client_key": "key.pem"}


@dataclass(frozen=True)
class Cluster:
    """A Dask scheduler.

    Attributes:
        address: "tcp://host:port"; with `tls` the connection is mutual TLS all the same.
        tls: folder with ca.pem, certificate.pem and key.pem; None: no TLS.
        insecure: whether to go over a network without TLS. Whoever can reach such a scheduler can run programs on its
            workers and here.
    """

    address: str
    tls: Path | None = None
    insecure: bool = False

    def __post_init__(self) -> None:
        """Raises RequestError: the address, or what it needs, is wrong."""
        self._checked()

    def run(
        self, orders: Mapping[str, dict[str, Any]], say: Callable[[str], None] = print
    ) -> Generator[list[tuple[str, dict[str, Any]]]]:
        """Runs orders by key; yields keys and answers in the order in which they come, several at a time.

        Raises:
            RequestError: nobody answers, or the scheduler or all workers were lost.
            HostError: `distributed` isn't installed, or a worker's program differs.
        """
        with self._client() as client:
            _check(client, {order["trial"]: order["environment"] for order in orders.values()}, say)
            executor = client.get_executor(retries=2, pure=False)
            waiting, running = deque(orders), dict[Future[dict[str, Any]], str]()
            seen = time.monotonic()
            while waiting or running:
                while waiting and len(running) < max(4 * sum(client.nthreads().values()), 16):
                    key = waiting.popleft()
                    running[executor.submit(perform, orders[key])] = key
                done, _ = wait(running, timeout=_LOOK, return_when=FIRST_COMPLETED)
                if done:
                    seen = time.monotonic()
                    yield [(running[f], self._answer(f, orders[running.pop(f)])) for f in done]
                elif client.status != "running":
                    raise self._lost("the scheduler was lost")
                elif client.scheduler_info(n_workers=-1)["workers"]:
                    seen = time.monotonic()  # trials may be long
                elif time.monotonic() - seen > ALONE:
                    raise self._lost(f"it has had no workers for {ALONE:g} s")
                else:
                    say(f"{self.address} has no workers; waiting for one")

    def _answer(self, future: Future[dict[str, Any]], order: dict[str, Any]) -> dict[str, Any]:
        from distributed import KilledWorker

        try:
            return future.result()
        except KilledWorker as error:
            return {
                "state": LOST, "values": {}, "error": f"its workers died: {type(error).__name__}", "seconds": 0.0,
                "worker": "", "environment": order["environment"],
            }  # fmt: skip
        except ProgramError:
            raise
        except (CancelledError, OSError):
            raise self._lost("the scheduler was lost") from None
        except Exception as error:  # such as a worker that came later and hasn't the package
            problem = f"one can't run a trial: {type(error).__name__}: {' '.join(str(error).split())}"
            raise HostError("workers", problem, "Install the same there and start the workers again") from None

    def _lost(self, problem: str) -> RequestError:
        return RequestError(
            f"--on {self.address}", problem, "Give the same command again: it goes on from what is kept"
        )

    @contextmanager
    def _client(self) -> Iterator[Any]:
        address, files = self._checked()
        try:
            from distributed import Client
            from distributed.security import Security
        except ImportError:
            raise HostError(
                "--on", "the package 'distributed' isn't installed", "pip install 'srl-runtime[distributed]'"
            ) from None
        for name in ("distributed", "distributed.client", "distributed.core", "distributed.comm"):
            logging.getLogger(name).setLevel(logging.CRITICAL)  # what matters is said here, without tracebacks
        security = Security(**files, require_encryption=True) if files else None
        try:
            client = Client(address, security=security, timeout=CONNECT, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            reason = next(line for line in [*str(error).splitlines(), type(error).__name__] if line)
            more = " and its certificates" if files else ", and whether it asks for TLS (--tls)"
            raise RequestError(
                f"--on {self.address}", f"no scheduler answers: {reason}", f"Check the address{more}"
            ) from None
        try:
            yield client
        finally:
            client.close(timeout=CONNECT)

    def _checked(self) -> tuple[str, dict[str, str]]:
        """The address that is used, and the certificates' files."""
        place, parts = f"--on {self.address}", urlsplit(self.address)
        try:
            complete = parts.scheme in ("tcp", "tls") and parts.hostname and parts.port
        except ValueError:
            complete = False
        if not complete:
            raise RequestError(place, "this isn't an address", "Write it as tcp://host:8786")
        if self.tls is None:
            if parts.scheme == "tls":
                raise RequestError(place, "TLS needs certificates", "Name their folder by --tls")
            if not (self.insecure or _is_loopback(str(parts.hostname))):
                raise RequestError(
                    place, "whoever reaches a scheduler without TLS can run programs on its workers and here",
                    "Use --tls FOLDER; --insecure-no-tls only in a network that nobody else can reach",
                )  # fmt: skip
            return self.address, {}
        files = {name: self.tls.absolute() / file for name, file in _FILES.items()}
        if missing := [file.name for file in files.values() if not file.is_file()]:
            names = ", ".join(_FILES.values())
            raise RequestError(f"--tls {self.tls}", f"it has no {', '.join(missing)}", f"It must have {names}")
        return f"tls://{parts.netloc}", {name: str(file) for name, file in files.items()}


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _check(client: Any, trials: Mapping[str, Mapping[str, str]], say: Callable[[str], None]) -> None:
    """Compares programs before work. Raises HostError that names each worker that differs, and in what."""
    end = time.monotonic() + CONNECT
    while not client.nthreads():
        if time.monotonic() > end:
            raise RequestError(
                f"--on {client.scheduler.address}", "it has no workers", "Start some: docs/studies/trials.md"
            )
        time.sleep(0.1)
    found: dict[str, list[str]] = {}
    # A function of ours can't be sent to a worker that doesn't have it: that shows as an error of deserialization.
    # One of the standard library can, and looks for ours.
    for worker, answer in client.run(pkgutil.resolve_name, f"{perform.__module__}:PROTOCOL", on_error="return").items():
        if answer != PROTOCOL:
            found[worker] = [f"no srl-runtime that runs trials of this kind ({answer})"]
    rest = [worker for worker in client.nthreads() if worker not in found]
    for worker, theirs in (client.run(version, "distributed", workers=rest) if rest else {}).items():
        if theirs != (ours := version("distributed")):
            found.setdefault(worker, []).append(f"distributed: {theirs} there, {ours} here")
    for trial, ours_ in trials.items() if rest else ():
        for worker, theirs in client.run(environment, trial, workers=rest).items():
            if words := differences(ours_, theirs):
                found.setdefault(worker, []).extend(words)
            for name in ("blas", "backend"):
                if not words and (there := theirs.get(name)) != ours_[name]:
                    say(f"{worker}: {there} there, {ours_[name]} here: last bits of its rows may differ")
    if found:
        listed = "; ".join(f"{worker}: {', '.join(dict.fromkeys(words))}" for worker, words in found.items())
        raise HostError("workers", listed, "Install the same there and start the workers again")
    for worker, threads in client.nthreads().items():
        if threads > 1:
            say(f"{worker} has {threads} threads, which share one processor: start workers with --nthreads 1")
