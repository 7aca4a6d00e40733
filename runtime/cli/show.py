"""`srl show`: a profile as the runtime understands it, as text, JSON or a picture. Opens nothing."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from srl.runtime.cli import add_command
from srl.runtime.cli.check import check_certificates, check_guards
from srl.runtime.cli.show_text import SECTIONS, text
from srl.runtime.contracts.errors import RequestError
from srl.runtime.loop.guards import limits_of
from srl.runtime.overview.overview import overview
from srl.runtime.profile import profile, wiring


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Registers the command."""
    parser = add_command(subparsers, "show", "srl show sixth-finger --sim --png sixth-finger.png")
    parser.add_argument("profile", help="a name under profiles/, or a path to a YAML file")
    parser.add_argument("--sim", nargs="*", metavar="DEVICE", help="as for run: simulate these devices, or all")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="as for run")
    parser.add_argument("--png", metavar="FILE.png", type=Path, help="a picture: the wiring and the tree of frames")
    parser.add_argument("--json", action="store_true", help="one JSON object with all of it")
    only = parser.add_mutually_exclusive_group()
    for section, what in SECTIONS.items():
        only.add_argument(f"--{section}", dest="only", action="store_const", const=section, help=f"only {what}")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Prints what the profile is once it is wired, and returns 0. Raises what `srl check` raises."""
    if args.png is not None and args.png.suffix != ".png":
        problem = f"the name {args.png} doesn't end in .png"
        raise RequestError("--png", problem, f"Name it like {args.profile.rpartition('/')[2].partition('.')[0]}.png")
    if args.json and args.only is not None:
        problem = "--json has all of it, and so no parts to choose from"
        raise RequestError(f"--{args.only}", problem, "Leave one of the two out")
    checked, source = profile.load(args.profile, args.set)
    graph = wiring.build(checked, source, args.sim)
    check_guards(graph)
    check_certificates(graph)
    found = overview(graph, limits_of(graph))
    if args.png is not None:
        from srl.runtime.pictures.overview_picture import draw_overview

        draw_overview(found, args.png)
    if args.json:
        print(json.dumps(found | ({"png": str(args.png)} if args.png is not None else {}), allow_nan=False))
        return 0
    print("\n".join(text(found, [args.only] if args.only else list(SECTIONS))))
    if args.png is not None:
        print(f"{args.png}: the wiring and the frames")
    return 0
