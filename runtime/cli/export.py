"""`srl export`: writes what a recording holds as a file of other programs."""

from __future__ import annotations

import argparse
import json
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING

from runtime.cli import add_command
from runtime.contracts.errors import ProfileError, RequestError

if TYPE_CHECKING:
    from runtime.recording.reader import Recording

STILLS = 10  # instants, unless they are given
SIDES = ("front", "back", "left", "right")


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Registers the command."""
    parser = add_command(
        subparsers,
        "export",
        "writes a recording as a file of other programs, or as pictures",
        "srl export run.rrd --bvh run.bvh --stills run.png --tree tree.png",
    )
    parser.add_argument("recording", type=Path, help="FILE.rrd, or a folder of segments (a torn tail is salvaged)")
    parser.add_argument("--bvh", metavar="FILE", type=Path, help="the moving skeleton (law skeleton)")
    parser.add_argument("--page", metavar="FILE.png", type=Path, help="with --bvh: a picture of the file's text")
    parser.add_argument("--tree", metavar="FILE.png", type=Path, help="a picture of the skeleton's node tree")
    parser.add_argument("--stills", metavar="FILE.png", type=Path, help="pictures at ten instants, side by side")
    parser.add_argument(
        "--at", metavar="S", type=float, nargs="+", help="the instants of --stills, s from the beginning"
    )
    parser.add_argument(
        "--show", metavar="NAME", nargs="+", help="in pictures: these signals or parts only, e.g. 'right SRL'"
    )
    parser.add_argument(
        "--names", metavar="PART", nargs="+", help="with --stills: names the nodes of these parts, e.g. 'right SRL'"
    )
    parser.add_argument("--side", choices=SIDES, help="with --stills: whence one looks; default: front, a bit aside")
    parser.add_argument("--rate", metavar="HZ", help="frames per second; default: the profile's rate")
    parser.add_argument("--law", metavar="NAME", help="the law whose inputs are written, where there are several")
    parser.add_argument("--json", action="store_true", help="one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Returns 0."""
    from runtime.recording.reader import read

    if args.bvh is None and args.stills is None and args.tree is None:
        raise RequestError(
            "--bvh, --stills, --tree",
            "nothing is to be written",
            "Add --bvh FILE, --stills FILE.png or --tree FILE.png",
        )
    for option, needed in (
        ("rate", ("bvh",)), ("law", ("bvh",)), ("page", ("bvh",)), ("at", ("stills",)), ("names", ("stills",)),
        ("side", ("stills",)), ("show", ("stills", "tree", "page")),
    ):  # fmt: skip
        if getattr(args, option) is not None and all(getattr(args, other) is None for other in needed):
            others = ", ".join(f"--{other}" for other in needed)
            raise RequestError(f"--{option}", f"it is for {others}", f"Add --{needed[0]} FILE, or leave it out")
    recording = read(args.recording)
    missing = sum(last - first + 1 for first, last in recording.missing)
    figures: dict[str, object] = {"recording": str(args.recording), "missing_rows": missing}
    said = []
    if args.bvh is not None:
        frames, law, period = _bvh(recording, args)
        figures |= {"frames": frames, "period": period, "law": law, "file": str(args.bvh)}
        said.append(f"{args.bvh}: {frames} frames of {law}, {1.0 / period:g} a second")
    if args.page is not None:
        from runtime.recorder.bvh_page import draw_page

        draw_page(recording, args.bvh, args.page, args.show or ())
        figures["page"] = str(args.page)
        said.append(f"{args.page}: the beginning of {args.bvh}")
    if args.tree is not None:
        from runtime.recorder.node_tree import draw_tree

        figures |= {"tree": str(args.tree), "nodes": (nodes := draw_tree(recording, args.tree, args.show or ()))}
        said.append(f"{args.tree}: {nodes} nodes")
    if args.stills is not None:
        from runtime.recorder import stills

        times = args.at if args.at is not None else stills.spread(recording, STILLS)
        stills.draw(recording, args.stills, times, args.names or (), args.show or (), args.side)
        figures |= {"stills": str(args.stills), "at": times}
        said.append(f"{args.stills}: {len(times)} instants")
    if args.json:
        print(json.dumps(figures))
        return 0
    if missing:
        print(f"{missing} rows are missing; the pose before them is held")
    print("\n".join(said))
    return 0


def _bvh(recording: Recording, args: argparse.Namespace) -> tuple[int, str, float]:
    """Writes the file; returns the number of frames, the law's name, and s between frames."""
    import numpy as np

    from runtime.loop.law_inputs import LawInputs

    given = LawInputs(recording.layout, str(args.recording))
    law = given.exporting("bvh", args.law)
    period = float(1 / (_rate(args.rate) if args.rate is not None else Fraction(*recording.layout.meta["rate"])))
    now = (recording.int("now") - recording.int("now")[0]) / 1e9
    # The newest row at each frame's time; a millionth of a period makes up for rounding.
    times = np.arange(int(now[-1] / period + 1e-6) + 1) * period
    at = np.searchsorted(now, times + 1e-6 * period, "right") - 1
    return law.export("bvh", given.of(law, recording.rows[at]), period, args.bvh), law.name, period


def _rate(text: str) -> Fraction:
    try:
        rate = Fraction(text)
    except (ValueError, ZeroDivisionError):
        rate = Fraction(0)
    if not 0.1 <= rate <= 10000:
        raise ProfileError("--rate", f"'{text}' is no rate from 0.1 to 10000 Hz", "Give frames per second, such as 60")
    return rate
