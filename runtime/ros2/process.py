"""The process that makes a run a node of ROS 2: it follows the ring as the bus does, and may be killed at any time.

What peers ask goes through the bus's own socket, so the limb answers them as it answers every client.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import zenoh
from numpy.typing import NDArray

from srl.runtime.bus.client import Client, connect
from srl.runtime.bus.status import Reporter
from srl.runtime.contracts.errors import RequestError, SrlError
from srl.runtime.contracts.field import Field
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.child import Ending
from srl.runtime.ipc.header import CYCLE, DEVICE
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.ring import RingReader
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.messages import cdr, messages
from srl.runtime.profile.bus import BusConfig
from srl.runtime.profile.keys import COMMANDS, slug
from srl.runtime.recording.robots import robots
from srl.runtime.ros2.follower import Follower
from srl.runtime.ros2.joints import Joints, moved_by_devices
from srl.runtime.ros2.names import TF, TRAJECTORY, TRIGGER, Qos, token
from srl.runtime.ros2.node import Node, Publisher
from srl.runtime.ros2.tree import Tree
from srl.runtime.ros2.urdf import description

PUBLISHED = ("state", "command", "applied", "sent", "internal")  # roles; a simulation's truth stays on the bus
DIAGNOSED = 1_000_000_000  # ns between two diagnostics
LISTENERS = 50_000_000  # ns: a new subscriber hears its signal no later than this
SILENT = 500_000_000  # ns without a sign of life after which the loop counts as dead
LOOK = 0.002  # s between two looks at the ring


class Ros2:
    """The node of one run."""

    def __init__(self, run_folder: RunFolder) -> None:
        """Raises SrlError."""
        self._folder = run_folder
        layout = self._layout = Layout.load(run_folder.layout)
        layout.needs(str(run_folder.layout), "bus", "wall", "rate", "limits")
        config = BusConfig.model_validate(layout.meta["bus"] or {})
        assert config.ros2 is not None
        self._ring = RingReader(run_folder.rows, width=layout.width)
        self._ring.sequence = self._ring.head
        self._wall = int(layout.meta["wall"])
        self._period = round(1e9 / config.ros2.rate)
        self._followers: dict[str, Follower] = {}  # by setpoint
        self._refused = ""  # why a setpoint was refused last
        self._reporter = Reporter(run_folder.path.name, layout)
        found = moved_by_devices(robots(layout), layout)
        self._joints, self._tree = Joints(layout, found), Tree(layout, found)
        self._clients: dict[bool, Client] = {}  # a stop has a client of its own: it waits for no other request
        self._asking = {True: threading.Lock(), False: threading.Lock()}
        node = self._node = Node(config.ros2, config.tls, slug(run_folder.path.name))
        try:
            self._declare(node, config.ros2.commands)
        except BaseException:
            node.close()
            raise

    def _declare(self, node: Node, commands: bool) -> None:
        layout = self._layout
        self._joint_states = node.publisher("joint_states", messages.JOINT_STATE)
        self._tf = node.publisher("/tf", TF, Qos(depth=100))
        self._diagnostics = node.publisher("/diagnostics", messages.DIAGNOSTICS)
        fields = [f for f in layout.fields.values() if f.role in PUBLISHED and f.size]
        self._signals: list[tuple[Field, messages.Encoder, Publisher, int]] = []
        for field in fields:
            encoder = messages.Encoder(field)
            topic = "/".join(token(part) for part in field.name.split("."))
            self._signals.append((field, encoder, node.publisher(topic, encoder.kind), self._stamped_by(field)))
        self._heard: list[tuple[Field, messages.Encoder, Publisher, int]] = []
        # Latched: who comes late gets them, too.
        static = node.publisher("/tf_static", TF, Qos(depth=1, latched=True))
        static.put(cdr.encode(TF, self._tree.static(time.time_ns())))
        limits = {
            name: {**found, "labels": layout.fields[name].labels} for name, found in layout.meta["limits"].items()
        }
        text = description(slug(self._folder.path.name), self._tree, self._joints, limits)
        described = node.publisher("robot_description", messages.STRING, Qos(depth=1, latched=True))
        described.put(cdr.encode(messages.STRING, {"data": text}))
        if not commands:
            return
        for name in COMMANDS:
            node.service(name, TRIGGER, partial(self._trigger, name))
        for entry in layout.meta.get("setpoints", []):
            topic = "/".join(token(part) for part in entry["name"].split("."))
            for kind, last in ((messages.MULTI_ARRAY, "commands"), (messages.JOINT_STATE, "joint_commands")):
                node.subscribe(f"{topic}/{last}", kind, partial(self._setpoint, entry["name"], kind))
            follower = Follower(layout, entry["name"], partial(self._send, entry["name"]), self._refuse)
            if follower.able:
                self._followers[entry["name"]] = follower
                take = partial(self._trajectory, follower)
                node.subscribe(f"{topic}/joint_trajectory", TRAJECTORY, take)

    def _stamped_by(self, field: Field) -> int:
        device = field.name.partition(".")[0]
        if field.role != "state" or device not in self._layout.devices:
            return CYCLE.now
        return self._layout.device(self._layout.devices.index(device)).start + DEVICE.stamp

    # -- what peers ask, in zenoh's threads

    def _ask(self, request: Callable[[Client], Any], stops: bool = False) -> Any:
        """Asks the bus. Raises RequestError: it refuses, or isn't there."""
        with self._asking[stops]:
            if stops not in self._clients:
                self._clients[stops] = connect(self._folder)
            try:
                return request(self._clients[stops])
            except zenoh.ZError as error:
                self._clients.pop(stops).close()
                raise RequestError("bus", f"it is away: {error}", "Ask again") from None

    def _trigger(self, name: str, payload: bytes) -> bytes:
        try:
            self._ask(lambda client: client.command(name), stops=name == "stop")
        except SrlError as error:
            return cdr.encode("std_srvs/srv/Trigger_Response", {"success": False, "message": str(error)})
        return cdr.encode("std_srvs/srv/Trigger_Response", {"success": True, "message": ""})

    def _setpoint(self, name: str, kind: str, sample: zenoh.Sample) -> None:
        """Passes a setpoint on; one that doesn't fit is refused there, and counted."""
        try:
            field = self._layout.fields[name]
            values = messages.read_values(
                sample.payload.to_bytes(), messages.encoding(kind), field, f"topic of '{name}'"
            )
            if name in self._followers:
                self._followers[name].cancel("another command came")
            self._send(name, values)
        except SrlError as error:
            self._refuse(str(error))

    def _send(self, name: str, values: Array) -> None:
        self._ask(lambda client: client.setpoint(name, values))

    def _trajectory(self, follower: Follower, sample: zenoh.Sample) -> None:
        row = self._ring.newest()
        if row is not None:
            follower.take(sample.payload.to_bytes(), row, time.time_ns(), time.monotonic_ns())

    def _refuse(self, text: str) -> None:
        if text != self._refused:  # once, and not at a peer's rate
            self._refused = text
            print(f"ros2: {text}", file=sys.stderr, flush=True)

    # -- what they see

    def run(self, ending: Ending | None = None) -> None:
        """Runs until the ring is closed or this process is to end."""
        due = listeners = diagnosed = 0
        row = self._ring.newest()
        try:
            while ending is None or not ending.asked:
                rows = self._ring.take()
                if len(rows):
                    row = rows[-1]
                    self._reporter.timing.add(rows)
                elif self._ring.closed:
                    break
                now = time.monotonic_ns()
                if now >= listeners:
                    listeners = now + LISTENERS
                    self._heard = [signal for signal in self._signals if signal[2].heard]
                if row is not None and len(rows) and now >= due:
                    due = max(due + self._period, now - self._period)
                    self._publish(row)
                for follower in self._followers.values():
                    follower.turn(row, now)
                if now >= diagnosed:
                    diagnosed = now + DIAGNOSED
                    silent = not self._ring.closed and now - self._ring.beat > SILENT
                    message = self._reporter.message(row, time.time_ns(), silent)
                    self._diagnostics.put(cdr.encode(messages.DIAGNOSTICS, message))
                time.sleep(LOOK)
        finally:
            self.close()

    def _publish(self, row: NDArray[np.int64]) -> None:
        if (found := self._joints.message(row, self._wall)) is not None:
            stamp, message = found
            self._joint_states.put(cdr.encode(messages.JOINT_STATE, message), stamp)
        moving = self._tree.moving(row, self._wall)
        if moving["transforms"]:
            self._tf.put(cdr.encode(TF, moving))
        floats = row[self._layout.ints :].view(np.float64)
        for field, encoder, publisher, column in self._heard:
            taken = int(row[column])
            if taken >= 0:
                values = floats[field.offset : field.offset + field.size]
                publisher.put(encoder.encode(values, taken + self._wall), taken + self._wall)

    def close(self) -> None:
        """Ends the sessions."""
        self._node.close()
        for stops, lock in self._asking.items():
            with lock:
                if stops in self._clients:
                    self._clients.pop(stops).close()
        self._ring.close()


def main(arguments: list[str], ending: Ending) -> int:
    """Entry point of `python -m srl.runtime.ros2 RUN_FOLDER`. Returns the exit code."""
    if ending.orphan:
        print("ros2: the supervisor that started it has ended, so it doesn't begin", file=sys.stderr)
        return 1
    try:
        Ros2(RunFolder(Path(arguments[0]))).run(ending)
    except (SrlError, OSError) as error:
        print(f"ros2: {error}", file=sys.stderr)
        return 2
    return 0
