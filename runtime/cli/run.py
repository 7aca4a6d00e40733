"""`srl run`: runs a profile."""

from __future__ import annotations

import argparse
import json
import re
import shutil
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from srl.runtime.cli import add_command, on_twins, options
from srl.runtime.cli.check import check_certificates, check_guards
from srl.runtime.cli.console import Console
from srl.runtime.cli.status import Status
from srl.runtime.contracts import extras
from srl.runtime.contracts.errors import UNAVAILABLE, DeviceError, RequestError
from srl.runtime.contracts.files import encoded
from srl.runtime.ipc import latches
from srl.runtime.ipc.events import Level
from srl.runtime.ipc.header import Cause
from srl.runtime.ipc.launch import ANONYMOUS, Launch
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.run_folder import ROOM, RunFolder, free_bytes
from srl.runtime.profile import profile, wiring
from srl.runtime.profile.graph import Graph
from srl.runtime.profile.source import Source
from srl.runtime.recording.segments import folder_of
from srl.runtime.service import arming
from srl.runtime.service.end_signals import EndSignals
from srl.runtime.service.helpers import helpers
from srl.runtime.service.persistent_latches import PersistentLatches
from srl.runtime.service.summary import WELL, Summary
from srl.runtime.service.supervisor import Supervisor, state_dir

REFRESH = 0.1  # s between two readings of the rows


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Registers the command."""
    parser = add_command(subparsers, "run", "srl run sixth-finger --sim --duration 20 --record hand.rrd")
    options.profile(parser)
    options.sim(parser)
    on_twins.add_option(parser)
    parser.add_argument("--fast", action="store_true", help="simulated time as fast as it goes (all devices simulated)")
    parser.add_argument("--duration", type=float, metavar="S", help="end after so many seconds of the loop's time")
    parser.add_argument("--record", type=Path, metavar="FILE.rrd", help="record every cycle")
    parser.add_argument("--person", metavar="ID", help="with --record: whose run it is, an anonymous id such as P07")
    options.figure(parser, "draw what happened, from the recording")
    parser.add_argument("--view", action="store_true", help="serve its panel, for a browser on this machine")
    parser.add_argument("--foxglove", action="store_true", help="show it live to Foxglove's app on this machine")
    options.wearer(parser)
    options.overrides(parser)
    options.name(parser)
    options.confirm(parser)
    options.run_code(parser, True)
    options.as_json(parser, "print one summary object at the end")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Runs until the duration is over, a signal arrives, or a fault ends the run."""
    with EndSignals() as signals:
        status = Status(Console(sys.stderr), quiet=args.json)
        try:
            on_twins.check(args)
            status.wait(f"{args.profile}: its parts are put together")
            with on_twins.twins(args.profile, args.twin, args.set, args.wearer, status.line) as twins:
                return _run(args, twins, signals, status)
        finally:
            status.clear()


def _run(args: argparse.Namespace, twins: on_twins.Twins, signals: EndSignals, status: Status) -> int:
    checked, source = profile.load(args.profile, on_twins.overrides(args, twins), args.run_code)
    graph = wiring.build(checked, source, args.sim)
    check_guards(graph)
    check_certificates(graph)
    _check_arguments(args, graph)
    _check_owners(args.person, source, graph)
    name = checked.name if args.instance is None else args.instance
    if not re.match(profile.SLUG, name):
        raise RequestError("--instance", f"'{name}' is no name", "Use lower-case letters, digits, - and _")
    state = state_dir(name)
    automatic, advice = arming.automatic(graph, args.confirm or twins.alone(graph))
    cycles = round(args.duration * float(checked.rate)) if args.duration is not None else _wearers_end(graph)
    where = RunFolder.of(name)
    where.claim()
    latched: PersistentLatches | None = None
    supervisor: Supervisor | None = None
    well = False
    try:
        # Only what stopped a real limb outlives its run.
        if {graph.devices[a.device].name for a in graph.actuators} - twins.devices - set(graph.simulated):
            latched = PersistentLatches(state, status.line)
        record = args.record
        if args.figure is not None and record is None:
            record = where.path / "figure.rrd"
            record.unlink(missing_ok=True)
            shutil.rmtree(folder_of(record), ignore_errors=True)
        launch = Launch(
            source.label, source.text, list(source.overrides), str(source.files.folder), encoded(source.files.kept),
            args.sim, args.fast, cycles, automatic, [] if latched is None else latches.names(latched.latches),
            record is not None, args.person or "", _make_room(args, source, checked, status),
            sorted(twins.devices),
        )  # fmt: skip
        telemetry = helpers(where, checked.bus, record, args.view, args.foxglove)
        supervisor = Supervisor(where, launch, state, telemetry, status.line)
        signals.pass_to(supervisor.end)
        result = _supervise(supervisor, latched, args, advice, status)
        if (error := supervisor.error) is not None:
            if isinstance(error, DeviceError):  # another try may find it: systemd restarts the service
                error.exit_code = UNAVAILABLE
            raise error
        code = _report(supervisor, result, args, status)
        well = code == 0
        if args.figure is not None and record is not None:
            status.wait(f"{args.figure} is drawn")
            _draw(_recording(record), args.figure)
            status.clear()
    finally:
        if latched is not None:
            ran = latched.began or (supervisor is not None and supervisor.death is not None)
            latched.close(well or not ran)  # before the first cycle nothing has moved
        where.release()
    return code


