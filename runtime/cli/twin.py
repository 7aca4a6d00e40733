"""`srl twin`: opens the wire-level twins of a profile's devices, in real time."""

from __future__ import annotations

import argparse
import gc
import json
import os
import select
import shlex
import signal
import sys
import time
from contextlib import suppress
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from srl.runtime.cli import add_command, on_twins, options, wearer
from srl.runtime.contracts import registry
from srl.runtime.contracts.errors import ProfileError, RequestError, SrlError, nearest
from srl.runtime.contracts.wearer import Wearer, instruction_of
from srl.runtime.contracts.world import Fake, Twin, World
from srl.runtime.ipc.child import PARENT, end_with_parent
from srl.runtime.ipc.launch import Launch
from srl.runtime.loop.clock import MonotonicClock
from srl.runtime.profile import profile, wiring
from srl.runtime.profile.graph import Graph
from srl.runtime.profile.source import Source

RATE = 1000.0  # Hz, how often the world is stepped and the twins look at their ports
LOG_PERIOD = 10_000_000  # ns of world time between rows of the log
LATE = 50_000_000  # ns behind its time, from which a client may take a device for silent
_NOBODY = "the simulated world has no person who takes instructions, or several"
_BEFORE_OTHERS = -10  # nice, where that is allowed
_HURRY = "End other programs" + ("" if PARENT in os.environ else ", or give it priority: chrt -f 10 srl twin ...")
LAST_WORDS = 50_000_000  # ns, how long the twins still hear what was sent before the end


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Registers the command."""
    parser = add_command(subparsers, "twin", "srl twin sixth-finger")
    options.profile(parser)
    parser.add_argument("devices", nargs="*", metavar="DEVICE", help="default: all that have a twin")
    options.overrides(parser)
    options.wearer(parser)
    parser.add_argument("--duration", type=float, metavar="S", help="end after so many seconds; default: at Ctrl-C")
    parser.add_argument(
        "--pace", type=float, default=1.0, metavar="N", help="seconds of the world in a second; default: 1"
    )
    options.renamed(parser, "--speed", "--pace")
    parser.add_argument("--poll", type=float, default=RATE, metavar="HZ", help="looks at the ports; default: 1000")
    options.renamed(parser, "--rate", "--poll")
    parser.add_argument("--link", type=Path, metavar="FOLDER", help="keep a symlink FOLDER/DEVICE to each port")
    parser.add_argument("--log", type=Path, metavar="FILE.npz", help="save what happened at the end (docs/twins.md)")
    parser.add_argument("--control", action="store_true", help="take faults from standard input (docs/twins.md)")
    parser.add_argument("--launch", type=Path, help=argparse.SUPPRESS)  # a part of the profile: srl calibrate --twin
    options.as_json(parser, "one JSON line with the addresses, one with the figures")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Serves until the duration is over or a signal arrives; with `srl run --twin`, until that is gone."""
    if PARENT in os.environ:
        end_with_parent(signal.SIGTERM)
        _before_others()
    _check_arguments(args)
    checked, source = _profile(args)
    graph = wiring.build(checked, source, [])
    assert graph.world is not None
    for line in (*(f"warning: {warning}" for warning in graph.warnings), *graph.remarks):
        print(line, file=sys.stderr)
    if args.launch is not None and not hasattr(graph.world.wearer, "instruct"):
        raise ProfileError(source.place("sim"), _NOBODY, "Calibrate with --sim or a person")
    twins = make_twins(graph, args.devices)
    for name, twin in twins.items():
        if args.link is not None:
            _serial(twin, name).link = args.link / name
        if args.log is not None and hasattr(twin, "keep_log"):
            twin.keep_log = True
    ended: list[int] = []
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda caught, _: ended.append(caught))
    log = _Log(graph.world) if args.log is not None else None
    try:
        for twin in twins.values():
            twin.open()
        _announce(args, twins)
        gc.collect()
        gc.freeze()  # what stands now stays: to search it for garbage again and again takes 40 ms each time
        late = _Late()
        _serve(graph.world, twins, args, ended, log, late)
        late.sum_up()
        if args.json:
            metrics = {name: twin.metrics() for name, twin in twins.items()}
            print(json.dumps({"metrics": metrics, "late": late.metrics()}), flush=True)
        else:
            _tell_refused(twins)
    finally:
        for twin in twins.values():
            twin.close()
        graph.world.close()
    if log is not None:
        log.save(args.log, twins)
    return 0


def _before_others() -> None:
    """A twin that is late looks like a device that fails: it goes before what isn't a loop, where that is allowed."""
    if os.getpriority(os.PRIO_PROCESS, 0) != 0:
        return  # somebody has chosen
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, _BEFORE_OTHERS)
    with suppress(OSError):  # the kernel shares the processors among sessions first, and this is a session of its own
        Path("/proc/self/autogroup").write_text(str(_BEFORE_OTHERS))


