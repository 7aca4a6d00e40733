"""`srl study`: runs a paper's experiment and prints its table beside the paper's figures."""

from __future__ import annotations

import argparse
import inspect
import json
import re
import sys
from math import isfinite, isnan
from pathlib import Path
from typing import Any

from srl.runtime.cli import add_command, options
from srl.runtime.contracts import registry, whole_file
from srl.runtime.contracts.errors import HostError, RequestError
from srl.studies.cli import COMMANDS


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Registers the command."""
    parser = add_command(subparsers, "study", "srl study peg-in-hole --json", COMMANDS)
    parser.add_argument("name", metavar="NAME", help=f"one of: {', '.join(registry.names('studies'))}")
    parser.add_argument("--out", type=Path, default=Path("out"), metavar="FOLDER", help="for pictures and recordings")
    parser.add_argument("--quick", action="store_true", help="fewer persons and shorter tasks, to see that it runs")
    parser.add_argument(
        "--sweep",
        action="store_true",
        help="change what was assumed: how much does each claim depend on it",
    )
    options.as_json(parser)
    parser.add_argument(
        "--write", type=Path, metavar="PAGE",
        help="puts the study's tables into this page, between `<!-- NAME: ... -->` and `<!-- end -->`",
    )  # fmt: skip
    people = parser.add_argument_group("with a person, beside `srl run`, where the study can be done with people")
    people.add_argument("--person", metavar="ID", help="anonymous id, such as P07")
    people.add_argument("--profile", metavar="PROFILE", help="the one that runs; default: the study's own")
    trials = parser.add_argument_group("how trials run (studies whose trials are tasks: docs/studies/trials.md)")
    where = trials.add_mutually_exclusive_group()
    where.add_argument("--workers", type=int, metavar="N", help="processes on this machine; default: one a core")
    where.add_argument("--on", metavar="ADDRESS", help="a Dask scheduler, such as tcp://scheduler:8786")
    trials.add_argument(
        "--tls",
        type=Path,
        metavar="FOLDER",
        help="mutual TLS to the scheduler: ca.pem, certificate.pem, key.pem; default: the folder in $SRL_STUDY_TLS",
    )
    trials.add_argument(
        "--insecure-no-tls",
        action="store_true",
        help="goes over a network without TLS: who reaches the scheduler can run programs on its workers and here",
    )
    trials.add_argument("--retry", action="store_true", help="runs trials again that failed before")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Runs the study. Returns 0 also if a claim doesn't hold, which the output says; 1 if trials failed."""
    study = registry.load("studies", args.name, f"srl study {args.name}")
    if args.person is None and args.profile is not None:
        raise RequestError("--profile", "it is for a study with a person", "Add --person ID, or leave it out")
    _refuse_what_would_be_ignored(args)
    page = None if args.write is None else Page(args.write, args.name)
    runner = _runner(args, study)
    folder = args.out / args.name
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RequestError(f"--out {args.out}", f"can't be written: {error.strerror}", "Name another folder") from None
    if args.sweep:
        return _sweep(args.name, study, folder, runner, args.json)
    if args.person is not None:
        return _show(_session(args, study, folder), folder / args.person, args.json)
    result = study(folder, args.quick) if runner is None else study(folder, args.quick, runner=runner)
    if page is not None:
        page.fill(result.page)
    return max(_show(result, folder, args.json), 1 if runner is not None and runner.failed else 0)


class PageError(HostError):
    """A page that can't be written."""


class Page:
    """A page of Markdown with room for a study's tables."""

    def __init__(self, path: Path, study: str) -> None:
        """Reads it, before hours of trials. Raises RequestError: it can't be read, or has no room."""
        self._path, self._place = path, f"--write {path}"
        try:
            self._text = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise RequestError(self._place, f"it can't be read: {error}", "Name a page that is there") from None
        found = re.search(rf"<!-- {re.escape(study)}: [^\n]*-->\n(.*?)<!-- end -->", self._text, re.DOTALL)
        if found is None:
            remedy = f"Put `<!-- {study}: made by ... -->` and `<!-- end -->` there, each on a line of its own"
            raise RequestError(self._place, "it has no room for this study", remedy)
        self._room = found.span(1)

    def fill(self, content: str) -> None:
        """Writes the study's tables in place of what was there. Raises RequestError: it has none, or it can't."""
        if not content:
            raise RequestError(self._place, "this study has no tables for a page", "Leave out --write")
        begin, end = self._room
        text = self._text[:begin] + content.rstrip() + "\n" + self._text[end:]
        whole_file.write(self._path, text.encode(), PageError)


