"""One calibration from what the command line orders to the file, whatever law it is of."""

from __future__ import annotations

import importlib
import json
import os
import re
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

from srl.commissioning.calibration.guide import Guide, QuitError
from srl.commissioning.calibration.guided import Procedure
from srl.commissioning.calibration.marks import MarkedSamples
from srl.commissioning.calibration.method import Method
from srl.commissioning.calibration.played import is_motion_file, played
from srl.commissioning.calibration.request import METHODS, CalibrationRequest
from srl.commissioning.calibration.result import Result
from srl.commissioning.calibration.run_channels import RunChannels
from srl.commissioning.calibration.screen import Report, Screen
from srl.commissioning.calibration.sources import RowSource, recorded
from srl.commissioning.calibration.target import check_target, write_record
from srl.runtime.contracts import registry
from srl.runtime.contracts.errors import HostError, RequestError, SrlError, nearest
from srl.runtime.contracts.files import encoded
from srl.runtime.ipc.launch import ANONYMOUS, Launch
from srl.runtime.ipc.run_folder import ROOM, free_bytes
from srl.runtime.models.models import bodies
from srl.runtime.profile import library, profile
from srl.runtime.profile.profile import Profile
from srl.runtime.profile.source import Source
from srl.runtime.recording.segments import check_target as check_recording
from srl.runtime.recording.segments import folder_of
from srl.runtime.service.end_signals import EndSignals

_USABLE: Final = "Its recording can be used: --recording"
_GROUP: Final = "calibrations"
_MIXED: Final = "Don't mix a person and the simulated wearer in one file"
_AGAIN: Final = "r N redo number N   q quit"
Computed = Result[Any] | SrlError


def method_of(law: str) -> type[Method[Any, Any]]:
    """How one of `KINDS` is calibrated. Only its module is loaded: all of them take seconds."""
    module, _, name = METHODS[law].partition(".")
    found: type[Method[Any, Any]] = getattr(
        importlib.import_module(f"srl.commissioning.calibration.{module}.method"), name
    )
    return found


def kind_of(name: str) -> type[Method[Any, Any]]:
    """How one of `KINDS`, or a kind of another package, is calibrated.

    Raises:
        ProfileError: there is no such kind.
        HostError: the other package's can't be used, or has the name of ours.
    """
    place = f"entry points srl.{_GROUP}"
    if name in METHODS:
        if name in registry.names(_GROUP):
            problem = f"a package claims '{name}', which is srl's own kind of calibration"
            raise HostError(place, problem, "Uninstall the package, or have its author rename the kind")
        return method_of(name)
    found = registry.load(_GROUP, name, place)
    if not (isinstance(found, type) and issubclass(found, Method) and found.name == name):
        problem = f"'{name}' is no Method of srl.calibrating with this name"
        raise HostError(place, problem, "docs/extending-calibration.md says what a kind is")
    return found


def run(request: CalibrationRequest, screen: Screen) -> int:
    """Returns 0 once the file is written, 130 after Ctrl-C. Errors are raised: a refused calibration is one."""
    kind = kind_of(request.kind)
    for option in fields(request):
        only = option.metadata.get("only", request.kind)
        if only != request.kind and getattr(request, option.name):
            remedy = f"Leave it out, or calibrate {only}"
            raise RequestError(f"--{option.name}", f"it is of '{only}', not of '{request.kind}'", remedy)
    if request.person is not None and not kind.personal:
        raise RequestError("--person", f"'{request.kind}' is no person's", "Leave it out")
    method = _method(request, kind, screen.say)
    checked = method.checked
    if request.recording:
        channel_map, parts, date = _recorded(method, request.recording)
        method.ready(channel_map)
        result = method.compute(channel_map, parts, date)
        if not request.json:
            print("\n".join(method.lines(result)))
        return _finish(method, result)
    if request.person is None and kind.personal:
        raise RequestError("--person", "it isn't said whose calibration it is", "Give an anonymous id: --person P07")
    before: list[MarkedSamples] = []
    earlier: RunChannels | None = None
    if request.redo:
        earlier, before, _ = _recorded(method, request.before or ())
    elif request.before:
        raise RequestError("--from", "it goes with --redo", f"Say which {method.thing}: --redo 3")
    made, text = method.subset(request.person or "")
    _check_simulated(request, checked, made)
    procedure = method.procedure(before)
    for number in request.redo or ():
        if answer := procedure.redo(number):
            raise RequestError(f"--redo {number}", answer, "Name one of them")
    if request.sim:
        simulated = method.simulated(made, text)
        try:
            _check_alike(simulated, earlier)
            return _guided(method, simulated, procedure, before, screen)
        finally:
            simulated.close()
    return _live(method, text, request.instance or checked.name, procedure, before, earlier, screen)


