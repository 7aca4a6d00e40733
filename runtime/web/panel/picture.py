"""The live picture's part of the operator's panel: nodes, links and capsules in space, curves, how the loop is."""

from __future__ import annotations

import json
import time
from dataclasses import asdict
from typing import Any, ClassVar, Final

import numpy as np

from srl.runtime.contracts.signals import Array
from srl.runtime.ipc.header import State
from srl.runtime.ipc.layout import Layout, Words
from srl.runtime.ipc.rows import Condition, Rows
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.profile.plots import Plot, joint_plots, profile_plots
from srl.runtime.recording.readable import said
from srl.runtime.recording.shapes import PALETTE, PERSON, RAMP, UNKNOWN, Color, Placing, colors
from srl.runtime.recording.solids import Solids, Thing
from srl.runtime.web.panel import three
from srl.runtime.web.panel.pages import KEEP, PageServer
from srl.runtime.web.panel.peer import Peer

RATE: Final = 60.0  # pictures a second, at most
TIMING: Final = Plot(title="Loop", unit="ms", lines={"period": "loop.period", "cycle": "loop.cycle"})


class PictureServer(PageServer):
    """Shows one instance to all its pages alike. `srl.runtime.web.operator` adds the rest, and commands."""

    files: ClassVar = {
        "/": ("picture.html", "text/html"),
        "/picture.js": ("picture.js", "text/javascript"),
        "/legend.js": ("legend.js", "text/javascript"),
        "/eye.js": ("eye.js", "text/javascript"),
        "/space.js": ("space.js", "text/javascript"),
        "/solid.js": ("solid.js", "text/javascript"),
        "/pools.js": ("pools.js", "text/javascript"),
        "/three.module.min.js": ("three/three.module.min.js", "text/javascript"),
        "/three.core.min.js": ("three/three.core.min.js", "text/javascript"),
        "/curves.js": ("curves.js", "text/javascript"),
        "/operator.js": ("operator.js", "text/javascript"),
        "/guide.js": ("guide.js", "text/javascript"),
        "/pad.js": ("pad.js", "text/javascript"),
        "/parameter.js": ("parameter.js", "text/javascript"),
        "/part.js": ("part.js", "text/javascript"),
        "/link.js": ("link.js", "text/javascript"),
        "/picture.css": ("picture.css", "text/css"),
        "/operator.css": ("operator.css", "text/css"),
        "/guide.css": ("guide.css", "text/css"),
    }

    def __init__(self, run_folder: RunFolder) -> None:
        """Raises RecordingError: there is no run here."""
        super().__init__(run_folder)
        self._rows = Rows(run_folder)
        self._view: View = View(self._rows.layout)
        self._shown, self._due = (0.0, ""), 0.0
        self._period = self._cycle = 0.0  # ms, the largest since the last picture
        self._wake = 0

    def scene_beside(self, layout: Layout) -> dict[str, Any]:
        """What a page is told of a run once, beside the picture's scene."""
        return {}

    def frame_beside(self, layout: Layout, row: Words, now: float) -> dict[str, Any]:
        """What a page is told of a row (width,), beside the picture. `now`: CLOCK_MONOTONIC s."""
        return {}

    def joined(self, peer: Peer) -> None:
        peer.tell(self._scene())

    def look(self) -> None:
        now = time.monotonic()
        rows = self._rows.take(now)
        if self._rows.layout is not self._view.layout:
            self._view, self._wake = View(self._rows.layout), 0
            scene = self._scene()
            for peer in self.peers:
                peer.tell(scene)
        if len(rows):
            self._time(rows)
        row = self._rows.last
        if row is None or now < self._due or not self.peers:
            return
        condition, words = self._rows.condition(now)
        if (self._rows.stamp, words) == self._shown and now < self._due + KEEP:
            return
        self._shown, self._due = (self._rows.stamp, words), now + 1.0 / RATE
        frame = self._view.frame(row, [self._period, self._cycle])
        frame |= {"kind": "frame", "t": self._rows.stamp * 1e3, "condition": condition, "words": words}
        frame |= self.frame_beside(self._view.layout, row, now)
        self._period = self._cycle = 0.0
        text = json.dumps(frame)
        for peer in self.peers:
            peer.show(text)

    @property
    def over(self) -> bool:
        """Whether the run has ended."""
        return self._rows.condition(time.monotonic())[0] is Condition.ENDED

    @property
    def silent(self) -> bool:
        """Whether no rows come."""
        return self._rows.condition(time.monotonic())[0] is Condition.SILENT

    def close(self) -> None:
        self._rows.close()

    def _scene(self) -> dict[str, Any]:
        return self._view.scene | self.scene_beside(self._view.layout)

    def _time(self, rows: Words) -> None:
        wake, write = (self._view.layout.header(rows, name) for name in ("wake", "write"))
        if self._wake:
            self._period = max(self._period, float(np.diff(wake, prepend=self._wake).max()) / 1e6)
        self._cycle = max(self._cycle, float((write - wake).max()) / 1e6)
        self._wake = int(wake[-1])


