"""Files of a run that only their owner may read and write: they say what moves a limb, and what a person did."""

from __future__ import annotations

import os
from pathlib import Path

from srl.runtime.contracts.errors import RecordingError

MODE = 0o600


def create(path: Path) -> int:
    """Makes a new file, which must not be there, and opens it to write. Returns the descriptor. Raises OSError."""
    return os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, MODE)


def replace(path: Path, content: bytes) -> None:
    """Writes a file, whole or not at all, in place of an older one. Raises OSError."""
    scratch = path.with_suffix(".new")
    scratch.unlink(missing_ok=True)
    with open(create(scratch), "wb") as file:
        file.write(content)
    scratch.rename(path)


def read_text(path: Path) -> str:
    """Reads a file of a run as UTF-8.

    Raises:
        RecordingError: it can't be read, or it is no text.
    """
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise RecordingError(str(path), f"it can't be read: {error.strerror}", "Is the run up?") from None
    except UnicodeDecodeError:
        raise RecordingError(str(path), "the file is damaged: it is no text", "It wasn't written by srl") from None
