"""Somebody else's tests, in a process of their own, with their package and srl's pytest plugin as if installed."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from helpers import ROOT


def environment(folder: Path, *installed: Path) -> dict[str, str]:
    """The environment of their processes. `installed`: folders with packages and their `.dist-info`.

    The plugin's entry point is written here: that of the checkout is as old as its last installation.
    """
    info = folder / "srl_plugin-1.dist-info"
    info.mkdir(exist_ok=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: srl-plugin\nVersion: 1\n")
    (info / "entry_points.txt").write_text("[pytest11]\nsrl = srl.runtime.testing.plugin\n")
    path = [*installed, folder, ROOT, os.environ.get("PYTHONPATH", "")]
    return os.environ | {
        "PYTHONPATH": os.pathsep.join(str(p) for p in path if str(p)),
        "SRL_RUNTIME_DIR": str(folder / "run"),
        "STATE_DIRECTORY": str(folder / "state"),
    }


def pytest_in(folder: Path, reported: dict[str, str], *arguments: str) -> subprocess.CompletedProcess[str]:
    """Runs their tests; says what it printed."""
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *arguments],
        cwd=folder, env=reported, capture_output=True, text=True, check=False, timeout=110,
    )  # fmt: skip
