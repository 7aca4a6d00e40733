"""The process that makes a run a node of ROS 2: it follows the ring as the bus does, and may be killed at any time.

What peers ask goes through the bus's own socket, so the limb answers them as it answers every client.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from srl.runtime.bus.process import LISTENERS, SILENT
from srl.runtime.bus.status import Reporter
from srl.runtime.contracts.errors import SrlError
from srl.runtime.contracts.field import Field
from srl.runtime.ipc.child import Ending
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.ring import RingReader
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.messages import cdr, messages
from srl.runtime.profile.bus import BusConfig
from srl.runtime.profile.keys import slug
from srl.runtime.recording.robots import robots
from srl.runtime.ros2.commands import Commands
from srl.runtime.ros2.joints import Joints, moved_by_devices
from srl.runtime.ros2.names import TF, Qos, topic
from srl.runtime.ros2.node import Node, Publisher, connect
from srl.runtime.ros2.tree import Tree
from srl.runtime.ros2.urdf import description

PUBLISHED = ("state", "command", "applied", "sent", "internal")  # roles; a simulation's truth stays on the bus
DIAGNOSED = 1_000_000_000  # ns between two diagnostics
LOOK = 0.002  # s between two looks at the ring
RETRY = 1_000_000_000  # ns between two attempts to reach the router


class _Topics:
    """What the node publishes."""

    def __init__(self, node: Node, name: str, layout: Layout, joints: Joints, tree: Tree) -> None:
        self._layout, self._joints, self._tree = layout, joints, tree
        self._wall = int(layout.meta["wall"])
        self._joint_states = node.publisher("joint_states", messages.JOINT_STATE)
        self._tf = node.publisher("/tf", TF, Qos(depth=100))
        self._diagnostics = node.publisher("/diagnostics", messages.DIAGNOSTICS)
        self._signals: list[tuple[Field, messages.Encoder, Publisher, int]] = []
        for field in layout.fields.values():
            if field.role in PUBLISHED and field.size:
                encoder = messages.Encoder(field)
                publisher = node.publisher(topic(field.name), encoder.kind)
                self._signals.append((field, encoder, publisher, layout.stamped_by(field)))
        self._heard = self._signals[:0]
        self._listeners = 0
        # Latched: who comes late gets them, too.
        static = node.publisher("/tf_static", TF, Qos(depth=1, transient_local=True))
        static.put(cdr.encode(TF, tree.static(time.time_ns())))
        described = node.publisher("robot_description", messages.STRING, Qos(depth=1, transient_local=True))
        described.put(cdr.encode(messages.STRING, {"data": description(name, layout, tree, joints)}))

    def publish(self, row: NDArray[np.int64], now: int) -> None:
        """Publishes a row (width,). now: CLOCK_MONOTONIC ns."""
        if now >= self._listeners:
            self._listeners = now + LISTENERS
            self._heard = [signal for signal in self._signals if signal[2].heard]
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

    def diagnose(self, message: cdr.Message) -> None:
        """Publishes the diagnostics."""
        self._diagnostics.put(cdr.encode(messages.DIAGNOSTICS, message))


class Ros2:
    """The node of one run."""

    def __init__(self, run_folder: RunFolder) -> None:
        """Raises SrlError."""
        self._folder, self._name = run_folder, slug(run_folder.path.name)
        layout = self._layout = Layout.load(run_folder.layout)
        layout.needs(str(run_folder.layout), "bus", "wall", "rate", "limits")
        config = BusConfig.model_validate(layout.meta["bus"] or {})
        assert config.ros2 is not None
        self._config, self._tls = config.ros2, config.tls if config.ros2.router.startswith("tls/") else None
        self._ring = RingReader(run_folder.rows, width=layout.width)
        self._ring.sequence = self._ring.head
        self._reporter = Reporter(run_folder.path.name, layout)
        found = moved_by_devices(robots(layout), layout)
        self._joints, self._tree = Joints(layout, found), Tree(layout, found)
        self._node: Node | None = None
        self._topics: _Topics | None = None
        self._commands: Commands | None = None
        self._retry, self._waits = 0, False

    def run(self, ending: Ending | None = None) -> None:
        """Runs until the ring is closed or this process is to end."""
        due = diagnosed = 0
        period = round(1e9 / self._config.rate)
        row = self._ring.newest()
        try:
            while ending is None or not ending.asked:
                rows = self._ring.take()
                if len(rows):
                    row = rows[-1]
                    self._reporter.timing.add(rows)
                elif self._ring.closed:
                    break
                self._reporter.counts.lost_rows = self._ring.lost
                now = time.monotonic_ns()
                if self._commands is not None:
                    self._commands.turn(rows, row, self._ring.lost, now)
                else:
                    self._take_commands()
                if self._topics is None:
                    self._join(now)
                elif row is not None and len(rows) and now >= due:
                    due = max(due + period, now - period)
                    self._topics.publish(row, now)
                if self._topics is not None and now >= diagnosed:
                    diagnosed = now + DIAGNOSED
                    silent = not self._ring.closed and now - self._ring.beat > SILENT
                    self._topics.diagnose(self._reporter.message(row, time.time_ns(), silent))
                time.sleep(LOOK)
        finally:
            self.close()

    def _join(self, now: int) -> None:
        """Declares everything, once there is a router."""
        if now < self._retry:
            return
        self._retry = now + RETRY
        session = connect(self._config, self._tls)
        if session is None:
            if not self._waits:
                self._waits = True
                print(f"ros2: no router at {self._config.router}; the node waits for one", file=sys.stderr, flush=True)
            return
        node = self._node = Node(session, self._config, self._name)
        self._topics = _Topics(node, self._name, self._layout, self._joints, self._tree)
        print(f"ros2: the node is at the router {self._config.router}", file=sys.stderr, flush=True)

    def _take_commands(self) -> None:
        """Announces what peers may ask for, once the bus is there to pass it on."""
        if self._node is not None and self._folder.bus_socket.exists():
            self._commands = Commands(self._node, self._folder, self._layout, self._reporter.counts, self._config)

    def close(self) -> None:
        """Ends the sessions."""
        if self._node is not None:
            self._node.close()
        if self._commands is not None:
            self._commands.close()
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
