"""`srl study`: a paper's experiment, with its table beside the paper's figures."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from runtime import registry
from runtime.cli import add_command
from runtime.errors import RequestError


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Registers the command."""
    parser = add_command(subparsers, "study", "runs a paper's experiment", "srl study peg-in-hole --json")
    parser.add_argument("name", help="see the list in the error of a wrong name")
    parser.add_argument("--out", type=Path, default=Path("out"), metavar="DIR", help="for pictures and recordings")
    parser.add_argument("--quick", action="store_true", help="fewer persons and shorter tasks, to see that it runs")
    parser.add_argument(
        "--sweep",
        action="store_true",
        help="change what was assumed one at a time: how much does each claim depend on it",
    )
    parser.add_argument("--json", action="store_true", help="one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Returns 0 also where a claim doesn't hold: it is printed as such."""
    study = registry.load("studies", args.name, f"srl study {args.name}")
    folder = args.out / args.name
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RequestError(f"--out {args.out}", f"can't be written: {error.strerror}", "Name another folder") from None
    if args.sweep:
        return _sweep(args.name, study, folder, args.json)
    result = study(folder, args.quick)
    kept = _keep(folder / "result.json", result.figures())
    if args.json:
        print(kept)
        return 0
    print(f"{result.study} ({'simulated' if result.simulated else 'on hardware'}, seeds {result.seeds})")
    _print_table(result.table)
    for claim in result.claims:
        measured = "not measured" if claim.measured is None else f"{claim.measured:.4g} {claim.unit}".rstrip()
        paper = f"; paper: {claim.paper}" if claim.paper else ""
        print(f"  {'holds' if claim.holds else 'DOES NOT HOLD'}: {claim.id}: {claim.text} ({measured}{paper})")
    for file in (*result.files, "result.json"):
        print(f"  {file}")
    return 0


def _keep(file: Path, figures: dict[str, Any]) -> str:
    """Some take hours: what came out stays beside the recordings."""
    text = json.dumps(figures)
    file.write_text(text + "\n", encoding="utf-8")
    return text


def _sweep(name: str, study: Any, folder: Path, as_json: bool) -> int:
    sweep = getattr(sys.modules[study.__module__], "sweep", None)
    if sweep is None:
        raise RequestError(f"srl study {name} --sweep", "this study has nothing to sweep", "Leave out --sweep")
    rows = sweep(folder)
    kept = _keep(folder / "sweep.json", {"study": name, "simulated": True, "sweep": rows})
    if as_json:
        print(kept)
    else:
        print(f"{name}, simulated, one assumption changed at a time")
        _print_table(rows)
    return 0


def _print_table(rows: list[dict[str, Any]]) -> None:
    if not rows:
        return
    columns = list(rows[0])
    cells = [columns, *([_shown(row.get(column)) for column in columns] for row in rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(columns))]
    for row in cells:
        print("  " + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())


def _shown(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.2f}" if isinstance(value, float) else str(value)
