"""One calibration from what the command line orders to the file."""

from __future__ import annotations

import json
import os
import re
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, get_args

from pydantic import ValidationError

from runtime.calibration import cut as cutting
from runtime.calibration import report
from runtime.calibration import result as results
from runtime.calibration.guide import Guide, QuitError
from runtime.calibration.live import Live
from runtime.calibration.result import Result
from runtime.calibration.screen import Screen
from runtime.calibration.sense import Senses
from runtime.calibration.sources import RowSource, Simulated, recorded
from runtime.calibration.taps import Taps, bodies
from runtime.contracts.errors import OptionError, ProfileError, RequestError, nearest
from runtime.contracts.signals import Array
from runtime.contracts.wearer import Dof
from runtime.control.ikns import marks
from runtime.control.ikns.calibration import CalibrationError, Thresholds
from runtime.control.ikns.marks import MarksConfig
from runtime.control.ikns.procedure import Plan, Procedure
from runtime.control.ikns.record import NAME
from runtime.control.ikns.samples import Samples, ended, joined, seen, stretch
from runtime.profile import profile
from runtime.profile.profile import Profile
from runtime.profile.source import Source
from runtime.recording.segments import check_target
from runtime.service.end_signals import EndSignals

ANONYMOUS: Final = r"^[A-Za-z]{0,4}[0-9]{1,6}$"  # no name fits it
_NEXT: Final = "Enter write it   f DOF flip its sense   r N redo point N   q quit"
_REFUSED: Final = "r N redo point N   q quit"


@dataclass(frozen=True)
class Order:
    """What is wanted; the options of `srl calibrate`."""

    profile: str
    person: str | None = None
    out: Path | None = None
    yes: bool = False
    sim: bool = False
    record: Path | None = None
    view: bool = False
    recording: Sequence[Path] | None = None
    before: Sequence[Path] | None = None
    redo: Sequence[int] | None = None
    dofs: str | None = None
    points: int | None = None
    flip: Sequence[str] = ()
    sense: Path | None = None
    option: Sequence[str] = ()
    set: Sequence[str] = ()
    instance: str | None = None
    json: bool = False


def run(order: Order, screen: Screen) -> int:
    """Returns 0 once the file is written, 130 after Ctrl-C. Errors are raised: a refused calibration is one."""
    checked, source = profile.load(order.profile, order.set)
    target = _target(order, checked, source)
    plan, thresholds = _options(order)
    senses = _senses(order, target, checked, source)
    dofs = _dofs(order) or ("swivel",)
    if order.recording:
        taps, parts, date = _recorded(order, order.recording, checked, source, thresholds)
        _check_sense(order, senses, taps.options, screen)
        result = _flipped(senses.kept(results.compute(taps, parts, date)), order.flip)
        if not order.json:
            print("\n".join(report.lines(result)))
        return _finish(order, target, result)
    if order.person is None:
        raise RequestError("--person", "it isn't said whose calibration it is", "Give an anonymous id: --person P07")
    before: list[Samples] = []
    if order.redo:
        old, before, _ = _recorded(order, order.before or (), checked, source, thresholds)
        if order.dofs and old.options.dofs != dofs:
            problem = f"they are of {', '.join(old.options.dofs)}"
            raise RequestError("--from", problem, "Name recordings of the same degrees of freedom")
        dofs, thresholds = old.options.dofs, old.options.thresholds
    elif order.before:
        raise RequestError("--from", "it goes with --redo", "Say which points: --redo 3")
    made, text = cutting.cut(checked, source, order.person, dofs, thresholds, order.sim)
    _check_sense(order, senses, MarksConfig.model_validate(made.controllers[-1].options), screen)
    procedure = Procedure(dofs, thresholds, plan, _explored(before) if before else None)
    for number in order.redo or ():
        if answer := procedure.redo(number):
            raise RequestError(f"--redo {number}", answer, "Name one of them")
    if order.sim:
        simulated = Simulated(made, text, screen.say, order.record)
        try:
            return _guided(order, target, simulated, procedure, before, screen, senses)
        finally:
            simulated.close()
    return _live(order, target, text, order.instance or checked.name, procedure, before, screen, senses)


def _live(
    order: Order, target: Path, text: Source, name: str, procedure: Procedure, before: list[Samples], screen: Screen,
    senses: Senses,
) -> int:  # fmt: skip
    """Runs the cut profile, and ends it in any case; Ctrl-C ends it, too."""
    if not re.match(profile.SLUG, name):
        raise RequestError("--instance", f"'{name}' is no name", "Use lower-case letters, digits, - and _")
    record = order.record or target.with_name(f"{target.stem}-{time.strftime('%Y%m%d-%H%M%S')}.rrd")
    check_target(record)
    with EndSignals() as signals:
        asked: list[bool] = []
        signals.pass_to(lambda: asked.append(True))
        source = Live(text, name, record, order.view, screen.say)
        try:
            code = _guided(order, target, source, procedure, before, screen, senses, lambda: bool(asked))
        except QuitError:
            if asked:
                return 130  # by Ctrl-C, as a shell says it
            raise
        finally:
            source.close()
            screen.say(f"recorded in {record}")
        return code


