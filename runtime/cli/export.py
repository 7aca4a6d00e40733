"""`srl export`: writes what a recording holds as a file of other programs."""

from __future__ import annotations

import argparse
import json
from fractions import Fraction
from pathlib import Path

from runtime.cli import add_command
from runtime.contracts.errors import ProfileError


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Registers the command."""
    parser = add_command(
        subparsers, "export", "writes a recording as a file of other programs", "srl export run.rrd --bvh run.bvh"
    )
    parser.add_argument("recording", type=Path, help="FILE.rrd, or a folder of segments (a torn tail is salvaged)")
    parser.add_argument("--bvh", metavar="FILE", type=Path, required=True, help="the moving skeleton (law skeleton)")
    parser.add_argument("--rate", metavar="HZ", help="frames per second; default: the profile's rate")
    parser.add_argument("--law", metavar="NAME", help="the law whose inputs are written, where there are several")
    parser.add_argument("--json", action="store_true", help="one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Returns 0."""
    import numpy as np

    from runtime.loop.law_inputs import LawInputs
    from runtime.recording.reader import read

    recording = read(args.recording)
    place = str(args.recording)
    given = LawInputs(recording.layout, place)
    law = given.exporting("bvh", args.law)
    period = float(1 / (_rate(args.rate) if args.rate is not None else Fraction(*recording.layout.meta["rate"])))
    now = (recording.int("now") - recording.int("now")[0]) / 1e9
    # The newest row at each frame's time; a millionth of a period makes up for rounding.
    times = np.arange(int(now[-1] / period + 1e-6) + 1) * period
    at = np.searchsorted(now, times + 1e-6 * period, "right") - 1
    frames = law.export("bvh", given.of(law, recording.rows[at]), period, args.bvh)
    missing = sum(last - first + 1 for first, last in recording.missing)
    if args.json:
        figures = {"frames": frames, "period": period, "law": law.name, "missing_rows": missing}
        print(json.dumps(figures | {"recording": place, "file": str(args.bvh)}))
        return 0
    if missing:
        print(f"{missing} rows are missing; the pose before them is held")
    print(f"{args.bvh}: {frames} frames of {law.name}, {1.0 / period:g} a second")
    return 0


def _rate(text: str) -> Fraction:
    try:
        rate = Fraction(text)
    except (ValueError, ZeroDivisionError):
        rate = Fraction(0)
    if not 0.1 <= rate <= 10000:
        raise ProfileError("--rate", f"'{text}' is no rate from 0.1 to 10000 Hz", "Give frames per second, such as 60")
    return rate