def _method(request: CalibrationRequest, kind: type[Method[Any, Any]], say: Callable[[str], None]) -> Method[Any, Any]:
    checked, source = profile.load(request.profile, request.set)
    return kind(request, checked, source, _target(request, checked, source, kind), say)


def beside_twins(request: CalibrationRequest) -> Launch | None:
    """The part of the profile whose devices' twins the calibration needs, with the simulated person who is instructed.

    None: the whole profile's twins serve, and the user's keys move them.

    Raises:
        SrlError: what is requested can't be calibrated so.
    """
    kind = kind_of(request.kind)
    if not kind.instructed:
        return None
    _, made = _method(replace(request, sim=True), kind, lambda text: None).subset(request.person or "P0")
    files = made.files
    return Launch(made.label, made.text, list(made.overrides), str(files.folder), encoded(files.kept))


def _check_simulated(request: CalibrationRequest, checked: profile.Profile, made: profile.Profile) -> None:
    """Raises RequestError: `--sim` names devices that aren't there, or leaves out one that the person needs."""
    for device in request.simulated:
        if device not in checked.devices:
            raise RequestError(f"--sim {device}", "the profile has no such device", nearest(device, checked.devices))
    if request.simulated and (real := [name for name in made.devices if name not in request.simulated]):
        problem = f"a simulated person can't move what is real: {', '.join(real)}"
        raise RequestError("--sim", problem, f"Name it, too ({' '.join(made.devices)}), or no device at all")


def _check_alike(source: RowSource, earlier: RunChannels | None) -> None:
    """Raises RequestError: what is done now is simulated, and the recording before isn't, or the other way round."""
    if earlier is not None and earlier.simulated != source.channel_map.simulated:
        raise RequestError("--from", _mixed(earlier.simulated), _MIXED)


def _live(
    method: Method[Any, Any], text: Source, name: str, procedure: Procedure, before: list[MarkedSamples],
    earlier: RunChannels | None, screen: Screen,
) -> int:  # fmt: skip
    """Runs the cut profile, and ends it in any case; Ctrl-C ends it, too."""
    request, target = method.request, method.target
    if not re.match(profile.SLUG, name):
        raise RequestError("--instance", f"'{name}' is no name", "Use lower-case letters, digits, - and _")
    record = request.record or target.with_name(f"{target.stem}-{time.strftime('%Y%m%d-%H%M%S')}.rrd")
    check_recording(record)
    _check_room(target.parent, record.parent)
    with EndSignals() as signals:
        asked: list[bool] = []

        def stop() -> bool:
            request.check_twins()
            return bool(asked)

        signals.pass_to(lambda: asked.append(True))
        source = method.live(text, name, record, screen)
        try:
            _check_alike(source, earlier)
            shown = source.screen or screen
            shown.begin(source.folder)
            code = _guided(method, source, procedure, before, shown, stop)
        except QuitError:
            if asked or source.interrupted:
                return 130  # by Ctrl-C, as a shell says it
            raise
        finally:
            source.close()
            if record.exists():
                screen.say(f"recorded in {record}")
            else:
                screen.say(f"{record} wasn't made: what could be recorded is in {folder_of(record)}")
        return code


