"""`--twin`: the devices' twins run beside, and the unchanged drivers talk to them."""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Final

from srl.runtime.cli import wearer
from srl.runtime.contracts.errors import HostError, RequestError
from srl.runtime.contracts.files import Files, decoded
from srl.runtime.contracts.wearer import Instruction, written
from srl.runtime.ipc.child import PARENT
from srl.runtime.ipc.launch import Launch
from srl.runtime.profile import profile
from srl.runtime.profile.graph import Graph
from srl.runtime.profile.source import Source

TWO_WORLDS: Final = "a device is on its twin or simulated inside the loop, and both would have a world of their own"
_END = 10.0  # s that they may take to end


@dataclass(frozen=True)
class Twins:
    """What runs beside.

    Attributes:
        overrides: with which the profile's drivers talk to them.
        devices: that are on their twins.
    """

    overrides: list[str]
    devices: frozenset[str] = frozenset()
    _process: subprocess.Popen[str] | None = None

    def alone(self, graph: Graph) -> bool:
        """Whether no device of this graph is real: nobody wears what they move."""
        return bool(self.devices) and {device.name for device in graph.devices} <= self.devices

    def instruct(self, instruction: Instruction) -> None:
        """Tells the simulated person beside them what to do. Raises HostError: they have ended."""
        assert self._process is not None
        try:
            print(f"wearer {written(instruction)}", file=self._process.stdin, flush=True)
        except OSError:
            raise _ended() from None

    def check(self) -> None:
        """Raises HostError: they have ended."""
        if self._process is not None and self._process.poll() is not None:
            raise _ended()


def _ended() -> HostError:
    return HostError("--twin", "the twins have ended", "Begin again; nothing was written")


def add_option(parser: argparse.ArgumentParser) -> None:
    """Adds `--twin` to a command."""
    parser.add_argument(
        "--twin", nargs="*", metavar="DEVICE",
        help="the real drivers, on simulated devices that speak the wire protocol; without a name, all",
    )  # fmt: skip


@contextmanager
def twins(
    name: str, devices: Sequence[str] | None, given: Sequence[str], recording: str | None, say: Callable[[str], None],
    cut: Launch | None = None,
) -> Iterator[Twins]:  # fmt: skip
    """Serves the twins meanwhile, in a process of their own.

    Args:
        name: the profile's.
        devices: those named; none: all that have a twin; None: there are no twins.
        given: the user's overrides.
        recording: that the simulated person repeats.
        say: takes what the twins say meanwhile, line by line.
        cut: the part of the profile that is served; its simulated person can be instructed. None: the whole profile.
    Raises:
        RequestError: they don't start.
    """
    if devices is None:
        yield Twins(list(given))
        return
    command = [sys.executable, "-m", "srl", "twin", name, *devices, "--json"]
    if recording is not None:
        command += ["--wearer", recording]
    with tempfile.TemporaryDirectory(prefix="srl-") as scratch:
        if cut is None:
            command += [word for override in given for word in ("--set", override)]
        else:
            cut.save(Path(scratch) / "launch.json")
            command += ["--launch", str(Path(scratch) / "launch.json"), "--control"]
        checked, _ = profile.load(name, given) if cut is None else parsed(cut)
        yield from _served(command, name, checked.devices, devices, given, say, cut is None)


def _served(
    command: list[str],
    name: str,
    every: Iterable[str],
    devices: Sequence[str],
    given: Sequence[str],
    say: Callable[[str], None],
    whole: bool,
) -> Iterator[Twins]:
    process = subprocess.Popen(
        command, stdin=subprocess.DEVNULL if whole else subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True, start_new_session=True,  # Ctrl-C ends the run, and it ends them
        env={**os.environ, PARENT: str(os.getpid())},
    )  # fmt: skip
    assert process.stdout is not None
    assert process.stderr is not None
    try:
        first = process.stdout.readline()
        if not first:
            raise RequestError("--twin", _why(process.stderr.read()), "Correct that; `srl twin` starts them alone")
        threading.Thread(target=_pass_on, args=(process.stderr, say), daemon=True).start()
        threading.Thread(target=process.stdout.read, daemon=True).start()
        found = json.loads(first)["twins"]
        _name_the_real(every, found, bool(devices), say)
        ports = [f"devices.{device}.port={address}" for device, address in found.items()]
        start = _start(name, given, found) if whole else []  # a part says nothing of a start
        yield Twins([*start, *given, *ports], frozenset(found), process)
    finally:
        process.terminate()
        if process.stdin is not None:
            with suppress(OSError):
                process.stdin.close()
        try:
            process.wait(_END)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def parsed(cut: Launch) -> tuple[profile.Profile, Source]:
    """A part of a profile, and what it was read from."""
    files = Files(Path(cut.folder), decoded(cut.files, "the launch file"), run_code=True)
    return profile.parse(cut.label, cut.text, cut.overrides, files)


def _name_the_real(every: Iterable[str], found: Collection[str], chosen: bool, say: Callable[[str], None]) -> None:
    """Says which devices are real beside the twins. Raises RequestError: nobody has chosen which are."""
    real = ", ".join(device for device in every if device not in found)
    if real and not chosen:
        problem = f"no twin is there for {real}, so the real device would be opened"
        raise RequestError("--twin", problem, f"Name those that are to be on twins: --twin {' '.join(found)}; or --sim")
    if real:
        say(f"REAL: {real}. On twins: {', '.join(found)}")


def _start(name: str, given: Sequence[str], devices: Collection[str]) -> list[str]:
    """Where no device is real the limb starts as in a simulation: nobody wears it."""
    checked, _ = profile.load(name, given)
    real = checked.devices.keys() - set(devices)
    return [] if real or checked.sim is None or checked.sim.start is None else [f"start={checked.sim.start}"]


def _why(text: str) -> str:
    lines = [line for line in text.splitlines() if line.strip()]
    return lines[-1].removeprefix("srl: ").removeprefix("srl twin: ") if lines else "the twins ended without a word"


def _pass_on(lines: IO[str], say: Callable[[str], None]) -> None:
    for line in lines:
        if line.startswith("srl twin:"):  # what the profile warns of, the run says itself
            say(line.removeprefix("srl ").rstrip())


def check(args: argparse.Namespace) -> None:
    """Raises RequestError: another option contradicts `--twin`."""
    if args.twin is None:
        return
    if args.sim is not None:
        raise RequestError("--twin", TWO_WORLDS, "Leave --sim out")
    if not args.run_code:
        raise RequestError("--no-run-code", "the twins' process isn't bound by it", "Leave out one of the two")
    if args.fast:
        raise RequestError("--fast", "the twins keep real time", "Leave --fast out, or simulate all with --sim")


def overrides(args: argparse.Namespace, found: Twins) -> list[str]:
    """The overrides of a run: on twins, theirs; else those of the user and the wearer's recording."""
    return found.overrides if found.devices else wearer.overrides(args.profile, found.overrides, args.wearer)
