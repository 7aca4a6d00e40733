"""A long run on twins: whether memory grows, descriptors stay open, the loop's pages fault, or cycles are lost.

    python -m bench.soak                          # an hour of moca-man
    python -m bench.soak --minutes 10 --sim       # fakes in the loop's process, where the twins can't keep up

The twins are a process of their own, so the loop holds drivers and no simulation. An overrun is counted and doesn't
stop the limb. Where it stops for another cause, it is reset as a person would do it, and that is counted, too.
"""

from __future__ import annotations

import argparse
import json
import os
import select
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import IO, Any, Final

import numpy as np

from bench import standstill
from srl.runtime.contracts.errors import HostError, SrlError
from srl.runtime.ipc.control_socket import send_request
from srl.runtime.ipc.header import CYCLE, Cause, State
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.ring import RingReader
from srl.runtime.ipc.run_folder import RunFolder

PROFILE: Final = "moca-man"  # the shipped one with the most devices, laws and commands
PERIOD: Final = 1.0  # s between two looks
TIMEOUT: Final = 300.0  # s for a start or an end, on a loaded machine
REQUESTS: Final = 5.0  # s between two starts or resets
PRIORITY: Final = 10  # of the twins, where it is allowed: below the loop's. Late twins are silent devices to the loop.
# One lap of PROFILE's person: leads the hand out and back, closes and opens it, and takes the base along.
LAP: Final = [
    {"do": "go_to", "by": [0.15, 0.1, -0.1]},
    {"do": "press", "button": "G"},
    {"do": "press", "button": "P"},
    {"do": "go_to", "by": [0.5, 0.0, 0.0], "tolerance": 0.05},
    {"do": "go_to", "by": [-0.5, 0.0, 0.0], "tolerance": 0.05},
    {"do": "press", "button": "P"},
    {"do": "press", "button": "G"},
    {"do": "go_to", "by": [-0.15, -0.1, 0.1]},
    {"do": "wait", "seconds": 1.0},
]
LAP_TIME: Final = 10.0  # s: no lap is faster
MIB: Final = 1 << 20
_SRL: Final = (sys.executable, "-m", "srl")
_MODULES: Final = ("loop", "bus", "recorder")


@dataclass
class Watched:
    """What was seen of one process.

    Attributes:
        at: s since the soak began.
        own: bytes of memory that are its own: not the rows, which all share.
        open, threads: how many descriptors and threads it has.
        faults, main: minor faults since it began, of all threads and of the main one, which runs the cycle.
    """

    at: list[float] = field(default_factory=list)
    own: list[int] = field(default_factory=list)
    open: list[int] = field(default_factory=list)
    threads: list[int] = field(default_factory=list)
    faults: list[int] = field(default_factory=list)
    main: list[int] = field(default_factory=list)

    def look(self, pid: int, at: float) -> None:
        """Adds what the kernel says now. Raises OSError: it has gone."""
        of = Path(f"/proc/{pid}")
        _, resident, shared, *_ = map(int, (of / "statm").read_text().split())
        # From the third field of proc(5) on.
        whole, main = ((of / name).read_text().rpartition(")")[2].split() for name in ("stat", f"task/{pid}/stat"))
        descriptors = len(os.listdir(of / "fd"))
        self.at.append(at)
        self.own.append((resident - shared) * os.sysconf("SC_PAGE_SIZE"))
        self.open.append(descriptors)
        self.threads.append(int(whole[17]))
        self.faults.append(int(whole[7]))
        self.main.append(int(main[7]))

    def judged(self, warm_up: float) -> Line | None:
        """The line of the table; None: it was seen for too short a time."""
        at = np.array(self.at)
        after = at >= warm_up
        if np.count_nonzero(after) < 4:
            return None
        at, own = at[after] / 3600, np.array(self.own)[after] / MIB
        half, some = len(at) // 2, max(len(at) // 5, 1)
        first, second = (float(np.polyfit(at[part], own[part], 1)[0]) for part in (slice(half), slice(half, None)))
        descriptors, minutes = np.array(self.open)[after], 60 * (at[-1] - at[0])
        faults, main = (float(np.ptp(np.array(counts)[after]) / minutes) for counts in (self.faults, self.main))
        return Line(
            float(own[0]), float(own[-1]), first, second, int(descriptors[:some].min()), int(descriptors[-some:].min()),
            int(descriptors.max()), self.threads[-1], faults, main,
        )  # fmt: skip


