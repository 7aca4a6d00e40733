"""`srl twin` as a process of its own."""

from __future__ import annotations

import json
import select
import subprocess
import sys
from pathlib import Path
from typing import Any, Self

from helpers import ROOT


class TwinProcess:
    """Runs until the `with` ends; `metrics`, and `late` (s, by how much it was behind at most), are there afterwards.

    Attributes:
        addresses: by device.
        run: the arguments for `srl` that were printed.
    """

    def __init__(self, *arguments: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "srl", "twin", *arguments, "--json"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT,
        )  # fmt: skip
        first = self.line()
        self.addresses: dict[str, str] = first["twins"]
        self.run: list[str] = first["run"]
        self.metrics: dict[str, Any] = {}
        self.late = 0.0
        self.output = ""

    def line(self) -> dict[str, Any]:
        """The next line it prints."""
        assert self.process.stdout is not None
        assert select.select([self.process.stdout], [], [], 60)[0], "srl twin is silent"
        line = self.process.stdout.readline()
        assert line, self.process.stderr.read() if self.process.stderr else ""
        found: dict[str, Any] = json.loads(line)
        return found

    def control(self, text: str) -> dict[str, Any]:
        """Sends one line and gives the answer."""
        assert self.process.stdin is not None
        self.process.stdin.write(text + "\n")
        self.process.stdin.flush()
        return self.line()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.terminate()
        out, self.output = self.process.communicate(timeout=60)
        if self.process.returncode == 0:
            last = json.loads(out.splitlines()[-1])
            self.metrics, self.late = last["metrics"], last["late"]["most"]


def twins_of(pid: int) -> list[int]:
    """Processes below this one that serve twins."""
    below: dict[int, list[int]] = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
            words = (folder / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if b"twin" in words:
            below.setdefault(parent, []).append(int(folder.name))
    return below.get(pid, [])
