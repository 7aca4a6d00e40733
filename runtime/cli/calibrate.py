"""`srl calibrate`: makes a person's calibration file, guided, from the simulated wearer, or from a recording."""

from __future__ import annotations

import argparse
import json
import re
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from runtime.calibration import cut as cutting
from runtime.calibration import result as results
from runtime.calibration.guide import Guide, QuitError
from runtime.calibration.result import Result
from runtime.calibration.screen import Plain, Screen, Terminal
from runtime.calibration.sources import RowSource, Simulated, recorded
from runtime.calibration.taps import Taps
from runtime.cli import add_command
from runtime.cli.console import Console
from runtime.contracts.errors import RequestError, SrlError, nearest
from runtime.contracts.signals import Array
from runtime.control.ikns import samples as marks
from runtime.control.ikns.calibration import CalibrationError, Thresholds
from runtime.control.ikns.procedure import Plan, Procedure
from runtime.control.ikns.samples import MarksConfig, Samples
from runtime.profile import profile
from runtime.profile.profile import Profile
from runtime.profile.source import Source
from runtime.service.end_signals import EndSignals

ANONYMOUS: Final = r"^[A-Za-z]{0,4}[0-9]{1,6}$"  # no name fits it
_NEXT: Final = "Enter write it   f DOF flip its sense   r N redo point N   q quit"


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Registers the command."""
    parser = add_command(
        subparsers, "calibrate", "makes a person's calibration file", "srl calibrate my-arm.yaml ikns --person P07"
    )
    parser.add_argument("profile", help="a name under profiles/, or a path to a YAML file")
    parser.add_argument("law", choices=("ikns",), help="what is calibrated")
    parser.add_argument("--person", metavar="ID", help="anonymous id, such as P07")
    parser.add_argument("-o", "--out", type=Path, metavar="FILE", help="default: the file that the profile names")
    parser.add_argument("--yes", action="store_true", help="replace a file that is there; it is kept as FILE.old")
    parser.add_argument("--sim", action="store_true", help="the simulated wearer does it, as fast as it goes")
    parser.add_argument("--record", type=Path, metavar="FILE.rrd", help="where every row goes; a person's always do")
    parser.add_argument("--view", action="store_true", help="show a person's motion in the rerun viewer (127.0.0.1)")
    parser.add_argument(
        "--recording", type=Path, nargs="+", metavar="FILE.rrd", help="compute from recordings, nobody moves"
    )
    parser.add_argument("--from", dest="before", type=Path, nargs="+", metavar="FILE.rrd", help="with --redo")
    parser.add_argument("--redo", type=int, nargs="+", metavar="N", help="do only these points again; needs --from")
    parser.add_argument("--dofs", metavar="NAMES", help="degrees of freedom; default: swivel")
    parser.add_argument("--points", type=int, metavar="N", help="number of points; default: 10")
    parser.add_argument("--flip", action="append", default=[], metavar="DOF", help="turn its sense round")
    parser.add_argument(
        "--option", action="append", default=[], metavar="KEY=VALUE",
        help="a time of the procedure or a threshold: exploration=30, samples=200 (docs/calibrate.md)",
    )  # fmt: skip
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="override a key of the profile")
    parser.add_argument("--instance", metavar="NAME", help="name of the run's instance; default: the profile's")
    parser.add_argument("--json", action="store_true", help="print the quality report as one JSON object")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Returns 0 once the file is written, 2 if the calibration is refused. Errors are raised."""
    checked, source = profile.load(args.profile, args.set)
    target = _target(args, checked, source)
    plan, thresholds = _options(args)
    if args.recording:
        taps, parts, date = _recorded(args, args.recording, checked, source, thresholds)
        return _finish(args, target, results.compute(taps, parts, date), None)
    if args.person is None:
        raise RequestError("--person", "it isn't said whose calibration it is", "Give an anonymous id: --person P07")
    dofs = _dofs(args) or ("swivel",)
    before: list[Samples] = []
    if args.redo:
        old, before, _ = _recorded(args, args.before or (), checked, source, thresholds)
        if (args.dofs and old.options.dofs != dofs) or old.options.person != args.person:
            problem = f"they are of {old.options.person} with {', '.join(old.options.dofs)}"
            raise RequestError("--from", problem, "Name recordings of the same person and degrees of freedom")
        dofs, thresholds = old.options.dofs, old.options.thresholds
    elif args.before:
        raise RequestError("--from", "it goes with --redo", "Say which points: --redo 3")
    made, text = cutting.cut(checked, source, args.person, dofs, thresholds, args.sim)
    procedure = Procedure(dofs, thresholds, plan, _explored(before) if before else None)
    for number in args.redo or ():
        if answer := procedure.redo(number):
            raise RequestError(f"--redo {number}", answer, "Name one of them")
    if args.sim:
        console = Console(sys.stderr)
        with_source = Simulated(made, text, console.say, args.record)
        try:
            return _guided(args, target, with_source, procedure, before, _screen(args, console))
        finally:
            with_source.close()
    return _live(args, target, checked, text, procedure, before)