def _check_room(*folders: Path) -> None:
    """Raises RequestError: a disk is full, so what a person does could neither be recorded nor written."""
    for folder in folders:
        if free_bytes(folder) < ROOM:
            problem = f"its disk has less than {ROOM >> 20} MiB free, so what is done could be lost"
            raise RequestError(str(folder), problem, "Free some, or choose another folder: -o, --record")


def _guided(
    method: Method[Any, Any],
    source: RowSource,
    procedure: Procedure,
    before: list[MarkedSamples],
    screen: Screen,
    stop: Any = lambda: False,
) -> int:
    """Leads through the procedure until a file is written, or it is given up."""
    method.ready(source.channel_map)
    guide = Guide(source, procedure, screen, stop)

    def wait() -> None:
        source.wait()
        if stop():
            raise QuitError("calibration", "it was ended without a file", _USABLE)

    with screen:
        while True:
            guide.run()
            if guide.first is None:
                raise method.error("recording", "no row has come", "Begin again")
            date = source.channel_map.date(guide.first)
            try:
                again: Computed = method.compute(source.channel_map, [*before, *guide.samples], date)
            except method.error as error:
                again = error
            answer, result = _decide(method, screen, again, wait)
            word, _, number = answer.partition(" ")
            if word == "r" and number.strip().isdigit():
                if lack := procedure.redo(int(number)):
                    screen.say(lack)
                continue
            if word == "q":
                raise QuitError("calibration", "it was ended without a file", _USABLE)
            break
        if fine := not isinstance(result, SrlError) and not result.refusals:
            if source.moves:  # its limb could move, and nobody would watch it meanwhile
                source.close()
            _write(method, result)
            screen.written(f"{method.target}, its report {_picture(method)}")
    if not fine:
        return _finish(method, result)  # it says why not
    _tell(method, result)
    return 0


def _decide(
    method: Method[Any, Any], screen: Screen, result: Computed, wait: Callable[[], None]
) -> tuple[str, Computed]:
    """Shows the report and asks what to do, until something else than the method's own commands is wanted."""
    screen.report(_report(method, result))
    refused = isinstance(result, SrlError) or bool(result.refusals)
    keys = _AGAIN if refused else "   ".join(filter(None, ("Enter write it", method.next, _AGAIN)))
    while True:
        answer = screen.ask(keys, wait).strip()
        word, _, rest = answer.partition(" ")
        if word in ("", "q") or (word == "r" and rest.strip().isdigit()):
            return answer, result
        # Nothing else may write a file, least of all a word that was misspelt.
        try:
            again = None if isinstance(result, SrlError) else method.command(result, answer)
        except RequestError as error:
            screen.say(str(error))
            continue
        if again is None:
            screen.say(f"'{answer}' is no command")
        else:
            result = again
            screen.changed(_report(method, result))


def _report(method: Method[Any, Any], result: Computed) -> Report:
    if isinstance(result, SrlError):
        return Report((), (str(result),), None)
    refused = tuple(map(str, result.refusals))
    return Report(method.lines(result), refused, partial(method.draw, result), method.choices(result))


def _finish(method: Method[Any, Any], result: Computed) -> int:
    """Writes the file and its report, and says where; or says why it can't be used."""
    _write(method, result)
    _tell(method, result)
    return 0


def _write(method: Method[Any, Any], result: Computed) -> None:
    """Writes the file and its report. Raises why it can't be used."""
    request = method.request
    if isinstance(result, SrlError):
        raise result
    if result.refusals:
        if request.json:
            print(json.dumps(method.metrics(result) | {"file": None, "report": None}))
        for reason in result.refusals[:-1]:
            print(f"srl calibrate: {reason}", file=sys.stderr)
        raise result.refusals[-1]
    method.draw(result, _picture(method))  # first: without its report the file could be taken for a good one
    write_record(method.target, method.record(result), request.yes)


