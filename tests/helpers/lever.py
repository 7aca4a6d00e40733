"""The whole packages that docs/extending.md and docs/extending-calibration.md show, as files."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parents[2] / "docs"
FENCE = re.compile(r"^```\w*\n(# ([\w./]+)\n.*?)^```$", re.MULTILINE | re.DOTALL)


def write_package(folder: Path, page: str = "extending.md") -> None:
    """Writes each of the page's files into the folder."""
    for body, name in FENCE.findall((DOCS / page).read_text()):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(body)


def write_installed(folder: Path, page: str = "extending.md") -> dict[str, Any]:
    """Writes them as if the package were installed there, with its entry points. Returns its project file."""
    write_package(folder, page)
    project = tomllib.loads((folder / "pyproject.toml").read_text())
    name = project["project"]["name"]
    info = folder / f"{name.replace('-', '_')}-0.1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 0.1.0\n")
    points = project["project"]["entry-points"]
    (info / "entry_points.txt").write_text(
        "".join(f"[{group}]\n" + "".join(f"{k} = {v}\n" for k, v in items.items()) for group, items in points.items())
    )
    return project
