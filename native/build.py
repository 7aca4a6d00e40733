"""The build of the package: it gets three.js first, so that the wheel has it. Without npm or network it has none."""

from __future__ import annotations

import runpy
from pathlib import Path

from setuptools.command.build_py import build_py

_THREE = Path(__file__).parent.parent / "runtime" / "web" / "panel" / "three.py"


class BuildPy(build_py):
    """`[tool.setuptools.cmdclass]` of pyproject.toml names it."""

    def run(self) -> None:
        """Gets it, then builds."""
        if problem := runpy.run_path(str(_THREE))["fetch"]():
            self.warn(f"three.js: {problem}. The panel's picture will be flat")
        super().run()
