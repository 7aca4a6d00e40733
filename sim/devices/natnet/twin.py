"""The twin of an OptiTrack system: a simulated Motive that streams NatNet (sheet optitrack_natnet)."""

from __future__ import annotations

import struct
from typing import Any, Final

from srl.drivers.capture.names import Point, Subject
from srl.drivers.natnet import protocol
from srl.drivers.natnet.frame import EDITED, MODEL_CHANGED, UNLABELLED, Body, Marker, MotiveFrame
from srl.drivers.natnet.model import BodyModel, Model
from srl.drivers.natnet.protocol import MalformedError, Message, ServerInfo, Version
from srl.runtime.contracts.rotation import Quaternion, conjugate, turned
from srl.runtime.contracts.signals import Array
from srl.sim.devices.natnet import twin_frame as encode
from srl.sim.devices.natnet.fake import FakeNatNet
from srl.sim.devices.shared.sockets import UdpDoor
from srl.sim.devices.shared.stream_twin import StreamTwin

FREQUENCY: Final = 10_000_000  # Hz, of the performance counter
GROUP: Final = "239.255.42.99"
FORGET: Final = 10_000_000_000  # ns after which a silent unicast client gets no more frames; ours
_BOOTED: Final = 3600 * FREQUENCY  # ticks at the world's beginning
_MEASURED: Final = 0x0A  # a marker's flags: solved from the cameras, of a model
_HIDDEN: Final = 0x09
_RESIDUAL: Final = 0.0002  # m
_SIZE: Final = 0.014  # m
_VERSIONS: Final = {Version(*map(int, text.split("."))) for text in ("3.0", "3.1", "4.0", "4.1", "4.2")}


class _Session:
    """A client: where its frames go, and in which version."""

    def __init__(self, version: Version, now: int) -> None:
        self.version, self.heard = version, now


