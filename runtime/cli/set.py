"""`srl set`: lists the live parameters of a running instance, or changes one, over its bus."""

from __future__ import annotations

import argparse
import json
from typing import Any

from srl.runtime.cli import add_command, options
from srl.runtime.cli.instance import choose
from srl.runtime.contracts.errors import RequestError, nearest
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.profile.keys import path


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Registers the command."""
    parser = add_command(subparsers, "set", "srl set sixth-finger mapping.drift_pull 1.5")
    options.instance(parser)
    parser.add_argument("parameter", nargs="?", help="as the list names it; left out: lists all")
    parser.add_argument("value", nargs="?", help="one number, in the parameter's unit; left out: lists what is there")
    options.as_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Lists, or sets and prints the loop's answer. Raises RequestError: it is refused, with the bounds."""
    from srl.runtime.bus.client import connect

    value = None if args.value is None else _number(args.parameter, args.value)
    folder = choose(args.instance)
    _needs_bus(folder)
    with connect(folder) as client:
        known = client.parameters()
        chosen = known if args.parameter is None else {name: known[name] for name in [_one(args.parameter, known)]}
        if value is not None:
            (name,) = chosen
            chosen[name] |= {"before": chosen[name]["value"]} | client.set_param(name, value, "srl set")
    if args.json:
        print(json.dumps({"instance": folder.path.name, "parameters": chosen}))
        return 0
    if not chosen:
        print(f"{folder.path.name}: no controller of its profile has live parameters")
    for name, parameter in chosen.items():
        print(f"{folder.path.name}: {name}: {_words(parameter)}")
    return 0


def _words(parameter: dict[str, Any]) -> str:
    bounds = f"{parameter['lower']:g} to {parameter['upper']:g}"
    if "before" in parameter:
        return f"{_value(parameter, 'before')} -> {_value(parameter, 'value')} ({bounds})"
    return f"{_value(parameter, 'value')} ({bounds}; default {parameter['default']:g}): {parameter['text']}"


def _value(parameter: dict[str, Any], which: str) -> str:
    if parameter[which] is None:
        return "not known yet"
    return f"{parameter[which]:g}" + f" {parameter['unit']}" * (parameter["unit"] != "1")


def _one(name: str, known: dict[str, Any]) -> str:
    """The parameter that is meant: by its name, or as the bus's keys write it."""
    for other in known:
        if name in (other, path(other).replace("/", ".")):
            return other
    raise RequestError(f"parameter '{name}'", "it isn't there", nearest(name, known))


def _number(parameter: str, given: str) -> float:
    try:
        return float(given)
    except ValueError:
        raise RequestError(f"parameter '{parameter}'", f"'{given}' is no number", "Give one, such as 1.5") from None


def _needs_bus(folder: RunFolder) -> None:
    if not folder.bus_socket.exists():
        remedy = "A profile without `bus:` has none: add it. Else the bus is about to begin: try again"
        raise RequestError(f"instance '{folder.path.name}'", "no bus listens, over which parameters are set", remedy)
