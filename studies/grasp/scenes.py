"""Grasps to look at: a rerun recording in which hand and finger close around objects, with their contacts."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np
import rerun as rr

from srl.runtime.contracts.rotation import from_matrix
from srl.runtime.contracts.signals import Array
from srl.runtime.models.human_hand import FINGERS
from srl.studies.grasp.cell import GraspCell
from srl.studies.grasp.closing import CLOSINGS, MOTIONS, start
from srl.studies.grasp.isotropy_trial import AUGMENTED, grasps
from srl.studies.grasp.things import SHAPES, Thing

_FRAMES: Final = 30  # of each closing
_ARROW: Final = 0.02  # m, length of a contact's normal
_SEED: Final = 0


def write(file: Path, text: str, sizes: Iterable[float], quick: bool = False) -> None:
    """Writes the closings of the first placement of each object, one after another on the timeline `step`.

    Args:
        text: the profile's.
        sizes: m.
        quick: the whole hand alone.
    """
    recording = rr.RecordingStream("srl-grasps")
    recording.save(str(file))
    step = 0
    for shape in SHAPES:
        for size in sizes:
            thing = Thing(shape, size)
            cell = GraspCell(text, thing, thing.place(np.random.default_rng([_SEED, 1])))
            begin = start(cell)
            if begin is None:
                continue
            for closing in CLOSINGS:
                motion = MOTIONS[closing](cell, begin, FINGERS)
                for grasp in grasps(cell, begin, closing, motion, AUGMENTED[:1] if quick else AUGMENTED):
                    words = f"{shape}, {1e3 * size:.0f} mm, {closing}, {grasp.name}, {grasp.seen}"
                    kept = np.unique(np.linspace(0, len(grasp.postures) - 1, _FRAMES).astype(int))
                    for i in kept:
                        recording.set_time("step", sequence=step)
                        cell.pose(grasp.postures[i])
                        _log(recording, cell, words, [*grasp.digits, *cell.extra] if i == kept[-1] else [])
                        step += 1
    recording.flush()
    recording.disconnect()


def _log(recording: Any, cell: GraspCell, words: str, digits: list[str]) -> None:
    """Logs the geoms as they are, and the contacts of these digits."""
    log_geoms(recording, "grasp", cell.model, cell.data)
    origins, normals = _contacts(cell, digits)
    recording.log(
        "grasp/contacts", rr.Arrows3D(origins=origins - _ARROW * normals, vectors=_ARROW * normals, radii=0.001)
    )
    recording.log("grasp/name", rr.TextDocument(words + (f": {len(origins)} contacts" if digits else "")))


def log_geoms(recording: Any, root: str, model: Any, data: Any) -> None:
    """Logs the geoms of a MuJoCo model where they are, under a path of the recording."""
    turns = [from_matrix(frame.reshape(3, 3)) for frame in data.geom_xmat]
    quaternions = np.array([(x, y, z, w) for w, x, y, z in turns])
    colours = (255 * model.geom_rgba).astype(np.uint8)

    def of(kind: Any) -> Any:
        return np.flatnonzero(model.geom_type == kind)

    boxes, capsules = of(mujoco.mjtGeom.mjGEOM_BOX), of(mujoco.mjtGeom.mjGEOM_CAPSULE)
    spheres, cylinders = of(mujoco.mjtGeom.mjGEOM_SPHERE), of(mujoco.mjtGeom.mjGEOM_CYLINDER)
    solid = rr.components.FillMode.Solid
    recording.log(
        f"{root}/boxes",
        rr.Boxes3D(
            half_sizes=model.geom_size[boxes], centers=data.geom_xpos[boxes], quaternions=quaternions[boxes],
            colors=colours[boxes], fill_mode=solid,
        ),
    )  # fmt: skip
    # The viewer's capsules begin at the given point and extend along z.
    lengths = 2.0 * model.geom_size[capsules, 1]
    along = data.geom_xmat[capsules].reshape(-1, 3, 3)[:, :, 2]
    recording.log(
        f"{root}/capsules",
        rr.Capsules3D(
            lengths=lengths, radii=model.geom_size[capsules, 0],
            translations=data.geom_xpos[capsules] - 0.5 * lengths[:, None] * along,
            quaternions=quaternions[capsules], colors=colours[capsules], fill_mode=solid,
        ),
    )  # fmt: skip
    recording.log(
        f"{root}/spheres",
        rr.Ellipsoids3D(
            half_sizes=np.tile(model.geom_size[spheres, :1], 3), centers=data.geom_xpos[spheres],
            colors=colours[spheres], fill_mode=solid,
        ),
    )  # fmt: skip
    recording.log(
        f"{root}/cylinders",
        rr.Cylinders3D(
            lengths=2.0 * model.geom_size[cylinders, 1], radii=model.geom_size[cylinders, 0],
            centers=data.geom_xpos[cylinders], quaternions=quaternions[cylinders], colors=colours[cylinders],
            fill_mode=solid,
        ),
    )  # fmt: skip


def _contacts(cell: GraspCell, digits: list[str]) -> tuple[Array, Array]:
    """Points and normals (k, 3) in the hand's frame."""
    found = cell.contacts(digits)
    return found.points @ cell.axes.T + cell.centre, found.normals @ cell.axes.T