def _guided(
    order: Order,
    target: Path,
    source: RowSource,
    procedure: Procedure,
    before: list[Samples],
    screen: Screen,
    senses: Senses,
    stop: Any = lambda: False,
) -> int:
    """Leads through the procedure until a file is written, or it is given up."""
    guide, turned = Guide(source, procedure, screen, stop), list(order.flip)
    with screen:
        while True:
            guide.run()
            if guide.first is None:
                raise CalibrationError("recording", "no row has come", "Begin again")
            again = _computed(turned, senses, source.taps, [*before, *guide.samples], guide)
            answer, result = _decide(screen, again, turned, source.wait)
            word, _, number = answer.partition(" ")
            if word == "r" and number.strip().isdigit():
                if lack := procedure.redo(int(number)):
                    screen.say(lack)
                continue
            if word == "q":
                raise QuitError("calibration", "it was ended without a file", "Its recording can be used: --recording")
            break
    return _finish(order, target, result)


def _computed(
    turned: Sequence[str], senses: Senses, taps: Taps, parts: list[Samples], guide: Guide
) -> Result | CalibrationError:
    assert guide.first is not None
    try:
        return _flipped(senses.kept(results.compute(taps, parts, taps.date(guide.first))), turned)
    except CalibrationError as error:
        return error


def _decide(
    screen: Screen, result: Result | CalibrationError, turned: list[str], wait: Callable[[], None]
) -> tuple[str, Result | CalibrationError]:
    """Shows the report and asks what to do; flips, and notes it in `turned`, until something else is wanted."""
    refused: tuple[CalibrationError, ...] = (result,) if isinstance(result, CalibrationError) else result.refusals
    for line in [] if isinstance(result, CalibrationError) else report.lines(result):
        screen.say(line)
    for reason in refused:
        screen.say(f"refused: {reason}")
    while True:
        answer = screen.ask(_REFUSED if refused else _NEXT, wait)
        word, _, rest = answer.strip().partition(" ")
        if word in ("", "q") or (word == "r" and rest.strip().isdigit()):
            return answer.strip(), result
        # Nothing else may write a file, least of all a word that was misspelt.
        if word != "f" or isinstance(result, CalibrationError):
            screen.say(f"'{answer}' is no command")
            continue
        name = rest.strip() or (result.dofs[0] if len(result.dofs) == 1 else "")
        try:
            result = result.flipped(name)
            turned.append(name)
            screen.say(f"{name} is turned round: what was 0 is 1")
        except RequestError as error:
            screen.say(str(error))


def _finish(order: Order, target: Path, result: Result | CalibrationError) -> int:
    """Writes the file and its report; or says why it can't be used."""
    if isinstance(result, CalibrationError):
        raise result
    told = report.figures(result) | {"file": None, "report": None}
    if result.refusals:
        if order.json:
            print(json.dumps(told))
        for reason in result.refusals[:-1]:
            print(f"srl calibrate: {reason}", file=sys.stderr)
        raise result.refusals[-1]
    picture = target.with_name(f"{target.name}.report.png")
    report.draw(result, picture)  # first: without its report the file could be taken for a good one
    results.write(target, result, order.yes)
    told |= {"file": str(target), "report": str(picture)}
    if order.json:
        print(json.dumps(told))
    else:
        print(f"{target}\n{picture}")
    return 0


def _flipped(result: Result, dofs: Sequence[str]) -> Result:
    for dof in dofs:
        result = result.flipped(dof)
    return result


def _senses(order: Order, target: Path, checked: Profile, source: Source) -> Senses:
    """The files whose sense may be kept: the one that is named; else the target, then the profile's."""
    named = _named(checked, source)
    return Senses(order.sense, [target, *([] if named is None else [named])])


def _named(checked: Profile, source: Source) -> Path | None:
    """The calibration file that the profile names, if it names one. Raises ProfileError."""
    law = cutting.find(checked, source)
    given = checked.controllers[law].options.get("calibration")
    if not isinstance(given, str):
        return None
    try:
        return source.files.find(given)
    except OptionError as error:
        raise ProfileError(source.place(f"controllers.{law}.calibration"), error.problem, error.remedy) from None


def _check_sense(order: Order, senses: Senses, options: MarksConfig, screen: Screen) -> None:
    """Checks what the command line says of the sense, before anybody sits down. Raises RequestError."""
    for dof in order.flip:
        if dof not in options.dofs:
            raise RequestError("--flip", f"there is no degree of freedom '{dof}'", nearest(dof, options.dofs))
        if order.flip.count(dof) > 1:
            raise RequestError("--flip", f"'{dof}' is named twice, which would turn nothing", "Name it once")
    if senses.of(options) is None and (order.recording or order.redo):
        screen.say(
            f"No calibration file of {options.person} with these joints stands there, so the sense is as computed: "
            "what was turned round before (--flip, f) isn't in a recording. --sense FILE takes it from a file"
        )


