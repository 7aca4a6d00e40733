"""A small client of a running instance, for `srl top`, tests and users' scripts.

from srl.runtime.bus.client import connect
with connect("sixth-finger") as srl:
    print(srl.status()["state"])
    for update in srl.states("glove/**", timeout=1.0): ...
    srl.command("stop")
"""

from __future__ import annotations

import json
import queue
import re
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
import zenoh

from srl.runtime.bus import session
from srl.runtime.bus.status import parse
from srl.runtime.contracts.errors import RequestError, nearest
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.tls import TlsConfig
from srl.runtime.ipc.run_folder import RunFolder, running
from srl.runtime.messages import cdr, messages
from srl.runtime.profile.keys import COMMANDS, ROLES, Keys

_ENDPOINT = re.compile(r"^(tcp|tls|unixsock-stream)/")
KEPT = 1024  # samples kept for a slow reader; the oldest are dropped first


@dataclass(frozen=True, slots=True)
class Update:
    """One sample of a signal.

    Attributes:
        name: the signal's key below `state/`, e.g. "glove/position".
        values: in SI units and in the signal's shape; a pose as (x, y, z, qw, qx, qy, qz).
        stamp: Unix time in s; None if the message has no header (Float64MultiArray).
        labels: the names of a JointState.
        kind: the type of the ROS 2 message.
    """

    name: str
    values: Array
    stamp: float | None
    labels: tuple[str, ...]
    kind: str


def connect(target: str | Path | RunFolder, tls: TlsConfig | None = None, timeout: float = 2.0) -> Client:
    """Connects to one instance and returns a client.

    Args:
        target: the instance's name, its run folder, or a zenoh endpoint ("tls/host:7447").
        tls: certificates, for a tls endpoint.
        timeout: s to wait for the connection, and for each answer.
    Raises:
        RequestError: there is no answer.
    """
    if isinstance(target, str) and _ENDPOINT.match(target):
        return Client(target, tls, timeout)
    if isinstance(target, str) and "/" not in target:
        found = {run_folder.path.name: run_folder for run_folder in running()}
        target = found.get(target, RunFolder.of(target))
    run_folder = target if isinstance(target, RunFolder) else RunFolder(Path(target))
    if not run_folder.bus_socket.exists():
        remedy = "Is it running? Set SRL_RUNTIME_DIR as for `srl run`, or give the run folder (docs/bus.md)"
        raise RequestError(f"instance '{run_folder.path.name}'", f"no bus listens at {run_folder.bus_socket}", remedy)
    return Client(f"unixsock-stream/{run_folder.bus_socket}", tls, timeout)


