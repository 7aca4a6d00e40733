"""Runs of a profile for a study: simulated, each in its own process, with every cycle recorded."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML

from runtime.contracts.errors import RequestError
from runtime.contracts.signals import Array
from runtime.ipc.layout import Layout
from runtime.recording.reader import read
from runtime.recording.segments import folder_of

PROFILES = Path(__file__).resolve().parents[1] / "profiles"


@dataclass(frozen=True)
class Run:
    """One finished run.

    Attributes:
        name: the task's name.
        file: the recording.
        summary: the output of `srl run --json`.
        layout, rows: every cycle.
    """

    name: str
    file: Path
    summary: dict[str, Any]
    layout: Layout
    rows: Any

    @property
    def t(self) -> Array:
        """(k,) s since the first cycle."""
        now = self.layout.word(self.rows, "now")
        seconds: Array = (now - now[0]) * 1e-9
        return seconds

    def value(self, signal: str) -> Array:
        """Returns a signal's values, (k, ...)."""
        return self.layout.value(self.rows, signal)

    def word(self, name: str) -> Any:
        """Returns an integer word, (k,), such as "state"."""
        return self.layout.word(self.rows, name)


@dataclass(frozen=True)
class Task:
    """A run to be made.

    Attributes:
        name: of the recording.
        profile: a name under profiles/.
        changes: merged into the profile, key by key; lists and scalars replace, None removes.
        duration: greatest world time, s.
        seed: of the world.
    """

    name: str
    profile: str
    changes: dict[str, Any]
    duration: float
    seed: int


def run_all(tasks: Iterable[Task], folder: Path, workers: int | None = None) -> list[Run]:
    """Runs the tasks, several at a time; the recordings stay in `folder`.

    Raises:
        RequestError: a run ended neither by itself nor by a stop of its devices.
    """
    # One core is left for the loops' recorders.
    with ThreadPoolExecutor(workers or max((os.cpu_count() or 2) - 1, 1)) as pool:
        return list(pool.map(lambda task: _run(task, folder), tasks))


def _run(task: Task, folder: Path) -> Run:
    file = folder / f"{task.name}.rrd"
    for old in (file, file.with_name(f"{file.name}.part")):
        old.unlink(missing_ok=True)
    shutil.rmtree(folder_of(file), ignore_errors=True)
    with tempfile.TemporaryDirectory(prefix="srl-study-") as scratch:
        profile = Path(scratch) / f"{task.profile}.yaml"
        yaml = YAML(typ="safe", pure=True)
        # The order of a profile's keys matters: `guide-buttons` identifies buttons by their places.
        yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
        content = merged(yaml.load(PROFILES / f"{task.profile}.yaml"), task.changes | {"seed": task.seed})
        yaml.dump(content, profile)
        command = [
            sys.executable, "-m", "runtime", "run", str(profile), "--sim", "--fast", "--json",
            "--duration", str(task.duration), "--record", str(file), "--instance", Path(scratch).name.replace("_", "-"),
        ]  # fmt: skip
        place = {"SRL_RUNTIME_DIR": f"{scratch}/run", "STATE_DIRECTORY": f"{scratch}/state", "OMP_NUM_THREADS": "1"}
        done = subprocess.run(command, env=os.environ | place, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 1) or not done.stdout.strip():
        said = done.stderr.strip().splitlines()
        raise RequestError(f"study run '{task.name}'", said[-1] if said else "it said nothing", "Correct the profile")
    # If a machine is too busy to finish the file in time, the segments remain.
    recording = read(file if file.exists() else folder_of(file))
    summary = json.loads(done.stdout.strip().splitlines()[-1])
    return Run(task.name, recording.path, summary, recording.layout, recording.rows)


def merged(base: Any, changes: Any) -> Any:
    """Returns `base` with `changes` merged in, mapping by mapping; None removes a key."""
    if not isinstance(base, dict) or not isinstance(changes, dict):
        return changes
    found = dict(base)
    for key, value in changes.items():
        if value is None:
            found.pop(key, None)
        else:
            found[key] = merged(found.get(key), value)
    return found


def controller(profile: str, use: str, **options: Any) -> list[dict[str, Any]]:
    """Returns the profile's controllers with options of one of them changed, because a list replaces a list."""
    content = YAML(typ="safe", pure=True).load(PROFILES / f"{profile}.yaml")
    entries = [dict(entry) for entry in content["controllers"]]
    chosen = [entry for entry in entries if entry["use"] == use or entry.get("name") == use]
    if len(chosen) != 1:
        raise ValueError(f"{profile} has {len(chosen)} controllers '{use}'")
    chosen[0] |= options
    return entries


def largest(values: Array) -> float:
    """Returns the greatest length of vectors (k, 3); 0 if there are none."""
    return float(np.linalg.norm(values, axis=-1).max(initial=0.0))
