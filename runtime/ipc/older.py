"""Files that somebody may have written by hand: none is lost when another one takes its place."""

from __future__ import annotations

import os
from itertools import chain, count
from pathlib import Path

from srl.runtime.contracts import whole_file
from srl.runtime.contracts.errors import RequestError, SrlError


def check(path: Path, what: str, replacing: bool, example: str, error: type[SrlError] = RequestError) -> None:
    """Checks that a file can be written there.

    Args:
        what: it is, for the error: "a calibration".
        replacing: whether the user has said that one that is there may be replaced.
        example: of a name that would do where `path` is a folder.
    Raises:
        `error`: it can't, or one is there.
    """
    try:
        os.stat(path)
    except FileNotFoundError:
        pass
    except OSError as reason:
        raise error(str(path), f"it can't be written: {reason.strerror}", "Choose another name or folder") from None
    if path.is_dir():
        raise error(str(path), "it is a folder", f"Name a file in it: -o {example}")
    if path.exists() and not replacing:
        raise error(str(path), f"{what} is there already", "Add --yes to replace it (it is kept as .old), or -o FILE")
    if not path.parent.is_dir() or not os.access(path.parent, os.W_OK):
        raise error(str(path.parent), "the folder can't be written", "Make it, or choose another with -o")


def keep(path: Path, error: type[SrlError] = RequestError) -> Path | None:
    """Copies the file that is there, if one is, to the first free of FILE.old, FILE.old.2, ...

    Returns:
        Where; None if none was there.
    Raises:
        `error`: it can't be written.
    """
    names = (f"{path.name}.old{number}" for number in chain([""], (f".{n}" for n in count(2))))
    older = next(free for name in names if not os.path.lexists(free := path.with_name(name)))
    try:
        if not path.exists():
            return None
        whole_file.write(older, path.read_bytes(), error)
    except OSError as reason:
        raise error(str(older), f"it can't be written: {reason.strerror}", "Choose another folder") from None
    return older
