"""The text of a BVH file as a picture: its beginning, the blocks of parts that are shown, and its motion."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.pictures.chosen import chosen
from srl.runtime.recording.reader import Recording
from srl.runtime.recording.solids import Solids

ACROSS, FRAMES = 92, 3  # letters of a line, frames of the motion; what is beyond them is left out
FONT, LETTER, LINE = 7, 0.0625, 0.135  # points; inches of a letter and of a line
LEFT_OUT = "..."
KEYWORD = re.compile(r"HIERARCHY|ROOT|JOINT|End Site|OFFSET|CHANNELS|MOTION|Frames:|Frame Time:")


def draw_page(recording: Recording, bvh: Path, png: Path, show: Sequence[str] = ()) -> None:
    """Draws the file that was written of a recording; keywords are bold.

    Args:
        recording: says which nodes the parts have.
        bvh: the file.
        png: where.
        show: parts of the body, or their signal, whose nodes' blocks are drawn; none: the first branch alone.
    Raises:
        RecordingError: no such part, it can't be written.
    """
    things = [thing for thing in Solids(recording.layout).things if thing.groups]
    names = {things[i].labels[k] for i, rows in chosen(things, show).items() for k in rows} if show else set()
    lines = excerpt(bvh.read_text(encoding="ascii").splitlines(), names)
    figure = plt.figure(figsize=(LETTER * ACROSS + 0.3, LINE * len(lines) + 0.3))
    try:
        width, height = figure.get_size_inches()
        for i, line in enumerate(lines):
            bold = "".join(c if any(m.start() <= k < m.end() for m in KEYWORD.finditer(line)) else " "
                           for k, c in enumerate(line))  # fmt: skip
            plain = "".join(" " if b != " " else c for b, c in zip(bold, line, strict=True))
            for text, weight in ((bold, "bold"), (plain, "normal")):
                figure.text(
                    0.15 / width, 1.0 - (0.15 + LINE * (i + 0.8)) / height, text, fontsize=FONT, weight=weight,
                    family="monospace", va="baseline",
                )  # fmt: skip
        figure.savefig(png, dpi=130, format="png")
    except OSError as error:
        raise RecordingError(str(png), f"it can't be written: {error.strerror}", "Choose another place") from None
    finally:
        plt.close(figure)


def excerpt(lines: Sequence[str], names: Collection[str]) -> list[str]:
    """Of a file's lines: the named joints with those on which they hang (none: the first branch), and some motion."""
    motion = lines.index("MOTION")
    paths = _paths(lines[:motion])
    branch = paths[[line.strip() for line in lines].index("End Site")]
    wanted = [path for path in paths if path and path[-1] in names] or [branch]
    kept = {path[:k] for path in wanted for k in range(len(path) + 1)}
    found: list[str] = []
    for line, path in zip(lines, paths, strict=False):
        if path in kept:
            found.append(line)
        elif not found[-1].endswith(LEFT_OUT):
            found.append(line[: len(line) - len(line.lstrip())] + LEFT_OUT)
    found += lines[motion : motion + 3 + FRAMES]
    if len(lines) > motion + 3 + FRAMES:
        found.append(LEFT_OUT)
    found = [line.replace("\t", "  ") for line in found]
    return [line if len(line) <= ACROSS else f"{line[: ACROSS - len(LEFT_OUT) - 1]} {LEFT_OUT}" for line in found]


def _paths(head: Sequence[str]) -> list[tuple[str, ...]]:
    """For each line of the hierarchy the joints whose block it is in, from the root on; an end site is its joint's."""
    found: list[tuple[str, ...]] = []
    opened: list[str] = []
    title = ""
    for line in head:
        kind, _, name = line.strip().partition(" ")
        if kind in ("ROOT", "JOINT", "End"):
            title = opened[-1] if kind == "End" else name
            found.append((*opened, title) if kind != "End" else tuple(opened))
            continue
        if kind == "{":
            opened.append(title)
        found.append(tuple(dict.fromkeys(opened)))
        if kind == "}":
            opened.pop()
    return found
