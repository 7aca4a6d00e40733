"""A small client of a running instance, for `srl top`, tests and users' scripts.

from srl.runtime.bus.client import connect
with connect("sixth-finger") as srl:
    print(srl.status()["state"])
    for update in srl.states("glove/**", timeout=1.0): ...
    srl.command("stop")

What nobody answers raises NoAnswerError, and so does what is sent while the instance's bus is away.
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

from srl.runtime.bus import arrivals, presence, session
from srl.runtime.bus.presence import Presence
from srl.runtime.bus.status import parse
from srl.runtime.contracts.errors import NoAnswerError, RequestError, nearest
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.tls import TlsConfig
from srl.runtime.ipc.run_folder import RunFolder, running
from srl.runtime.messages import cdr, messages
from srl.runtime.profile.keys import COMMANDS, ROLES, Keys, slug

_ENDPOINT = re.compile(r"^(tcp|tls|unixsock-stream)/")
KEPT = 1024  # samples kept for a slow reader; the oldest are dropped first
AWAY = 5.0  # s without its bus after which a reader gives an instance up: a bus that died is started again sooner
LOOK = 0.25  # s between two looks at whether the bus is there, while no sample comes


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


def connect(
    target: str | Path | RunFolder, tls: TlsConfig | None = None, timeout: float = 2.0, instance: str | None = None
) -> Client:
    """Connects to one instance and returns a client.

    Args:
        target: the instance's name, its run folder, or a zenoh endpoint ("tls/host:7447").
        tls: certificates, for a tls endpoint.
        timeout: s to wait for the connection, and for each answer.
        instance: the instance's name, for an endpoint behind which several are.
    Raises:
        NoAnswerError: nobody answers there.
        RequestError: several instances do, and none is named.
    """
    if isinstance(target, str) and _ENDPOINT.match(target):
        return Client(target, tls, timeout, instance)
    if isinstance(target, str) and "/" not in target:
        found = {run_folder.path.name: run_folder for run_folder in running()}
        target = found.get(target, RunFolder.of(target))
    run_folder = target if isinstance(target, RunFolder) else RunFolder(Path(target))
    name = run_folder.path.resolve().name
    if not run_folder.bus_socket.exists():
        remedy = "Is it running? Set SRL_RUNTIME_DIR as for `srl run`, or give the run folder (docs/bus.md)"
        raise NoAnswerError(f"instance '{name}'", f"no bus listens at {run_folder.bus_socket}", remedy)
    return Client(f"unixsock-stream/{run_folder.bus_socket}", tls, timeout, name)


class Client:
    """A client of one instance, made by `connect`.

    Close it or use it in a `with` statement: an open session makes the process hang at its end.

    Attributes:
        instance: its name; as in the bus's keys (`sixth_finger`), where only an endpoint was given.
        role: what its certificate may do, one of ROLES; None for a client on the instance's machine.
    """

    def __init__(self, endpoint: str, tls: TlsConfig | None, timeout: float, instance: str | None = None) -> None:
        self._endpoint, self._timeout = endpoint, timeout
        self._session = session.join(endpoint, tls, timeout)
        try:
            self.instance = self._find(instance)
            self.keys = Keys(self.instance)
            self._presence = Presence(self._session, self.keys.alive)
            if not self._presence.wait(timeout):
                raise self._nobody(self.keys.alive, "nobody answered")
            self.role = self._role() if endpoint.startswith("tls/") else None
        except BaseException:
            self._session.close()
            raise
        self.keys = Keys(self.instance, self.role)
        self._there: set[str] = set()  # setpoints that the instance is known to have
        self._comings = self._presence.comings  # of the bus that has them

    def _find(self, instance: str | None) -> str:
        until = time.monotonic() + self._timeout
        while True:
            answers = self._session.liveliness().get("srl/*/alive", timeout=self._timeout)
            found = sorted({str(answer.ok.key_expr).split("/")[1] for answer in answers if answer.ok is not None})
            if instance is None and len(found) > 1:
                problem = f"several instances are alive there: {', '.join(found)}"
                raise RequestError(f"bus ({self._endpoint})", problem, f"Name one: connect(..., instance='{found[0]}')")
            if instance is None and found:
                return found[0]
            if instance is not None and slug(instance) in found:
                return instance
            if time.monotonic() > until:
                break
            time.sleep(0.02)
        which = "srl instance" if instance is None else f"instance '{instance}'"
        remedy = f"Is the service running? Alive there: {', '.join(found) or 'none that this client may see'}"
        if not found and self._endpoint.startswith("tls/"):
            remedy = (
                "The certificate is accepted: either the service has just ended, or the certificate's name has no role "
                "in its profile. Add it to `bus.roles` there, and start the service again"
            )
        raise NoAnswerError(f"bus ({self._endpoint})", f"no {which} is alive there", remedy)

    def _role(self) -> str:
        """The role of this client's certificate: only the keys of that role answer it."""
        for role in reversed(ROLES):
            if self._get(key := Keys(self.instance, role).whoami):
                return role
        raise self._nobody(key, "nobody answered")

    def close(self) -> None:
        """Ends the session."""
        self._session.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def alive(self) -> bool:
        """Asks whether the instance's bus answers now. False: not within the client's `timeout`, too.

        It doesn't ask for the token: as a connection ends, zenoh forgets its tokens a little later than its queries.
        """
        return any(a.ok is not None for a in self._session.get(self.keys.status, timeout=self._timeout))

    def subscribe_alive(self, callback: Callable[[bool], None]) -> Any:
        """Calls `callback` on a zenoh thread: True now and whenever the instance's bus comes, False when it goes.

        A bus that hangs, or whose network is cut, has gone after 10 s.
        """
        return presence.subscribe(self._session, self.keys.alive, callback)

    # Reading

    def status(self, timeout: float | None = None) -> dict[str, Any]:
        """Waits for the next status and returns it as from `srl.runtime.bus.status.parse`. Raises NoAnswerError."""
        for sample in self._samples(self.keys.status, timeout or self._timeout):
            return parse(cdr.decode(messages.DIAGNOSTICS, sample.payload.to_bytes()))
        raise self._nobody(self.keys.status, "no status came")

    def states(self, pattern: str = "**", timeout: float | None = None) -> Iterator[Update]:
        """Yields samples of the signals whose name ("glove/position") matches a pattern, as they arrive.

        Args:
            pattern: a key expression below `state/`.
            timeout: s without a sample after which it ends; None: never.
        Raises:
            NoAnswerError: the instance's bus is away when `timeout` is over, or for AWAY s.
            RequestError: the instance has no such signal.
        """
        self._check(pattern)
        for sample in self._samples(f"{self.keys.root}/state/{pattern}", timeout):
            yield self._update(sample)

    def subscribe(self, callback: Callable[[Update], None], pattern: str = "**") -> Any:
        """Calls `callback` for each sample, on a zenoh thread. `undeclare()` of the returned object ends it.

        That the instance has gone is no sample: `subscribe_alive` tells. Raises as `states`.
        """
        self._check(pattern)
        return self._session.declare_subscriber(
            f"{self.keys.root}/state/{pattern}", lambda s: callback(self._update(s))
        )

    def subscribe_status(self, callback: Callable[[dict[str, Any]], None]) -> Any:
        """Calls `callback` for each status, as `subscribe` does for samples."""
        return self._session.declare_subscriber(
            self.keys.status,
            lambda s: callback(parse(cdr.decode(messages.DIAGNOSTICS, s.payload.to_bytes()))),
        )

    def _check(self, pattern: str) -> None:
        if not self.meta(pattern):
            key = f"{self.keys.root}/state/{pattern}"
            raise RequestError(key, "no signal has such a name", nearest(pattern, self.meta()))

    def _samples(self, key: str, timeout: float | None) -> Iterator[zenoh.Sample]:
        arrived: queue.SimpleQueue[zenoh.Sample] = queue.SimpleQueue()

        def arrive(sample: zenoh.Sample) -> None:
            arrived.put(sample)
            if arrived.qsize() > KEPT:
                arrived.get_nowait()

        subscriber = self._session.declare_subscriber(key, arrive)
        try:
            last = time.monotonic()
            while True:
                left = LOOK if timeout is None else last + timeout - time.monotonic()
                try:
                    sample = arrived.get(timeout=min(max(left, 0.0), LOOK))
                except queue.Empty:
                    if self._presence.missing > (AWAY if left > LOOK or timeout is None else 0.0):
                        raise self._nobody(key, "nothing comes any more") from None
                    if left <= LOOK and timeout is not None:
                        return
                else:
                    yield sample
                    last = time.monotonic()
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
        """The description of each signal (unit, frame, labels, shape, type), by its name below `state/`.

        Raises NoAnswerError.
        """
        answers = self._get(f"{self.keys.root}/state/{pattern}/meta")
        return {key.removeprefix(f"{self.keys.root}/state/").removesuffix("/meta"): value for key, value in answers}

    def events(self) -> list[dict[str, Any]]:
        """The newest events of the loop, oldest first: time (Unix, ns), level, cycle, text. Raises NoAnswerError."""
        for _, events in self._get(self.keys.events):
            found: list[dict[str, Any]] = events
            return found
        raise self._nobody(self.keys.events, "nobody answered")

    def parameters(self) -> dict[str, dict[str, Any]]:
        """Every live parameter (value, lower, upper, unit, text, default), by its name. Raises NoAnswerError."""
        return {value["name"]: value for _, value in self._get(self.keys.parameters)}

    # Requests

    def command(self, name: str, came: int | None = None) -> dict[str, Any]:
        """Sends a command: "start", "stop" or "reset". Returns {"ok": True, "state": ...}.

        Args:
            name: the command's.
            came: CLOCK_MONOTONIC ns, when it came to who passes it on: it is refused if a stop has come since.

        Raises:
            NoAnswerError: nobody answered. It says whether the command may have been carried out.
            RequestError: the command was refused.
        """
        if name not in COMMANDS:
            raise RequestError(f"command '{name}'", "there is no such command", nearest(name, COMMANDS))
        return self._ask(self.keys.command(name), attachment=None if came is None else arrivals.came(came))

    def get_param(self, name: str) -> dict[str, Any]:
        """The parameter's value, lower, upper, unit, text and default. Raises RequestError."""
        return self._ask(self.keys.parameter(name))

    def set_param(self, name: str, value: float, sender: str = "") -> dict[str, Any]:
        """Sets a parameter and returns once the loop has taken it.

        Args:
            name: as in `parameters`, e.g. "object-mapping.drift_pull".
            value: one number within the parameter's bounds, in its unit.
            sender: who changes it, for the event that tells of it.
        Raises:
            NoAnswerError: nobody answered. It says whether the value may have been set.
            RequestError: it is refused, or `value` isn't one number.
        """
        key = self.keys.parameter(name)
        if np.ndim(value) or np.asarray(value).dtype.kind not in "iuf":
            raise RequestError(key, f"a parameter takes one number, not {value!r:.60}", "Set each parameter by itself")
        named = arrivals.from_sender(sender) if sender else None
        return self._ask(key, json.dumps(float(value)).encode(), messages.JSON, named)

    def setpoint(self, name: str, values: Any, answer: bool = False) -> None:
        """Sends a setpoint to the loop. It is valid for the setpoint's `max_age`.

        The first call with a name asks the instance whether it has such a setpoint, and waits for the answer.

        Args:
            name: the setpoint's name, e.g. "client.force".
            values: a number or an array, in the signal's shape and SI units.
            answer: True to wait until the loop has the setpoint. If False, a refusal of the values appears only in
                the status, and what is sent in the instant in which the bus goes is lost without an error.
        Raises:
            NoAnswerError: the bus is away, so nothing is sent; or nobody answered.
            RequestError: there is no such setpoint, or `values` are no numbers; with `answer`, it is refused.
        """
        try:
            array = np.asarray(values, np.float64)
        except (TypeError, ValueError):
            problem = f"a setpoint takes numbers, not {values!r:.60}"
            raise RequestError(self.keys.setpoint(name), problem, "Send a number or an array of them") from None
        if self._presence.missing:
            raise self._nobody(self.keys.setpoint(name), "nobody is there, so nothing is sent")
        if self._comings != (comings := self._presence.comings):  # perhaps another run, with other setpoints
            self._comings = comings
            self._there.clear()
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

    def _ask(
        self, key: str, payload: bytes | None = None, encoding: str | None = None, attachment: bytes | None = None
    ) -> dict[str, Any]:
        for _, answer in self._get(key, payload, encoding, attachment):
            if answer["ok"]:
                return answer
            place, _, rest = answer["error"].partition(": ")
            problem, _, remedy = rest.partition(". ")
            raise RequestError(place, problem, remedy.rstrip("."))
        raise self._nobody(key, "nobody answered: it has no such key, or not for this client")

    def _get(
        self, key: str, payload: bytes | None = None, encoding: str | None = None, attachment: bytes | None = None
    ) -> list[tuple[str, Any]]:
        """The answers, none where no key matches. Raises NoAnswerError: not all came."""
        there = self._presence.there
        answers = list(
            self._session.get(
                key,
                payload=payload,
                encoding=encoding,
                attachment=attachment,
                timeout=self._timeout,
                congestion_control=zenoh.CongestionControl.DROP,
            )
        )
        late = any(answer.ok is None for answer in answers)  # zenoh puts an error in the place of what is late
        if late or (not answers and not self.alive()):
            changes = payload is not None or key.startswith(self.keys.commands.removesuffix("**"))
            unknown = ". Whether it was carried out isn't known" if changes and (there or late) else ""
            raise self._nobody(key, f"nobody answered{f' within {self._timeout:g} s' if late else ''}{unknown}")
        return [(str(a.ok.key_expr), json.loads(a.ok.payload.to_bytes())) for a in answers if a.ok is not None]

    def _nobody(self, key: str, problem: str) -> NoAnswerError:
        remedy = f"Look at `srl top {self.instance}`; `srl stop {self.instance}`, on its machine, needs no bus"
        return NoAnswerError(f"instance '{self.instance}' ({key})", problem, remedy)
