"""One sample of the simulated cameras as the blocks of a DataStream packet."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Final

import numpy as np

from srl.drivers.capture.names import Subject
from srl.drivers.vicon.protocol import Block, packet
from srl.runtime.contracts import rotation
from srl.runtime.contracts.signals import Array
from srl.sim.devices.vicon import twin_blocks as encode
from srl.sim.devices.vicon.fake import FakeVicon

STATIC: Final = (
    Block.STREAM_INFO,
    Block.SUBJECT_INFO,
    Block.SUBJECT_TOPOLOGY,
    Block.APPLICATION_INFO,
    Block.SUBJECT_SCALE,
)
"""Sent only when they have changed."""
OFFERED: Final = frozenset(
    (
        *STATIC,
        Block.FRAME_INFO, Block.LABELED_RECONS, Block.UNLABELED_RECONS, Block.LOCAL_SEGMENTS, Block.GLOBAL_SEGMENTS,
        Block.TIMECODE, Block.LATENCY_INFO, Block.SUBJECT_HEALTH, Block.HARDWARE_FRAME_INFO, Block.FRAME_RATE_INFO,
        Block.OBJECT_QUALITY, Block.PING, Block.LIGHTWEIGHT_SEGMENTS, Block.REQUEST_FRAME, Block.KEEP_ALIVE,
        Block.CONTENTS, Block.FILTER, Block.REQUEST_NEXT_FRAME,
    )
)  # fmt: skip
_Y_UP: Final = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # rotates a z-up point: x forward, y up, z right
_PAL: Final = 25  # frames per second of the time code
_Made = tuple[Block, bytes]  # a block, and its type
_Pose = tuple[Array, Array]  # t (3,), R (3, 3)
_ORIGIN: Final = (np.zeros(3), np.eye(3))


class FrameMaker:
    """Makes packets from samples.

    Attributes:
        disabled: names of the subjects that the operator has switched off.
        offset: frame number of sample 0.
    """

    def __init__(self, fake: FakeVicon) -> None:
        self.fake = fake
        self.disabled: set[str] = set()
        self.offset = 0

    def subjects(self) -> list[Subject]:
        """The subjects that are switched on."""
        return [subject for subject in self.fake.scene.subjects if subject.name not in self.disabled]

    def poses(self, values: Array) -> tuple[Array, Array, Array]:
        """Segments' t (s, 3), mm, and R (s, 3, 3), and markers' p (m, 3), mm, in the server's axes."""
        poses, points = self.fake.scene.split(values)
        t, p, R = poses[:, :3] * 1e3, points * 1e3, rotation.matrices(poses[:, 3:])
        if self.fake.server.y_up:
            t, p, R = t @ _Y_UP.T, p @ _Y_UP.T, _Y_UP @ R @ _Y_UP.T
        return t, R, p

    def packet(
        self, number: int, values: Array, wanted: Collection[int], known: set[int], allowed: Mapping[int, set[int]]
    ) -> bytes:
        """Makes the packet of sample `number`.

        Args:
            number: the sample's number.
            values: the sample.
            wanted: block types to which the client subscribed.
            known: static types that the client already has; those sent now are added.
            allowed: the client's filter: numbers of subjects by block type.
        """
        unchanged = {int(kind) for kind in STATIC if kind in wanted and kind in known}
        made = [item for item in self._static() if item[0] not in known] + self._once(number)
        made += self._seen(number, values, allowed)
        made = [item for item in made if item[0] in wanted]
        known.update(kind for kind in STATIC if kind in wanted)
        counts: dict[int, int] = {}
        for kind, _ in made:
            counts[kind] = counts.get(kind, 0) + 1
        head = [encode.contents(counts, unchanged)] if Block.CONTENTS in wanted else []
        return packet(*head, *(data for _, data in made))

    def _static(self) -> list[_Made]:
        options = self.fake.seen_by
        made: list[_Made] = [(Block.STREAM_INFO, encode.stream_info(options.rate))]
        for subject in self.subjects():
            numbers = [segment.id for segment in subject.segments]
            carriers = self.fake.scene.carried_by(subject)
            attached = [(marker.id, segment) for marker, segment in zip(subject.markers, carriers, strict=True)]
            rest = np.zeros((len(numbers), 3)), np.tile(np.eye(3), (len(numbers), 1, 1))
            made += [
                (Block.SUBJECT_INFO, encode.subject_info(subject, attached=attached)),
                (Block.SUBJECT_TOPOLOGY, encode.segments(Block.SUBJECT_TOPOLOGY, subject.id, numbers, *rest)),
                (Block.SUBJECT_SCALE, encode.subject_scale(subject.id, numbers)),
            ]
        return [*made, (Block.APPLICATION_INFO, encode.application_info(self.fake.server.y_up))]

    def _once(self, number: int) -> list[_Made]:
        """The blocks that a frame has once, whatever the cameras see."""
        options, frame = self.fake.seen_by, number + self.offset
        seconds, rest = divmod(self.fake.taken_at(number), 10**9)
        time = (seconds // 3600 % 24, seconds // 60 % 60, seconds % 60, rest * _PAL // 10**9)
        return [
            (Block.FRAME_INFO, encode.number(Block.FRAME_INFO, frame)),
            (Block.HARDWARE_FRAME_INFO, encode.number(Block.HARDWARE_FRAME_INFO, frame)),
            (Block.TIMECODE, encode.timecode(*time, 0, 1, 0, 0, 0)),
            (Block.LATENCY_INFO, encode.latency({"Camera": options.delay / 2, "Processing": options.delay / 2})),
            (Block.FRAME_RATE_INFO, encode.frame_rates({"System": options.rate})),
        ]

    def _seen(self, number: int, values: Array, allowed: Mapping[int, set[int]]) -> list[_Made]:
        """Poses and markers; occluded ones are left out of their block, but the block is still sent."""
        scene = self.fake.scene
        t, R, p = self.poses(values)
        segments, markers = self.fake.visible(number)
        made: list[_Made] = []
        for subject in self.subjects():
            rows = [i for i, (owner, _) in enumerate(scene.segments) if owner == subject.id and segments[i]]
            made += [
                (kind, data)
                for kind, data in self._subject(subject, {scene.segments[i][1]: (t[i], R[i]) for i in rows})
                if subject.id in allowed.get(kind, {subject.id})
            ]
        on = {subject.id for subject in self.subjects()}
        owners = on & allowed.get(Block.LABELED_RECONS, on)
        shown = [i for i, (owner, _) in enumerate(scene.markers) if markers[i] and owner in owners]
        made.append((Block.LABELED_RECONS, encode.labeled([scene.markers[i] for i in shown], p[shown], shown)))
        spots = np.array(self.fake.seen_by.reflections).reshape(-1, 3) * 1e3
        if self.fake.server.y_up:
            spots = spots @ _Y_UP.T
        tracks = range(len(scene.markers), len(scene.markers) + len(spots))
        return [*made, (Block.UNLABELED_RECONS, encode.unlabeled(spots, tracks))]

    def _subject(self, subject: Subject, poses: Mapping[int, _Pose]) -> list[_Made]:
        """A subject's blocks, from the visible segments' poses (t, R) in the world by number."""
        local: dict[int, _Pose] = {}
        for segment in subject.segments:
            if segment.id in poses and (segment.parent == 0 or segment.parent in poses):
                t, R = poses[segment.id]
                t0, R0 = poses.get(segment.parent, _ORIGIN)
                local[segment.id] = R0.T @ (t - t0), R0.T @ R
        quality = len(poses) / len(subject.segments)
        turned = np.array([rotation.log(rotation.from_matrix(R)) for _, R in local.values()]).reshape(-1, 3)
        return [
            (kind, encode.segments(kind, subject.id, list(found), *_stacked(found)))
            for kind, found in ((Block.LOCAL_SEGMENTS, local), (Block.GLOBAL_SEGMENTS, poses))
        ] + [
            (Block.LIGHTWEIGHT_SEGMENTS, encode.lightweight(subject.id, list(local), _stacked(local)[0], turned)),
            (Block.SUBJECT_HEALTH, encode.subject_health(subject.id, self.fake.seen_by.noise * 1e3, quality)),
            (Block.OBJECT_QUALITY, encode.object_quality(subject.id, quality)),
        ]


def _stacked(poses: Mapping[int, _Pose]) -> tuple[Array, Array]:
    t = np.array([pose[0] for pose in poses.values()]).reshape(-1, 3)
    return t, np.array([pose[1] for pose in poses.values()]).reshape(-1, 3, 3)