@dataclass(frozen=True)
class Line:
    """A process after its warm-up: MiB of its own, their slopes in MiB an hour, descriptors, minor faults a minute.

    A leak has the same slope in both halves; what is still warming up has less in the second. Descriptors: the fewest
    in the first and the last fifth, which are those that stay open: while it merges, the recorder has six more.
    """

    started: float
    ended: float
    first_half: float
    second_half: float
    open_started: int
    open_ended: int
    open_most: int
    threads: int
    faults: float
    main: float


@dataclass
class Soak:
    """What came about.

    Attributes:
        rate: of the loop, Hz.
        seconds: how long it was watched.
        cycles, active: cycles that were seen, and in how many of them the limb was active.
        lost: periods that the loop missed; rows that overtook this reader are in `unseen`.
        losses: where it missed them: begin and end, ns of CLOCK_MONOTONIC, and how many.
        own: those of `lost` in which the machine itself didn't stand still (bench/standstill.py).
        longest: s, for which the machine stood still.
        resets: how often the limb was started again, by cause.
        ended: why it ended before its time; "" if it didn't.
    """

    processes: dict[str, Watched] = field(default_factory=dict)
    rate: float = 0.0
    seconds: float = 0.0
    cycles: int = 0
    active: int = 0
    lost: int = 0
    losses: list[tuple[int, int, int]] = field(default_factory=list)
    now: int = 0  # of the newest row
    own: int = 0
    longest: float = 0.0
    unseen: int = 0
    resets: dict[str, int] = field(default_factory=dict)
    ended: str = ""
    summary: dict[str, Any] = field(default_factory=dict)


def soak(
    name: str, sim: bool, minutes: float, rate: float | None, looks: float, overrides: list[str], say: IO[str]
) -> Soak:
    """Runs it; `looks`: Hz, how often the twins look at their ports. Raises HostError: the twins didn't begin."""
    made = Soak()
    if name == PROFILE:
        laps = [{"do": "press", "button": "A"}, *(LAP * round(60 * minutes / LAP_TIME + 1))]
        overrides = [f"sim.parts.person.plan={json.dumps(laps)}", *overrides]
    with ExitStack() as stack:
        folder = Path(tempfile.mkdtemp(prefix="srl-soak-"))
        stack.callback(shutil.rmtree, folder, ignore_errors=True)
        in_memory = Path(tempfile.mkdtemp(prefix="srl-", dir="/dev/shm" if os.access("/dev/shm", os.W_OK) else None))
        stack.callback(shutil.rmtree, in_memory, ignore_errors=True)
        os.environ |= {"SRL_RUNTIME_DIR": str(in_memory), "STATE_DIRECTORY": str(folder / "state")}
        watched: dict[str, subprocess.Popen[str]] = {}
        if sim:
            arguments = ["run", name, "--sim", *_set(overrides)]
        else:
            command = [*_first(), *_SRL, "twin", name, *_set(overrides), "--poll", f"{looks:g}", "--json"]
            watched["twins"] = stack.enter_context(_started(command))
            arguments = json.loads(_line(watched["twins"]))["run"]
        stack.enter_context(_started([sys.executable, "-m", "bench.standstill", str(folder)]))
        own = ["faults.overrun.tolerate=1000000", "faults.overrun.stop=1000000"]
        if rate is not None:
            own += [f"rate={rate:g}", "clock=monotonic"]
        more = ["--instance", "soak", "--json", "--record", str(folder / "soak.rrd"), *_set(own)]
        with (folder / "said").open("w+") as output:
            run = watched["supervisor"] = stack.enter_context(_started([*_SRL, *arguments, *more], output))
            try:
                _watch(made, RunFolder.of("soak"), watched, 60 * minutes, say)
                run.terminate()
                out, _ = run.communicate(timeout=TIMEOUT)
                made.summary = json.loads(out.splitlines()[-1])
            except (HostError, ValueError, IndexError, subprocess.TimeoutExpired) as error:
                run.kill()
                output.seek(0)
                made.ended = f"{error} {output.read().strip()[-600:]}"
        still = standstill.gaps(folder)
        made.longest = float(np.ptp(still, axis=1).max(initial=0)) * 1e-9
        made.own = standstill.own(np.array(made.losses, np.int64).reshape(-1, 3), still, 1e9 / (made.rate or 1.0))
    return made


