"""The robots of a recording: their links, and which of its signals moves them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from runtime.contracts.errors import RecordingError
from runtime.contracts.linkage import Linkage
from runtime.contracts.signals import Array
from runtime.ipc.layout import Layout


@dataclass(frozen=True)
class Robot:
    """One robot.

    Attributes:
        name: the device's, which is that of its frame, too.
        linkage: its links.
        angles: the signal that moves them; "" where nothing does.
        file: of the URDF with its meshes, or "".
        packages: folders in which the URDF's `package://` begins.
    """

    name: str
    linkage: Linkage
    angles: str
    file: str
    packages: tuple[str, ...]

    def frame(self, number: int) -> str:
        """The name of a link's frame. Those of the profile have no colon."""
        return f"{self.name}:{self.linkage.links[number].name}"

    def moved(self, layout: Layout, rows: NDArray[np.int64]) -> Array:
        """(k, m, 7): the poses of the moving links in rows (k, width), each in the link before: `Linkage.moved`."""
        if not self.angles:
            return np.empty((len(rows), 0, 7))
        return self.linkage.moved(layout.fields[self.angles].labels, layout.value(rows, self.angles))

    def origins(self, layout: Layout, row: NDArray[np.int64]) -> Array:
        """(n, 3): the links' origins in the device's own frame, m, in a row (width,)."""
        if not self.angles:
            return self.linkage.placed((), np.empty(0))[:, :3, 3]
        field = layout.fields[self.angles]
        return self.linkage.placed(field.labels, layout.value(row, self.angles))[:, :3, 3]


def robots(layout: Layout) -> list[Robot]:
    """The robots of a layout; none in a recording of an earlier version.

    Raises:
        RecordingError: the layout is damaged.
    """
    found = []
    try:
        for given in layout.meta.get("robots", ()):
            file: dict[str, Any] = given["urdf"] or {"path": "", "packages": ()}
            robot = Robot(
                given["name"], Linkage.of(given["links"]), given["angles"], file["path"], tuple(file["packages"])
            )
            if robot.linkage.moving and robot.angles in layout.fields:
                names = layout.fields[robot.angles].labels
                if not all(robot.linkage.links[i].joint in names for i in robot.linkage.moving):
                    raise ValueError(f"'{robot.angles}' doesn't move '{robot.name}'")
            elif robot.linkage.moving:
                raise ValueError(f"there is no '{robot.angles}'")
            found.append(robot)
    except (KeyError, TypeError, ValueError) as error:
        raise RecordingError("the layout", f"it is damaged: robots: {error}", "Use another recording") from None
    return found
