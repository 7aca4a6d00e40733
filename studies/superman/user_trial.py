"""Common parts of a trial of the two user studies: the plan, the person alone, and what is read of a run."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from srl.studies.simulated import Run

Mask = NDArray[np.bool_]
MUSCLES: Final = ("AD", "PD", "BC", "TR")  # in the order of the person's activations
_BUTTONS: Final = {"admittance": "A", "mode": "M", "gripper": "G", "priority": "P"}


def plan(steps: Iterable[Any], patience: float) -> list[dict[str, Any]]:
    """Converts steps of srl.sim.parts.person.plans to the form of a profile, with the profiles' buttons."""
    out = []
    for step in steps:
        entry = step.model_dump(mode="json", exclude_none=True)
        if "button" in entry:
            entry["button"] = _BUTTONS[entry["button"]]
        if "patience" in entry:
            entry["patience"] = patience
        out.append(entry)
    return out


def alone(parts: dict[str, Any]) -> dict[str, Any]:
    """Returns changes to the profile moca-man: a person without a robot, electrodes on the arm, at 100 Hz."""
    gone = dict.fromkeys(("panel", "sensor", "arm", "base", "hand"))
    muscles = {"anterior_deltoid": 1, "posterior_deltoid": 2, "biceps": 3, "triceps": 4}
    return {
        "rate": 100,
        "clock": None,
        "devices": gone | {"emg": {"driver": "trigno", "port": "tcp://192.168.1.30", "channels": muscles}},
        "controllers": [],
        "guard": None,
        "stop": None,
        "frames": None,
        "sim": {
            "ends_with": "person",
            "floor": False,
            "parts": dict.fromkeys(("base", "arm", "hand", "sensor", "grip")) | parts,
            "devices": {"panel": None, "sensor": None, "emg": {"part": "person"}},
        },
    }


def between(run: Run, first: int, last: int) -> Mask:
    """Returns whether each row, (k,), lies in the plan's steps first to last, both included."""
    step = run.value("world.person_progress")[:, 0]
    inside: Mask = (step >= first) & (step <= last)
    return inside


def activity(run: Run, inside: Mask) -> dict[str, float]:
    """Returns the mean activation by muscle, percent of the greatest voluntary contraction, over the rows `inside`."""
    means = 100 * run.value("world.person_activation")[inside].mean(axis=0)
    return dict(zip(MUSCLES, (round(float(v), 3) for v in means), strict=True))
