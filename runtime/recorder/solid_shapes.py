"""Boxes, cylinders, capsules and spheres as rerun draws them: of robots' links and of the simulated world."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr

from srl.runtime.contracts import rotation
from srl.runtime.contracts.linkage import Solid


def solid_shapes(solids: Sequence[Solid]) -> list[tuple[str, Any]]:
    """One shape of rerun for each kind of solid."""
    found: list[tuple[str, Any]] = []
    fill = rr.components.FillMode.Solid
    for kind in dict.fromkeys(s.kind for s in solids):
        chosen = [s for s in solids if s.kind == kind]
        size, pose = np.array([s.size for s in chosen]), np.array([s.pose for s in chosen])
        at, (w, x, y, z) = pose[:, :3], pose[:, 3:].T
        place = {"quaternions": np.stack([x, y, z, w], axis=1), "colors": [s.color for s in chosen]}
        if kind == "box":
            found.append((kind, rr.Boxes3D(half_sizes=size, centers=at, fill_mode=fill, **place)))
        elif kind == "cylinder":
            lengths = 2 * size[:, 1]
            found.append((kind, rr.Cylinders3D(lengths=lengths, radii=size[:, 0], centers=at, fill_mode=fill, **place)))
        elif kind == "capsule":
            # The viewer's capsules begin at the given point and extend along z.
            along = np.stack([row[2] for row in rotation.rows(w, x, y, z)], axis=1)
            start, lengths = at - along * size[:, 1:2], 2 * size[:, 1]
            found.append(
                (kind, rr.Capsules3D(lengths=lengths, radii=size[:, 0], translations=start, fill_mode=fill, **place))
            )
        else:
            found.append((kind, rr.Ellipsoids3D(centers=at, radii=size[:, 0], colors=place["colors"], fill_mode=fill)))
    return found
