"""Resolves the names of wanted segments and markers to the server's numbers, or makes an error that lists them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from srl.drivers.capture.config import CaptureConfig
from srl.drivers.capture.names import Segment, Subject
from srl.runtime.contracts.errors import DeviceError, nearest

_LISTED = 20


@dataclass
class Selection:
    """Rows of the state arrays by the server's numbers.

    Attributes:
        segments: by subject's number: a dict of rows by segment's number.
        markers: row by (subject's number, marker's number).
        missing: names of the profile that the server doesn't have at present.
    """

    segments: dict[int, dict[int, int]] = field(default_factory=dict)
    markers: dict[tuple[int, int], int] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)


def root_of(subject: Subject) -> Segment | None:
    """Returns the segment without a parent."""
    return next((segment for segment in subject.segments if segment.parent == 0), None)


def select(config: CaptureConfig, subjects: Iterable[Subject]) -> Selection:
    """Resolves the names that the server has; the others go to `missing`, and so do those that two subjects have."""
    by_name: dict[str, Subject] = {}
    twice = set()
    for each in subjects:
        if each.name in by_name:
            twice.add(each.name)
        by_name[each.name] = each
    for name in twice:
        del by_name[name]
    found = Selection()
    for row, (name, target) in enumerate(config.segments.items()):
        owner, _, wanted = target.partition("/")
        subject = by_name.get(owner)
        segment = None
        if subject is not None:
            segment = next((s for s in subject.segments if s.name == wanted), None) if wanted else root_of(subject)
        if subject is None or segment is None:
            found.missing.append(name)
        else:
            found.segments.setdefault(subject.id, {})[segment.id] = row
    for row, (name, target) in enumerate(config.markers.items()):
        owner, _, wanted = target.partition("/")
        subject = by_name.get(owner)
        marker = next((m for m in subject.markers if m.name == wanted), None) if subject is not None else None
        if subject is None or marker is None:
            found.missing.append(name)
        else:
            found.markers[subject.id, marker.id] = row
    return found


def refuse(config: CaptureConfig, subjects: Sequence[Subject], missing: str, place: str) -> DeviceError:
    """Returns the error for the first missing name, with the names that exist instead."""
    kind, targets = ("segment", config.segments) if missing in config.segments else ("marker", config.markers)
    owner, _, wanted = targets[missing].partition("/")
    subject = next((s for s in subjects if s.name == owner), None)
    line = f"Correct '{kind}s: {{{missing}: {targets[missing]}}}'"
    if len([s for s in subjects if s.name == owner]) > 1:
        return DeviceError(place, f"two of its subjects are called '{owner}'", "Give each its own name there")
    if subject is None:
        names = [s.name for s in subjects]
        return DeviceError(
            place, f"the server has no subject '{owner}'", f"{line}, or enable it in the server. {listed(owner, names)}"
        )
    parts = subject.segments if kind == "segment" else subject.markers
    return DeviceError(
        place,
        f"subject '{owner}' has no {kind} '{wanted}'" if wanted else f"subject '{owner}' has no segments",
        f"{line}. {listed(wanted, [part.name for part in parts])}",
    )


def listed(name: str, names: Sequence[str]) -> str:
    """Returns the existing names as text; of many, the nearest and the first ones."""
    if len(names) <= _LISTED:
        return nearest(name, names)
    return f"{nearest(name, names).partition('Known:')[0]}There are {len(names)}: {', '.join(names[:_LISTED])}, ..."
