"""`srl export`: writes what a recording holds as a file of other programs."""

from __future__ import annotations

import argparse
import json
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING

from srl.runtime.cli import add_command, options
from srl.runtime.cli.status import working
from srl.runtime.contracts.errors import ProfileError, RequestError, SrlError

if TYPE_CHECKING:
    from srl.runtime.recording.reader import Recording

STILLS = 10  # instants, unless they are given
OUTPUTS = ("rrd", "figure", "bvh", "stills", "film", "tree")
SIDES = ("front", "back", "left", "right")


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Registers the command."""
    parser = add_command(
        subparsers,
        "export",
        "srl export run.rrd --parquet run.parquet --mcap run.mcap",
    )
    options.recording(parser)
    parser.add_argument(
        "--rrd", metavar="FILE", type=Path, help="a recording that rerun shows, of segments made where rerun isn't"
    )
    parser.add_argument("--parquet", metavar="FILE", type=Path, help="a table: a row a cycle, a column a number")
    parser.add_argument("--mcap", metavar="FILE", type=Path, help="ROS 2's messages, for Foxglove and PlotJuggler")
    parser.add_argument("--c3d", metavar="FILE", type=Path, help="a body's points and the devices' other numbers")
    parser.add_argument("--mat", metavar="FILE", type=Path, help="all signals, for MATLAB")
    parser.add_argument("--trc", metavar="FILE", type=Path, help="a body's points, for OpenSim")
    parser.add_argument("--mot", metavar="FILE", type=Path, help="joint positions in degrees, for OpenSim")
    parser.add_argument("--bids", metavar="FOLDER", type=Path, help="a data set in BIDS-Motion, made or added to")
    parser.add_argument("--person", metavar="ID", help="with --bids: whose it is, where the recording doesn't say")
    parser.add_argument("--bvh", metavar="FILE", type=Path, help="the moving skeleton (law skeleton)")
    options.run_code(parser, False)
    parser.add_argument("--page", metavar="FILE.png", type=Path, help="with --bvh: a picture of the file's text")
    parser.add_argument("--tree", metavar="FILE.png", type=Path, help="a picture of the skeleton's node tree")
    options.figure(parser, "draw what happened: commands, the profile's plots, states, timing")
    parser.add_argument("--stills", metavar="FILE.png", type=Path, help="pictures at ten instants, side by side")
    parser.add_argument(
        "--at", metavar="S", type=float, nargs="+", help="the instants of --stills, s from the beginning"
    )
    parser.add_argument("--film", metavar="FILE.gif", type=Path, help="a moving picture")
    parser.add_argument(
        "--between", metavar="S", type=float, nargs=2,
        help="begin and end of --film, s from the beginning; default: while the limb was active",
    )  # fmt: skip
    parser.add_argument(
        "--show", metavar="NAME", nargs="+", help="in pictures: these signals or parts only, e.g. 'right SRL'"
    )
    parser.add_argument(
        "--names", metavar="PART", nargs="+", help="with --stills: names the nodes of these parts, e.g. 'right SRL'"
    )
    parser.add_argument("--side", choices=SIDES, help="whence one looks; default: front, a bit aside")
    parser.add_argument(
        "--rate", metavar="HZ", help="frames per second; default: the profile's rate for --bvh, 12.5 for --film"
    )
    parser.add_argument("--law", metavar="NAME", help="the law whose inputs are written, where there are several")
    options.as_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Returns 0."""
    from srl.runtime.export.formats import ENDINGS, FORMATS

    forms = (*FORMATS, *OUTPUTS)
    if all(getattr(args, form) is None for form in forms):
        problem = "nothing is to be written"
        raise RequestError(", ".join(f"--{form}" for form in forms), problem, "Add --parquet FILE, or another")
    for form, ending in ENDINGS.items():
        if getattr(args, form) is not None and getattr(args, form).suffix != ending:
            problem = f"the name {getattr(args, form)} doesn't end in {ending}"
            raise RequestError(f"--{form}", problem, f"Name it like run{ending}")
    for form in (*forms, "page"):
        target = getattr(args, form)
        if form == "rrd" and target is not None and target.suffix != ".rrd":
            raise RequestError("--rrd", f"the name {target} doesn't end in .rrd", "Name it like run.rrd")
        if target is not None and (
            (target.suffix == ".rrd" and form != "rrd") or target.resolve() == args.recording.resolve()
        ):
            raise RequestError(f"--{form}", f"{target} is a recording, and would be lost", "Choose another name")
    for option, needed in (
        ("rate", ("bvh", "film", "c3d", "trc", "mot")), ("person", ("bids",)), ("law", ("bvh",)), ("page", ("bvh",)),
        ("at", ("stills",)), ("names", ("stills",)), ("side", ("stills", "film")), ("between", ("film",)),
        ("show", ("stills", "film", "tree", "page")),
    ):  # fmt: skip
        if getattr(args, option) is not None and all(getattr(args, other) is None for other in needed):
            others = ", ".join(f"--{other}" for other in needed)
            raise RequestError(f"--{option}", f"it is for {others}", f"Add --{needed[0]} FILE, or leave it out")
    options.check_figure(args.figure)
    options.check_person(args.person)
    metrics: dict[str, object] = {"recording": str(args.recording)}
    lines: list[str] = []
    try:
        with working(f"{args.recording} is exported"):
            missing = _export(args, metrics, lines)
    except SrlError:
        for line in lines:  # what was written before is there
            print(line)
        raise
    if args.json:
        print(json.dumps(metrics))
        return 0
    if missing:
        print(f"{missing} rows are missing; where a format has no gaps, what was before them is held")
    print("\n".join(lines))
    return 0


