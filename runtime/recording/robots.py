"""The robots of a recording: their links, and which of its signals moves them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from srl.runtime.contracts.linkage import Linkage
from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.layout import Layout
from srl.runtime.recording.shapes import Placing


@dataclass(frozen=True)
class Robot:
    """One robot.

    Attributes:
        name: the device's, which is that of its frame, too.
        linkage: its links.
        angles: the signal that moves them; "" where nothing does.
        file: of the URDF with its meshes, or "".
        packages: folders in which the URDF's `package://` begins.
        on: the link of a robot before this one on which it hangs, ROBOT/LINK; "": it stands at the frame of its name.
    """

    name: str
    linkage: Linkage
    angles: str
    file: str
    packages: tuple[str, ...]
    on: str = ""

    @property
    def entity(self) -> str:
        """The entity under which its shapes are. One name, as rerun's loader of URDFs takes no path."""
        return f"robot-{self.name}"

    def frame(self, number: int) -> str:
        """The name of a link's frame. Those of the profile have no colon."""
        return f"{self.name}:{self.linkage.links[number].name}"

    def moved(self, layout: Layout, rows: NDArray[np.int64]) -> Array:
        """(k, m, 7): the poses of the moving links in rows (k, width), each in the link before: `Linkage.moved`."""
        if not self.angles:
            return np.empty((len(rows), 0, 7))
        return self.linkage.moved(layout.fields[self.angles].labels, layout.value(rows, self.angles))

    def placed(self, layout: Layout, row: NDArray[np.int64]) -> Array:
        """(n, 4, 4): where the links are in the robot's own frame, m, in a row (width,)."""
        if not self.angles:
            return self.linkage.placed((), np.empty(0))
        field = layout.fields[self.angles]
        return self.linkage.placed(field.labels, layout.value(row, self.angles))


class FixedRobots:
    """Where the robots of one layout are.

    Attributes:
        robots: each after the one on which it hangs.
        hidden: signals of the simulated world that would be drawn in the same place.
    """

    def __init__(self, layout: Layout) -> None:
        self._layout, self._placing = layout, Placing(layout)
        self.robots = robots(layout)
        self.hidden = frozenset(f"world.{robot.name}_{what}" for robot in self.robots for what in ("links", "outline"))

    def of(self, row: NDArray[np.int64]) -> list[Array]:
        """(n, 4, 4) of each robot: its links in the root frame, m, in a row (width,). Not finite while unknown."""
        known: dict[str, Array] = {}
        found = []
        for robot in self.robots:
            own = known[robot.on] if robot.on else self._placing.to_root(row, robot.name)
            links = own @ robot.placed(self._layout, row)
            names = (f"{robot.name}/{link.name}" for link in robot.linkage.links)
            known |= dict(zip(names, links, strict=True))
            found.append(links)
        return found


def robots(layout: Layout) -> list[Robot]:
    """The robots of a layout; none in a recording of an earlier version. One that is damaged is left out.

    A picture is never worth a recording, so this raises nothing.
    """
    found = []
    links: set[str] = set()
    for given in layout.meta.get("robots", ()):
        try:
            file: dict[str, Any] = given["urdf"] or {"path": "", "packages": ()}
            linkage = Linkage.of(given["links"])
            robot = Robot(
                given["name"], linkage, given["angles"], file["path"], tuple(file["packages"]), given.get("on") or ""
            )
            if robot.on and robot.on not in links:
                continue
            if linkage.moving:
                names = layout.fields[robot.angles].labels
                if not {linkage.links[i].joint for i in linkage.moving} <= set(names):
                    continue
        except (KeyError, TypeError, ValueError, AttributeError):
            continue
        if linkage.links:
            found.append(robot)
            links |= {f"{robot.name}/{link.name}" for link in linkage.links}
    return found
