"""A twin in a process of its own, which a test can stop, continue and kill, as a device that hangs.

The process runs this file: world, fake and twin of one device, served 1000 times a second in real time.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from fractions import Fraction
from typing import Any, Self

import numpy as np
from ruamel.yaml import YAML

from helpers import ROOT, environment
from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.world import Fake, Twin, World


class Peer:
    """The process. Attributes: `address`, what the driver's `port` should be; `pid`."""

    def __init__(
        self,
        driver: str,
        config: dict[str, Any] | None = None,
        options: dict[str, Any] | None = None,
        world: dict[str, Any] | None = None,
        seed: int = 0,
    ) -> None:
        """
        Args:
            driver: registered name of the device.
            config: the device's options, without `port` where the twin doesn't care (a dummy is put in).
            options: the fake's.
            world: `{"world": "cell", "parts": {...}}` and so on.
            seed: of the world.
        """
        order = {"driver": driver, "config": config or {}, "options": options or {}, "world": world or {}, "seed": seed}
        self._process = subprocess.Popen(
            [sys.executable, "-m", "helpers.peer", json.dumps(order)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment() | {"OMP_NUM_THREADS": "1"},
        )
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        assert line, f"the twin of {driver} didn't start"
        self.address: str = json.loads(line)["address"]
        self.pid = self._process.pid

    def stop(self) -> None:
        """SIGSTOP: it hangs, its kernel's buffers go on taking."""
        os.kill(self.pid, signal.SIGSTOP)

    def cont(self) -> None:
        """SIGCONT."""
        os.kill(self.pid, signal.SIGCONT)

    def set(self, name: str, value: object) -> None:
        """Sets an attribute of the twin ("muted"), or calls a method of it with no argument ("close")."""
        self._ask({"set": name, "value": value})

    def metrics(self) -> dict[str, Any]:
        """The twin's figures, and `truth`: the world's truth signals, now; `time`: ns of the world."""
        answer: dict[str, Any] = self._ask({"figures": True})
        return answer

    def _ask(self, what: dict[str, object]) -> Any:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps(what) + "\n")
        self._process.stdin.flush()
        return json.loads(self._process.stdout.readline())

    def close(self) -> None:
        """Kills it."""
        with contextlib.suppress(ProcessLookupError):
            self.cont()
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def load(profile: str) -> tuple[str, dict[str, Any], dict[str, Any]]:
    """The profile's actuator: its name, its options, the profile."""
    text = YAML(typ="safe", pure=True).load(ROOT / "profiles" / f"{profile}.yaml")
    ((name, entry),) = text["devices"].items()
    return name, entry, text


def peer_of(profile: str, **options: Any) -> Peer:
    """The twin of the profile's actuator, in the profile's own simulated world."""
    _, entry, text = load(profile)
    world = {key: value for key, value in text["sim"].items() if key != "devices"}
    config = {key: value for key, value in entry.items() if key not in ("driver", "max_age", "robot")}
    return Peer(entry["driver"], config, options, world)


def cycles(driver: Driver, seconds: float, rate: float, each: Callable[[int], None] | None = None) -> None:
    """Calls the driver as the loop does: `read`, then `each(now)` (which may fill commands and `write`)."""
    period = 1 / rate
    start = time.monotonic()
    count = 0
    while (now := time.monotonic()) - start < seconds:
        stamp = time.monotonic_ns()
        driver.read(stamp)
        if each is not None:
            each(stamp)
        count += 1
        time.sleep(max(0.0, start + count * period - now))


def bound(driver: Driver) -> Driver:
    """The driver with arrays of its own."""
    driver.bind(
        {s.name: np.zeros(s.shape) for s in driver.states}, {c.name: np.zeros(c.shape) for c in driver.commands}
    )
    return driver


def make(order: dict[str, Any]) -> tuple[World, Fake, Twin]:
    """World, fake and twin from an order."""
    from srl.runtime.contracts import registry

    options = dict(order["world"])
    world_class = registry.load("worlds", options.pop("world", "cell"), "test")
    world = world_class(world_class.Config.model_validate(options), order["seed"])
    fake_class = registry.load("fakes", order["driver"], "test")
    config = dict(order["config"])
    if "port" in fake_class.Config.model_fields:
        config.setdefault("port", "/dev/null")
    fake = fake_class(
        "device", fake_class.Config.model_validate(config), world, fake_class.Options.model_validate(order["options"])
    )
    bound(fake)
    return world, fake, registry.load("twins", order["driver"], "test")(fake)


def _serve(order: dict[str, Any]) -> None:
    from srl.runtime.loop.clock import MonotonicClock

    world, _, twin = make(order)
    twin.open()
    # A robot's controller isn't held up by whatever else runs on this machine.
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))
    print(json.dumps({"address": twin.address}), flush=True)
    os.set_blocking(0, False)
    rest = b""
    clock = MonotonicClock(Fraction(1000))
    clock.start()
    start = clock.tick.deadline
    while True:
        tick = clock.wait()
        # A device that was held up makes good what it missed step by step: its own watchdogs must see the time pass.
        for due in range(tick.deadline - tick.missed * clock.period, tick.deadline + 1, clock.period):
            world.advance(due - start)
            twin.service(due)
        try:
            data = os.read(0, 65536)
        except BlockingIOError:
            continue
        if not data:
            return
        *lines, rest = (rest + data).split(b"\n")
        for line in lines:
            asked = json.loads(line)
            if "set" in asked:
                attribute = getattr(twin, asked["set"])
                if callable(attribute):
                    attribute()
                else:
                    setattr(twin, asked["set"], asked["value"])
            truth = {name: values.tolist() for name, values in world.truth_arrays.items()}
            metrics = twin.metrics() | {"truth": truth, "time": world.time}
            print(json.dumps(metrics, default=str), flush=True)


if __name__ == "__main__":
    _serve(json.loads(sys.argv[1]))
