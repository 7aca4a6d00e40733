"""A disk that is soon full."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

_REFUSALS = ("permission denied", "not permitted", "must be superuser")


@contextmanager
def small_disk(at: Path) -> Iterator[Path]:
    """A folder with 4 MB of room, in memory. Where this user may not mount it, the test is skipped."""
    at.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", str(at)]
    done = subprocess.run(mount, capture_output=True, text=True, check=False, env=os.environ | {"LC_ALL": "C"})
    if any(refusal in done.stderr for refusal in _REFUSALS):
        pytest.skip(f"no small disk: {done.stderr.strip()}")
    assert done.returncode == 0, done.stderr
    try:
        yield at
    finally:
        subprocess.run(["umount", "--lazy", str(at)], check=True)
