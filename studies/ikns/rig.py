"""A wearer in lockstep for the studies of IKNS, and its k-DoF calibration."""

from __future__ import annotations

import datetime
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, Final

import numpy as np
from ruamel.yaml import YAML

from srl.control.ikns.calibration import Calibration, Recording, calibrate, refusals
from srl.control.ikns.record import Record
from srl.control.ikns.thresholds import Thresholds
from srl.runtime.contracts.files import Files
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.wearer import Dof, Explore, Hold, Instruction
from srl.runtime.ipc.requests import RequestKind
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.profile import profile, wiring
from srl.runtime.profile.profile import Profile
from srl.runtime.profile.source import Source
from srl.sim.parts.body.upper_body import UpperBodyPart
from srl.studies.simulated import cell
from srl.studies.toolkit.errors import StudyError

FILE: Final = "ikns-finger.calibration.json"  # as the profile ikns-finger names it
DOFS: Final[tuple[Dof, ...]] = ("swivel", "shrug", "protraction")
"""In the order of the signal `world.wearer_dofs`."""
_TIMEOUT: Final = 20.0  # s for the hand to come to a point
DATE: Final = datetime.date(2024, 1, 1)  # of simulated calibrations: a task depends on no clock
_EXPLORATION: Final = 20.0  # s; it only says how large the workspace is
_HELD: Final = 5.0  # s of each trial
_CORNERS: Final = (*product((-1.0, 1.0), repeat=3), (0.0, 0.0, -1.0), (0.0, 0.0, 1.0))


def worn(text: str, overrides: Mapping[str, Any], seed: int, calibration: str = "") -> tuple[Profile, Source]:
    """A profile with a simulated wearer who does what a trial tells it.

    Args:
        text: the profile's.
        overrides: what else is set, by key path.
        seed: of the world.
        calibration: content of the file that the profile names `FILE`; empty: there is none.
    """
    # What the wearer sees is what the trial shows it, not the finger.
    own = {"sim.parts.wearer.plan": [], "sim.parts.wearer.watches": {}, "seed": seed}
    words = [f"{key}={json.dumps(value)}" for key, value in {**overrides, **own}.items()]
    files = Files(recorded={FILE: calibration.encode()} if calibration else {})
    return profile.parse("study.yaml", text, words, files)


class Rig:
    """A profile in lockstep, and the wearer in it.

    Attributes:
        lockstep: the profile.
        wearer: as `srl.runtime.contracts.wearer.Wearer`.
        views: the signals of the present cycle, by name.
        rate: Hz.
        disturb: called between the cameras and the laws of each cycle.
    """

    def __init__(self, text: str, overrides: Mapping[str, Any], seed: int, calibration: str = "") -> None:
        """Arguments: as of `worn`."""
        self.lockstep = Lockstep(wiring.build(*worn(text, overrides, seed, calibration), []))
        graph = self.lockstep.graph
        (part,) = (p for p in cell(self.lockstep).parts.values() if isinstance(p, UpperBodyPart))
        self.wearer, self.views, self.rate = part.wearer, graph.row.views, float(graph.profile.rate)
        self.disturb: Callable[[], None] = lambda: None

    def step(self, request: RequestKind = RequestKind.NONE) -> None:
        """One cycle."""
        self.lockstep.sense()
        self.disturb()
        self.lockstep.act(request)

    def tell(self, instruction: Instruction, seconds: float, *names: str) -> list[Array]:
        """Waits until it is reached, and goes on for some seconds; returns signals in them, (cycles, elements)."""
        self.wearer.instruct(instruction)
        for _ in range(round(_TIMEOUT * self.rate)):
            self.step()
            if isinstance(instruction, Explore) or self.wearer.done:
                break
        else:
            raise StudyError("wearer", f"the hand didn't get there: {instruction}", "Look at the wearer's options")
        found = [np.empty((round(seconds * self.rate), self.views[name].size)) for name in names]
        for k in range(round(seconds * self.rate)):
            self.step()
            for name, values in zip(names, found, strict=True):
                values[k] = self.views[name].ravel()
        return found


