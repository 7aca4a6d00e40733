"""The node tree of a recorded skeleton, as a picture: parents above, children below."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.pictures.chosen import chosen
from srl.runtime.pictures.figure import COLORS
from srl.runtime.recording.reader import Recording
from srl.runtime.recording.solids import Solids

FONT, LETTER = 7, 0.062  # points; inches of one letter in a box
LEVEL = 0.4  # inches from a node to its children
FRAME, TITLE = 0.35, 2.6  # inches around; inches that the title and the legend need


def draw_tree(recording: Recording, png: Path, show: Sequence[str] = ()) -> int:
    """Draws the tree of the skeleton, or of the parts that are shown with the node on which they hang.

    Args:
        recording: whose layout has a signal with labels, links and groups, a parent's row before its children's.
        png: where.
        show: parts of the body (`Signal.groups`), or the signal; none: all of the first signal that is a tree.
    Returns:
        The number of nodes drawn.
    Raises:
        RecordingError: no signal is a tree, no such part, it can't be written.
    """
    things = Solids(recording.layout).things
    trees = [i for i, thing in enumerate(things) if thing.groups and thing.links and thing.labels]
    if not trees:
        raise RecordingError(str(recording.path), "no signal in it is a skeleton", "Record a profile with `skeleton`")
    rows = chosen([things[i] for i in trees], show)
    thing, drawn = next((things[i], rows[n]) for n, i in enumerate(trees) if n in rows)
    parent = {max(pair): min(pair) for link in thing.links for pair in pairwise(link)}
    carriers = {parent[i] for i in drawn if i in parent} - set(drawn)
    shown = sorted({*drawn, *carriers})
    below = {i: [j for j in shown if parent.get(j) == i] for i in shown}
    place = _places(below, [i for i in shown if parent.get(i) not in below])
    column = LETTER * max(len(thing.labels[i]) for i in shown) + 0.15
    across, deep = (1 + max(xy[k] for xy in place.values()) for k in (0, 1))
    size = (max(column * across, TITLE) + 2 * FRAME, LEVEL * deep + 2 * FRAME)
    figure, axis = plt.subplots(figsize=size, layout="constrained")
    try:
        axis.axis("off")
        for i in shown:
            x, y = place[i]
            color = "0.5" if i in carriers else COLORS[thing.numbers[i] % len(COLORS)]
            for j in below[i]:
                middle = (y + place[j][1]) / 2
                axis.plot([x, x, place[j][0], place[j][0]], [-y, -middle, -middle, -place[j][1]], color="0.5", lw=0.8)
            box = {"boxstyle": "round,pad=0.25", "facecolor": "white", "edgecolor": color}
            axis.text(x, -y, thing.labels[i], fontsize=FONT, ha="center", va="center", bbox=box, zorder=3)
        axis.set_xlim(-0.5, across - 0.5)
        axis.set_ylim(0.5 - deep, 0.5)
        parts = list(dict.fromkeys(thing.groups[i] for i in shown if i not in carriers))
        numbers = {part: thing.numbers[thing.groups.index(part)] for part in parts}
        lines = [plt.Line2D([], [], color=COLORS[n % len(COLORS)], linewidth=3) for n in numbers.values()]
        figure.legend(lines, numbers, loc="outside lower center", ncols=len(parts), fontsize=8, frameon=False)
        segments = sum(map(len, below.values()))
        figure.suptitle(f"{thing.name}: {len(shown)} nodes, {segments} segments", fontsize=9)
        figure.savefig(png, dpi=130, format="png")
    except OSError as error:
        raise RecordingError(str(png), f"it can't be written: {error.strerror}", "Choose another place") from None
    finally:
        plt.close(figure)
    return len(shown)


def _places(below: Mapping[int, Sequence[int]], roots: Sequence[int]) -> dict[int, tuple[float, int]]:
    """Column and depth of each node: leaves side by side, a parent in the middle above its children."""
    place: dict[int, tuple[float, int]] = {}
    free = 0

    def put(i: int, depth: int) -> float:
        nonlocal free
        if below[i]:
            columns = [put(j, depth + 1) for j in below[i]]
            x = (columns[0] + columns[-1]) / 2
        else:
            x, free = float(free), free + 1
        place[i] = (x, depth)
        return x

    for root in roots:
        put(root, 0)
    return place
