"""`srl jog`: moves the joints of one device slowly, each while a key is held on the terminal."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable
from dataclasses import replace

from srl.commissioning.cli import COMMANDS
from srl.runtime.cli import add_command, on_twins, options


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Registers the command."""
    parser = add_command(subparsers, "jog", "srl jog finger-jog --sim", COMMANDS)
    options.profile(parser)
    parser.add_argument("device", nargs="?", help="default: the only one that takes commands")
    options.sim(parser)
    on_twins.add_option(parser)
    options.overrides(parser)
    parser.add_argument(
        "--speed", type=float, default=0.1, metavar="RAD/S",
        help="rad/s, 0.5 at most; joints that slide move at a fifth of it, in m/s; default: 0.1",
    )  # fmt: skip
    parser.add_argument("--step", action="store_true", help="a held key moves once, until it is let go")
    options.name(parser)
    options.confirm(parser)
    parser.add_argument(
        "--panel", action="store_true", help="presses come from the page of `srl panel`, not from this terminal"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Runs until q, a signal or the loss of the terminal. Returns 0, or 1 after a fault."""
    from srl.runtime.cli.console import Console
    from srl.runtime.contracts.errors import RequestError
    from srl.runtime.ipc.events import Level

    if args.panel and args.step:
        raise RequestError("--step", "it is for a terminal's keys", "Leave out --step, or --panel")
    if args.twin is not None and args.sim is not None:
        raise RequestError("--twin", on_twins.TWO_WORLDS, "Leave --sim out")
    console = Console(sys.stderr)  # it neither waits for a terminal nor fails once that has gone

    def say(text: str) -> None:
        console.say(text, Level.INFO)

    with on_twins.twins(args.profile, args.twin, args.set, None, say) as twins:
        return _jog(args, twins, say)


def _jog(args: argparse.Namespace, twins: on_twins.Twins, say: Callable[[str], None]) -> int:
    from srl.commissioning.jog.profile_subset import subset
    from srl.commissioning.jog.session import Session
    from srl.runtime.cli.check import check_certificates, check_guards
    from srl.runtime.contracts.errors import RequestError
    from srl.runtime.profile import profile
    from srl.runtime.service import arming

    made = subset(*profile.load(args.profile, twins.overrides), args.device, args.speed, args.sim, args.panel)
    made = replace(made, twins=twins.devices)
    check_guards(made.graph)
    check_certificates(made.graph)
    name = made.profile.name if args.instance is None else args.instance
    if not re.match(profile.SLUG, name):
        raise RequestError("--instance", f"'{name}' is no name", "Use lower-case letters, digits, - and _")
    if args.panel:
        say(f"{name}: jogged on the page of `srl panel {name}`; Ctrl-C ends")
    arm = arming.automatic(made.graph, args.confirm or twins.alone(made.graph))
    return Session(made, name, arm, args.step, say, args.panel).run()
