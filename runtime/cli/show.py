"""More that `srl check` shows of a profile: all of it as text or JSON, a picture, files of other programs."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any, Final

from srl.runtime.cli import options
from srl.runtime.cli.show_text import SECTIONS, text
from srl.runtime.contracts.errors import RequestError
from srl.runtime.loop.guards import limits_of
from srl.runtime.overview.overview import overview
from srl.runtime.profile.bus import BusConfig
from srl.runtime.profile.graph import Graph

_ALL: Final = "all"


def add_options(parser: argparse.ArgumentParser) -> None:
    """What is shown, and what is written."""
    only = parser.add_mutually_exclusive_group()
    only.add_argument(
        f"--{_ALL}", dest="only", action="store_const", const=_ALL, help="all of it: devices, wiring, limits, frames"
    )
    for section, what in SECTIONS.items():
        only.add_argument(f"--{section}", dest="only", action="store_const", const=section, help=f"only {what}")
    options.figure(parser, "draw the wiring and the tree of frames")
    options.renamed(parser, "--png", "--figure")
    parser.add_argument(
        "--foxglove-layout", metavar="FILE.json", type=Path, help="a layout for Foxglove's app, with this run's topics"
    )
    parser.add_argument(
        "--router", metavar="FILE.json5", type=Path, help="a configuration of ROS 2's router that knows bus.roles"
    )


def check(args: argparse.Namespace) -> None:
    """Raises RequestError: what is asked for can't be made."""
    if args.figure is not None and args.figure.suffix != ".png":
        problem = f"the name {args.figure} doesn't end in .png"
        name = (args.profile or "profile").rpartition("/")[2].partition(".")[0]
        raise RequestError("--figure", problem, f"Name it like {name}.png")
    if args.foxglove_layout is not None and args.foxglove_layout.suffix != ".json":
        problem = f"the name {args.foxglove_layout} doesn't end in .json"
        raise RequestError("--foxglove-layout", problem, "Name it like layout.json")
    if args.json and args.only not in (None, _ALL):
        problem = "--json has all of it, and so no parts to choose from"
        raise RequestError(f"--{args.only}", problem, "Leave one of the two out")


def write(args: argparse.Namespace, graph: Graph) -> dict[str, str]:
    """Writes the files that are asked for. Returns what is said of each, by its option."""
    said = {}
    if args.figure is not None:
        from srl.runtime.pictures.overview_picture import draw_overview

        draw_overview(overview(graph, limits_of(graph)), args.figure)
        said["figure"] = f"{args.figure}: the wiring and the frames"
    if args.foxglove_layout is not None:
        from srl.runtime.export import foxglove_layout

        panels = foxglove_layout.write(graph.layout, args.foxglove_layout)
        said["foxglove_layout"] = f"{args.foxglove_layout}: {panels} panels"
    if args.router is not None:
        from srl.runtime.ros2.router import configuration

        checked = graph.profile
        made = configuration(checked.bus or BusConfig(), checked.name, list(checked.setpoints))
        try:
            args.router.write_text(json.dumps(made, indent=2) + "\n")
        except OSError as error:
            raise RequestError("--router", f"{args.router}: {error.strerror}", "Name a file that can be made") from None
        print(f"{args.router}: for ZENOH_ROUTER_CONFIG_URI, beside ca.pem, router.pem and router.key", file=sys.stderr)
    return said


def content(graph: Graph) -> dict[str, Any]:
    """All of it as plain data."""
    return overview(graph, limits_of(graph))


def lines(graph: Graph, only: str) -> list[str]:
    """The text of a section, or of all."""
    return text(overview(graph, limits_of(graph)), list(SECTIONS) if only == _ALL else [only])
