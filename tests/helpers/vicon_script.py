"""A scripted DataStream server: what it sends is made frame by frame."""

from __future__ import annotations

import itertools

import numpy as np

from helpers.twin import bound
from srl.drivers.capture.names import Marker, Segment, Subject
from srl.drivers.transport import open_transport
from srl.drivers.vicon import Vicon, protocol
from srl.drivers.vicon.protocol import Block, packet
from srl.sim.devices.vicon import twin_blocks as encode

MS = 1_000_000  # ns


ARM = Subject(1, "Arm", (Segment(1, "Base", 0), Segment(2, "Link1", 1)), (Marker(1, "M1"), Marker(2, "M2")))


WAND = Subject(2, "Wand", (Segment(1, "Wand", 0),), ())


ALL = frozenset(Block)


ARM_OPTIONS = {
    "segments": {"base": "Arm", "link": "Arm/Link1"},
    "markers": {"first": "Arm/M1", "second": "Arm/M2"},
    "unlabelled": 2,
}


_names = itertools.count()


def pose(x=0.0, y=0.0, z=0.0, R=None):
    """A pose on the wire, mm."""
    return np.array([x, y, z]), np.eye(3) if R is None else np.array(R, float)


def frame(number, *, poses=None, markers=(), spots=(), latency=None, static=(), unchanged=(1, 2)):
    """A frame packet: poses by (subject, segment), markers (subject, marker, x, y, z)."""
    made = list(static)
    made.append(encode.number(Block.FRAME_INFO, number))
    if latency is not None:
        made.append(encode.latency({"all": latency}))
    for subject in sorted({subject for subject, _ in poses or {}}):
        own = {segment: value for (owner, segment), value in poses.items() if owner == subject}
        t, R = np.array([v[0] for v in own.values()]), np.array([v[1] for v in own.values()])
        made.append(encode.segments(Block.GLOBAL_SEGMENTS, subject, list(own), t, R))
    p = np.array([m[2:] for m in markers]).reshape(-1, 3)
    made.append(encode.labeled([m[:2] for m in markers], p, range(len(markers))))
    made.append(encode.unlabeled(np.array(spots).reshape(-1, 3), range(len(spots))))
    return packet(encode.contents({}, () if static else unchanged), *made)


def static(*subjects, rate=100.0, y_up=False):
    """What a first frame has besides."""
    names = [encode.subject_info(subject) for subject in subjects]
    return [encode.stream_info(rate), *names, encode.application_info(y_up)]


class Server:
    """The other end of a link; has spoken before the driver opens."""

    def __init__(self, *first: bytes, offered=ALL) -> None:
        self.url = f"loop://vicon-{next(_names)}"
        self.link = open_transport(self.url, place="server")
        self.parser = protocol.Parser()
        self.send(protocol.object_enums(offered), *first)

    def send(self, *packets: bytes) -> None:
        self.link.write_all(b"".join(packets), 5.0)

    def heard(self):
        """(type, body) of every block the client has sent since."""
        return [(i.type, bytes(i.body)) for sent in self.parser.feed(self.link.read()) for i in sent]


def open_driver(server: Server, **options) -> Vicon:
    device = Vicon("mocap", Vicon.Config.model_validate({"port": server.url} | (options or ARM_OPTIONS)))
    bound(device)
    device.open()
    return device


def values(device: Vicon, name: str):
    return device.state_arrays[name]
