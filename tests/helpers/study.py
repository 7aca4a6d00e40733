"""The world of a study's run, without the runtime."""

from __future__ import annotations

from ruamel.yaml import YAML

from runtime.contracts.frames import FrameEntry, Frames
from sim.world.cell import Cell, CellConfig
from studies.runs import PROFILES, Task, merged


def profile(task: Task) -> dict[str, dict]:
    """The task's profile with its changes, as it is written to a file."""
    found: dict[str, dict] = merged(YAML(typ="safe", pure=True).load(PROFILES / f"{task.profile}.yaml"), task.changes)
    return found


def cell(task: Task) -> Cell:
    """The world in which the task runs, its parts standing in the profile's frames."""
    content = profile(task)
    options = {key: value for key, value in content["sim"].items() if key not in ("world", "devices")}
    entries = {name: FrameEntry.model_validate(entry) for name, entry in content.get("frames", {}).items()}
    frames = Frames(entries, [*content["devices"], *options["parts"]])
    return Cell(CellConfig.model_validate(options), task.seed, frames)