def _watch(
    made: Soak, where: RunFolder, watched: dict[str, subprocess.Popen[str]], seconds: float, say: IO[str]
) -> None:
    started = time.monotonic()
    while not (where.layout.exists() and where.rows.exists()):
        if watched["supervisor"].poll() is not None or time.monotonic() > started + TIMEOUT:
            raise HostError("soak", "the run didn't begin", "Look at what it said")
        time.sleep(0.1)
    layout = Layout.load(where.layout)
    numerator, denominator = layout.meta["rate"]
    made.rate = numerator / denominator
    started = next_request = time.monotonic()
    with RingReader(where.rows) as reader:
        while (at := time.monotonic() - started) < seconds:
            if any(process.poll() is not None for process in watched.values()):
                raise HostError("soak", "the run or its twins ended early", "Look at what it said")
            pids = {name: process.pid for name, process in watched.items()}
            for name, pid in (pids | _children(pids["supervisor"])).items():
                with suppress(OSError):  # a helper that has ended is started again
                    made.processes.setdefault(name, Watched()).look(pid, at)
            made.seconds = at
            _take(made, reader)
            row = reader.newest()
            state = State.STARTING if row is None else State(int(row[CYCLE.state]))
            if row is not None and state in (State.READY, State.STOPPED) and time.monotonic() > next_request:
                next_request = time.monotonic() + REQUESTS
                if state is State.STOPPED:
                    cause = Cause(int(row[CYCLE.cause]))
                    why = f"{cause.name.lower()} {layout.fault_source(cause, int(row[CYCLE.fault_source]))}".strip()
                    made.resets[why] = made.resets.get(why, 0) + 1
                send_request(where, "start" if state is State.READY else "reset")
            if sys.stderr.isatty():
                print(f"\r{at / 60:6.1f} of {seconds / 60:g} min, lost {made.lost} ", end="", file=say, flush=True)
            time.sleep(PERIOD)
        _take(made, reader)
        made.unseen = reader.lost


def _take(made: Soak, reader: RingReader) -> None:
    while len(rows := reader.take()):
        made.cycles += len(rows)
        made.active += int(np.count_nonzero(rows[:, CYCLE.state] == State.ACTIVE))
        before = made.now or int(rows[0, CYCLE.now]), made.lost
        made.now, made.lost = int(rows[-1, CYCLE.now]), int(rows[-1, CYCLE.overruns])
        if made.lost > before[1]:
            times = np.concatenate([before[:1], rows[:, CYCLE.now]])
            lost = np.diff(rows[:, CYCLE.overruns], prepend=before[1])
            made.losses += [(int(times[i]), int(times[i + 1]), int(lost[i])) for i in np.flatnonzero(lost)]


def _children(pid: int) -> dict[str, int]:
    """The run's processes by name."""
    found: dict[str, int] = {}
    with suppress(OSError):
        for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
            line = Path(f"/proc/{child}/cmdline").read_bytes().decode(errors="replace").split("\0")
            found |= {name: int(child) for name in _MODULES if f"srl.runtime.{name}" in line}
    return found


