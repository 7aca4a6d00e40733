"""Files that are written whole or not at all."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from srl.runtime.contracts.errors import SrlError


def write(path: Path, content: bytes, error: type[SrlError]) -> None:
    """Writes a file in place of an older one, and has it on the disk. Raises `error`: it can't be written."""
    scratch = path.with_name(f".{path.name}.{os.getpid()}.new")
    try:
        with open(scratch, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        scratch.rename(path)
    except OSError as reason:
        raise error(str(path), f"it can't be written: {reason.strerror}", "Choose another folder") from None
    finally:
        with contextlib.suppress(OSError):
            scratch.unlink()