class View:
    """What a page is told of one layout.

    Attributes:
        scene: what doesn't change: the things, the curves, the colours.
    """

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self._solids, self._placing = Solids(layout), Placing(layout)
        self._plots = [*profile_plots(layout), *joint_plots(layout)]
        nothing = np.zeros((1, layout.width), np.int64)
        curves = [(plot, list(plot.curves(layout, nothing))) for plot in self._plots]
        things = [
            {
                "name": thing.name, "points": thing.points, "colors": _colors(thing), "labels": thing.labels,
                "links": thing.links, "groups": thing.groups, "radii": thing.radii, "solid": thing.solid,
                "law": thing.law, "thick": thing.thick, "said": said(layout, thing.name),
                "parts": [{"link": number} | asdict(solid) for number, solid in thing.parts],
            }
            for thing in self._solids.things
        ]  # fmt: skip
        rate = layout.meta["rate"]
        self.scene: dict[str, Any] = {
            "kind": "scene", "name": str(layout.meta.get("name", "")), "rate": rate[0] / rate[1],
            "simulated": layout.simulated, "things": things, "palette": PALETTE, "ramp": RAMP,
            "unknown": UNKNOWN, "frames": list(self._placing.frames),
            "scenery": _scenery(layout, self._solids.things), "solid": three.there(), "plots": [
                {"title": said(layout, p.title), "unit": p.unit, "labels": labels}
                for p, labels in [*curves, (TIMING, list(TIMING.lines))]
            ],
        }  # fmt: skip

    def frame(self, row: Words, timing: list[float]) -> dict[str, Any]:
        """What a page shows of a row (width,); null stands for what isn't finite.

        Returns:
            `things`: points as x y z after each other, m; or capsules as two ends, radius, distance, m.
            `links`: by thing, a robot's links as the first three rows of (4, 4), m; None of others. `frames`: likewise.
            `curves`: the numbers of each plot, and last `timing`. `cycle`, `state`, and `ages` of the devices in ms.
        """
        placed = self._solids.links(row)
        things = [_numbers(values, 4) for values in self._solids.of(row, placed)]
        curves = [np.array([v[0] for v in p.curves(self.layout, row[None]).values()]) for p in self._plots]
        now = int(self.layout.header(row, "now"))
        stamps = {name: int(self.layout.header(row, f"{name}.stamp")) for name in self.layout.devices}
        links = [None] * (len(things) - len(placed)) + [_numbers(places[:, :3], 4) for places in placed]
        frames = [_numbers(self._placing.to_root(row, name)[:3], 4) for name in self._placing.frames]
        return {
            "things": things, "links": links, "frames": frames,
            "curves": [*(_numbers(values, 5) for values in curves), timing],
            "cycle": int(self.layout.header(row, "cycle")), "state": _state(int(self.layout.header(row, "state"))),
            "ages": {name: (now - stamp) / 1e6 if stamp >= 0 else None for name, stamp in stamps.items()},
        }  # fmt: skip


def _colors(thing: Thing) -> list[Color]:
    """One for each row, or one for all; none where the distance gives the colours."""
    found = colors(thing.numbers)
    if not any(thing.thick):
        return found
    each = found * len(thing.thick) if len(found) == 1 else found
    return [PERSON if thick else color for thick, color in zip(thing.thick, each, strict=True)]


def _scenery(layout: Layout, things: list[Thing]) -> list[dict[str, Any]]:
    """The simulated world's objects that never move, as the parts of a robot; not those that are drawn as one."""
    drawn = {thing.name for thing in things if thing.parts}
    return [
        {
            "kind": solid["kind"], "size": solid["size"], "pose": [*solid["position"], *solid["quaternion"]],
            "color": [round(255 * c) for c in solid["colour"][:3]],
        }
        for solid in layout.meta.get("scenery", ()) if solid.get("part") not in drawn
    ]  # fmt: skip


def _numbers(values: Array, digits: int) -> list[float | None]:
    flat = values.ravel()
    rounded: list[float | None] = np.round(flat, digits).tolist()
    if not np.isfinite(flat).all():
        return [value if ok else None for value, ok in zip(rounded, np.isfinite(flat), strict=True)]
    return rounded


def _state(number: int) -> str:
    return next((s.name.lower().replace("_", " ") for s in State if s == number), str(number))
