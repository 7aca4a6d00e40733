"""The twin of a Vicon system: a simulated DataStream server, or Tracker's UDP object stream."""

from __future__ import annotations

from typing import Final
from urllib.parse import urlsplit

import numpy as np
from numpy.typing import NDArray

from srl.drivers.capture.selection import root_of
from srl.drivers.vicon import objects
from srl.drivers.vicon.objects import TrackedObject
from srl.runtime.contracts.rotation import euler_angles
from srl.sim.devices.shared.sockets import Client, TcpDoor, UdpDoor, free_port
from srl.sim.devices.shared.stream_twin import StreamTwin
from srl.sim.devices.vicon.fake import FakeVicon
from srl.sim.devices.vicon.twin_frame import FrameMaker
from srl.sim.devices.vicon.twin_session import Session

_MOST: Final = 13  # most objects in the largest datagram


class ViconTwin(StreamTwin):
    """Sends the fake's samples when they would reach a client of the fake.

    If the device's `port` is `udp://...`, the object stream is sent to that port of this host (port 0: to a free one).
    Otherwise the twin is a DataStream server for up to four clients.

    Attributes:
        maker: makes packets; `maker.offset` is the frame number of the first sample.
    """

    def __init__(self, fake: FakeVicon) -> None:
        super().__init__(fake, fake.kept)
        self.vicon = fake
        self.maker = FrameMaker(fake)
        self._tcp, self._udp = TcpDoor(), UdpDoor()
        self._to_objects = fake.vicon.objects_only
        self._port = (urlsplit(fake.vicon.port).port or 0) if self._to_objects else 0
        self._sessions: dict[Client, Session] = {}

    def doors(self) -> list[TcpDoor | UdpDoor]:
        return [self._udp if self._to_objects else self._tcp]

    def describe(self) -> str:
        if not self._to_objects:
            return self._tcp.address
        self._port = self._port or free_port()
        return f"udp://127.0.0.1:{self._port}"

    def opened(self) -> None:
        super().opened()
        self._sessions = {}

    def disable(self, subject: str) -> None:
        """Switches a subject off, as the operator does: it is removed from the stream's lists."""
        self.maker.disabled.add(subject)
        self._announce()

    def enable(self, subject: str) -> None:
        """Switches a subject on again, as the operator does."""
        self.maker.disabled.discard(subject)
        self._announce()

    def work(self, now: int) -> None:
        if self._to_objects:
            self._send_objects(now)
            return
        for client in self._tcp.accept():
            self._sessions[client] = Session(client, self.maker)
        for client, session in list(self._sessions.items()):
            session.service()
            for number in session.sent:
                self.sent(number, self._frame(number), now)
            session.sent.clear()
            if client.gone:
                client.close()
                del self._sessions[client]

    def _announce(self) -> None:
        for session in self._sessions.values():
            session.forget()

    def _send_objects(self, now: int) -> None:
        self._udp.read()
        for number, values in self.due.take():
            frame = self._frame(number)
            self._udp.write(objects.encode(frame, self._objects(number, values)), ("127.0.0.1", self._port))
            self.sent(number, frame, now)

    def _objects(self, number: int, values: NDArray[np.float64]) -> list[TrackedObject]:
        """The visible root segments as Tracker's objects; the others are left out."""
        scene = self.vicon.scene
        t, R, _ = self.maker.poses(values)
        visible, _ = self.vicon.visible(number)
        found = []
        for subject in self.maker.subjects()[:_MOST]:
            root = root_of(subject)
            row = scene.segments.index((subject.id, root.id)) if root is not None else -1
            if row >= 0 and visible[row]:
                found.append(TrackedObject(subject.name, (*t[row].tolist(), *euler_angles(R[row][None], "XYZ")[0])))
        return found

    def _frame(self, number: int) -> int:
        return (number + self.maker.offset) % (1 << 32)