def _tell(method: Method[Any, Any], result: Computed) -> None:
    """Says what was written."""
    target, picture = method.target, _picture(method)
    if method.request.json:
        print(json.dumps(method.metrics(result) | {"file": str(target), "report": str(picture)}))
    else:
        print(f"{target}\n{picture}")


def _picture(method: Method[Any, Any]) -> Path:
    return method.target.with_name(f"{method.target.name}.report.png")


def _recorded(method: Method[Any, Any], paths: Sequence[Path]) -> tuple[Any, list[MarkedSamples], Any]:
    """Reads recordings of one calibration, in their order."""
    if not paths:
        problem = f"it isn't said what the other {method.thing} come from"
        raise RequestError("--redo", problem, "Add --from FILE.rrd")
    found: Any = None
    parts: list[MarkedSamples] = []
    for path in paths:
        file = is_motion_file(path)
        channel_map, rows = played(method, path) if file else recorded(path, method.channel_map)
        if found is not None and not method.same(channel_map, found):
            problem = "it isn't of the same calibration as the one before"
            raise RequestError(str(path), problem, "Name recordings of one calibration")
        if found is not None and channel_map.person != found.person:
            problem = f"it is of {channel_map.person}, the one before of {found.person}"
            raise RequestError(str(path), problem, "Name recordings of one person")
        _check_origin(path, channel_map, found, method.checked, method.request)
        if method.request.person not in (None, channel_map.person):
            raise RequestError(str(path), f"it is of {channel_map.person}", "Name a recording of this person")
        found = channel_map
        parts.append(method.ended(channel_map.samples(rows)))
        date = channel_map.date(rows)
    return method.take(found), parts, date


def _check_origin(
    path: Path, channel_map: RunChannels, before: RunChannels | None, checked: Profile, request: CalibrationRequest
) -> None:
    """Raises RequestError: a recording is of another body, or simulated and the others aren't."""
    theirs, ours = channel_map.bodies, bodies(checked.models)
    for name in sorted(theirs.keys() | ours.keys()):
        if (was := theirs.get(name)) != (now := ours.get(name)):
            problem = f"it was made with another body '{name}': {_differs(was, now)} in the profile"
            raise RequestError(str(path), problem, "Calibrate from the beginning, or set the body as it was")
    others = channel_map.simulated if before is None else before.simulated
    if request.redo and not request.twins:  # beside twins the run says itself what is simulated (`_check_alike`)
        others = request.sim
    if channel_map.simulated != others:
        raise RequestError(str(path), _mixed(channel_map.simulated), _MIXED)


def _mixed(simulated: bool) -> str:
    return "it is simulated, the rest isn't" if simulated else "it is of a person, the rest is simulated"


def _differs(was: dict[str, Any] | None, now: dict[str, Any] | None) -> str:
    """The first option that differs: "stature 1.75, now 1.6"."""
    if was is None or now is None:
        return f"{'none' if was is None else 'one'}, now {'none' if now is None else 'one'}"
    return next(f"{key} {was[key]}, now {now[key]}" for key in was if was[key] != now[key])


def _target(request: CalibrationRequest, checked: Profile, source: Source, kind: type[Method[Any, Any]]) -> Path:
    file = kind.named(request, checked, source)
    if request.person is not None and not re.fullmatch(ANONYMOUS, request.person):
        problem = f"'{request.person}' isn't anonymous: up to four letters, then a number"
        raise RequestError("--person", problem, "Number the persons, P07, and keep their names elsewhere")
    path = request.out or file
    if path is None:
        raise RequestError("-o", "the profile names no calibration file", "Say where it goes: -o p07.json")
    if request.out is None and request.profile in library.shipped() and path.is_relative_to(source.files.folder):
        problem = f"the profile '{request.profile}' comes with srl, and its calibration file would be replaced"
        raise RequestError("-o", problem, "Say where the file goes, -o p07.json, or copy the profile")
    if path.is_symlink():
        path = Path(os.path.realpath(path))  # the link stays
    check_target(path, kind.record_type, request.yes)
    return path
