"""What simulated cameras see of a cell: subjects with segments and markers, in the capture system's terms."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import mujoco
import numpy as np
from numpy.typing import NDArray

from srl.drivers.capture.names import Marker, Segment, Subject
from srl.runtime.contracts.errors import WiringError, nearest
from srl.runtime.contracts.frames import IDENTITY, as_pose
from srl.runtime.contracts.rotation import Quaternion, composed, homogeneous, inverted
from srl.runtime.contracts.signals import Array
from srl.sim.parts.body.subject import MocapSubject
from srl.sim.world.cell import Cell


class Scene:
    """Subjects are numbered from 1, and so are the segments and markers of each subject.

    Attributes:
        subjects: names and numbers, as the server streams them.
        segments: (subject's number, segment's number) of each row of poses.
        markers: (subject's number, marker's number) of each row of points.
        carriers: of each row of points, the row of poses of the segment that carries the marker.
    """

    def __init__(
        self, cell: Cell, parts: Iterable[MocapSubject], bodies: Mapping[str, Mapping[str, str]], place: str,
        frame: str | None = None,
    ) -> None:  # fmt: skip
        """
        Args:
            cell: the world.
            parts: each is a subject.
            bodies: further subjects without markers: by name, their segments' bodies in the cell, the root first.
            place: the profile's key, for errors.
            frame: the server's origin in the profile's tree; None, or one that isn't in it: the world's.
        Raises:
            WiringError: a name given twice, or a body that the cell doesn't have.
        """
        self._data = cell.data
        self._cell, self._frame = cell, frame if frame in cell.frames.entries else None
        subjects: list[Subject] = []
        body_ids, site_ids, carriers = list[int](), list[int](), list[int]()
        self.segments: list[tuple[int, int]] = []
        self.markers: list[tuple[int, int]] = []
        for part in parts:
            number, first = len(subjects) + 1, len(self.segments)
            names = list(part.segments)
            segments = tuple(
                Segment(i, name, names.index(seen.parent) + 1 if seen.parent else 0)
                for i, (name, seen) in enumerate(part.segments.items(), 1)
            )
            markers = tuple(Marker(i, label) for i, label in enumerate(part.markers, 1))
            subjects.append(Subject(number, part.subject, segments, markers))
            body_ids += [cell.model.body(seen.body).id for seen in part.segments.values()]
            self.segments += [(number, segment.id) for segment in segments]
            site_ids += [cell.model.site(f"{part.name}/{label}").id for label in part.markers]
            self.markers += [(number, marker.id) for marker in markers]
            carriers += [first + names.index(name) for name in part.markers.values()]
        known = [cell.model.body(i).name for i in range(1, cell.model.nbody)]
        for subject, own in bodies.items():
            number = len(subjects) + 1
            for name, body in own.items():
                if body not in known:
                    raise WiringError(
                        f"{place}.bodies.{subject}.{name}", f"the cell has no body '{body}'", nearest(body, known)
                    )
            body_ids += [cell.model.body(body).id for body in own.values()]
            named = tuple(Segment(i, name, 0 if i == 1 else 1) for i, name in enumerate(own, 1))
            self.segments += [(number, segment.id) for segment in named]
            subjects.append(Subject(number, subject, named, ()))
        self.subjects = tuple(subjects)
        names = [subject.name for subject in subjects]
        if twice := [name for name in names if names.count(name) > 1]:
            raise WiringError(place, f"two subjects are called '{twice[0]}'", "Give one another 'subject'")
        if not subjects:
            raise WiringError(
                place, "the cell has nothing for cameras to see", "Add a part 'mocap-body' or 'upper-body', or 'bodies'"
            )
        self._turns: Array = np.tile([1.0, 0.0, 0.0, 0.0], (len(self.segments), 1))
        self._turned = np.zeros(len(self.segments), np.bool_)
        self._bodies, self._sites = np.array(body_ids, np.intp), np.array(site_ids, np.intp)
        self.owner_of_segment = np.array([number for number, _ in self.segments], np.intp)
        self.carriers = np.array(carriers, np.intp)
        self.owner_of_marker = np.array([number for number, _ in self.markers], np.intp)

    def turn(self, subject: str, q: Quaternion) -> None:
        """The system's axes of a subject's segments are turned by this in those of the cell's bodies."""
        number = next(s.id for s in self.subjects if s.name == subject)
        self._turns[self.owner_of_segment == number] = q
        self._turned[self.owner_of_segment == number] = True

    @property
    def size(self) -> int:
        """Number of values that `take` returns."""
        return 7 * len(self.segments) + 3 * len(self.markers)

    def take(self) -> Array:
        """(size,): x, y, z (m), w, x, y, z of each segment, then x, y, z of each marker, now, in its frame."""
        turned = self._data.xquat[self._bodies]
        if self._turned.any():
            turned = turned.copy()
            for row in np.flatnonzero(self._turned).tolist():
                mujoco.mju_mulQuat(turned[row], turned[row].copy(), self._turns[row])
        poses = np.hstack([self._data.xpos[self._bodies], turned])
        points = self._data.site_xpos[self._sites]
        if self._frame is not None and (origin := self._cell.pose_of(self._frame)) != IDENTITY:
            back = inverted(origin)
            poses = np.array([composed(back, as_pose(pose)) for pose in poses]).reshape(poses.shape)
            points = points @ homogeneous(back)[:3, :3].T + back[:3]
        return np.concatenate([poses.ravel(), points.ravel()])

    def split(self, values: Array) -> tuple[Array, Array]:
        """Splits a noisy sample into poses (s, 7) with unit quaternions and points (m, 3)."""
        count = 7 * len(self.segments)
        poses, points = values[:count].reshape(-1, 7), values[count:].reshape(-1, 3)
        poses = poses.copy()
        poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
        return poses, points

    def carried_by(self, subject: Subject) -> list[int]:
        """The number of the segment that carries each of the subject's markers."""
        return [self.segments[row][1] for row in self.carriers[self.owner_of_marker == subject.id].tolist()]

    def masks(self, name: str) -> tuple[NDArray[np.bool_], NDArray[np.bool_]] | None:
        """Masks of the segments and markers of `SUBJECT` or `SUBJECT/MARKER`; None if the name is unknown."""
        owner, _, label = name.partition("/")
        subject = next((s for s in self.subjects if s.name == owner), None)
        if subject is None:
            return None
        if not label:
            return self.owner_of_segment == subject.id, self.owner_of_marker == subject.id
        number = next((marker.id for marker in subject.markers if marker.name == label), None)
        if number is None:
            return None
        return np.zeros(len(self.segments), bool), np.array([m == (subject.id, number) for m in self.markers], bool)

    def names(self) -> list[str]:
        """All names that `masks` accepts."""
        return [s.name for s in self.subjects] + [f"{s.name}/{m.name}" for s in self.subjects for m in s.markers]
