"""`srl recordings`: lists the recordings of a folder; opens, exports and deletes them."""

from __future__ import annotations

import argparse
import json
import os
import shlex
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from srl.runtime.cli import add_command, options
from srl.runtime.contracts.errors import RecordingError, RequestError, SrlError, nearest

if TYPE_CHECKING:
    from srl.runtime.recording.index import Entry

FORMATS = ("parquet", "mcap", "c3d", "mat", "trc", "mot", "bids")


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Registers the command."""
    parser = add_command(
        subparsers, "recordings", "srl recordings data --person P07 --export parquet --to tables",
    )  # fmt: skip
    parser.add_argument("folder", type=Path, nargs="?", default=Path(), help="default: this one; with all below it")
    parser.add_argument("--name", metavar="FILE", nargs="+", help="only these, by their paths in the list")
    parser.add_argument("--person", metavar="ID", help="only those of this person")
    parser.add_argument("--profile", metavar="NAME", help="only those of this profile")
    parser.add_argument("--fault", action="store_true", help="only those whose last stop was by a fault")
    parser.add_argument("--damaged", action="store_true", help="only those with which something is wrong")
    parser.add_argument("--rebuild", action="store_true", help="make the index anew from the files")
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--open", action="store_true", help="open them in rerun, and say what else opens them")
    what.add_argument("--export", choices=FORMATS, help="write them in this format (srl export)")
    what.add_argument("--delete", action="store_true", help="delete those of --name or --person; asks first")
    parser.add_argument("--to", metavar="FOLDER", type=Path, help="with --export: where to; default: beside each")
    parser.add_argument("--yes", action="store_true", help="with --delete: don't ask")
    options.as_json(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Returns 0; 1 if one of them couldn't be exported or deleted."""
    from srl.runtime.recording.index import entries

    for option, needed in (("to", "export"), ("yes", "delete")):
        if getattr(args, option) and not getattr(args, needed):
            raise RequestError(f"--{option}", f"it is for --{needed}", f"Add --{needed}, or leave it out")
    if args.delete and args.name is None and args.person is None:
        raise RequestError("--delete", "it isn't said which", "Add --person ID or --name FILE")
    if args.json and args.delete and not args.yes:
        raise RequestError("--delete", "with --json nobody is asked", "Add --yes")
    found = entries(args.folder, args.rebuild, lambda text: print(f"srl recordings: {text}", file=sys.stderr))
    chosen = _chosen(args, found)
    unknown = [e.name for e in found if not e.summary.rows and not e.summary.persons]
    if args.person is not None and unknown:
        print(f"srl recordings: it can't be read whose these are: {', '.join(unknown)}", file=sys.stderr)
    if args.open:
        return _open(chosen)
    if args.export:
        return _export(chosen, args)
    if args.delete:
        return _delete(chosen, args)
    if args.json:
        print(json.dumps({"recordings": [_as_json(entry) for entry in chosen]}))
    else:
        _list(chosen)
    return 0


def _chosen(args: argparse.Namespace, found: Sequence[Entry]) -> list[Entry]:
    names = {entry.name for entry in found}
    if gone := [name for name in args.name or () if name not in names]:
        raise RequestError("--name", f"there is no recording {gone[0]} in {args.folder}", nearest(gone[0], names))
    chosen = [
        e for e in found
        if (args.name is None or e.name in args.name)
        and (args.person is None or args.person in e.summary.persons)
        and (args.profile is None or args.profile == e.summary.profile)
        and (e.summary.fault or not args.fault)
        and (e.summary.problem or not args.damaged)
    ]  # fmt: skip
    for option, known in (
        ("person", {p for e in found for p in e.summary.persons}),
        ("profile", {e.summary.profile for e in found if e.summary.profile}),
    ):
        wanted = getattr(args, option)
        if wanted is not None and wanted not in known:
            raise RequestError(f"--{option}", f"no recording in {args.folder} is of '{wanted}'", nearest(wanted, known))
    return chosen


def _as_json(entry: Entry) -> dict[str, object]:
    return {"name": entry.name, "path": str(entry.path), "bytes": entry.size, "date": entry.summary.date} | asdict(
        entry.summary
    )