def _supervise(
    supervisor: Supervisor, latched: PersistentLatches | None, args: argparse.Namespace, advice: str, status: Status
) -> dict[str, Any]:
    """Starts the supervisor, runs it until the end, and returns the figures."""
    started = time.monotonic()
    summary: Summary | None = None
    next_look = 0.0
    supervisor.start()
    while supervisor.step():
        if latched is not None and supervisor.running and supervisor.rows is not None:
            latched.follow(supervisor.rows)
        if time.monotonic() < next_look:
            continue
        next_look = time.monotonic() + REFRESH
        if not supervisor.running:
            if summary is None:
                status.wait(f"{args.profile}: the devices are opened, {time.monotonic() - started:.0f} s")
            continue
        if summary is None:
            summary = _summary(supervisor)
            if advice:
                status.line(advice)
        if summary is not None:
            _show(supervisor, summary, status)
    summary = summary or _summary(supervisor)
    if summary is not None:
        _show(supervisor, summary, status)
        status.end()
    status.clear()
    if args.record is not None:
        status.wait(f"{args.record} is completed")
    failed = supervisor.finish()
    status.clear()
    if "recorder" in failed and supervisor.error is None:  # else the run hasn't started, and says why
        status.line("the recording is NOT complete; what was saved is in its .segments folder")
    return (summary.metrics() if summary is not None else {}) | {"recording_complete": "recorder" not in failed}


def _summary(supervisor: Supervisor) -> Summary | None:
    """The figures of a run whose loop has begun."""
    if supervisor.layout is None or supervisor.rows is None:
        return None
    return Summary(supervisor.layout, supervisor.rows)


def _show(supervisor: Supervisor, summary: Summary, status: Status) -> None:
    summary.update()
    status.mark(summary)
    for event in supervisor.events.take() if supervisor.events is not None else ():
        status.line(f"cycle {event.cycle}: {event.text}", event.level)
    status.show(summary)


def _report(supervisor: Supervisor, result: dict[str, Any], args: argparse.Namespace, status: Status) -> int:
    cause = Cause[result.get("cause", "none").upper()]
    code = 0 if cause in WELL and result["recording_complete"] else 1
    result["instance"] = supervisor.run_folder.path.name
    result["restarts"] = {h.name: h.restarts for h in supervisor.helpers}
    result["result"] = supervisor.metrics
    result["recording"] = str(_recording(args.record)) if args.record is not None else None
    if supervisor.death is not None:
        code = 1
        death = supervisor.death
        result["death"] = {
            "how": death.how,
            "actuators_stopped_ms": round(death.stopped_after_ms, 3),
            "black_box": str(death.black_box) if death.black_box else None,
        }
        rows = f"The last rows are in {death.black_box}. " if death.black_box else ""
        status.line(
            f"{death.how}; the actuators had their stop {death.stopped_after_ms:.1f} ms after its last sign of life. "
            f"{rows}Find the cause before the next run, which begins in the stop.",
            Level.ERROR,
        )
    elif cause not in WELL:
        text = f"ended in a fault: {cause.name.lower().replace('_', ' ')} {result['fault_source']}"
        status.line(text.rstrip(), Level.ERROR)
    if args.json:
        print(json.dumps(result))
    return code


