"""The world of a study's trial, without the runtime."""

from __future__ import annotations

from typing import Any

from srl.runtime.contracts.frames import FrameEntry, Frames
from srl.runtime.profile import profile as profiles
from srl.sim.world.cell import Cell, CellConfig
from srl.studies.simulated import Setup, parsed


def profile(setup: Setup) -> dict[str, Any]:
    """The setup's profile with its changes."""
    return parsed(profiles.find(setup.profile)[1], setup.changes, 1)


def cell(setup: Setup) -> Cell:
    """The world in which it runs, its parts standing in the profile's frames."""
    content = profile(setup)
    options = {key: value for key, value in content["sim"].items() if key not in ("world", "devices")}
    entries = {name: FrameEntry.model_validate(entry) for name, entry in content.get("frames", {}).items()}
    frames = Frames(entries, [*content["devices"], *options["parts"]])
    return Cell(CellConfig.model_validate(options), content["seed"], frames)
