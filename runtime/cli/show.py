"""`srl show`: a profile as the runtime understands it, as text, JSON or a picture. Opens nothing."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from srl.runtime.cli import add_command, options
from srl.runtime.cli.check import check_certificates, check_guards
from srl.runtime.cli.show_text import SECTIONS, text
from srl.runtime.contracts.errors import RequestError
from srl.runtime.loop.guards import limits_of
from srl.runtime.overview.overview import overview
from srl.runtime.profile import profile, wiring
from srl.runtime.profile.bus import BusConfig


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Registers the command."""
    parser = add_command(subparsers, "show", "srl show sixth-finger --sim --figure sixth-finger.png")
    options.profile(parser)
    options.sim(parser)
    options.overrides(parser)
    options.figure(parser, "draw the wiring and the tree of frames")
    options.renamed(parser, "--png", "--figure")
    parser.add_argument(
        "--foxglove-layout", metavar="FILE.json", type=Path, help="a layout for Foxglove's app, with this run's topics"
    )
    options.as_json(parser, "one JSON object with all of it")
    parser.add_argument(
        "--router", metavar="FILE.json5", type=Path, help="a configuration of ROS 2's router that knows bus.roles"
    )
    only = parser.add_mutually_exclusive_group()
    for section, what in SECTIONS.items():
        only.add_argument(f"--{section}", dest="only", action="store_const", const=section, help=f"only {what}")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Prints what the profile is once it is wired, and returns 0. Raises what `srl check` raises."""
    if args.figure is not None and args.figure.suffix != ".png":
        problem = f"the name {args.figure} doesn't end in .png"
        raise RequestError("--figure", problem, f"Name it like {args.profile.rpartition('/')[2].partition('.')[0]}.png")
    if args.foxglove_layout is not None and args.foxglove_layout.suffix != ".json":
        problem = f"the name {args.foxglove_layout} doesn't end in .json"
        raise RequestError("--foxglove-layout", problem, "Name it like layout.json")
    if args.json and args.only is not None:
        problem = "--json has all of it, and so no parts to choose from"
        raise RequestError(f"--{args.only}", problem, "Leave one of the two out")
    checked, source = profile.load(args.profile, args.set)
    graph = wiring.build(checked, source, args.sim)
    check_guards(graph)
    check_certificates(graph)
    if args.router is not None:
        from srl.runtime.ros2.router import configuration

        made = configuration(checked.bus or BusConfig(), checked.name, list(checked.setpoints))
        try:
            args.router.write_text(json.dumps(made, indent=2) + "\n")
        except OSError as error:
            raise RequestError("--router", f"{args.router}: {error.strerror}", "Name a file that can be made") from None
        print(f"{args.router}: for ZENOH_ROUTER_CONFIG_URI, beside ca.pem, router.pem and router.key", file=sys.stderr)
    found = overview(graph, limits_of(graph))
    if args.figure is not None:
        from srl.runtime.pictures.overview_picture import draw_overview

        draw_overview(found, args.figure)
    panels = 0
    if args.foxglove_layout is not None:
        from srl.runtime.export.foxglove_layout import write

        panels = write(graph.layout, args.foxglove_layout)
    if args.json:
        files = {"figure": args.figure, "foxglove_layout": args.foxglove_layout}
        print(json.dumps(found | {k: str(v) for k, v in files.items() if v is not None}, allow_nan=False))
        return 0
    print("\n".join(text(found, [args.only] if args.only else list(SECTIONS))))
    if args.figure is not None:
        print(f"{args.figure}: the wiring and the frames")
    if args.foxglove_layout is not None:
        print(f"{args.foxglove_layout}: {panels} panels")
    return 0