def sensing(text: str, **options: Any) -> str:
    """A profile's text with cameras, `arm-angles` and `ikns` alone; the options are those of `ikns`.

    Nothing moves but the wearer. The calibration is the file `FILE`.
    """
    given: dict[str, Any] = YAML(typ="safe", pure=True).load(text)
    given["controllers"] = [law for law in given["controllers"] if law["use"] in ("arm-angles", "ikns")]
    for law in given["controllers"]:
        if law["use"] == "ikns":
            law |= {"calibration": FILE, **options}
    given["devices"] = {"mocap": given["devices"]["mocap"]}
    for key in ("guard", "stop", "record", "faults"):
        given.pop(key, None)
    return json.dumps(given)


def angles_alone(text: str) -> str:
    """The same without `ikns`: for a calibration."""
    given = json.loads(sensing(text))
    given["controllers"] = [law for law in given["controllers"] if law["use"] == "arm-angles"]
    return json.dumps(given)


@dataclass(frozen=True)
class Instructed:
    """What a wearer did at the calibration points: at each one, one instructed trial a DoF.

    Attributes:
        rows: (T, 1 + n + 3 + 2), s, rad, m in the chest's frame, the point's number, that of the DoF that was to move.
        ranges: (10, k) rad, of each DoF's own angle at each point.
        dofs: their names.
        joints: names of the angles.
        rate: Hz.
    """

    rows: Array
    ranges: Array
    dofs: tuple[Dof, ...]
    joints: tuple[str, ...]
    rate: float

    def calibrated(self, dofs: Sequence[Dof]) -> tuple[Record, Calibration]:
        """Returns the file and the calibration for some of the DoFs. Raises SrlError: it would be refused."""
        chosen = [self.dofs.index(dof) for dof in dofs]
        rows = self.rows[np.isin(self.rows[:, -1], chosen)]
        number = np.array([chosen.index(int(j)) for j in rows[:, -1]], np.intp)
        thresholds = Thresholds()
        point = rows[:, -2].astype(np.intp)
        found = calibrate(Recording(rows[:, 0], rows[:, 1:-5], rows[:, -5:-2], number, point), thresholds)
        for reason in refusals(found, thresholds):
            raise reason
        made = Record.of(
            found, thresholds, person="simulated", simulated=True, date=DATE, rate=self.rate, frame="chest",
            joints=self.joints, dofs=tuple(dofs),
        )  # fmt: skip
        return made, found


def instructed(rig: Rig, dofs: Sequence[Dof]) -> Instructed:
    """The wearer does what a calibration for several DoFs asks for. The profile needs `arm-angles` alone."""
    (explored,) = rig.tell(Explore(_EXPLORATION), _EXPLORATION, "arm.hand")
    places = explored[:, :3]
    middle, half = 0.5 * (places.max(axis=0) + places.min(axis=0)), 0.5 * np.ptp(places, axis=0)
    rows, ranges, started = list[Array](), np.zeros((len(_CORNERS), len(dofs))), 0.0
    for i, corner in enumerate(_CORNERS):
        x, y, z = (middle + 0.9 * half * corner).tolist()
        for j, dof in enumerate(dofs):
            rig.tell(Hold((x, y, z)), 1.0)
            angles, hand, truth = rig.tell(Hold((x, y, z), dof), _HELD, "arm.angles", "arm.hand", "world.wearer_dofs")
            t = started + np.arange(len(angles)) / rig.rate
            started = float(t[-1]) + 1.0  # what is between two trials isn't recorded
            rows.append(np.column_stack([t, angles, hand[:, :3], np.full((len(t), 2), (i, j))]))
            ranges[i, j] = np.ptp(truth[:, DOFS.index(dof)])
    joints = rig.lockstep.graph.layout.fields["arm.angles"].labels
    return Instructed(np.vstack(rows), ranges, tuple(dofs), joints, rig.rate)
