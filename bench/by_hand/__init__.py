"""What somebody would write by hand instead, in C: compiled when a bench needs it."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def compiled(name: str) -> Iterator[Path]:
    """The program `name`.c of this folder, compiled into a folder that ends with the context.

    Raises RuntimeError: there is no C compiler, or it refuses the file.
    """
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        raise RuntimeError("there is no C compiler for the program written by hand: install gcc")
    with tempfile.TemporaryDirectory(prefix="srl-bench-") as folder:
        program = Path(folder) / name
        source = Path(__file__).parent / f"{name}.c"
        command = [compiler, "-O2", "-Wall", "-Wextra", "-Werror", "-o", str(program), str(source), "-lm"]
        done = subprocess.run(command, check=False, capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError(f"{compiler} doesn't compile {source.name}: {done.stderr.strip()[:300]}")
        yield program