def _wearers_end(graph: Graph) -> int | None:
    """Number of cycles until the wearer's recording is over; None where there is no end."""
    if graph.world is None or graph.world.duration is None:
        return None
    return round(graph.world.duration * float(graph.profile.rate))


def _check_arguments(args: argparse.Namespace, graph: Graph) -> None:
    if args.duration is not None and not args.duration > 0:
        raise RequestError("--duration", f"{args.duration} s is no duration", "Give a number above 0")
    real = [d.name for d in graph.devices if d.name not in graph.simulated]
    if args.fast and real:
        raise RequestError(
            "--fast",
            f"real devices keep their own time: {', '.join(real)}",
            "Leave --fast out, or simulate all with --sim",
        )
    if args.wearer and args.sim is None and args.twin is None:
        raise RequestError("--wearer", "only a simulated person repeats a recording", "Add --sim, or --twin")
    if args.person is not None and args.record is None:
        raise RequestError("--person", "nothing is recorded that could say it", "Add --record FILE.rrd")
    options.check_person(args.person)
    if args.record is not None:
        from srl.runtime.recording.segments import check_target

        check_target(args.record)
    for option, asked, needed in (
        ("--view", args.view, ("aiohttp",)),
        ("--foxglove", args.foxglove, ("aiohttp",)),
    ):
        for name in needed if asked else ():
            if find_spec(name) is None:  # else it would fail beside the limb, or after the run
                raise RequestError(option, f"this needs {name}, which isn't installed here", extras.remedy(name))
    options.check_figure(args.figure)


def _make_room(args: argparse.Namespace, source: Source, checked: profile.Profile, status: Status) -> list[str]:
    """Deletes what `record.keep` doesn't keep, and returns what it deleted.

    Raises:
        RequestError: the disk is nearly full, or too much is kept for another recording.
    """
    if args.record is None:
        return []
    folder = args.record.absolute().parent
    texts: list[str] = []
    if checked.record.keep is not None:
        # Not at the top: it loads rerun.
        from srl.runtime.recording.keep import Keep, make_room
        from srl.runtime.recording.summary import persons

        run = Layout(devices=[])
        run.meta = {"person": args.person, "profile": source.text, "files": encoded(source.files.kept)}
        why = make_room(folder, Keep.of(checked.record.keep.model_dump()), persons(run), texts.append)
        if why:
            for text in texts:  # else the run's events say it
                status.line(text)
            remedy = "Move or delete some (srl recordings --delete), or raise record.keep in the profile"
            raise RequestError(f"--record: {folder}", why, remedy)
    if free_bytes(folder) < ROOM:
        problem = f"its disk has less than {ROOM >> 20} MiB free, so the recording would soon be cut short"
        raise RequestError(f"--record: {folder}", problem, "Free some, or choose another folder")
    return texts


def _check_owners(person: str | None, source: Source, graph: Graph) -> None:
    """Refuses another person's calibration, of whatever kind. A simulated person's serves where all is simulated."""
    if person is None:
        return
    from srl.runtime.recording.summary import owner

    all_simulated = all(device.name in graph.simulated for device in graph.devices)
    for name, content in source.files.kept.items():
        whose, simulated = owner(content)
        known = re.fullmatch(ANONYMOUS, whose) is not None and not (simulated and all_simulated)
        if known and whose != person:
            problem = f"the file {name} was made with {whose}, the run is {person}'s"
            raise RequestError("--person", problem, f"Name {person}'s file in the profile, or calibrate {person}")


def _recording(record: Path) -> Path:
    """Where the recording is: without rerun, or where it couldn't be finished, in its segments."""
    return folder_of(record) if folder_of(record).exists() else record


def _draw(record: Path, figure: Path) -> None:
    from srl.runtime.pictures.figure import draw
    from srl.runtime.recording.reader import read

    draw(read(record), figure)
