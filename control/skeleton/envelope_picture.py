"""What a picture of the envelope shows: its capsules, coloured by their distance, and the closest gaps."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from srl.control.skeleton.envelope import Envelope
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import CAPSULE, GAP

RANKS = ("first", "second", "third")


class EnvelopePicture:
    """Fills the signals `envelope` and `closest` of one arm and its wearer."""

    def __init__(self, envelope: Envelope) -> None:
        self._names = (*envelope.segments, *envelope.links)
        s, links = len(envelope.segments), len(envelope.links)
        self._radii = np.concatenate([envelope.radii, np.full(links, envelope.link_radius)])
        # For each capsule the pairs that it is in, one after the other: the least distance is that of a slice.
        in_pairs = [
            [k for k, pair in enumerate(envelope.pairs) if capsule in (pair.segment, s + pair.link)]
            for capsule in range(s + links)
        ]
        self._compared = np.array([i for i, pairs in enumerate(in_pairs) if pairs], dtype=int)
        self._pairs = np.array([k for pairs in in_pairs for k in pairs], dtype=int)
        sizes = [len(pairs) for pairs in in_pairs if pairs]
        self._starts = np.append(0, np.cumsum(sizes[:-1], dtype=int))
        self._first = s
        self._of_segment = {i: np.array(in_pairs[i]) for i in range(s) if in_pairs[i]}

    def signals(self, frame: str | None) -> tuple[Signal, Signal]:
        """The outputs; `frame` is the suit's world."""
        return (
            Signal(
                name="envelope", shape=(len(self._names), len(CAPSULE)), unit="m", frame=frame, labels=self._names,
                components=(CAPSULE,), visual="capsules",
            ),
            Signal(
                name="closest", shape=(len(RANKS), len(GAP)), unit="m", frame=frame, labels=RANKS, components=(GAP,),
                visual="gaps",
            ),
        )  # fmt: skip

    def fill(self, out: Mapping[str, Array], segments: Array, nodes: Array) -> None:
        """Fills both.

        Args:
            out: the law's outputs; `distance` and `points` are read.
            segments: (s, 2, 3) m, the ends of the body's segments.
            nodes: (n + 2, 3) m, of the arm.
        """
        distance, points, envelope, closest = (out[name] for name in ("distance", "points", "envelope", "closest"))
        s = self._first
        envelope[:s, :6] = segments.reshape(s, 6)
        envelope[s:, :3], envelope[s:, 3:6] = nodes[:-1], nodes[1:]
        envelope[:, 6] = self._radii
        envelope[:, 7] = np.nan
        if len(self._compared):
            envelope[self._compared, 7] = np.minimum.reduceat(distance[self._pairs], self._starts)
        closest[:] = np.nan
        near = np.argsort(envelope[:s, 7])[: len(RANKS)]  # NaN is last
        for row, segment in zip(closest, near.tolist(), strict=False):
            pairs = self._of_segment.get(segment)
            if pairs is not None:
                k = pairs[distance[pairs].argmin()]
                row[:6], row[6] = points[k].ravel(), distance[k]
