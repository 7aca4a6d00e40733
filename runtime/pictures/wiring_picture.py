"""The wiring of a profile as boxes and arrows: what measures, the laws, the guard of each command, what moves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.font_manager import FontProperties
from matplotlib.patches import FancyBboxPatch, PathPatch
from matplotlib.path import Path
from matplotlib.textpath import TextPath

from srl.runtime.pictures.figure import COLORS
from srl.runtime.pictures.wiring_layout import HEAD, NOTE, ROW, Arrow, Box, columns

Item = Mapping[str, Any]
FONT, TITLE, SMALL = 7.0, 7.5, 6.0  # points: ports, titles, notes
EDGES = {"source": "#009E73", "law": "#0072B2", "guard": "#D55E00", "device": "#444444"}
HEADS = {"source": "what measures or asks", "law": "laws", "guard": "guard", "device": "what moves"}
MOST = 40  # letters of a line of notes
ABOVE = 0.3  # inches above the boxes, for the columns' heads
Wire = tuple[Box, str, Box, str]
POINTS = 72.0  # in an inch


@dataclass
class Wiring:
    """A wiring that is laid out. `width` and `height`, inches, are those that `paint` needs."""

    made: list[list[Box]]
    arrows: list[Arrow]

    @property
    def width(self) -> float:
        return max((box.x + box.width for column in self.made for box in column), default=1.0)

    @property
    def height(self) -> float:
        return max((box.y + box.height for column in self.made for box in column), default=1.0) + ABOVE


def laid_out(overview: Item) -> Wiring:
    """Lays out the wiring of `srl.runtime.overview.overview.overview`."""
    boxes, wires = _graph(overview)
    for box in boxes:
        box.width = _width(box)
    return Wiring(*columns(boxes, wires))


def paint(axis: Any, wiring: Wiring) -> None:
    """Draws on an axis whose unit is an inch, y downwards, from -ABOVE."""
    owners = [box for column in wiring.made for box in column if box.kind in ("source", "law", "guard")]
    signals = list(dict.fromkeys((a.source, a.signal) for box in owners for a in wiring.arrows if a.source is box))
    colors = {signal: COLORS[i % len(COLORS)] for i, signal in enumerate(signals)}
    for arrow in wiring.arrows:
        _draw_arrow(axis, arrow, colors[arrow.source, arrow.signal])
    for column in wiring.made:
        for box in column:
            if box.kind == "slot":
                color = next(colors[a.source, a.signal] for a in wiring.arrows if a.end is box)
                middle = box.y + box.height / 2.0
                axis.plot([box.x, box.x + box.width], [middle, middle], color=color, linewidth=0.9, zorder=1)
            else:
                _draw_box(axis, box)
        kinds = list(dict.fromkeys(box.kind for box in column if box.kind != "slot"))
        if kinds:
            head = " / ".join(HEADS[kind] for kind in kinds)
            x = column[0].x + column[0].width / 2.0
            axis.text(x, -0.2, head, fontsize=FONT, ha="center", va="center", color="0.4", style="italic")


def _graph(overview: Item) -> tuple[list[Box], list[Wire]]:
    """The boxes with their columns, and the wires between their ports."""
    taken, made = _taken(overview), dict[str, list[Box]]()
    boxes: list[Box] = []
    for device in overview["devices"]:
        if device["states"]:
            boxes.append(_source(_named(device), device["states"], taken, made))
    for name in dict.fromkeys(each["name"].partition(".")[0] for each in overview["clients"]):
        signals = [each for each in overview["clients"] if each["name"].partition(".")[0] == name]
        boxes.append(_source(f"{name} (client of the bus)", signals, taken, made))
    wires: list[Wire] = []
    for law in overview["laws"]:
        boxes.append(_law(law, taken, made, wires))
    last = 1 + max((box.column for box in boxes), default=0)
    takers: dict[str, Box] = {}
    for command in overview["commands"]:
        guard = Box(command["name"], "guard", column=last, right={"applied": "applied"}, notes=_limits(command))
        for ending, label in (("", "asked"), (".velocity", "its rate"), (".gravity", "its gravity part")):
            _connect(guard, label, label, [command["name"] + ending], made, wires)
        for wire in (command["clear"] or {}).get("reads", ()):
            _connect(guard, f"clear {wire['port']}", f"clear of: {wire['port']}", wire["signals"], made, wires)
        device = next(device for device in overview["devices"] if device["name"] == command["device"])
        taker = takers.setdefault(device["name"], Box(_named(device), "device", column=last + 1))
        short = command["name"].partition(".")[2]
        taker.left[short] = short
        wires.append((guard, "applied", taker, short))
        boxes.append(guard)
    return [*boxes, *takers.values()], wires


def _named(device: Item) -> str:
    return f"{device['name']} ({device['driver']}{', simulated' if device['simulated'] else ''})"


def _law(law: Item, taken: set[str], made: dict[str, list[Box]], wires: list[Wire]) -> Box:
    box = Box(f"{law['name']} ({law['use']})" if law["name"] != law["use"] else law["name"], "law")
    for wire in law["reads"]:
        _connect(box, wire["port"], wire["port"], wire["signals"], made, wires)
    for need in law["needs"]:  # a frame that is fixed has no wire
        _connect(box, need["name"], f"{need['of']} in {need['into']}", need["measured_by"], made, wires)
    box.column = 1 + max((start.column for start, _, end, _ in wires if end is box), default=0)
    rest = []
    for wire in law["writes"]:
        for signal in wire["signals"]:
            if signal in taken:
                box.right[signal] = wire["port"]
                made.setdefault(signal, []).append(box)
            else:
                rest.append(wire["port"])
    live = [p["name"].partition(".")[2] for p in law["parameters"]]
    box.notes = _lines("no law reads: ", rest) + _lines("live: ", live)
    return box


def _taken(overview: Item) -> set[str]:
    """The signals that a law or a guard reads."""
    found = {s for law in overview["laws"] for wire in law["reads"] for s in wire["signals"]}
    found |= {s for law in overview["laws"] for need in law["needs"] for s in need["measured_by"]}
    found |= {s for c in overview["commands"] for wire in (c["clear"] or {}).get("reads", ()) for s in wire["signals"]}
    commands = [command["name"] for command in overview["commands"]]
    return found | {name + ending for name in commands for ending in ("", ".velocity", ".gravity")}


def _source(title: str, signals: Sequence[Item], taken: set[str], made: dict[str, list[Box]]) -> Box:
    box, rest = Box(title, "source"), []
    for signal in signals:
        short = signal["name"].partition(".")[2]
        if signal["name"] in taken:
            shape = "x".join(map(str, signal["shape"]))
            box.right[signal["name"]] = f"{short}  {shape} {signal['unit']}"
            made[signal["name"]] = [box]
        else:
            rest.append(short)
    box.notes = _lines("no law reads: ", rest)
    return box


def _connect(
    box: Box, key: str, label: str, signals: Sequence[str], made: Mapping[str, list[Box]], wires: list[Wire]
) -> None:
    """A port, and a wire from each box that writes one of its signals; no port where nobody writes any."""
    found = [(start, signal, box, key) for signal in signals for start in made.get(signal, ())]
    if found:
        box.left[key] = label
        wires += found


def _limits(command: Item) -> list[str]:
    """A line for each limit: the least and the largest; "by joint" where not all elements have the same."""
    found = []
    limits = command["limits"]
    if command["kind"] == "position" and not {"lower", "upper"} & set(limits):
        found.append("no bound of the position yet")  # the device may give one once it is open
    for name, limit in limits.items():
        if name == "upper" and "lower" in limits:
            continue
        both = name == "lower" and "upper" in limits
        by_unit: dict[str, list[float | None]] = {}
        for element, unit in limit["units"].items():
            values = [limit["values"][element]]
            values += [limits["upper"]["values"][element]] if both else []
            by_unit.setdefault(unit, []).extend(values)
        for unit, values in by_unit.items():
            what = "position" if both else name.replace("_", " ")
            found.append(f"{what} {_span(values, unit, 1 + both)}")
    clear = [f"keeps clear: {command['clear']['use']}"] if command["clear"] else []
    return [*found, *clear, f"stop: {command['stop']}"]


def _span(values: Sequence[float | None], unit: str, alike: int) -> str:
    """The least and the largest of some elements' values; `alike`: how many differ where the elements don't."""
    known = [value for value in values if value is not None]
    if not known:
        return f"unbounded yet ({unit})"
    low, high = min(known), max(known)
    span = f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
    if len(known) < len(values):
        return f"{span} {unit}, some unbounded"
    return f"{span} {unit}" + ", by joint" * (len(set(known)) > alike)


def _lines(begin: str, names: Sequence[str]) -> list[str]:
    """Names, wrapped; none: no line."""
    if not names:
        return []
    lines = [begin]
    for i, name in enumerate(names):
        word = name + (", " if i < len(names) - 1 else "")
        if len(lines[-1]) + len(word) > MOST:
            lines.append("  ")
        lines[-1] += word
    return lines


def long(words: str, size: float, weight: str = "normal") -> float:
    """Inches."""
    if not words.strip():
        return 0.0
    path = TextPath((0.0, 0.0), words, size=size, prop=FontProperties(weight=weight))
    return float(np.ptp(path.vertices[:, 0])) / POINTS


def _width(box: Box) -> float:
    rows = [long(a, FONT) for a in box.left.values()], [long(b, FONT) for b in box.right.values()]
    ports = max(rows[0], default=0.0) + max(rows[1], default=0.0) + (0.2 if rows[0] and rows[1] else 0.0)
    notes = max((long(line, SMALL) for line in box.notes), default=0.0)
    return max(long(box.title, TITLE, "bold"), ports, notes) + 0.22


def _draw_box(axis: Any, box: Box) -> None:
    color = EDGES[box.kind]
    frame = FancyBboxPatch(
        (box.x, box.y), box.width, box.height, boxstyle="round,pad=0,rounding_size=0.05", facecolor="white",
        edgecolor=color, linewidth=1.0, zorder=3,
    )  # fmt: skip
    axis.add_patch(frame)
    axis.text(
        box.x + box.width / 2.0, box.y + 0.13, box.title, fontsize=TITLE, ha="center", va="center", color=color,
        weight="bold", zorder=4,
    )  # fmt: skip
    for side, labels, x in (("left", box.left, box.x + 0.07), ("right", box.right, box.x + box.width - 0.07)):
        for key, label in labels.items():
            y = box.y + box.port(side, key)
            axis.text(x, y, label, fontsize=FONT, ha=side, va="center", color="#222222", zorder=4)
    y = box.y + HEAD + ROW * max(len(box.left), len(box.right))
    for i, line in enumerate(box.notes):
        axis.text(box.x + 0.07, y + NOTE * (i + 0.5), line, fontsize=SMALL, va="center", color="0.45", zorder=4)


def _draw_arrow(axis: Any, arrow: Arrow, color: str) -> None:
    x, y = arrow.start.x + arrow.start.width, arrow.start.y + arrow.start.port("right", arrow.begin)
    end, level = arrow.end.x, arrow.end.y + arrow.end.port("left", arrow.at)
    tip = end if arrow.end.kind == "slot" else end - 0.08
    middle = (x + tip) / 2.0
    places = np.array([(x, y), (middle, y), (middle, level), (tip, level)])
    curve = Path(places, [Path.MOVETO, Path.CURVE4, Path.CURVE4, Path.CURVE4])
    axis.add_patch(PathPatch(curve, facecolor="none", edgecolor=color, linewidth=0.9, zorder=2))
    if tip < end:
        axis.fill([end, tip, tip], [level, level + 0.035, level - 0.035], color=color, linewidth=0.0, zorder=2)