def _live(
    args: argparse.Namespace, target: Path, checked: Profile, text: Source, procedure: Procedure, before: list[Samples]
) -> int:
    from runtime.calibration.live import Live
    from runtime.recording.segments import check_target

    name = args.instance or checked.name
    if not re.match(profile.SLUG, name):
        raise RequestError("--instance", f"'{name}' is no name", "Use lower-case letters, digits, - and _")
    record = args.record or target.with_name(f"{target.stem}-{time.strftime('%Y%m%d-%H%M%S')}.rrd")
    check_target(record)
    console = Console(sys.stderr)
    screen = _screen(args, console)
    with EndSignals() as signals:
        asked: list[bool] = []
        signals.pass_to(lambda: asked.append(True))
        source = Live(text, name, record, args.view, screen.say)
        try:
            code = _guided(args, target, source, procedure, before, screen, lambda: bool(asked))
        except QuitError:
            if asked:
                return 130  # by Ctrl-C, as a shell says it
            raise
        finally:
            source.close()
            console.say(f"recorded in {record}")
        return code


def _guided(
    args: argparse.Namespace,
    target: Path,
    source: RowSource,
    procedure: Procedure,
    before: list[Samples],
    screen: Screen,
    stop: Any = lambda: False,
) -> int:
    """Leads through the procedure until a file is written, or it is given up."""
    guide = Guide(source, procedure, screen, stop)
    with screen:
        while True:
            guide.run()
            if guide.first is None:
                raise CalibrationError("recording", "no row has come", "Begin again")
            again = _computed(args, source.taps, [*before, *guide.samples], guide)
            if isinstance(again, Result):
                answer, result = _decide(screen, again)
            else:
                screen.say(str(again))
                answer, result = screen.ask("r N redo point N   q quit"), None
            word, _, number = answer.partition(" ")
            if word == "r" and number.strip().isdigit():
                if lack := procedure.redo(int(number)):
                    screen.say(lack)
                continue
            if word == "q":
                raise QuitError("calibration", "it was ended without a file", "Its recording can be used: --recording")
            if result is None:
                assert isinstance(again, SrlError)
                raise again
            break
    return _finish(args, target, result, screen)


def _computed(args: argparse.Namespace, taps: Taps, parts: list[Samples], guide: Guide) -> Result | CalibrationError:
    assert guide.first is not None
    try:
        return _flipped(results.compute(taps, parts, taps.date(guide.first)), args.flip)
    except CalibrationError as error:
        return error


def _decide(screen: Screen, result: Result) -> tuple[str, Result]:
    """Shows the report and asks what to do; flips until something else is wanted."""
    from runtime.calibration import report

    for line in report.lines(result):
        screen.say(line)
    for reason in result.refusals:
        screen.say(f"refused: {reason}")
    while True:
        answer = screen.ask(_NEXT)
        word, _, dof = answer.partition(" ")
        if word != "f":
            return answer, result
        try:
            result = result.flipped(dof.strip() or result.dofs[0])
            screen.say(f"{dof.strip() or result.dofs[0]} is turned round: what was 0 is 1")
        except RequestError as error:
            screen.say(str(error))


def _finish(args: argparse.Namespace, target: Path, result: Result, screen: Screen | None) -> int:
    """Writes the file and its report; or says why it can't be used."""
    from runtime.calibration import report

    if screen is None:
        result = _flipped(result, args.flip)
        if not args.json:
            print("\n".join(report.lines(result)))
    told = report.figures(result) | {"file": None, "report": None}
    if result.refusals:
        if args.json:
            print(json.dumps(told))
        for reason in result.refusals[:-1]:
            print(f"srl calibrate: {reason}", file=sys.stderr)
        raise result.refusals[-1]
    picture = target.with_name(f"{target.name}.report.png")
    report.draw(result, picture)  # first: without its report the file could be taken for a good one
    results.write(target, result, args.yes)
    told |= {"file": str(target), "report": str(picture)}
    if args.json:
        print(json.dumps(told))
    else:
        print(f"{target}\n{picture}")
    return 0


