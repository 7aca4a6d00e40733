"""The whole package that docs/extending.md shows, as files."""

from __future__ import annotations

import re
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "extending.md"
FENCE = re.compile(r"^```\w*\n(# ([\w./]+)\n.*?)^```$", re.MULTILINE | re.DOTALL)


def write_package(folder: Path) -> None:
    """Writes each of the page's files into the folder."""
    for body, name in FENCE.findall(PAGE.read_text()):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(body)