class NatNetTwin(StreamTwin):
    """Sends the fake's samples when they would reach a client of the fake.

    The address is that of its command port. In unicast, frames go from the data port to each client that connected; in
    multicast to the group, on loopback. Attributes: `offset`, the frame number of sample 0; `playing`: it shows a take
    (edit mode); `disabled`: names of the assets that the operator has switched off.
    """

    def __init__(self, fake: FakeNatNet) -> None:
        super().__init__(fake, fake.kept)
        self.motive = fake
        self.offset = 1000
        self.playing = False
        self.version = fake.motive.version
        self._disabled: set[str] = set()
        self._changed = False
        self._command, self._data = UdpDoor(), UdpDoor()
        self._sessions: dict[tuple[str, int], _Session] = {}

    def doors(self) -> list[Any]:
        return [self._command, self._data]

    def opened(self) -> None:
        super().opened()
        self._sessions = {}

    @property
    def info(self) -> ServerInfo:
        """What it says of itself."""
        program = (3, 1, 0, 0) if self.version.major == 4 else (2, 1, 0, 0)
        return ServerInfo(
            "Motive", program, self.version, FREQUENCY, self._data.port, self.motive.motive.multicast, GROUP
        )

    def disable(self, subject: str) -> None:
        """Switches an asset off, as the operator does; the next frame says that the model list has changed."""
        self._disabled.add(subject)
        self._changed = True

    def enable(self, subject: str) -> None:
        """Switches an asset on again."""
        self._disabled.discard(subject)
        self._changed = True

    def restart(self, version: str | None = None) -> None:
        """Motive is started again: it counts anew and knows no client; perhaps it is another version."""
        self.offset = -self.motive.newest()
        self._sessions = {}
        if version is not None:
            major, minor = map(int, version.split("."))
            self.version = Version(major, minor)

    def work(self, now: int) -> None:
        for data, peer in self._command.read():
            self._obey(data, peer, now)
        self._data.read()
        for number, values in self.due.take():
            self._send(number, values, now)

    def metrics(self) -> dict[str, object]:
        """Adds to the stream's figures: clients that get the frames."""
        return super().metrics() | {"clients": len(self._sessions)}

    # -- commands

    def _obey(self, data: bytes, peer: tuple[str, int], now: int) -> None:
        try:
            message, payload = protocol.split(data)
        except MalformedError:
            return
        session = self._sessions.get(peer)
        if session is not None:
            session.heard = now
        if message in (Message.CONNECT, Message.DISCOVERY):
            self._sessions[peer] = _Session(self._wanted(payload), now)
            info = self.info._replace(version=self._sessions[peer].version)
            self._command.write(protocol.encode_server_info(info), peer)
        elif message == Message.REQUEST_MODEL:
            made, places = self._model()
            self._command.write(encode.model(made, places, session.version if session else self.version), peer)
        elif message == Message.REQUEST:
            self._answer(payload.split(b"\0")[0].decode("ascii", "replace"), peer, session)
        elif message == Message.ECHO and len(payload) >= 8:
            answer = payload[:8] + struct.pack("<Q", self._ticks(self.motive.world.time))
            self._command.write(protocol.packet(Message.ECHOED, answer), peer)
        elif message == Message.DISCONNECT:
            self._sessions.pop(peer, None)

    def _wanted(self, payload: bytes) -> Version:
        """The version that a client asks for: in unicast, of Motive 3 and later."""
        if len(payload) >= 269 and self.version.major >= 4 and not self.motive.motive.multicast:
            version = Version(payload[265], payload[266])
            if version in _VERSIONS and version <= self.version:
                return version
        return self.version

    def _answer(self, text: str, peer: tuple[str, int], session: _Session | None) -> None:
        word, _, rest = text.partition(",")
        made: bytes | None = None
        if word == "FrameRate":
            made = struct.pack("<f", self.motive.seen_by.rate)
        elif word == "UnitsToMillimeters":
            made = struct.pack("<f", 1000.0)
        elif word == "CurrentMode":
            made = struct.pack("<i", 2 if self.playing else 0)
        elif word == "Bitstream":
            if rest and session is not None and (asked := rest.split("."))[0].isdigit() and asked[-1].isdigit():
                wanted = Version(int(asked[0]), int(asked[1] if len(asked) > 1 else 0))
                if wanted in _VERSIONS and not self.motive.motive.multicast:
                    session.version = wanted
            version = session.version if session else self.version
            made = f"Bitstream,{version}.0.0".encode() + b"\0"
        if made is None:
            self._command.write(protocol.packet(Message.UNRECOGNISED), peer)
        else:
            self._command.write(protocol.packet(Message.RESPONSE, made), peer)

    # -- frames

    @staticmethod
    def _ticks(world_ns: int) -> int:
        return _BOOTED + world_ns * FREQUENCY // 10**9

    def _subjects(self) -> list[Subject]:
        subjects = self.motive.offered(self.motive.scene.subjects)
        return [subject for subject in subjects if subject.name not in self._disabled]

    def _model(self) -> tuple[Model, dict[str, list[Point]]]:
        """Names, and each rigid body's markers on it."""
        bodies: list[BodyModel] = []
        skeletons: list[tuple[str, int, tuple[BodyModel, ...]]] = []
        places: dict[str, list[Point]] = {}
        scene = self.motive.scene
        poses, points = scene.split(scene.take())
        for subject in self._subjects():
            rows = {of: row for row, (owner, of) in enumerate(scene.segments) if owner == subject.id}
            names = tuple(marker.name for marker in subject.markers)
            if len(subject.segments) == 1:
                bodies.append(BodyModel(subject.name, subject.id, 0, (0.0, 0.0, 0.0), names))
                own = [row for row, (owner, _) in enumerate(scene.markers) if owner == subject.id]
                places[subject.name] = [self._local(poses[rows[1]], points[row]) for row in own]
                continue
            bones = []
            for segment in subject.segments:
                pose = poses[rows[segment.id]]
                offset = self._local(poses[rows[segment.parent]], pose[:3]) if segment.parent else (0.0, 0.0, 0.0)
                bones.append(BodyModel(segment.name, segment.id, segment.parent, offset, ()))
            skeletons.append((subject.name, subject.id, tuple(bones)))
        sets = {s.name: tuple(marker.name for marker in s.markers) for s in self._subjects() if s.markers}
        return Model(sets, tuple(bodies), tuple(skeletons)), places

    def _local(self, pose: Array, point: Array) -> Point:
        w, qx, qy, qz = pose[3:].tolist()
        x, y, z = (point - pose[:3]).tolist()
        return self._point(turned(conjugate((w, qx, qy, qz)), (x, y, z)))

    def _point(self, p: Point) -> Point:
        """In Motive's axes: with y up, (x, y, z) of a z-up world is (x, z, -y)."""
        x, y, z = p
        return (x, z, -y) if self.motive.y_up else p

    def _rotation(self, q: Quaternion) -> Quaternion:
        w, x, y, z = q
        return (w, x, z, -y) if self.motive.y_up else q

    def _send(self, number: int, values: Array, now: int) -> None:
        seen, sets = self._seen(number, values)
        made: dict[Version, bytes] = {}
        if self.motive.motive.multicast:
            targets = {(GROUP, self._data.port): self.version}
        else:
            self._sessions = {p: s for p, s in self._sessions.items() if now - s.heard < FORGET}
            targets = {peer: session.version for peer, session in self._sessions.items()}
        for peer, version in targets.items():
            if version not in made:
                made[version] = encode.frame(seen, sets, version)
            self._data.write(made[version], peer)
        self.sent(number, seen.number, now)

    def _seen(self, number: int, values: Array) -> tuple[MotiveFrame, dict[str, list[Point]]]:
        fake, scene = self.motive, self.motive.scene
        poses, points = (found.tolist() for found in scene.split(values))
        segments, markers = (seen.tolist() for seen in fake.visible(number))
        taken = fake.taken_at(number)
        sent = taken + round(fake.seen_by.delay * 1e9)
        frame = MotiveFrame(
            number + self.offset,
            taken * 1e-9,
            0 if fake.motive.usb else self._ticks(taken),
            self._ticks((taken + sent) // 2 if not fake.motive.usb else taken + round(fake.optitrack.latency * 1e9)),
            self._ticks(sent),
            (EDITED if self.playing else 0) | (MODEL_CHANGED if self._changed else 0),
        )
        self._changed = False
        on = {subject.id: subject for subject in self._subjects()}
        for row, (owner, of) in enumerate(scene.segments):
            if owner not in on:
                continue
            x, y, z, w, qx, qy, qz = poses[row]
            place = self._point((x, y, z)) if segments[row] else (0.0, 0.0, 0.0)
            turn = self._rotation((w, qx, qy, qz)) if segments[row] else (1.0, 0.0, 0.0, 0.0)
            single = len(on[owner].segments) == 1
            body = Body(owner if single else owner << 16 | of, place, turn, _RESIDUAL, segments[row])
            if single:
                frame.bodies.append(body)
            else:
                frame.skeletons.setdefault(owner, []).append(body)
        sets: dict[str, list[Point]] = {}
        for row, (owner, member) in enumerate(scene.markers):
            if owner not in on:
                continue
            x, y, z = points[row]
            place = self._point((x, y, z)) if markers[row] else (0.0, 0.0, 0.0)
            sets.setdefault(on[owner].name, []).append(place)
            flags = _MEASURED if markers[row] else _HIDDEN
            frame.markers.append(Marker(owner, member, place, _SIZE, flags, _RESIDUAL))
        for i, spot in enumerate(fake.seen_by.reflections):
            place = self._point(spot)
            frame.others.append(place)
            frame.markers.append(Marker(0, 50001 + i, place, _SIZE, UNLABELLED | 2, _RESIDUAL))
        return frame, sets