def _session(args: argparse.Namespace, study: Any, folder: Path) -> Any:
    """The result of a study with one more person."""
    place = f"srl study {args.name} --person"
    session = getattr(sys.modules[study.__module__], "session", None)
    if session is None:
        raise RequestError(place, "this study has simulated persons only", "Leave out --person")
    given = {} if args.profile is None else {"profile": args.profile}
    return session(folder, args.person, quick=args.quick, **given)


def _show(result: Any, folder: Path, as_json: bool) -> int:
    """Prints a result and keeps it."""
    if as_json:
        print(_json(result.metrics()))
        _keep(folder / "result.json", result.metrics())
        return 0
    print(f"{result.study} ({'simulated' if result.simulated else 'on hardware'}, seeds {result.seeds})")
    _print_table(result.table)
    for claim in result.claims:
        paper = f"paper: {claim.paper}" if claim.paper else ""
        if claim.measured is None or isnan(claim.measured):  # which neither confirms nor refutes it
            print(f"  not measured: {claim.id}: {claim.text}" + (f" ({paper})" if paper else ""))
            continue
        measured = f"{claim.measured:.4g} {claim.unit}".rstrip() + (f"; {paper}" if paper else "")
        print(f"  {'holds' if claim.holds else 'DOES NOT HOLD'}: {claim.id}: {claim.text} ({measured})")
    for file in (*result.files, "result.json"):
        print(f"  {file}")
    _keep(folder / "result.json", result.metrics())
    return 0


def _refuse_what_would_be_ignored(args: argparse.Namespace) -> None:
    if args.write is not None and (args.sweep or args.person is not None):
        raise RequestError("--write", "only a whole study has tables for a page", "Leave out --sweep and --person")
    if args.sweep and (args.quick or args.person is not None):
        raise RequestError("--sweep", "it has its own persons and tasks", "Leave out --quick and --person")
    if args.person is not None and (named := _about_trials(args)):
        raise RequestError(named[0], "a person's trials are run here, one by one", f"Leave out {named[0]}")


def _about_trials(args: argparse.Namespace) -> list[str]:
    """The options that say how trials run, as given."""
    options = {"--workers": args.workers, "--on": args.on, "--tls": args.tls}
    flags = {"--insecure-no-tls": args.insecure_no_tls, "--retry": args.retry}
    return [name for name, value in options.items() if value is not None] + [name for name in flags if flags[name]]


def _runner(args: argparse.Namespace, study: Any) -> Any:
    """The runner of the study's trials; None if they aren't tasks."""
    place = f"srl study {args.name}"
    if "runner" not in inspect.signature(study).parameters:
        if named := _about_trials(args):
            raise RequestError(f"{place} {named[0]}", "this study's trials aren't tasks", f"Leave out {named[0]}")
        return None
    make = registry.load("runners", "tasks", place)
    return make(workers=args.workers, on=args.on, tls=args.tls, insecure=args.insecure_no_tls, retry=args.retry)


def _keep(file: Path, metrics: dict[str, Any]) -> None:
    """Saves the results beside the recordings, as some studies take hours."""
    try:
        file.write_text(_json(metrics) + "\n", encoding="utf-8")
    except OSError as error:
        print(f"srl study: {file} can't be written: {error.strerror}; the table above is all there is", file=sys.stderr)


def _json(metrics: dict[str, Any]) -> str:
    return json.dumps(_plain(metrics))


def _plain(value: Any) -> Any:
    """Replaces numbers that are not finite with None, as JSON has no NaN."""
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return None if isinstance(value, float) and not isfinite(value) else value


def _sweep(name: str, study: Any, folder: Path, runner: Any, as_json: bool) -> int:
    sweep = getattr(sys.modules[study.__module__], "sweep", None)
    if sweep is None:
        raise RequestError(f"srl study {name} --sweep", "this study has nothing to sweep", "Leave out --sweep")
    rows = sweep(folder) if runner is None else sweep(folder, runner=runner)
    metrics = {"study": name, "simulated": True, "sweep": rows}
    if as_json:
        print(_json(metrics))
    else:
        print(f"{name}, simulated, with other assumptions")
        _print_table(rows)
    _keep(folder / "sweep.json", metrics)
    return 1 if runner is not None and runner.failed else 0


def _print_table(rows: list[dict[str, Any]]) -> None:
    """Each part of a study, as the rows' column "part" says, has columns of its own; so has what needs further ones."""
    groups: list[list[dict[str, Any]]] = []
    for row in rows:
        if groups and row.get("part") == groups[-1][0].get("part") and row.keys() <= groups[-1][0].keys():
            groups[-1].append(row)
        else:
            groups.append([row])
    for group in groups:
        columns = list(group[0])
        cells = [columns, *([_shown(row.get(column)) for column in columns] for row in group)]
        widths = [max(len(row[i]) for row in cells) for i in range(len(columns))]
        for line in cells:
            print("  " + "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip())


def _shown(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.2f}" if isinstance(value, float) else str(value)
