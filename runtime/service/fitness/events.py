"""Checks the input devices (gamepads, rings) that a profile's drivers open: whether they are there and may be read."""

from __future__ import annotations

import glob
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

from srl.runtime.profile.ports import local_path
from srl.runtime.service.fitness.finding import Finding, read

NODES: Final = "/dev/input/event*"
_NAMES: Final = "/sys/class/input/{}/device/name"
_JOIN: Final = "sudo usermod -aG input $USER"


def inputs(wanted: Mapping[str, str]) -> Iterator[Finding]:
    """Each input device, by the device's name: its path, or a word with which its driver looks for it."""
    for name, port in wanted.items():
        path = local_path(port)
        yield _found(f"input of {name}") if path is None else _named(f"input of {name}", path)


def _named(what: str, path: str) -> Finding:
    if os.access(path, os.R_OK):
        return Finding(what, "good", f"{path} may be read")
    if os.path.exists(path):
        return Finding(what, "bad", f"{path} may not be read", f"{_JOIN}, then log in again", _JOIN)
    return Finding(
        what, "bad", f"{path} isn't there", "Plug it in, or wake it; this lists what is there", "ls -l /dev/input/by-id"
    )


def _found(what: str) -> Finding:
    nodes = glob.glob(NODES)
    readable = [node for node in nodes if os.access(node, os.R_OK)]
    if not nodes:
        return Finding(what, "bad", "no input device is there", "Plug it in, or pair it", "ls -l /dev/input")
    if not readable:
        return Finding(
            what, "bad", f"none of {len(nodes)} input devices may be read", f"{_JOIN}, then log in again", _JOIN
        )
    names = sorted({read(_NAMES.format(Path(node).name)) or node for node in readable})
    return Finding(what, "good", f"it is looked for among {', '.join(names)}")
