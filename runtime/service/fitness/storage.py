"""Checks the folders of a run: the one in memory for its rows, the one of its state, and the one of its recordings."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterator
from pathlib import Path

from srl.runtime.contracts.errors import HostError
from srl.runtime.ipc.run_folder import RunFolder, base, check_owners, free_bytes
from srl.runtime.service.crash_dump import needed
from srl.runtime.service.fitness.finding import Finding

SPARE = 16 << 20  # bytes in the run folder for what isn't rows
LITTLE, LEAST = 2 << 30, 200 << 20  # bytes of disk: soon used up; too little for a recording to end well


def memory(rows: int) -> Finding:
    """Whether the run folder may be used, is in memory, and has room for `rows` bytes."""
    folder, what = base(), "runtime folder"
    elsewhere = "Or set SRL_RUNTIME_DIR to a folder of yours on tmpfs"
    at = _nearest(folder)
    try:
        check_owners(at, own=False)
    except HostError as error:
        return Finding(what, "bad", f"{error.place}: {error.problem}", error.remedy, _move())
    if not os.access(at, os.W_OK | os.X_OK):
        return Finding(what, "bad", f"{folder} can't be written: {at} isn't yours", elsewhere, _move())
    mount, kind = _mount(at)
    if kind not in ("tmpfs", "ramfs"):
        return Finding(
            what, "doubtful", f"{folder} is on {kind}, not in memory", "Set SRL_RUNTIME_DIR to a folder on tmpfs",
            _move(),
        )  # fmt: skip
    needed, free = rows + SPARE, free_bytes(at)
    if free < needed:
        more = (os.statvfs(at).f_blocks * os.statvfs(at).f_frsize + needed - free >> 20) + 1
        return Finding(
            what, "bad", f"{folder} has {free >> 20} MiB free; a run's rows take {needed >> 20}", elsewhere,
            f"sudo mount -o remount,size={more}m {shlex.quote(mount)}",
        )  # fmt: skip
    return Finding(what, "good", f"{folder} is in memory, {free >> 20} MiB free")


def leftovers() -> Iterator[Finding]:
    """What dead runs left in memory: their last rows, which nobody has saved yet."""
    found = False
    for lock in sorted(base().glob("*/lock")):
        run_folder = RunFolder(lock.parent)
        if run_folder.is_claimed() or not (why := needed(run_folder)):
            continue
        found = True
        name, held = run_folder.path.name, sum(p.stat().st_blocks * 512 for p in run_folder.path.iterdir())
        yield Finding(
            f"run folder of {name}", "doubtful", f"{why}; {run_folder.path} holds {held >> 20} MiB",
            f"The next run of {name} saves them. If nobody needs them, this frees the memory",
            f"rm -r {shlex.quote(str(run_folder.path))}",
        )  # fmt: skip
    if not found:
        yield Finding("run folders", "good", "no dead run left rows")


def state(folder: Path) -> Finding:
    """Whether the folder for what must outlive a reboot may be written: without it no run begins."""
    at = _nearest(folder)
    if not os.access(at, os.W_OK | os.X_OK):
        remedy = "A stop that lasts, and what a crash leaves, are kept there"
        return Finding(
            "state folder", "bad", f"{folder} can't be written: {at} isn't yours", remedy,
            f"sudo install -d -o $USER -m 750 {shlex.quote(str(folder.parent))}",
        )  # fmt: skip
    return Finding("state folder", "good", str(folder))


def disk(folder: Path) -> Finding:
    """Whether recordings have room."""
    what = "recordings' folder"
    at = _nearest(folder)
    if not os.access(at, os.W_OK | os.X_OK):
        return Finding(
            what, "bad", f"{folder} can't be written: {at} isn't yours", "Or name another: --recordings FOLDER",
            f"sudo install -d -o $USER -m 750 {shlex.quote(str(folder))}",
        )  # fmt: skip
    free = free_bytes(at)
    if free < LITTLE:
        return Finding(
            what, "bad" if free < LEAST else "doubtful", f"{folder} has {free >> 20} MiB free",
            "Make room before you record; this lists what is there", f"srl recordings {shlex.quote(str(folder))}",
        )  # fmt: skip
    return Finding(what, "good", f"{folder} has {free >> 30} GiB free")


def _nearest(folder: Path) -> Path:
    """The folder, or the lowest one above it that is there."""
    at = folder.absolute()
    while not at.exists():
        at = at.parent
    return at


def _mount(at: Path) -> tuple[str, str]:
    """The mount point that holds a path, and its kind."""
    mounts = [line.split()[1:3] for line in Path("/proc/mounts").read_text().splitlines()]
    inside = [(mount, kind) for mount, kind in mounts if at.resolve().is_relative_to(mount)]
    # Of two at one place the later one is seen.
    return max(reversed(inside), key=lambda found: len(found[0]))


def _move() -> str:
    return "export SRL_RUNTIME_DIR=/dev/shm/srl-$USER"
