"""`srl stop`, `srl reset`, `srl start`: they send a request directly to the loop, without the bus."""

from __future__ import annotations

import argparse
import json
import time

from srl.runtime.cli import add_command, options
from srl.runtime.cli.instance import choose
from srl.runtime.contracts.errors import RequestError
from srl.runtime.ipc.control_socket import send_request
from srl.runtime.ipc.run_folder import RunFolder

_NAMES = ("stop", "reset", "start")


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Registers the three commands."""
    for name in _NAMES:
        parser = add_command(subparsers, name, f"srl {name} sixth-finger")
        options.instance(parser)
        options.as_json(parser, "print the loop's answer as one JSON object")
        if name == "stop":
            parser.add_argument("--exit", action="store_true", help="end the run after the stop")
        parser.set_defaults(run=run, exit=False)


def run(args: argparse.Namespace) -> int:
    """Sends the request and prints the answer."""
    run_folder = choose(args.instance)
    answer = send_request(run_folder, "exit" if args.exit else args.command)
    if answer is None:
        raise RequestError(
            f"instance '{run_folder.path.name}'",
            f"the loop didn't answer within 2 s, so whether it carried out the {args.command} isn't known",
            "Use the hardware stop; then look at `srl top` and the journal",
        )  # fmt: skip
    if args.exit:
        _wait_for_end(run_folder)
    if args.json:
        print(json.dumps(answer))
    elif answer["ok"]:
        print(f"{run_folder.path.name}: {answer['state']}")
    if answer["ok"]:
        return 0
    why = (
        f" ({answer['cause']} {answer.get('fault_source', '')})".replace(" )", ")") if answer["cause"] != "none" else ""
    )
    remedy = "Mend its cause, then reset" if "cause" in str(answer["error"]) else "See `srl top` for what it does"
    raise RequestError(
        f"instance '{run_folder.path.name}'",
        f"{args.command} refused, {answer['state']}{why}: {answer['error']}",
        remedy,
    )


def _wait_for_end(run_folder: RunFolder) -> None:
    deadline = time.monotonic() + 10
    while run_folder.is_claimed() and time.monotonic() < deadline:
        time.sleep(0.02)
