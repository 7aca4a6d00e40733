"""What a DataStream server sends: bodies of blocks (sheet vicon_datastream, A.4), mm, rad, s. No I/O."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

import numpy as np

from srl.drivers.capture.names import Subject
from srl.drivers.vicon.protocol import CLOCK, Block, block
from srl.runtime.contracts.signals import Array

_SEGMENT: Final = np.dtype([("id", "<u4"), ("t", "<f8", 3), ("R", "<f8", 9)])
_LIGHT: Final = np.dtype([("id", "<u4"), ("t", "<f4", 3), ("axis_angle", "<f4", 3)])
_LABELED: Final = np.dtype(
    [("subject", "<u4"), ("marker", "<u4"), ("radius", "<f8"), ("p", "<f8", 3), ("cov", "<f8", 9), ("track", "<u4")]
)
_UNLABELED: Final = np.dtype([("radius", "<f8"), ("p", "<f8", 3), ("cov", "<f8", 9), ("track", "<u4")])
RADIUS: Final = 7.0  # mm, of a marker


def text(value: str) -> bytes:
    """Encodes a string."""
    raw = value.encode("utf-8")
    return struct.pack("<I", len(raw)) + raw


def contents(counts: Mapping[int, int], unchanged: Iterable[int]) -> bytes:
    """Encodes Contents."""
    body = struct.pack("<I", len(counts)) + b"".join(struct.pack("<II", *item) for item in sorted(counts.items()))
    same = sorted(unchanged)
    return block(Block.CONTENTS, body + struct.pack(f"<{1 + len(same)}I", len(same), *same))


def stream_info(rate: float) -> bytes:
    """Encodes StreamInfo of a frame rate, Hz."""
    return block(Block.STREAM_INFO, struct.pack("<q", round(CLOCK / rate)))


def application_info(y_up: bool) -> bytes:
    """Encodes ApplicationInfo."""
    return block(Block.APPLICATION_INFO, bytes([y_up]))


def number(kind: Block, value: int) -> bytes:
    """Encodes FrameInfo or HardwareFrameInfo."""
    return block(kind, struct.pack("<I", value % (1 << 32)))


def subject_info(
    subject: Subject,
    bounds: Mapping[int, Sequence[float]] | None = None,
    attached: Iterable[tuple[int, int]] = (),
) -> bytes:
    """Encodes SubjectInfo.

    Args:
        subject: names and numbers.
        bounds: min x, y, z, max x, y, z (mm) by segment number; the others are 0.
        attached: (marker's number, segment's number).
    """
    body = struct.pack("<I", subject.id) + text(subject.name) + struct.pack("<I", len(subject.segments))
    for segment in subject.segments:
        box = (bounds or {}).get(segment.id, (0.0,) * 6)
        body += struct.pack("<II6f", segment.parent, segment.id, *box) + text(segment.name)
    body += struct.pack("<I", len(subject.markers))
    for marker in subject.markers:
        body += struct.pack("<I", marker.id) + text(marker.name)
    pairs = list(attached)
    return block(
        Block.SUBJECT_INFO, body + struct.pack("<I", len(pairs)) + b"".join(struct.pack("<II", *p) for p in pairs)
    )


def segments(kind: Block, subject: int, numbers: Sequence[int], t: Array, R: Array) -> bytes:
    """Encodes GlobalSegments, LocalSegments or SubjectTopology of one subject.

    Args:
        kind: which of them.
        subject: the subject's number.
        numbers: numbers of the segments, n.
        t: (n, 3), mm.
        R: (n, 3, 3), from the segment to the world or to its parent.
    """
    rows = np.zeros(len(numbers), _SEGMENT)
    rows["id"], rows["t"], rows["R"] = numbers, t, R.reshape(-1, 9)
    return block(kind, struct.pack("<II", subject, len(numbers)) + rows.tobytes())


def lightweight(subject: int, numbers: Sequence[int], t: Array, axis_angle: Array) -> bytes:
    """Encodes LightweightSegments: poses relative to the parents; t (n, 3), mm, axis times angle (n, 3), rad."""
    rows = np.zeros(len(numbers), _LIGHT)
    rows["id"], rows["t"], rows["axis_angle"] = numbers, t, axis_angle
    return block(Block.LIGHTWEIGHT_SEGMENTS, struct.pack("<II", subject, len(numbers)) + rows.tobytes())


def subject_scale(subject: int, numbers: Sequence[int]) -> bytes:
    """Encodes SubjectScale: nothing is scaled."""
    body = b"".join(struct.pack("<I3d", number, 1.0, 1.0, 1.0) for number in numbers)
    return block(Block.SUBJECT_SCALE, struct.pack("<II", subject, len(numbers)) + body)


def labeled(markers: Sequence[tuple[int, int]], p: Array, tracks: Sequence[int], radius: float = RADIUS) -> bytes:
    """Encodes LabeledRecons: (subject's, marker's number) each, p (n, 3) and radius in mm, numbers of tracks."""
    rows = np.zeros(len(markers), _LABELED)
    if len(markers):
        rows["subject"], rows["marker"] = np.array(markers).T
        rows["p"], rows["track"], rows["radius"] = p, tracks, radius
    return block(Block.LABELED_RECONS, struct.pack("<I", len(markers)) + rows.tobytes())


def unlabeled(p: Array, tracks: Sequence[int], radius: float = RADIUS) -> bytes:
    """Encodes UnlabeledRecons: p (n, 3) and the radius in mm."""
    rows = np.zeros(len(p), _UNLABELED)
    rows["p"], rows["track"], rows["radius"] = p, tracks, radius
    return block(Block.UNLABELED_RECONS, struct.pack("<I", len(p)) + rows.tobytes())


def latency(stages: Mapping[str, float]) -> bytes:
    """Encodes LatencyInfo: s by the stage's name."""
    body = b"".join(text(name) + struct.pack("<d", seconds) for name, seconds in stages.items())
    return block(Block.LATENCY_INFO, struct.pack("<I", len(stages)) + body)


def frame_rates(rates: Mapping[str, float]) -> bytes:
    """Encodes FrameRateInfo: Hz by name."""
    body = b"".join(text(name) + struct.pack("<d", rate) for name, rate in sorted(rates.items()))
    return block(Block.FRAME_RATE_INFO, struct.pack("<I", len(rates)) + body)


def subject_health(subject: int, error: float, health: float) -> bytes:
    """Encodes SubjectHealth: mm, 0 to 1."""
    return block(Block.SUBJECT_HEALTH, struct.pack("<I2d", subject, error, health))


def object_quality(subject: int, quality: float) -> bytes:
    """Encodes ObjectQuality: 0 to 1."""
    return block(Block.OBJECT_QUALITY, struct.pack("<Id", subject, quality))


def timecode(
    hours: int, minutes: int, seconds: int, frames: int, subframe: int, per_frame: int, standard: int, user: int,
    field: int,
) -> bytes:  # fmt: skip
    """Encodes Timecode."""
    body = struct.pack(
        "<4B2H2IB", hours, minutes, seconds, frames, subframe, per_frame, standard % (1 << 32), user, field
    )
    return block(Block.TIMECODE, body)