class Client:
    """A client of one instance, made by `connect`.

    Close it or use it in a `with` statement: an open session makes the process hang at its end.

    Attributes:
        instance: its name.
        role: what its certificate may do, one of ROLES; None for a client on the instance's machine.
    """

    def __init__(self, endpoint: str, tls: TlsConfig | None, timeout: float) -> None:
        self._endpoint, self._timeout = endpoint, timeout
        self._session = session.join(endpoint, tls, timeout)
        try:
            self.instance = self._find()
        except BaseException:
            self._session.close()
            raise
        self.role = self._role() if endpoint.startswith("tls/") else None
        self.keys = Keys(self.instance, self.role)
        self._there: set[str] = set()  # setpoints that the instance is known to have

    def _find(self) -> str:
        until = time.monotonic() + self._timeout
        while True:
            for answer in self._session.liveliness().get("srl/*/alive", timeout=self._timeout):
                if answer.ok is not None:
                    return str(answer.ok.key_expr).split("/")[1]
            if time.monotonic() > until:
                raise RequestError(
                    f"bus ({self._endpoint})", "no srl instance is alive there", "Is the service running?"
                )
            time.sleep(0.02)

    def _role(self) -> str | None:
        """The role of this client's certificate: only the keys of that role answer it."""
        for role in reversed(ROLES):
            if self._get(Keys(self.instance, role).whoami):
                return role
        return None

    def close(self) -> None:
        """Ends the session."""
        self._session.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def alive(self) -> bool:
        """Whether the instance's bus is running now."""
        return any(a.ok is not None for a in self._session.liveliness().get(self.keys.alive, timeout=self._timeout))

    # Reading

    def status(self, timeout: float | None = None) -> dict[str, Any]:
        """Waits for the next status and returns it as from `srl.runtime.bus.status.parse`. Raises RequestError."""
        for sample in self._samples(self.keys.status, timeout or self._timeout):
            return parse(cdr.decode(messages.DIAGNOSTICS, sample.payload.to_bytes()))
        raise RequestError(self.keys.status, "no status came", "Is the service running?")

    def states(self, pattern: str = "**", timeout: float | None = None) -> Iterator[Update]:
        """Yields samples of the signals whose name ("glove/position") matches a pattern, as they arrive.

        Args:
            pattern: a key expression below `state/`.
            timeout: s without a sample after which it ends; None: never.
        """
        for sample in self._samples(f"{self.keys.root}/state/{pattern}", timeout):
            yield self._update(sample)

    def subscribe(self, callback: Callable[[Update], None], pattern: str = "**") -> Any:
        """Calls `callback` for each sample, on a zenoh thread. `undeclare()` of the returned object ends it."""
        return self._session.declare_subscriber(
            f"{self.keys.root}/state/{pattern}", lambda s: callback(self._update(s))
        )

    def subscribe_status(self, callback: Callable[[dict[str, Any]], None]) -> Any:
        """Calls `callback` for each status, as `subscribe` does for samples."""
        return self._session.declare_subscriber(
            self.keys.status,
            lambda s: callback(parse(cdr.decode(messages.DIAGNOSTICS, s.payload.to_bytes()))),
        )

    def _samples(self, key: str, timeout: float | None) -> Iterator[zenoh.Sample]:
        arrived: queue.SimpleQueue[zenoh.Sample] = queue.SimpleQueue()

        def arrive(sample: zenoh.Sample) -> None:
            arrived.put(sample)
            if arrived.qsize() > KEPT:
                arrived.get_nowait()

        subscriber = self._session.declare_subscriber(key, arrive)
        try:
            while True:
                try:
                    yield arrived.get(timeout=timeout)
                except queue.Empty:
                    return
        finally:
            subscriber.undeclare()

    def _update(self, sample: zenoh.Sample) -> Update:
        name = str(sample.key_expr).removeprefix(f"{self.keys.root}/state/")
        kind = str(sample.encoding).partition(";")[2]
        message = cdr.decode(kind, sample.payload.to_bytes())
        stamp = message["header"]["stamp"] if "header" in message else None
        seconds = None if stamp is None else stamp["sec"] + stamp["nanosec"] * 1e-9
        return Update(name, messages.values_of(kind, message), seconds, tuple(message.get("name", ())), kind)

    def meta(self, pattern: str = "**") -> dict[str, dict[str, Any]]:
        """The description of each signal (unit, frame, labels, shape, type), by its name below `state/`."""
        answers = self._get(f"{self.keys.root}/state/{pattern}/meta")
        return {key.removeprefix(f"{self.keys.root}/state/").removesuffix("/meta"): value for key, value in answers}

    def events(self) -> list[dict[str, Any]]:
        """The newest events of the loop, oldest first: time (Unix, ns), level, cycle, text."""
        events: list[dict[str, Any]] = next((value for _, value in self._get(self.keys.events)), [])
        return events

    def parameters(self) -> dict[str, dict[str, Any]]:
        """Every live parameter (value, lower, upper, unit, text, default), by its name."""
        return {value["name"]: value for _, value in self._get(self.keys.parameters)}

    # Requests

    def command(self, name: str) -> dict[str, Any]:
        """Sends a command: "start", "stop" or "reset". Returns {"ok": True, "state": ...}.

        Raises:
            RequestError: the command was refused, or there was no answer.
        """
        if name not in COMMANDS:
            raise RequestError(f"command '{name}'", "there is no such command", nearest(name, COMMANDS))
        return self._ask(self.keys.command(name))

    def get_param(self, name: str) -> dict[str, Any]:
        """The parameter's value, lower, upper, unit, text and default. Raises RequestError."""
        return self._ask(self.keys.parameter(name))

    def set_param(self, name: str, value: float) -> dict[str, Any]:
        """Sets a parameter and returns once the loop has taken it.

        Args:
            name: as in `parameters`, e.g. "object-mapping.drift_pull".
            value: one number within the parameter's bounds, in its unit.
        Raises:
            RequestError: it is refused, or `value` isn't one number.
        """
        key = self.keys.parameter(name)
        if np.ndim(value) or np.asarray(value).dtype.kind not in "iuf":
            raise RequestError(key, f"a parameter takes one number, not {value!r:.60}", "Set each parameter by itself")
        return self._ask(key, json.dumps(float(value)).encode(), messages.JSON)

    def setpoint(self, name: str, values: Any, answer: bool = False) -> None:
        """Sends a setpoint to the loop. It is valid for the setpoint's `max_age`.

        The first call with a name asks the instance whether it has such a setpoint, and waits for the answer.

        Args:
            name: the setpoint's name, e.g. "client.force".
            values: a number or an array, in the signal's shape and SI units.
            answer: True to wait until the loop has the setpoint. If False, a refusal of the values appears only in
                the status.
        Raises:
            RequestError: there is no such setpoint, or `values` are no numbers; with `answer`, it is refused.
        """
        try:
            array = np.asarray(values, np.float64)
        except (TypeError, ValueError):
            problem = f"a setpoint takes numbers, not {values!r:.60}"
            raise RequestError(self.keys.setpoint(name), problem, "Send a number or an array of them") from None
        if name not in self._there:
            self._ask(self.keys.setpoint(name))
            self._there.add(name)
        payload = cdr.encode(messages.MULTI_ARRAY, messages.multi_array(array))
        encoding = messages.encoding(messages.MULTI_ARRAY)
        if answer:
            self._ask(self.keys.setpoint(name), payload, encoding)
        else:
            # DROP: with BLOCK, a put waits for a bus that has died.
            congestion = zenoh.CongestionControl.DROP
            key = self.keys.setpoint(name)
            self._session.put(key, payload, encoding=encoding, congestion_control=congestion, express=True)

    def _ask(self, key: str, payload: bytes | None = None, encoding: str | None = None) -> dict[str, Any]:
        for _, answer in self._get(key, payload, encoding):
            if answer["ok"]:
                return answer
            place, _, rest = answer["error"].partition(": ")
            problem, _, remedy = rest.partition(". ")
            raise RequestError(place, problem, remedy.rstrip("."))
        raise RequestError(key, "nobody answered", "Is the service running?")

    def _get(self, key: str, payload: bytes | None = None, encoding: str | None = None) -> list[tuple[str, Any]]:
        answers = self._session.get(
            key,
            payload=payload,
            encoding=encoding,
            timeout=self._timeout,
            congestion_control=zenoh.CongestionControl.DROP,
        )
        return [(str(a.ok.key_expr), json.loads(a.ok.payload.to_bytes())) for a in answers if a.ok is not None]
