"""Makes the calibration files of the simulated wearers in the profiles: `python -m studies.ikns.calibrate_wearer`.

The wearer of the profile's own cell does what it is told at ten points; nothing moves but it. Simulated.
"""

from __future__ import annotations

import json
import sys
from datetime import date
from importlib import resources
from itertools import product
from pathlib import Path
from typing import Any, Final, cast

import numpy as np
from ruamel.yaml import YAML

from runtime.contracts.signals import Array
from runtime.control.ikns.calibration import Recording, Thresholds, calibrate, refusals
from runtime.control.ikns.record import Record, write
from runtime.loop.lockstep import Lockstep
from runtime.profile import profile, wiring
from sim.parts.body.instructions import Dof, Explore, Hold, Instruction
from sim.parts.body.upper_body import UpperBodyPart
from sim.world.cell import Cell

_PATIENCE: Final = 20.0  # s for the hand to come to a point
_CHAIN: Final = "arm-angles"


class Procedure:
    """The wearer of a profile, its cameras and `arm-angles`. Devices that move, and what drives them, are left out."""

    def __init__(self, text: str) -> None:
        given: dict[str, Any] = YAML(typ="safe", pure=True).load(text)
        given["controllers"] = [law for law in given["controllers"] if law["use"] == _CHAIN]
        given["devices"] = {"mocap": given["devices"]["mocap"]}
        for key in ("guard", "stop", "record", "faults"):
            given.pop(key, None)
        self._lockstep = Lockstep(wiring.build(*profile.parse("calibration", json.dumps(given)), []))
        graph = self._lockstep.graph
        (part,) = (part for part in cast(Cell, graph.world).parts.values() if isinstance(part, UpperBodyPart))
        self._wearer, self._views = part.wearer, graph.row.views
        self.rate = graph.profile.rate
        self.joints = graph.laws[0].controller.outputs[0].labels
        self.rows: list[tuple[float, ...]] = []
        self._time = 0.0

    def tell(self, instruction: Instruction, seconds: float = 0.0, dof: int | None = None) -> Array:
        """Waits until it is reached, goes on for some seconds and returns (T, 3) m where the hand was in them.

        With `dof` these are samples of its trial.
        """
        self._wearer.instruct(instruction)
        end, hand = self._time + _PATIENCE, []
        self._step()
        while not isinstance(instruction, Explore) and not self._wearer.done:
            if self._time > end:
                raise RuntimeError(f"the hand didn't get there: {instruction}")
            self._step()
        for _ in range(round(seconds * float(self.rate))):
            self._step()
            hand.append(self._views["arm.hand"][:3].copy())
            if dof is not None:
                self.rows.append((self._time, *self._views["arm.angles"], *hand[-1], dof))
        return np.array(hand)

    def _step(self) -> None:
        self._lockstep.step()
        self._time += 1.0 / float(self.rate)


def calibrated(text: str, dofs: tuple[Dof, ...], seconds: float = 5.0) -> Record:
    """The calibration of the wearer in a profile's text, with `seconds` for each trial.

    Raises CalibrationError: it would be refused.
    """
    procedure, thresholds = Procedure(text), Thresholds()
    explored = procedure.tell(Explore(60.0), 60.0)
    middle, half = 0.5 * (explored.max(axis=0) + explored.min(axis=0)), 0.5 * np.ptp(explored, axis=0)
    for corner in (*product((-1.0, 1.0), repeat=3), (0.0, 0.0, -1.0), (0.0, 0.0, 1.0)):
        x, y, z = (middle + 0.9 * half * corner).tolist()
        for i, dof in enumerate(dofs):
            procedure.tell(Hold((x, y, z)), 1.0)
            procedure.tell(Hold((x, y, z), dof), seconds, i)
    rows = np.array(procedure.rows)
    found = calibrate(Recording(rows[:, 0], rows[:, 1:-4], rows[:, -4:-1], rows[:, -1].astype(int)), thresholds)
    for reason in refusals(found, thresholds):
        raise reason
    return Record.of(
        found, thresholds, person="simulated", date=date(2024, 1, 1), rate=float(procedure.rate), frame="chest",
        joints=procedure.joints, dofs=dofs,
    )  # fmt: skip


def main() -> None:
    """Writes the files of both profiles into the folder given, or the current one."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path()
    wanted: dict[str, tuple[Dof, ...]] = {"ikns-finger": ("swivel",), "ikns-two": ("swivel", "shrug")}
    for name, dofs in wanted.items():
        text = (resources.files("profiles") / f"{name}.yaml").read_text()
        write(folder / f"{name}.calibration.json", calibrated(text, dofs))


if __name__ == "__main__":
    main()
