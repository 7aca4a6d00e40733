"""The first look of the 3D view: at all that a row shows, from the side and above, close enough to fill the view."""

from __future__ import annotations

import numpy as np
import rerun.blueprint as rrb

from srl.runtime.contracts.field import Field
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.layout import Layout, Words
from srl.runtime.recording.robots import FixedRobots
from srl.runtime.recording.shapes import Placing

# From the thumb's side of a right hand (-x), from behind the wrist (-y) and from its back (+z). It suits a robot, too.
DIRECTION = np.array([-0.75, -0.35, 0.55]) / np.linalg.norm([-0.75, -0.35, 0.55])
# A body faces x, with y to its left: from its front, a little from its right.
BODY = np.array([0.8, -0.5, 0.3]) / np.linalg.norm([0.8, -0.5, 0.3])
DISTANCE, TALL = 2.4, 2.2  # in radii of the objects shown; a body is taller than wide
UP = (0.0, 0.0, 1.0)


def back_of(shapes: list[Field]) -> Array:
    """(3,): from what is looked at to the eye, in the root frame, in radii of the objects shown."""
    return TALL * BODY if any(field.visual == "skeleton" for field in shapes) else DISTANCE * DIRECTION


def look(layout: Layout, row: Words, shapes: list[Field]) -> rrb.EyeControls3D | None:
    """The eye for a row (width,); None if no shape is known yet. Positions in the root frame, m."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    placing = Placing(layout)
    for field in shapes:
        T = placing.to_root(row, field.frame)
        values = layout.value(row, field.name)
        if field.visual == "path" and not values.any():
            continue  # no sample yet
        if field.visual in ("sphere", "path"):
            points, margin = values[None, :3], values[3] if field.visual == "sphere" else 0.0
        elif field.visual in ("capsules", "gaps"):
            points, margin = values[:, :6].reshape(-1, 3), 0.0
        else:
            points, margin = values[:1] if field.visual == "arrow" else values.reshape(-1, 3), 0.0
        points = points @ T[:3, :3].T + T[:3, 3] + 0.0 * margin
        points = points[np.isfinite(points).all(axis=1)]
        if not len(points):
            continue
        low, high = np.minimum(low, points.min(axis=0) - margin), np.maximum(high, points.max(axis=0) + margin)
    for links in FixedRobots(layout).of(row):
        points = links[:, :3, 3]
        if np.isfinite(points).all():
            low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
    if np.isfinite(low).all():  # fixed objects are included, but they are not worth a view of their own
        for thing in layout.meta.get("scenery", []):
            middle, reach = np.array(thing["position"]), float(np.linalg.norm(thing["size"]))
            low, high = np.minimum(low, middle - reach), np.maximum(high, middle + reach)
    radius = float(np.linalg.norm(high - low) / 2)
    if not np.isfinite(radius) or radius == 0.0:
        return None
    centre = (low + high) / 2
    return rrb.EyeControls3D(position=centre + radius * back_of(shapes), look_target=centre, eye_up=UP)