def _export(args: argparse.Namespace, metrics: dict[str, object], lines: list[str]) -> int:
    """Writes what is asked for, with the figures and the lines about it; returns the number of missing rows."""
    from srl.runtime.recording.reader import read

    if args.rrd is not None:
        from srl.runtime.recorder.converted import convert

        rows, left_out = convert(args.recording, args.rrd)
    recording = read(args.recording)
    missing = sum(last - first + 1 for first, last in recording.missing)
    metrics["missing_rows"] = missing
    _data(recording, args, metrics, lines)
    if args.rrd is not None:
        metrics["rrd"] = str(args.rrd)
        lines += [f"{args.rrd}: {rows} rows", *(f"not whole: {line}" for line in left_out)]
    if args.bvh is not None:
        frames, law, period = _bvh(recording, args)
        metrics |= {"frames": frames, "period": period, "law": law, "file": str(args.bvh)}
        lines.append(f"{args.bvh}: {frames} frames of {law}, {1.0 / period:g} a second")
    if args.figure is not None:
        from srl.runtime.pictures.figure import draw

        draw(recording, args.figure)
        metrics["figure"] = str(args.figure)
        lines.append(f"{args.figure}: {len(recording.rows)} cycles")
    if args.page is not None:
        from srl.runtime.pictures.bvh_page import draw_page

        draw_page(recording, args.bvh, args.page, args.show or ())
        metrics["page"] = str(args.page)
        lines.append(f"{args.page}: the beginning of {args.bvh}")
    if args.tree is not None:
        from srl.runtime.pictures.node_tree import draw_tree

        metrics |= {"tree": str(args.tree), "nodes": (nodes := draw_tree(recording, args.tree, args.show or ()))}
        lines.append(f"{args.tree}: {nodes} nodes")
    if args.stills is not None:
        from srl.runtime.pictures import stills

        times = args.at if args.at is not None else stills.spread(recording, STILLS)
        stills.draw(recording, args.stills, times, args.names or (), args.show or (), args.side)
        metrics |= {"stills": str(args.stills), "at": times}
        lines.append(f"{args.stills}: {len(times)} instants")
    if args.film is not None:
        from srl.runtime.pictures import film

        rate = film.RATE if args.rate is None else float(_rate(args.rate))
        between = None if args.between is None else (args.between[0], args.between[1])
        count, period = film.draw(recording, args.film, between, rate, tuple(args.show or ()), args.side)
        metrics |= {"film": str(args.film), "pictures": count, "film_period": period}
        lines.append(f"{args.film}: {count} pictures, {1.0 / period:g} a second")
    return missing


def _data(recording: Recording, args: argparse.Namespace, metrics: dict[str, object], lines: list[str]) -> None:
    """Writes the files of data, and adds what to say of them."""
    from srl.runtime.export import formats

    for form in formats.FORMATS:
        target = getattr(args, form)
        if target is None:
            continue
        rate = _rate(args.rate) if args.rate is not None else None
        report = formats.write(form, recording, target, rate=rate, person=args.person)
        metrics[form] = {"files": [str(p) for p in report.files], "left_out": report.left_out}
        lines.append(f"{target}: {report.content}")
        lines += [f"  left out: {line}" for line in report.left_out]


def _bvh(recording: Recording, args: argparse.Namespace) -> tuple[int, str, float]:
    """Writes the file; returns the number of frames, the law's name, and s between frames."""
    import numpy as np

    from srl.runtime.loop.law_inputs import LawInputs

    given = LawInputs(recording.layout, str(args.recording), args.run_code)
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