def _profile(args: argparse.Namespace) -> tuple[profile.Profile, Source]:
    if args.launch is None:
        return profile.load(args.profile, wearer.overrides(args.profile, args.set, args.wearer))
    return on_twins.parsed(Launch.load(args.launch))


def make_twins(graph: Graph, names: list[str]) -> dict[str, Twin]:
    """Makes a twin for each named device, by default for all that have one. None is opened yet.

    Raises:
        ProfileError: no such device, or its driver has no twin.
    """
    entries, known = graph.profile.devices, registry.names("twins")
    for name in names:
        if name not in entries:
            raise ProfileError(
                f"srl twin {name}", f"{graph.source.label} has no device '{name}'", nearest(name, entries)
            )
    chosen = names or [name for name, entry in entries.items() if entry.driver in known]
    if not chosen:
        drivers = ", ".join(sorted({entry.driver for entry in entries.values()}))
        raise ProfileError(
            graph.source.label,
            f"none of its drivers has a twin: {drivers}",
            f"Drivers that have one: {', '.join(known)}",
        )
    fakes = {device.name: device for device in graph.devices if isinstance(device, Fake)}
    return {
        name: registry.load("twins", entries[name].driver, graph.source.place(f"devices.{name}.driver"))(fakes[name])
        for name in dict.fromkeys(chosen)
    }


def _serve(
    world: World, twins: dict[str, Twin], args: argparse.Namespace, ended: list[int], log: _Log | None, late: _Late
) -> None:
    clock = MonotonicClock(Fraction(args.poll))
    control = _Control(twins, world.wearer, args.json) if args.control else None
    clock.start()
    start = clock.tick.deadline
    addresses = {name: twin.address for name, twin in twins.items()}
    due = start
    while not ended:
        tick = clock.wait()
        elapsed = tick.deadline - start
        if args.duration is not None and elapsed > args.duration * 1e9:
            break
        # Missed ticks are made up step by step: a device's own watchdogs must see the time pass.
        for due in range(tick.deadline - tick.missed * clock.period, tick.deadline + 1, clock.period):
            if ended:
                break  # a machine that is too slow for the world would never be done
            world.advance(round((due - start) * args.pace))
            for twin in twins.values():
                twin.service(due)
            late.served(due)
            clock.breathe()
        if log is not None:
            log.take(tick.now)
        if control is not None:
            control.service()
        for name, twin in twins.items():
            if twin.address != addresses[name]:
                addresses[name] = twin.address
                _say(f"{name} is at {twin.address}" if twin.address else f"{name} is gone", args.json)
    # What a client had sent before the end is still on its way through the port.
    for last in range(due, due + LAST_WORDS, clock.period):
        world.advance(round((last - start) * args.pace))
        for twin in twins.values():
            twin.service(last)


def _tell_refused(twins: dict[str, Twin]) -> None:
    """Prints what the twins refused, and how often."""
    for name, twin in twins.items():
        refused = twin.metrics().get("refused")
        if isinstance(refused, dict) and refused:
            print(f"{name} refused: " + ", ".join(f"{what} ({count})" for what, count in refused.items()), flush=True)


def _announce(args: argparse.Namespace, twins: dict[str, Twin]) -> None:
    line = ["run", args.profile]
    for override in args.set:
        if not override.strip().startswith("sim."):
            line += ["--set", override]
    for name, twin in twins.items():
        line += ["--set", f"devices.{name}.port={twin.address}"]
    line.append("--confirm")
    if args.json:
        print(
            json.dumps({"twins": {name: twin.address for name, twin in twins.items()}, "run": line}),
            flush=True,
        )
        return
    for name, twin in twins.items():
        print(f"{name:<12} {twin.address}")
    print(f"srl {shlex.join(line)}", flush=True)


def _say(text: str, quiet: bool) -> None:
    print(text, file=sys.stderr if quiet else sys.stdout, flush=True)


class _Control:
    """Faults from standard input, one line each: VERB DEVICE. Each is answered by one line."""

    def __init__(self, twins: dict[str, Twin], person: Wearer | None, as_json: bool) -> None:
        self._twins, self._person, self._json = twins, person, as_json
        self._poll = select.poll()
        self._poll.register(sys.stdin.fileno(), select.POLLIN)
        self._rest = b""
        self._open = True

    def service(self) -> None:
        """Carries out the lines that have arrived. Never blocks."""
        if not self._open or not self._poll.poll(0):
            return
        data = os.read(sys.stdin.fileno(), 4096)
        self._open = bool(data)
        *lines, self._rest = (self._rest + data).split(b"\n")
        for line in lines:
            if words := line.decode("utf-8", "replace").split():
                try:
                    self._do(words)
                except SrlError as error:
                    print(f"srl twin: {error}", file=sys.stderr, flush=True)

    def _do(self, words: list[str]) -> None:
        if words[0] == "wearer":
            self._instruct(" ".join(words[1:]))
            return
        verb, name = words if len(words) == 2 else (" ".join(words), "")
        if verb not in _VERBS:
            raise RequestError(f"--control '{' '.join(words)}'", "expected VERB DEVICE", f"Verbs: {', '.join(_VERBS)}")
        if name not in self._twins:
            raise RequestError(f"--control '{verb} {name}'", f"there is no twin '{name}'", nearest(name, self._twins))
        twin = self._twins[name]
        attribute, value = _VERBS[verb]
        if not hasattr(twin, attribute):
            raise RequestError(f"--control '{verb} {name}'", "this device's twin can't do that", "Use another verb")
        if value is None:
            getattr(twin, attribute)()
        else:
            setattr(twin, attribute, value)
        done = {"control": verb, "device": name, "address": twin.address}
        print(json.dumps(done) if self._json else f"ok {verb} {name} {twin.address}".rstrip(), flush=True)

    def _instruct(self, text: str) -> None:
        """What the simulated person does from now on, as `contracts.wearer.written` writes it."""
        try:
            if self._person is None or not hasattr(self._person, "instruct"):
                raise ValueError(_NOBODY)
            self._person.instruct(instruction_of(text))
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
            problem = f"the simulated person can't do it: {error}"
            raise RequestError("--control wearer", problem, "Change what the profile simulates") from None


