"""`srl calibrate`: makes the calibration file of a person or a device: guided, simulated, or from a recording."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from srl.commissioning.calibration.request import KINDS, CalibrationRequest
from srl.commissioning.cli import COMMANDS
from srl.runtime.cli import add_command, on_twins, options
from srl.runtime.contracts import registry

if TYPE_CHECKING:
    from srl.commissioning.calibration.screen import Screen


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Registers the command."""
    parser = add_command(subparsers, "calibrate", "srl calibrate my-arm.yaml ikns --person P07", COMMANDS)
    options.profile(parser)
    kinds = dict.fromkeys((*KINDS, *registry.names("calibrations")))
    parser.add_argument("kind", choices=tuple(kinds), help="what is calibrated")
    parser.add_argument("--person", metavar="ID", help="anonymous id, such as P07")
    parser.add_argument("-o", "--out", type=Path, metavar="FILE", help="default: the file that the profile names")
    parser.add_argument(
        "--yes", action="store_true", help="replace a file that is there; it is kept as FILE.old, FILE.old.2, ..."
    )
    options.sim(parser, "a simulated person does it, as fast as it goes; named must be all that it reads")
    on_twins.add_option(parser)
    parser.add_argument("--record", type=Path, metavar="FILE.rrd", help="where every row goes; a person's always do")
    parser.add_argument("--view", action="store_true", help="show a person's motion on the panel, in a browser here")
    parser.add_argument(
        "--recording",
        type=Path,
        nargs="+",
        metavar="FILE.rrd",
        help="compute from recordings, or from a motion file (.mvnx, .c3d, .bvh); nobody moves",
    )
    parser.add_argument("--from", dest="before", type=Path, nargs="+", metavar="FILE.rrd", help="with --redo")
    parser.add_argument(
        "--redo",
        type=int,
        nargs="+",
        metavar="N",
        help="do only these points, actions, poses or shapes again; needs --from",
    )
    parser.add_argument("--dofs", metavar="NAMES", help="degrees of freedom; default: swivel")
    parser.add_argument("--points", type=int, metavar="N", help="number of points; default: 10")
    parser.add_argument("--flip", action="append", default=[], metavar="DOF", help="turn its direction round")
    parser.add_argument(
        "--direction", type=Path, metavar="FILE",
        help="keep the direction of this file; default: of the one that is replaced",
    )  # fmt: skip
    options.renamed(parser, "--sense", "--direction")
    parser.add_argument("--actions", metavar="NAMES", help="actions to record, for intention; default: the ten")
    parser.add_argument(
        "--option", action="append", default=[], metavar="KEY=VALUE",
        help="a time of the procedure or a threshold: exploration=30, samples=200 (docs/calibrate.md)",
    )  # fmt: skip
    options.overrides(parser)
    options.name(parser)
    parser.add_argument("--panel", action="store_true", help="guided on the page of `srl panel`, not on this terminal")
    options.as_json(parser, "print the quality report as one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Returns 0 once the file is written. Errors are raised: a calibration that is refused is one."""
    from srl.commissioning.calibration import session
    from srl.commissioning.calibration.screen import Plain, Terminal

    _check_twin(args)
    screen: Screen = Plain(lambda text: print(text, file=sys.stderr, flush=True))
    title = f"srl calibrate {args.profile} {args.kind}{f': {args.person}' if args.person else ''}"
    if args.panel:
        screen = _on_panel(args, title)
    elif sys.stderr.isatty() and not args.json:
        screen = Terminal(title)
    given = {name: value for name, value in vars(args).items() if name in CalibrationRequest.__dataclass_fields__}
    request = CalibrationRequest(**given | {"sim": args.sim is not None, "simulated": args.sim or ()})
    if args.twin is None:
        return session.run(request, screen)
    cut = session.beside_twins(request)
    with on_twins.twins(args.profile, args.twin, args.set, None, screen.say, cut) as twins:
        instruct = twins.instruct if cut is not None else None
        request = replace(
            request, set=twins.overrides, twins=twins.devices, instruct=instruct, check_twins=twins.check
        )  # fmt: skip
        return session.run(request, screen)


def _check_twin(args: argparse.Namespace) -> None:
    """Raises RequestError: another option contradicts `--twin`."""
    from srl.runtime.contracts.errors import RequestError

    if args.twin is not None and args.sim is not None:
        raise RequestError("--twin", on_twins.TWO_WORLDS, "Leave --sim out")
    if args.twin is not None and args.recording:
        raise RequestError("--twin", "a calibration from recordings opens no device", "Leave out one of the two")


def _on_panel(args: argparse.Namespace, title: str) -> Screen:
    """Raises RequestError: nobody does anything that a page could guide."""
    from srl.commissioning.calibration.panel import PanelScreen
    from srl.runtime.contracts.errors import RequestError

    if args.recording:
        raise RequestError("--panel", "a calibration from recordings isn't guided", "Leave out one of the two")
    if args.sim is not None:
        problem = "the simulated person needs no page, and is as fast as the machine"
        raise RequestError("--panel", problem, "Leave out one of the two, or use --twin")
    return PanelScreen(title, lambda text: print(text, file=sys.stderr, flush=True))