def _list(chosen: Sequence[Entry]) -> None:
    if not chosen:
        print("no recordings")
        return
    heads = ("date", "profile", "person", "length", "last stop", "recording")
    rows = [heads, *(_row(entry) for entry in chosen)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(heads))]
    for i, row in enumerate(rows):
        print("  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip())
        if i and chosen[i - 1].summary.problem:
            print(f"    {chosen[i - 1].summary.problem}. {chosen[i - 1].summary.remedy}.")


def _row(entry: Entry) -> tuple[str, ...]:
    s = entry.summary
    minutes, seconds = divmod(s.seconds, 60.0)
    length = f"{int(minutes)}:{seconds:04.1f}" if s.rows else "-"
    stop = f"FAULT {s.stop}" if s.fault else s.stop or ("none" if s.rows else "-")
    name = s.profile + (" (sim)" if s.simulated else f" (sim: {', '.join(s.partly)})" if s.partly else "")
    return s.date or "-", name or "-", ", ".join(s.persons) or "-", length, stop, entry.name


def _open(chosen: Sequence[Entry]) -> int:
    """Opens in rerun what it can, once all else is said that opens them. Returns rerun's answer, or 0."""
    shown: list[str] = []
    for entry in chosen:
        files = sorted(map(str, entry.path.glob("*.rrd"))) if entry.path.is_dir() else [str(entry.path)]
        print(f"{entry.name}:")
        if (entry.path / "rows.ring").exists():
            print(f"  srl export {entry.path} --parquet FILE.parquet    (a black box: rerun can't open it)")
        else:
            if entry.path.is_dir() and any(entry.path.glob("*.rows")):
                print(f"  srl export {entry.path} --rrd FILE.rrd    (made without rerun: it opens FILE.rrd)")
            else:
                print(f"  rerun --bind 127.0.0.1 {shlex.join(files)}")
                shown += files
            print(f"  srl replay {entry.path}")
        print(f'  python: srl.recordings.read(Path("{entry.path}"))')
    if not shown:
        return 0
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        print("there is no display here, so nothing is opened: type the line where there is one", file=sys.stderr)
        return 0
    sys.stdout.flush()
    quiet = {**os.environ, "CI": "1"}  # rerun sends no usage statistics then
    return subprocess.call([_viewer(), "--bind", "127.0.0.1", *shown], env=quiet)


def _viewer() -> str:
    """The path of rerun's binary. Raises RecordingError: it isn't there."""
    spec = find_spec("rerun_cli")
    path = Path(spec.origin).parent / "rerun" if spec is not None and spec.origin else None
    if path is None or not path.exists():
        raise RecordingError("rerun", f"its viewer isn't installed beside {sys.executable}", "Install rerun-sdk anew")
    return str(path)


def _export(chosen: Sequence[Entry], args: argparse.Namespace) -> int:
    from srl.runtime.export import formats
    from srl.runtime.recording.reader import read

    if args.export == "bids" and args.to is None:
        raise RequestError("--to", "BIDS-Motion is a folder for all of them", "Add --to FOLDER")
    done: list[dict[str, object]] = []
    failed = 0
    written: dict[Path, str] = {}  # by file, of which recording it is
    for entry in chosen:
        if args.export == "bids":
            target = args.to
        else:
            near = entry.path if args.to is None else args.to / entry.name
            target = near.with_name(
                near.name.removesuffix(".segments").removesuffix(".rrd") + formats.ENDINGS[args.export]
            )
        try:
            if args.export != "bids" and (other := written.setdefault(target, entry.name)) != entry.name:
                problem = f"{other} was written there, which would be lost"
                raise RequestError(str(target), problem, f"Export it by itself: srl export {entry.path}")
            _folder(target.parent)
            report = formats.write(args.export, read(entry.path), target, person=_person(entry, args.person))
        except SrlError as error:
            print(f"srl recordings: {entry.name}: {error}", file=sys.stderr)
            failed += 1
            continue
        done.append({"name": entry.name, "files": [str(p) for p in report.files], "left_out": report.left_out})
        if not args.json:
            print(f"{entry.name} -> {target}: {report.content}")
            print("".join(f"  left out: {line}\n" for line in report.left_out), end="")
    if args.json:
        print(json.dumps({"exported": done, "failed": failed}))
    return 1 if failed else 0


def _folder(path: Path) -> None:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(str(path), f"the folder can't be made: {error.strerror}", "Choose another") from None


def _person(entry: Entry, asked: str | None) -> str | None:
    """Whose a recording is: the one who is asked for, or as it says."""
    return asked if asked in entry.summary.persons else None


def _delete(chosen: Sequence[Entry], args: argparse.Namespace) -> int:
    from srl.runtime.recording.index import entries, made_of
    from srl.runtime.recording.keep import LEDGER, strike

    if not chosen:
        print(json.dumps({"deleted": [], "failed": 0}) if args.json else "no recordings")
        return 0
    if not args.json:
        _list(chosen)
        if beside := [str(file) for entry in chosen for file in made_of(entry.path)]:
            print(f"with what was made of them: {', '.join(beside)}")
    if not args.yes and not _agreed(len(chosen)):
        print("nothing was deleted")
        return 0
    deleted, others, failed = [], 0, 0
    for entry in chosen:
        try:
            others += len(strike(args.folder, entry, "srl recordings --delete"))
            deleted.append(entry.name)
        except OSError as error:
            place = args.folder / LEDGER
            print(f"srl recordings: {entry.name} stays: {place}: {error.strerror or error}", file=sys.stderr)
            failed += 1
        except RecordingError as error:
            print(f"srl recordings: {error}", file=sys.stderr)
            failed += 1
    entries(args.folder)  # the index forgets them
    if args.json:
        print(json.dumps({"deleted": deleted, "failed": failed}))
    else:
        made = f" and {others} pictures and exports of them" if others else ""
        print(f"deleted {len(deleted)} recordings{made}. What has another name or place, and calibrations, stay")
    return 1 if failed else 0


def _agreed(count: int) -> bool:
    if not sys.stdin.isatty():
        raise RequestError("--delete", "there is no terminal on which to ask", "Add --yes")
    return input(f"Delete {count} recording{'s' if count != 1 else ''} for good? [y/N] ").strip().lower() in (
        "y",
        "yes",
    )
