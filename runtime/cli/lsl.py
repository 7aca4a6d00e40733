"""`srl lsl`: an instance's signals as streams of the Lab Streaming Layer, for a lab's recorder."""

from __future__ import annotations

import argparse
import signal
import time

from srl.runtime.cli import add_command, options
from srl.runtime.cli.instance import choose

POLL = 0.005  # s between looks for new rows
NEWS = 1.0  # s between looks for what to tell
_REMEDY = (
    "Start it as the service srl-lsl@ (docs/lsl.md), or say --exposed if all in the network may, "
    "or if a firewall closes the ports 16571 to 16603"
)


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Registers the command."""
    parser = add_command(
        subparsers, "lsl", "srl lsl sixth-finger --signals glove.position finger.position_command.sent"
    )
    options.instance(parser)
    parser.add_argument(
        "--signals", nargs="+", required=True, metavar="SIGNAL", help="signals, or elements as in glove.position[0]"
    )
    parser.add_argument(
        "--exposed", action="store_true", help="also in the network; everyone there may read it, without a password"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Sends until Ctrl-C or SIGTERM, over restarts of the loop too."""
    from srl.runtime.contracts.exposure import refuse_strangers
    from srl.runtime.export.lsl_outlet import Outlet, load

    ended: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda got, _: ended.append(got))
    lsl = load(args.exposed)
    addresses = [] if args.exposed else refuse_strangers(_REMEDY)
    outlet = Outlet(lsl, choose(args.instance), args.signals)
    description, lack, lost, due = "", "", 0, 0.0
    try:
        while not ended:
            now = time.monotonic()
            outlet.follow(now)
            if now >= due:
                due = now + NEWS
                if not args.exposed:
                    addresses = refuse_strangers(_REMEDY, addresses)  # a cable or a radio that comes up later
                if outlet.description != description:
                    description = outlet.description
                    print(f"{description} (Ctrl-C ends)", flush=True)
                if outlet.lack != lack:
                    lack = outlet.lack
                    print(
                        f"nothing is sent of the new run: {lack}" if lack else "the signals are there again", flush=True
                    )
                if outlet.lost > lost:
                    print(f"{outlet.lost - lost} rows were lost: this process had no time", flush=True)
                    lost = outlet.lost
            time.sleep(POLL)
    finally:
        outlet.close()
    print(f"{outlet.sent} rows were sent, {outlet.lost} lost", flush=True)
    return 0