def _flipped(result: Result, dofs: Sequence[str]) -> Result:
    for dof in dofs:
        result = result.flipped(dof)
    return result


def _recorded(
    args: argparse.Namespace, paths: Sequence[Path], checked: Profile, source: Source, thresholds: Thresholds
) -> tuple[Taps, list[Samples], Any]:
    """Reads recordings of one calibration, in their order."""
    if not paths:
        raise RequestError("--redo", "it isn't said what the other points come from", "Add --from FILE.rrd")
    own: MarksConfig | None = None
    if args.person is not None:  # a plain run's recording says neither whose it is nor where its signals are
        made, _ = cutting.cut(checked, source, args.person, _dofs(args) or ("swivel",), thresholds)
        own = MarksConfig.model_validate(made.controllers[-1].options)
    found: Taps | None = None
    parts: list[Samples] = []
    for path in paths:
        taps, rows = recorded(path, own)
        if found is not None and (taps.joints, taps.options.dofs) != (found.joints, found.options.dofs):
            problem = "it has other joints or degrees of freedom than the one before"
            raise RequestError(str(path), problem, "Name recordings of one calibration")
        found = taps
        parts.append(taps.samples(rows))
        date = taps.date(rows)
    assert found is not None
    changes: dict[str, Any] = {}
    if args.option or args.points:
        changes["thresholds"] = thresholds
    if args.person is not None:
        changes["person"] = args.person
    return replace(found, options=found.options.model_copy(update=changes)), parts, date


def _explored(parts: Sequence[Samples]) -> Array:
    """(T, 3) m: where the hand has been in the exploration."""
    samples = marks.joined(parts)
    return marks.seen(samples, marks.stretch(samples, marks.EXPLORATION))


def _target(args: argparse.Namespace, checked: Profile, source: Source) -> Path:
    law = checked.controllers[cutting.find(checked, source)]
    if args.person is not None and not re.match(ANONYMOUS, args.person):
        problem = f"'{args.person}' isn't anonymous: up to four letters, then a number"
        raise RequestError("--person", problem, "Number the persons, P07, and keep their names elsewhere")
    path = args.out
    if path is None:
        if not isinstance(named := law.options.get("calibration"), str):
            raise RequestError("-o", "the profile names no calibration file", "Say where it goes: -o p07.json")
        path = Path(named)
    results.check_target(path, args.yes)
    return Path(path)


def _dofs(args: argparse.Namespace) -> tuple[str, ...]:
    found = tuple(name.strip() for name in (args.dofs or "").split(",") if name.strip())
    if len(set(found)) < len(found):
        raise RequestError("--dofs", "a degree of freedom is named twice", "Name each once")
    return found


def _options(args: argparse.Namespace) -> tuple[Plan, Thresholds]:
    """The procedure's times and the thresholds, with what the command line says."""
    values: dict[str, dict[str, Any]] = {"plan": {}, "thresholds": {}}
    known = {**dict.fromkeys(Plan.model_fields, "plan"), **dict.fromkeys(Thresholds.model_fields, "thresholds")}
    given = [*args.option, *([f"points={args.points}"] if args.points is not None else [])]
    for text in given:
        key, equals, value = text.partition("=")
        if key not in known or not equals:
            raise RequestError(f"--option {text}", "there is no such option", nearest(key, known))
        values[known[key]][key] = value
    try:
        return Plan.model_validate(values["plan"]), Thresholds.model_validate(values["thresholds"])
    except ValidationError as error:
        first = error.errors()[0]
        place = f"--option {'.'.join(map(str, first['loc']))}"
        raise RequestError(place, first["msg"], "Correct the value") from None


def _screen(args: argparse.Namespace, console: Console) -> Screen:
    if console.terminal and not args.json:
        return Terminal(f"srl calibrate {args.profile} {args.law}: {args.person}")
    return Plain(lambda text: print(text, file=sys.stderr, flush=True))