_VERBS: dict[str, tuple[str, bool | None]] = {  # a method to call, or an attribute and its value
    "close": ("close", None),
    "open": ("open", None),
    "mute": ("muted", True),
    "unmute": ("muted", False),
    "unplug": ("unplugged", True),
    "plug": ("unplugged", False),
    "restart": ("restart", None),
}


class _Late:
    """How far the twins are behind their time, which is what a busy machine does to them."""

    def __init__(self) -> None:
        self._times = self._most = 0
        self._late = False

    def served(self, due: int) -> None:
        """Takes that the twins have been served with what was due (ns of CLOCK_MONOTONIC)."""
        behind = time.monotonic_ns() - due
        before, self._late = self._late, behind > LATE
        self._times += self._late and not before
        self._most = max(self._most, behind)
        if self._late and not before and self._times == 1:
            print(
                f"srl twin: late by {behind * 1e-9:.2f} s, as this machine is busy: what the devices say comes late, "
                f"and a client may find them silent. {_HURRY}",
                file=sys.stderr, flush=True,
            )  # fmt: skip

    def sum_up(self) -> None:
        """Says at the end how often it was."""
        if self._times:
            print(
                f"srl twin: late {self._times} times, by up to {self._most * 1e-9:.2f} s", file=sys.stderr, flush=True
            )

    def metrics(self) -> dict[str, float]:
        """How often, and by how much at most, s."""
        return {"times": self._times, "most": self._most * 1e-9}


class _Log:
    """The world's ground truth at 100 Hz of its time, saved to a file at the end."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._next = 0
        self._times: list[tuple[int, int]] = []
        self._rows: dict[str, list[Any]] = {name: [] for name in world.truth_arrays}

    def take(self, now: int) -> None:
        """Takes a row if one is due."""
        time = self._world.time
        if time < self._next:
            return
        self._next = time - time % LOG_PERIOD + LOG_PERIOD
        self._times.append((time, now))
        for name, values in self._world.truth_arrays.items():
            self._rows[name].append(values.copy())

    def save(self, path: Path, twins: dict[str, Twin]) -> None:
        """Writes the file."""
        times = np.array(self._times, np.int64).reshape(-1, 2)
        arrays: dict[str, Any] = {"t": times[:, 0] * 1e-9, "now_ns": times[:, 1]}
        arrays |= {f"world.{name}": np.array(rows) for name, rows in self._rows.items()}
        for device, twin in twins.items():
            if hasattr(twin, "log"):
                arrays |= {f"{device}.{name}": values for name, values in twin.log().items()}
        try:
            np.savez_compressed(path, **arrays)
        except OSError as error:
            raise RequestError(f"--log {path}", f"can't be written: {error.strerror}", "Name another file") from None


def _serial(twin: Twin, name: str) -> Any:
    if not hasattr(twin, "link"):
        raise RequestError(
            "--link", f"the twin of '{name}' isn't behind a port that could be linked to", "Leave it out"
        )
    return twin


def _check_arguments(args: argparse.Namespace) -> None:
    if args.duration is not None and not args.duration > 0:
        raise RequestError("--duration", f"{args.duration} s is no duration", "Give a number above 0")
    if not 0 < args.pace <= 10:
        raise RequestError("--pace", f"{args.pace:g} isn't above 0 and up to 10", "1 is real time")
    if not 100 <= args.poll <= 10_000:
        raise RequestError("--poll", f"{args.poll:g} Hz isn't from 100 to 10000", "1000 suits all devices")
    if args.link is not None and not args.link.is_dir():
        raise RequestError("--link", f"there is no folder {args.link}", "Make it first")
    if args.log is not None and (args.log.suffix != ".npz" or not args.log.absolute().parent.is_dir()):
        raise RequestError("--log", f"{args.log} isn't a .npz in a folder that exists", "Name one, e.g. twin.npz")