def _first() -> list[str]:
    """What gives a command the twins' priority; nothing where that isn't allowed."""
    command = ["chrt", "-f", str(PRIORITY)]
    with suppress(OSError):
        if not subprocess.run([*command, "true"], stderr=subprocess.DEVNULL, check=False).returncode:
            return command
    return []


def _set(overrides: list[str]) -> list[str]:
    return [word for override in overrides for word in ("--set", override)]


@contextmanager
def _started(command: list[str], output: IO[str] | None = None) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=output, stdin=subprocess.DEVNULL, text=True)
    try:
        yield process
    finally:
        if process.poll() is None:
            process.terminate()
            try:
                process.wait(TIMEOUT)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _line(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    if not select.select([process.stdout], [], [], TIMEOUT)[0] or not (line := process.stdout.readline()):
        raise HostError("srl twin", "it didn't begin", "Try it by itself; is the machine overloaded?")
    return line


def table(made: Soak, warm_up: float) -> tuple[dict[str, Line], list[str]]:
    """The lines by process, and the same as a table in Markdown."""
    judged = {name: watched.judged(warm_up) for name, watched in sorted(made.processes.items())}
    lines = {name: line for name, line in judged.items() if line is not None}
    text = [
        "| process | own memory, MiB | MiB an hour: first half, second | descriptors | threads |"
        " minor faults a minute: all, main thread |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for name, line in lines.items():
        memory = f"{line.started:.1f} to {line.ended:.1f} | {line.first_half:+.1f}, {line.second_half:+.1f}"
        opened = f"{line.open_started} to {line.open_ended}, at most {line.open_most}"
        text.append(f"| {name} | {memory} | {opened} | {line.threads} | {line.faults:.0f}, {line.main:.0f} |")
    return lines, text


def main() -> int:
    """Runs and prints it. Returns 0, or 1: the loop's pages faulted, descriptors grew, or cycles were lost."""
    parser = argparse.ArgumentParser(prog="python -m bench.soak", description=__doc__.split("\n")[0])
    parser.add_argument("profile", nargs="?", default=PROFILE, help="all of its devices must have twins (%(default)s)")
    parser.add_argument("--minutes", type=float, default=60.0, help="how long (%(default)g)")
    parser.add_argument("--warm-up", type=float, default=60.0, metavar="S", help="that don't count (%(default)g)")
    parser.add_argument("--rate", type=float, help="Hz, by the computer's clock; default: the profile's own")
    parser.add_argument("--looks", type=float, default=1000.0, metavar="HZ", help="of the twins at their ports (1000)")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="as for srl run")
    parser.add_argument("--sim", action="store_true", help="fakes in the loop's process in place of twins")
    parser.add_argument("--json", action="store_true", help="one JSON object")
    args = parser.parse_args()
    try:
        made = soak(args.profile, args.sim, args.minutes, args.rate, args.looks, args.set, sys.stderr)
        lines, text = table(made, args.warm_up)
    except SrlError as error:
        print(f"\nbench.soak: {error}", file=sys.stderr)
        return 2
    whole = bool(made.summary.get("recording_complete"))
    good = not made.ended and whole and not made.own and "loop" in lines and not lines["loop"].main
    good &= all(line.open_ended <= line.open_started for line in lines.values())
    metrics = {
        "profile": args.profile, "on": "fakes" if args.sim else "twins", "rate_hz": made.rate,
        "minutes": round(made.seconds / 60, 1), "cycles": made.cycles, "active": made.active, "lost": made.lost,
        "lost_by_itself": made.own, "machine_stood_still_s": round(made.longest, 3),
        "unseen": made.unseen, "resets": made.resets, "recording_complete": whole,
        "restarts": made.summary.get("restarts"), "ended_early": made.ended, "good": good,
    }  # fmt: skip
    if args.json:
        print(json.dumps(metrics | {"processes": {name: asdict(line) for name, line in lines.items()}}))
    else:
        print("\n".join(["", *text, "", ", ".join(f"{name} {value}" for name, value in metrics.items())]))
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
