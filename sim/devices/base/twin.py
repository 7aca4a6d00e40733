"""The twin of a mobile base behind a zenoh bridge, or with zenoh as its middleware: topics as ROS 2 CDR."""

from __future__ import annotations

import math
import os
import time
from typing import Any, Final

from srl.drivers.base import protocol
from srl.runtime.messages import attachment, cdr
from srl.sim.devices.base.fake import FakeBase
from srl.sim.devices.shared.sockets import SocketTwin
from srl.sim.devices.shared.stream_twin import Due
from srl.sim.devices.zenoh.twin import CATCH_UP, Arrival, ZenohDoor

LATE: Final = 500_000_000  # ns; a command whose stamp is older, or that far in the future, is refused
EMERGENCY_PERIOD: Final = 100_000_000  # ns between reports of the emergency stop
# Type hashes that rmw_zenoh puts into its keys (protocol sheet, section 4).
_HASHES = {
    protocol.TWIST: "9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a",
    protocol.TWIST_STAMPED: "5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64",
    protocol.ODOMETRY: "3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
    protocol.BOOL: "feb91e995ff9ebd09c0cb3d2aed18b11077585839fb5db80193b62d74528f6c9",
}
_QOS = "::,10:,:,:,,"


class BaseTwin(SocketTwin):
    """Publishes odometry and the emergency stop; a velocity command stays in force for half a second.

    These commands are refused and counted: a message of another type, a stamp that is too old or too far in the
    future, a velocity that isn't finite, and with rmw_zenoh a missing attachment. Velocities beyond the
    controller's limits are clipped.
    """

    def __init__(self, fake: FakeBase) -> None:
        super().__init__(fake)
        self._fake, self._config = fake, fake.config
        self._kind = protocol.TWIST if fake.config.message == "Twist" else protocol.TWIST_STAMPED
        self._command = self._key(fake.config.command, self._kind)
        self._odometry = self._key(fake.config.odometry, protocol.ODOMETRY)
        self._emergency = None if fake.config.emergency is None else self._key(fake.config.emergency, protocol.BOOL)
        self.door = ZenohDoor("router", [self._command], [], [self._token()])
        self.child_frame = fake.config.child_frame or "robot_base_footprint"
        self.refused = 0
        self.taken: list[tuple[int, tuple[float, float, float]]] = []  # (world time in ns, velocity), with keep_log
        self.commands = 0
        self._ahead = round(fake.clock * 1e9)
        self._wall = 0
        self._due = Due(fake, CATCH_UP)
        self._reported = -EMERGENCY_PERIOD
        self._count = 0
        self._sender = os.urandom(16)

    def doors(self) -> list[Any]:
        return [self.door]

    def opened(self) -> None:
        self._wall = time.time_ns() - time.monotonic_ns() + self._ahead
        self._due.begin()

    def service(self, now: int) -> None:
        """The base's own time-out also works without its network."""
        super().service(now)
        self._fake.watch()

    def work(self, now: int) -> None:
        for arrival in self.door.read():
            self._obey(arrival, now)
        for number, values in self._due.take():
            stamp = now - (self._fake.world.time - self._fake.taken_at(number)) + self._wall
            x, y, yaw, vx, vy, wz = values.tolist()
            message = protocol.Odometry(
                stamp, "robot_odom", self.child_frame, (x, y, math.remainder(yaw, math.tau)), (vx, vy, wz)
            )
            self._send(self._odometry, protocol.odometry(message), stamp)
        if self._emergency is not None and now - self._reported >= EMERGENCY_PERIOD:
            self._reported = now
            self._send(self._emergency, cdr.encode(protocol.BOOL, {"data": self._fake.pressed()}), now + self._wall)

    def metrics(self) -> dict[str, object]:
        """Adds the numbers of commands obeyed and refused."""
        return super().metrics() | {"commands": self.commands, "refused": self.refused}

    def _obey(self, arrival: Arrival, now: int) -> None:
        try:
            vx, vy, wz, stamp = protocol.read_velocity(arrival.payload)
        except ValueError:
            self.refused += 1
            return
        late = stamp is not None and abs(now + self._wall - stamp) > LATE
        bare = self._config.middleware == "rmw_zenoh" and attachment.stamp_of(arrival.attachment) < 0
        wrong = (stamp is None) != (self._kind == protocol.TWIST)
        if late or bare or wrong or not math.isfinite(vx + vy + wz):
            self.refused += 1
            return
        self.commands += 1
        if self.keep_log:
            self.taken.append((self._fake.world.time, (vx, vy, wz)))
        self._fake.obey(vx, vy, wz)

    def _send(self, key: str, payload: bytes, stamp: int) -> None:
        extra = None
        if self._config.middleware == "rmw_zenoh":
            self._count += 1
            extra = attachment.encode(self._count, stamp, self._sender)
        self.door.write(key, payload, "", extra)

    def _key(self, topic: str, kind: str) -> str:
        full = self._config.topic(topic)
        if self._config.middleware == "bridge":
            return full
        return f"{self._config.domain}/{full}/{_mangled(kind)}/RIHS01_{_HASHES[kind]}"

    def _token(self) -> str:
        """The token with which the robot declares that it takes commands (protocol sheet, sections 2 and 4)."""
        topic = self._config.topic(self._config.command)
        if self._config.middleware == "bridge":
            return f"@/ZID/@ros2_lv/MS/{topic.replace('/', '§')}/{self._kind.replace('/', '§')}/{_QOS}"
        place = f"%{topic.replace('/', '%')}/{_mangled(self._kind)}/RIHS01_{_HASHES[self._kind]}"
        return f"@ros2_lv/{self._config.domain}/ZID/0/10/MS/%/%/base/{place}/{_QOS}"


def _mangled(kind: str) -> str:
    """ "geometry_msgs/msg/Twist" -> "geometry_msgs::msg::dds_::Twist_"."""
    package, _, name = kind.rpartition("/")
    return f"{package.replace('/', '::')}::dds_::{name}_"
