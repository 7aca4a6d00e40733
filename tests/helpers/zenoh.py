"""Twins that speak zenoh, served in a thread, and certificates for TLS."""

from __future__ import annotations

import subprocess
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np

from helpers.wait import TIMEOUT, until
from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.errors import DeviceError, DeviceLostError
from srl.runtime.contracts.tls import TlsConfig
from srl.runtime.contracts.world import Twin, World, WorldConfig


class Still(World):
    """A world in which nothing is but time."""

    def __init__(self, seed: int = 0) -> None:
        super().__init__(WorldConfig(), seed)

    def advance(self, until: int) -> None:
        self.time = max(self.time, until)

    def save(self) -> np.ndarray:
        return np.array([float(self.time)])

    def restore(self, state: np.ndarray) -> None:
        self.time = int(state[0])


class Served(threading.Thread):
    """Steps a world in real time and serves its twins, until the `with` ends."""

    def __init__(self, world: World, *twins: Twin) -> None:
        super().__init__(daemon=True)
        self.world, self.twins = world, twins
        self._lock = threading.Lock()
        self._ending = False
        for twin in twins:
            twin.open()

    def run(self) -> None:
        start = time.monotonic_ns() - self.world.time
        while not self._ending:
            with self._lock:
                now = time.monotonic_ns()
                self.world.advance(now - start)
                for twin in self.twins:
                    twin.service(now)
            time.sleep(0.001)

    def do(self, work: Callable[[], Any]) -> Any:
        """Something to the twins, between two turns."""
        with self._lock:
            return work()

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending = True
        self.join()
        for twin in self.twins:
            twin.close()


def bound(driver: Driver) -> Driver:
    """The driver with arrays of its own."""
    driver.bind(
        {s.name: np.zeros(s.shape) for s in driver.states}, {c.name: np.zeros(c.shape) for c in driver.commands}
    )
    return driver


def cycles(driver: Driver, done: Callable[[], bool], what: str, write: bool = False) -> None:
    """Reads (and writes) at some 200 Hz until a condition holds."""

    def cycle() -> None:
        now = time.monotonic_ns()
        driver.read(now)
        if write:
            driver.write(now)

    until(done, cycle, what=what, pause=0.005)


def lost(driver: Driver, timeout: float = TIMEOUT) -> str:
    """Reads until the device is lost; the reason."""

    def reason() -> str:
        try:
            driver.read(time.monotonic_ns())
        except DeviceLostError as error:
            assert not driver.health.connected
            return str(error)
        return ""

    return until(reason, what="the loss", timeout=timeout, pause=0.005)


def _refused(driver: Driver) -> str:
    """Opens it again; why it doesn't open, or ""."""
    try:
        driver.close()
        driver.open()
    except DeviceError as error:
        return str(error)
    return ""


def reopened(driver: Driver) -> None:
    """Opens again until it succeeds, as the runtime does."""
    why = ""

    def is_open() -> bool:
        nonlocal why
        why = _refused(driver)
        return not why

    until(is_open, what=lambda: f"it opens; {why}", pause=0.1)


def refusal(driver: Driver) -> str:
    """Why it doesn't open, once it has a connection: a busy host may not answer in time."""

    def answered() -> str:
        why = _refused(driver)
        return "" if "no connection" in why else why

    return until(answered, what="a refusal", pause=0.1)


def certificates(folder: Path, names: Sequence[str], addresses: Sequence[str] = ("127.0.0.1",)) -> dict[str, TlsConfig]:
    """An authority, and a certificate it has signed for each name, valid for localhost and the addresses."""

    def openssl(*words: str) -> None:
        subprocess.run(["openssl", *words], check=True, capture_output=True, cwd=folder)

    listed = ",".join(["DNS:localhost", *(f"IP:{address}" for address in addresses)])
    (folder / "extensions").write_text(f"subjectAltName={listed}\n")
    key = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes")
    openssl("req", "-x509", *key, "-keyout", "ca.key", "-out", "ca.pem", "-subj", "/CN=lab CA")
    for name in names:
        openssl("req", *key, "-keyout", f"{name}.key", "-out", f"{name}.csr", "-subj", f"/CN={name}")
        openssl(
            "x509", "-req", "-in", f"{name}.csr", "-out", f"{name}.pem",
            "-CA", "ca.pem", "-CAkey", "ca.key", "-CAcreateserial", "-extfile", "extensions",
        )  # fmt: skip
    return {
        name: TlsConfig(
            ca=str(folder / "ca.pem"), certificate=str(folder / f"{name}.pem"), key=str(folder / f"{name}.key")
        )
        for name in names
    }
