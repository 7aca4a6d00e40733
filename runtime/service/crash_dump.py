"""What a run left that didn't end well: its last rows are saved as a black box, and never deleted."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Mapping
from itertools import count
from pathlib import Path

from srl.runtime.contracts.errors import HostError, SrlError
from srl.runtime.ipc import private_file
from srl.runtime.ipc.launch import Launch
from srl.runtime.ipc.ring import RingReader
from srl.runtime.ipc.run_folder import RunFolder


def save(state: Path, contents: Mapping[str, bytes | memoryview | Path]) -> Path:
    """Saves a black box whole or not at all.

    Args:
        state: the instance's state folder.
        contents: by file name, the content, or the file to copy.
    Returns:
        The black box's folder.
    Raises:
        OSError: the state folder can't be written.
    """
    target = _new(state)
    part = target.with_name(f"{target.name}.part")
    state.mkdir(parents=True, exist_ok=True)
    part.mkdir(mode=0o700)
    try:
        for file, content in contents.items():
            with open(private_file.create(part / file), "wb") as out:
                if isinstance(content, Path):
                    with open(content, "rb") as source:
                        shutil.copyfileobj(source, out)
                else:
                    out.write(content)
        part.rename(target)
    except OSError:
        shutil.rmtree(part, ignore_errors=True)  # half a box would only take the room
        raise
    return target


def rescue(run_folder: RunFolder, state: Path, report: Callable[[str], None]) -> None:
    """Saves the last rows of the run before, if it didn't end well and nobody has saved them.

    Afterwards nothing in the run folder is needed any more. `report` takes a line of text.

    Raises:
        HostError: they can neither be saved nor moved aside.
    """
    why = needed(run_folder)
    if not why:
        return
    there = [path for path in run_folder.evidence if path.exists()]
    try:
        box = save(state, {path.name: path for path in there})
    except OSError as error:
        box = _new(run_folder.path)
        report(f"{why}; its last rows can't be saved in {state}: {error.strerror}; they stay in {box}")
        try:
            box.mkdir(mode=0o700)
            for path in there:
                path.rename(box / path.name)
        except OSError as again:
            raise HostError(
                str(run_folder.path), f"the last rows of the run before can't be moved aside: {again.strerror}",
                "Save this folder elsewhere, or make room",
            ) from None  # fmt: skip
        return
    report(f"{why}; its last rows are in {box}")


def needed(run_folder: RunFolder) -> str:
    """Why the rows that are there are needed; "" for those of a run that ended well, and for rows that are saved."""
    if not run_folder.rows.exists():
        return ""
    try:
        with RingReader(run_folder.rows) as ring:
            if not ring.settled:
                return "the run before didn't end properly"
            missing = ring.head - ring.consumed
        if missing and Launch.load(run_folder.launch).recorded:
            return f"{missing} rows of the run before aren't in its recording"
    except SrlError as error:
        return f"the run before left a damaged file ({error.place})"  # somebody may still want to look
    return ""


def _new(folder: Path) -> Path:
    """The name of a black box that isn't there yet."""
    name = f"blackbox-{time.strftime('%Y%m%d-%H%M%S')}-{os.getpid()}"
    names = (name if k == 0 else f"{name}-{k}" for k in count())
    return next(folder / n for n in names if not (folder / n).exists())
