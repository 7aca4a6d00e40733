"""The twin of an Xsens suit's MVN: it streams datagrams (sheet xsens_mvn)."""

from __future__ import annotations

import socket
from typing import Any, Final
from urllib.parse import urlsplit

import numpy as np
from numpy.typing import NDArray

from srl.drivers.xsens_mvn import protocol
from srl.drivers.xsens_mvn.protocol import CENTRE, JOINT_ENDS, JOINTS, POSES, Pose
from srl.runtime.contracts.signals import Array
from srl.sim.devices.shared.sockets import SocketTwin, UdpDoor
from srl.sim.devices.xsens_mvn.fake import FakeMvn, posed

_KEPT: Final = 0.4  # s of samples sent together after MVN has been busy; older ones are dropped
_CHILD: Final = 0  # a joint is the child's point 0, and some point of the parent
_PARENT: Final = 1


class XsensMvnTwin(SocketTwin):
    """Sends each sample of the fake to the profile's port on this host (port 0: to a free one): types 02, 20 and 24.

    Attributes: `offset`, the sample counter of sample 0; `origin`: ns of the world's time at which its time code is 0;
    `silent`: characters whose suit is off.
    """

    def __init__(self, fake: FakeMvn) -> None:
        super().__init__(fake)
        self.mvn = fake
        self.offset, self.origin = 0, 0
        self.silent: set[int] = set()
        self._udp = UdpDoor()
        self._port = urlsplit(fake.mvn.port).port or 0
        others = [k for k in range(fake.stream.others + 1) if k != fake.mvn.character][: fake.stream.others]
        self._characters = sorted([fake.mvn.character, *others])
        self._standing: Array | None = None
        self._last = -1
        self._frames = 0
        self._log: list[tuple[int, int, int]] = []

    def doors(self) -> list[Any]:
        return [self._udp]

    def describe(self) -> str:
        self._port = self._port or _free_port()
        return f"udp://127.0.0.1:{self._port}"

    def opened(self) -> None:
        self._last = self.mvn.newest()

    def restart(self) -> None:
        """The recording begins anew: sample counter and time code begin at 0."""
        self.offset = -self.mvn.newest() - 1
        self.origin = self.mvn.world.time

    def work(self, now: int) -> None:
        self._udp.read()
        newest = self.mvn.newest()
        self._last = min(self._last, newest)  # the world was restored to an earlier state
        kept = int(_KEPT * self.mvn.stream.rate)
        for number in range(max(self._last, newest - kept, -1) + 1, newest + 1):
            values = self.mvn.sample(number)
            if values is not None:
                self._send(number, values, now)
        self._last = newest

    def metrics(self) -> dict[str, object]:
        """Adds to the socket twin's figures: number of samples sent."""
        return super().metrics() | {"frames": self._frames}

    def log(self) -> dict[str, NDArray[Any]]:
        """`sent_ns` (k,): when each sample was sent. `taken_ns` (k,): its world time. `frame` (k,): its number."""
        sent, taken, frame = np.array(self._log, np.int64).reshape(-1, 3).T
        return {"sent_ns": sent, "taken_ns": taken, "frame": frame}

    def _send(self, number: int, values: Array, now: int) -> None:
        if self._standing is None:
            self._standing = values
        for character in self._characters:
            if character not in self.silent:
                for data in self.datagrams(number, values, character):
                    self._udp.write(data, ("127.0.0.1", self._port))
        self._frames += 1
        if self.keep_log:
            self._log.append((now, self.mvn.taken_at(number), number))

    def datagrams(self, number: int, values: Array, character: int = 0) -> list[bytes]:
        """The datagrams of one person's sample."""
        options = self.mvn.stream
        poses, centre = self.mvn.split(values if character == self.mvn.mvn.character else self._still(values))
        sample = (number + self.offset) % (1 << 32)
        time = max(self.mvn.taken_at(number) - self.origin, 0) // 1_000_000
        head = {"character": character, "sized": not options.old}
        made = [self._pose(i, row) for i, row in enumerate(poses, 1)]
        spread = np.array_split(np.arange(len(made)), options.datagrams)
        sent = [
            protocol.encode(
                POSES, sample, time, protocol.encode_poses(made[i] for i in part), len(part), **head,  # type: ignore[arg-type]
                index=index, last=index == len(spread) - 1,
            )
            for index, part in enumerate(spread)
        ]  # fmt: skip
        items = [
            protocol.encode_joint(parent << 8 | _PARENT, child << 8 | _CHILD, degrees)
            for (parent, child), degrees in zip(JOINT_ENDS.values(), self.mvn.angles(poses).tolist(), strict=True)
        ]
        sent.append(protocol.encode(JOINTS, sample, time, b"".join(items), len(items), **head))  # type: ignore[arg-type]
        x, y, z = centre.tolist()
        place = (y, z, x) if options.y_up else (x, y, z)
        sent.append(protocol.encode(CENTRE, sample, time, protocol.encode_centre(place), 1, **head))  # type: ignore[arg-type]
        return sent

    def _still(self, values: Array) -> Array:
        return values if self._standing is None else self._standing

    def _pose(self, number: int, row: Array) -> Pose:
        (x, y, z), (w, qx, qy, qz) = posed(row)
        if self.mvn.stream.y_up:
            return Pose(number, (y, z, x), (w, qy, qz, qx))
        return Pose(number, (x, y, z), (w, qx, qy, qz))


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port