def _recorded(
    order: Order, paths: Sequence[Path], checked: Profile, source: Source, thresholds: Thresholds
) -> tuple[Taps, list[Samples], Any]:
    """Reads recordings of one calibration, in their order."""
    if not paths:
        raise RequestError("--redo", "it isn't said what the other points come from", "Add --from FILE.rrd")
    own: MarksConfig | None = None
    if order.person is not None:  # a plain run's recording says neither whose it is nor where its signals are
        made, _ = cutting.cut(checked, source, order.person, _dofs(order) or ("swivel",), thresholds)
        own = MarksConfig.model_validate(made.controllers[-1].options)
    found: Taps | None = None
    parts: list[Samples] = []
    for path in paths:
        taps, rows = recorded(path, own)
        if found is not None and (taps.joints, taps.options.dofs) != (found.joints, found.options.dofs):
            problem = "it has other joints or degrees of freedom than the one before"
            raise RequestError(str(path), problem, "Name recordings of one calibration")
        _check_origin(path, taps, found, checked, order)
        if order.person not in (None, taps.options.person):
            raise RequestError(str(path), f"it is of {taps.options.person}", "Name a recording of this person")
        found = taps
        parts.append(ended(taps.samples(rows)))
        date = taps.date(rows)
    assert found is not None
    # A recording's own thresholds stand, but for those that were typed.
    typed = {name: getattr(thresholds, name) for name in thresholds.model_fields_set}
    kept = found.options.thresholds.model_copy(update=typed)
    return replace(found, options=found.options.model_copy(update={"thresholds": kept})), parts, date


def _check_origin(path: Path, taps: Taps, before: Taps | None, checked: Profile, order: Order) -> None:
    """Raises RequestError: a recording is of another body, or simulated and the others aren't."""
    theirs, ours = taps.bodies, bodies(checked)
    for name in sorted(theirs.keys() | ours.keys()):
        if (was := theirs.get(name)) != (now := ours.get(name)):
            problem = f"it was made with another body '{name}': {_differs(was, now)} in the profile"
            raise RequestError(str(path), problem, "Calibrate from the beginning, or set the body as it was")
    others = taps.simulated if before is None else before.simulated
    if taps.simulated != (order.sim if order.redo else others):
        problem = "it is simulated, the rest isn't" if taps.simulated else "it is of a person, the rest is simulated"
        raise RequestError(str(path), problem, "Don't mix a person and the simulated wearer in one file")


def _differs(was: dict[str, Any] | None, now: dict[str, Any] | None) -> str:
    """The first option that differs: "stature 1.75, now 1.6"."""
    if was is None or now is None:
        return f"{'none' if was is None else 'one'}, now {'none' if now is None else 'one'}"
    return next(f"{key} {was[key]}, now {now[key]}" for key in was if was[key] != now[key])


def _explored(parts: Sequence[Samples]) -> Array:
    """(T, 3) m: where the hand has been in the exploration."""
    samples = joined(parts)
    return seen(samples, stretch(samples, marks.EXPLORATION))


def _target(order: Order, checked: Profile, source: Source) -> Path:
    named = _named(checked, source)
    if order.person is not None and not re.fullmatch(ANONYMOUS, order.person):
        problem = f"'{order.person}' isn't anonymous: up to four letters, then a number"
        raise RequestError("--person", problem, "Number the persons, P07, and keep their names elsewhere")
    path = order.out or named
    if path is None:
        raise RequestError("-o", "the profile names no calibration file", "Say where it goes: -o p07.json")
    if order.out is None and order.profile in profile.shipped() and path.is_relative_to(source.files.folder):
        problem = f"the profile '{order.profile}' comes with srl, and its calibration file would be replaced"
        raise RequestError("-o", problem, "Say where the file goes, -o p07.json, or copy the profile")
    if path.is_symlink():
        path = Path(os.path.realpath(path))  # the link stays
    results.check_target(path, order.yes)
    return path


def _dofs(order: Order) -> tuple[str, ...]:
    found = tuple(name.strip() for name in (order.dofs or "").split(",") if name.strip())
    if len(set(found)) < len(found):
        raise RequestError("--dofs", "a degree of freedom is named twice", "Name each once")
    for name in found:
        if not re.fullmatch(NAME, name):
            problem = f"'{name}' is no name"
            raise RequestError("--dofs", problem, "Use up to 64 letters, digits, '.', '_' and '-': swivel,shrug")
        if order.sim and name not in get_args(Dof):
            raise RequestError("--dofs", f"the simulated wearer knows no motion '{name}'", nearest(name, get_args(Dof)))
    return found


def _options(order: Order) -> tuple[Plan, Thresholds]:
    """The procedure's times and the thresholds, with what the command line says."""
    values: dict[str, dict[str, Any]] = {"plan": {}, "thresholds": {}}
    known = {**dict.fromkeys(Plan.model_fields, "plan"), **dict.fromkeys(Thresholds.model_fields, "thresholds")}
    given = [*order.option, *([f"points={order.points}"] if order.points is not None else [])]
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
