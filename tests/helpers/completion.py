"""Asks for completions in a shell's own way."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path


def offered(line: str, tmp_path: Path) -> set[str]:
    """What a shell would offer at the end of a line, asked as argcomplete's shell functions ask."""
    output = tmp_path / "said"
    variables = {
        "_ARGCOMPLETE": "1", "_ARGCOMPLETE_SHELL": "bash", "_ARGCOMPLETE_STDOUT_FILENAME": str(output),
        "_ARGCOMPLETE_IFS": "\n", "COMP_LINE": line, "COMP_POINT": str(len(line)), "COMP_TYPE": "9",
    }  # fmt: skip
    subprocess.run([sys.executable, "-m", "srl"], env=os.environ | variables, timeout=100, check=True, cwd=tmp_path)
    return {word.strip() for word in output.read_text().split("\n")}
