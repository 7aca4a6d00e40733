"""What a capture system has, by its names: subjects with segments and markers."""

from __future__ import annotations

from typing import NamedTuple

Point = tuple[float, float, float]


class Segment(NamedTuple):
    """A segment of a subject; `parent` is 0 for a root."""

    id: int
    name: str
    parent: int


class Marker(NamedTuple):
    """A labelled marker of a subject."""

    id: int
    name: str


class Subject(NamedTuple):
    """A subject's names and numbers."""

    id: int
    name: str
    segments: tuple[Segment, ...]
    markers: tuple[Marker, ...]
