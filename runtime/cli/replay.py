"""`srl replay`: feeds a recording's inputs through its profile and compares the commands."""

from __future__ import annotations

import argparse
import json

from srl.runtime.cli import add_command, options
from srl.runtime.cli.status import working
from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.files import KeptFile
from srl.runtime.contracts.printable import printable
from srl.runtime.loop.replay import perturbed, recorded_code, replay


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Registers the command."""
    parser = add_command(subparsers, "replay", "srl replay hand.rrd --json")
    options.recording(parser)
    parser.add_argument(
        "--perturb", metavar="SIGNAL:CYCLE:AMOUNT", help="move one input sample first: the comparison must then fail"
    )
    options.run_code(parser, False)
    parser.add_argument("--show-code", action="store_true", help="print that code, run nothing, and end")
    options.as_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Returns 0 if every bit is the same, else 1."""
    from srl.runtime.recording.reader import read

    place = str(args.recording)
    if args.show_code:
        return _show(recorded_code(read(args.recording).layout, place), place, args.json)
    with working(f"{args.recording} is replayed"):
        recording = read(args.recording)
        if recording.missing:
            first, last = recording.missing[0]
            raise RecordingError(
                place, f"rows {first} to {last} are missing, so it can't be replayed", "Use a whole recording"
            )
        rows = recording.rows if args.perturb is None else perturbed(recording.layout, recording.rows, args.perturb)
        comparison = replay(recording.layout, rows, place, args.run_code)
        code = recorded_code(recording.layout, place)
    if args.json:
        print(json.dumps(comparison.metrics() | {"recording": place, "salvaged_bytes": recording.salvaged}))
    else:
        for path, file in code.items():
            print(f"{path}: the recorded code was run, sha256 {file.sha256}")
        for warning in comparison.warnings:
            print(f"warning: {warning}")
        if recording.salvaged:
            print(f"a torn tail of {recording.salvaged} bytes was left out")
        print(f"{comparison.cycles} cycles, largest difference {comparison.largest!r}", end="")
        print(f" in {comparison.where[0]} at cycle {comparison.where[1]}" if comparison.where else "")
        print(
            "identical"
            if comparison.identical
            else f"NOT identical ({comparison.states_differ} cycles with another state)"
        )
    return 0 if comparison.identical else 1


def _show(code: dict[str, KeptFile], place: str, as_json: bool) -> int:
    """Prints the code that a recording holds; what isn't text, and what a terminal would obey, is escaped."""
    texts = {path: file.content.decode("utf-8", "backslashreplace") for path, file in code.items()}
    if as_json:
        print(json.dumps({"recording": place, "code": texts}))
        return 0
    if not code:
        print(f"{place} holds no code")
    for path, text in texts.items():
        print(f"# {path}, sha256 {code[path].sha256}")
        for line in text.split("\n"):
            print(printable(line))
    return 0
