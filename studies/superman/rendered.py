"""Rendered impedance: how a handle that is shaken moves, over how eq. (1) says it should, up to 10 Hz.

The reference is v = F / (M_adm s + D_adm). The real handle differs by the delay of sensor and loop, by what the robot
can follow, and with MOCA by its compliance: the hand's force also bends the impedance of eq. (8) directly.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from matplotlib.figure import Figure

from srl.control.cobot.admittance import AdmittanceConfig
from srl.studies.result import Claim, Result
from srl.studies.superman.rendered_trial import TRIAL
from srl.studies.tasks.runner import Runner
from srl.studies.tasks.task import Row, TrialTask

STUDY: Final = "rendered-impedance"
ROBOTS: Final = {"moca": "moca-man", "kairos": "kairos-man"}
FREQUENCIES: Final = (0.2, 0.5, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0)  # Hz
_QUICK: Final = (2.0,)
_SHAKEN: Final = (("y", False), ("z", False), ("rz", False), ("y", True))
"""Axis of the world, and whether in locomotion."""
AMPLITUDE: Final = {"y": 5.0, "z": 5.0, "rz": 0.3}  # N or N m: a gentle hand; the largest motion is 0.1 m, 0.15 rad
_PLACE: Final = {"y": 1, "z": 2, "rz": 5}
_MEANT: Final = 2.0  # Hz, up to which a person moves on purpose (the specification's)
_GAIN, _PHASE = (0.5, 2.0), 45.0  # as far as it may be off: a factor of two, degrees; ours
_COLOURS: Final = {False: "#0072B2", True: "#D55E00"}
_FILE: Final = "rendered.png"


def tasks(frequencies: Iterable[float]) -> list[TrialTask]:
    """All trials: robots, axes and modes, with our additions and as published."""
    c, kept = AdmittanceConfig(), list(frequencies)
    return [
        TrialTask.of(
            STUDY, TRIAL, 0,
            {
                "robot": robot, "axis": axis, "locomotion": locomotion, "published": published, "frequency": f,
                "amplitude": AMPLITUDE[axis], "mass": c.mass[_PLACE[axis]], "damping": c.damping[_PLACE[axis]],
            },
            profile=profile,
        )
        for robot, profile in ROBOTS.items() for axis, locomotion in _SHAKEN for published in (False, True)
        for f in kept
    ]  # fmt: skip


def run(folder: Path, quick: bool, runner: Runner) -> Result:
    """Runs the study; quick: one frequency."""
    rows = runner.done(tasks(_QUICK if quick else FREQUENCIES), folder)
    draw(rows, folder / _FILE)
    return Result(STUDY, True, [0], claims(rows), [line(row) for row in rows], [_FILE, "rows.parquet"])


def line(row: Row) -> dict[str, Any]:
    """A row of the table."""
    p, v = row.task.parameters, row.values
    return {
        "robot": p["robot"], "axis": p["axis"], "mode": "locomotion" if p["locomotion"] else "manipulation",
        "law": "as published" if p["published"] else "ours", "Hz": p["frequency"], "gain": v["gain"],
        "phase deg": v["phase"], "other motion": v["rest"], "stop": v["cause"] or "none",
    }  # fmt: skip


def claims(rows: Sequence[Row]) -> list[Claim]:
    """Whether each robot renders what it should, where a person moves on purpose, translation and rotation apart."""
    found = []
    for robot in ROBOTS:
        for word, axes in (("translation", ("y", "z")), ("rotation", ("rz",))):
            own = [
                row for row in rows if _is(row, robot=robot, published=False) and row.task.parameters["axis"] in axes
            ]
            own = [row for row in own if row.task.parameters["frequency"] <= _MEANT]
            off = [abs(float(row.values["phase"] or 0.0)) for row in own]
            found.append(
                Claim(
                    id=f"{robot}-{word}", paper="", measured=max(off, default=None), unit="degrees",
                    text=f"up to {_MEANT:g} Hz the handle's {word} is that of eq. (1) within a factor of two and "
                    f"{_PHASE:g} degrees ({robot}, with our additions)",
                    holds=bool(own) and all(_near(row.values) for row in own),
                )
            )  # fmt: skip
    return found


def _near(values: Mapping[str, Any]) -> bool:
    return _GAIN[0] <= values["gain"] <= _GAIN[1] and abs(values["phase"]) <= _PHASE and not values["cause"]


def _is(row: Row, **wanted: Any) -> bool:
    return all(row.task.parameters[name] == value for name, value in wanted.items())


def draw(rows: Sequence[Row], file: Path) -> None:
    """Draws the Bode picture: gain and phase over the reference, a column for each robot and axis."""
    columns = [(robot, *shaken) for robot in ROBOTS for shaken in _SHAKEN]
    figure = Figure(figsize=(2.4 * len(columns), 5.0), layout="constrained")
    axes = figure.subplots(2, len(columns), sharex=True, sharey="row", squeeze=False)
    for i, (robot, axis, locomotion) in enumerate(columns):
        for published, colour in _COLOURS.items():
            own = [row for row in rows if _is(row, robot=robot, axis=axis, locomotion=locomotion, published=published)]
            f = [row.task.parameters["frequency"] for row in own]
            label = "as published" if published else "ours"
            style = {"color": colour, "marker": "o", "ms": 3.0, "lw": 1.2, "label": label}
            axes[0, i].plot(f, [row.values["gain"] for row in own], **style)
            axes[1, i].plot(f, [row.values["phase"] for row in own], **style)
        axes[0, i].axhline(1.0, color="0.6", lw=0.6)
        axes[1, i].axhline(0.0, color="0.6", lw=0.6)
        axes[0, i].set_title(f"{robot}, {axis}{', locomotion' if locomotion else ''}", fontsize=9)
        axes[1, i].set_xlabel("Hz")
    axes[0, 0].set_xscale("log")
    axes[0, 0].set_yscale("log")
    axes[0, 0].set_ylabel("gain over the reference")
    axes[1, 0].set_ylabel("phase over the reference (degrees)")
    axes[0, 0].legend(fontsize=8)
    figure.suptitle("Rendered over desired admittance, simulated")
    figure.savefig(file, dpi=110)
