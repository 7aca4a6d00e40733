"""What peers of ROS 2 may ask for: parameters, and where the profile lets them start, stop, reset and setpoints.

It goes through the bus's own socket, by three clients: a stop waits for no request, and a setpoint for none of both.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Any, Final

import numpy as np
import zenoh
from numpy.typing import NDArray

from srl.runtime.bus.client import Client, connect
from srl.runtime.bus.status import Counts
from srl.runtime.contracts.errors import RequestError, SrlError
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.messages import cdr, messages
from srl.runtime.profile.bus import Ros2Config
from srl.runtime.profile.keys import COMMANDS
from srl.runtime.ros2.follower import Follower
from srl.runtime.ros2.goals import Goals
from srl.runtime.ros2.inbox import Inbox, Item
from srl.runtime.ros2.names import TRAJECTORY, TRIGGER, topic
from srl.runtime.ros2.node import Call, Node
from srl.runtime.ros2.parameters import Parameters

Payload = Callable[[zenoh.Sample], bytes | None]
RESPONSE: Final = "std_srvs/srv/Trigger_Response"
TOLD: Final = 1_000_000_000  # ns between two lines about what was refused
LONGEST_LINE: Final = 300  # characters, as the text may be a peer's
# The last part of a setpoint's topics, by type.
TOPICS: Final = {
    messages.MULTI_ARRAY: "commands", messages.JOINT_STATE: "joint_commands", messages.POSE: "pose_commands",
    messages.TWIST: "twist_commands", messages.WRENCH: "wrench_commands",
}  # fmt: skip


class _Bus:
    """A client of the bus, which is joined when it is first needed, and again after a loss."""

    def __init__(self, folder: RunFolder) -> None:
        self._folder, self._lock = folder, threading.Lock()
        self._client: Client | None = None

    def ask(self, request: Callable[[Client], Any]) -> Any:
        """Raises RequestError: it refuses, or isn't there."""
        with self._lock:
            if self._client is None:
                self._client = connect(self._folder)
            try:
                return request(self._client)
            except zenoh.ZError as error:
                self._client.close()
                self._client = None
                raise RequestError("bus", f"it is away: {error}", "Ask again") from None

    def close(self) -> None:
        with self._lock:
            if self._client is not None:
                self._client.close()
                self._client = None


class Commands:
    """The services and subscriptions of a node."""

    def __init__(self, node: Node, folder: RunFolder, layout: Layout, counts: Counts, config: Ros2Config) -> None:
        """`counts`: of the diagnostics, in which refused setpoints are counted."""
        self._layout, self._counts, self._partial = layout, counts, config.allow_partial_joints_goal
        # A client each, for what waits for the other in none of the inbox's lanes.
        self._stop, self._requests, self._setpoints, self._parameters = (_Bus(folder) for _ in range(4))
        self._inbox = Inbox()
        self._told = 0
        self._row: NDArray[np.int64] | None = None
        self._followers: dict[str, Follower] = {}  # by setpoint
        if config.commands:
            for name in COMMANDS:
                hand_over = self._inbox.stops if name == "stop" else self._inbox.requests
                node.service(name, TRIGGER, hand_over(partial(self._trigger, name)))
            for entry in layout.meta.get("setpoints", []):
                self._subscribe(node, entry["name"], entry["max_age"])
        # Parameters may be read where nothing may be commanded.
        Parameters(node, self._inbox, layout, lambda: self._row, self._change if config.commands else None)

    def _subscribe(self, node: Node, name: str, max_age: float) -> None:
        newest = self._inbox.newest
        own = messages.kind_of(self._layout.fields[name])
        for kind in dict.fromkeys((messages.MULTI_ARRAY, messages.JOINT_STATE, own)):
            where = f"{topic(name)}/{TOPICS[kind]}"
            payload = partial(node.payload, topic=where, kind=kind)
            node.subscribe(where, kind, newest(partial(self._setpoint, name, kind, max_age, payload)))
        follower = Follower(self._layout, name, partial(self._send, name), self._refuse, self._partial)
        if follower.able:
            self._followers[name] = follower
            where = f"{topic(name)}/joint_trajectory"
            payload = partial(node.payload, topic=where, kind=TRAJECTORY)
            node.subscribe(where, TRAJECTORY, newest(partial(self._trajectory, follower, payload)))
            Goals(node, self._inbox, follower, topic(name), self._refuse)

    def turn(self, rows: NDArray[np.int64], row: NDArray[np.int64] | None, lost: int, now: int) -> None:
        """Goes on with the trajectories.

        Args:
            rows: (k, width), new since the last turn.
            row: the newest.
            lost: rows that were overwritten before they were read, so far.
            now: CLOCK_MONOTONIC ns.
        """
        self._row = row
        for follower in self._followers.values():
            follower.turn(rows, row, lost, now)

    # In the inbox's threads.

    def _trigger(self, name: str, item: Item) -> None:
        call: Call = item.what
        try:
            if name != "stop" and self._inbox.overtaken(item):
                raise RequestError(name, "a stop came after it", "Ask again")
            # The bus judges by when it came here: a stop that comes now goes another way, and may be there first.
            ask = (self._stop if name == "stop" else self._requests).ask
            ask(lambda client: client.command(name, None if name == "stop" else item.came))
        except SrlError as error:
            call.answer(cdr.encode(RESPONSE, {"success": False, "message": str(error)}))
        else:
            call.answer(cdr.encode(RESPONSE, {"success": True, "message": ""}))

    def _setpoint(self, name: str, kind: str, max_age: float, payload: Payload, item: Item) -> None:
        if self._inbox.overtaken(item) or time.monotonic_ns() - item.came > max_age * 1e9:
            return  # its time is over
        if (content := payload(item.what)) is None:
            return
        try:
            field, place, follower = self._layout.fields[name], f"topic of '{name}'", self._followers.get(name)
            rest = follower.where() if follower is not None and self._partial else None
            values = messages.read_values(content, messages.encoding(kind), field, place, rest)
            if follower is not None:
                follower.cancel("another command came")
            self._send(name, values)
        except SrlError as error:
            self._refuse(str(error))

    def _trajectory(self, follower: Follower, payload: Payload, item: Item) -> None:
        if not self._inbox.overtaken(item) and (content := payload(item.what)) is not None:
            follower.take(content, item.came)
            if self._inbox.overtaken(item):
                follower.cancel("a stop came")

    def _change(self, name: str, value: float) -> None:
        self._parameters.ask(lambda client: client.set_param(name, value))

    def _send(self, name: str, values: Array) -> None:
        self._setpoints.ask(lambda client: client.setpoint(name, values))

    def _refuse(self, text: str) -> None:
        """Counts what was refused, and says so once a second."""
        self._counts.rejected += 1
        self._counts.last_rejection = text[:LONGEST_LINE]
        now = time.monotonic_ns()
        if now >= self._told:
            self._told = now + TOLD
            print(f"ros2: {text[:LONGEST_LINE]}", file=sys.stderr, flush=True)

    def close(self) -> None:
        """Ends the threads and the sessions."""
        self._inbox.close()
        for bus in (self._stop, self._requests, self._setpoints, self._parameters):
            bus.close()
