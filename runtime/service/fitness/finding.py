"""What one check of the host found: its meaning, what mends it, and the command that does so."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

Verdict = Literal["good", "doubtful", "bad"]


@dataclass(frozen=True)
class Finding:
    """The result of one check.

    Attributes:
        what: what was checked, and of which device or file.
        found: what is so, and where.
        remedy: what mends it, in words; "" where nothing needs mending.
        command: the same to be typed in a shell; "" where no command does it.
    """

    what: str
    verdict: Verdict
    found: str
    remedy: str = ""
    command: str = ""


def read(path: str | Path) -> str:
    """A file of the kernel's, stripped; "" if it isn't there or has nothing to say."""
    try:
        return Path(path).read_text().strip()
    except OSError:
        return ""
