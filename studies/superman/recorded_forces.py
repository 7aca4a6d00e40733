"""Forces of real people applied to MOCA's handle, compared with the paths they made when they were recorded.

Two public recordings: a Panda led by its handle along a symbol, and a baton handed over between two people. Neither
robot's law is known, and the recorded person didn't feel our robot. So two things can be expected: the tool moves as
eq. 1 computes it from the forces; and its path has a similar shape, as far as force decided the motion then, too.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, cast

import numpy as np
from matplotlib.figure import Figure

from srl.control.cobot.admittance import AdmittanceConfig
from srl.runtime.contracts.signals import Array
from srl.runtime.profile import profile
from srl.sim.wearer.forces import ForceRecording, Forces, load_forces
from srl.sim.wearer.mat5 import read_mat5
from srl.sim.wearer.tables import read_rows
from srl.studies.result import Claim, Result
from srl.studies.simulated import Run, Setup, controllers, simulate
from srl.studies.superman.assumptions import assumed

NAME: Final = "recorded-forces"
PROFILE: Final = "moca-man"
REMEDY: Final = "name the folder that holds data in SRL_SHARED"
_GRID: Final = 0.02  # s, time step of comparisons
_SMOOTH: Final = 5  # number of such steps over which velocities are averaged


@dataclass(frozen=True)
class Original:
    """A recording.

    Attributes:
        name: for pictures and files.
        options: of the replay.
        path: (k, 3) m, positions of the tool, in the force's axes.
        axes: the axes in which paths are compared.
    """

    name: str
    options: dict[str, Any]
    path: Array
    axes: list[int]

    def forces(self) -> Forces:
        """Returns the forces as the simulated hand exerts them."""
        return load_forces(ForceRecording.model_validate(self.options), self.name)


@dataclass(frozen=True)
class Compared:
    """A replay compared with its original, on a common time grid.

    Attributes:
        t: (k,) s since the forces began.
        recorded, simulated: (k, 3) m, relative to their first points; `simulated` is the handle's ground truth.
        force: (k, 3) N, as replayed.
        law: RMS distance of the handle from eq. 1's own solution, as a share of its path's extent.
        shape: correlation of the paths after the best shift, turn and scale, in the compared axes.
        scale: simulated size over recorded size.
        direction: correlation of simulated and recorded velocities, axes unchanged.
        own: the same for recorded force and recorded velocity: how closely the two were related in the recording.
        axes: the compared axes.
    """

    t: Array
    recorded: Array
    simulated: Array
    force: Array
    law: float
    shape: float
    scale: float
    direction: float
    own: float
    axes: list[int]


def shared() -> Path:
    """Returns the folder with the recordings: `data` in SRL_SHARED, or in `shared` beside the checkout."""
    return Path(os.environ.get("SRL_SHARED", Path(__file__).resolve().parents[3] / "shared")) / "data"


def run(folder: Path, quick: bool) -> Result:
    """Runs the study; the table names missing recordings. `quick`: the shortest recording of each kind, led only."""
    setup = assumed(NAME)
    result = Result(NAME, simulated=True, seeds=[setup["seed"]])
    originals, missing = found_in(shared(), setup, quick)
    result.table += [{"recording": name, "": f"left out: {shared() / name} isn't there ({REMEDY})"} for name in missing]
    if originals:
        text = profile.find(PROFILE)[1]
        compared = {o.name: compare(o, replayed(text, o, setup), setup) for o in originals}
        result.table = [row(name, found) for name, found in compared.items()] + result.table
        draw(compared, folder / "recorded-forces.png")
        result.files = ["recorded-forces.png"]
    else:
        compared = {}
    result.claims = claims(compared, setup)
    return result


def found_in(data: Path, setup: dict[str, Any], quick: bool = False) -> tuple[list[Original], list[str]]:
    """Returns the recordings that exist, and the files that are missing."""
    originals: list[Original] = []
    missing: list[str] = []
    common = {"start": setup["begin"], "unbiased": setup["unbiased"]}
    panda, handover = setup["panda"], setup["handover"]
    if (data / panda["file"]).exists():
        paths = _panda(data / panda["file"])
        for number in panda["numbers"][:1] if quick else panda["numbers"]:
            options = {"file": str(data / panda["file"]), "number": number, **common}
            path = paths[number] * panda["turn"]
            originals.append(Original(f"panda-{number}", options, path, panda["axes"]))
    else:
        missing.append(panda["file"])
    files = [data / handover["file"], data / handover["path"]]
    if all(file.exists() for file in files) and not quick:
        options = {"file": str(files[0]), "rate": handover["rate"], **common}
        originals.append(Original("handover", options, _baton(files[1]) * handover["turn"], handover["axes"]))
    elif not quick:
        missing.append(handover["file"])
    return originals, missing


def _panda(file: Path) -> list[Array]:
    [rows] = [rows for rows in read_mat5(file).values() if isinstance(rows, list) and rows and "pos" in rows[0]]
    return [cast(Array, r["pos"]).T for r in rows]


def _baton(file: Path) -> Array:
    header, rows, _ = read_rows(file)
    columns = [header.index(axis) for axis in "xyz"]
    return np.array([[float(r[c]) for c in columns] for r in rows])


# -- the run


def replayed(text: str, original: Original, setup: dict[str, Any]) -> Run:
    """Runs the profile with the recording in place of the person's plan; a script presses button A."""
    person = {"part": "person", "tool": "grip/grip", "recording": original.options}
    changes = {
        "controllers": controllers(text, "admittance", dead_band=setup["dead_band"]),
        "sim": {
            "parts": {"person": {"plan": None, **person}},
            "devices": {"panel": {"person": None, "presses": {"A": [[0.5, 0.7]]}}},
        },
    }
    seconds = original.forces().duration + setup["rest"]
    return simulate(text, Setup(PROFILE, changes, seconds), setup["seed"], ("world.person_tool",))


# -- outcome


def compare(original: Original, done: Run, setup: dict[str, Any]) -> Compared:
    """Compares a finished run with its original."""
    forces, begin = original.forces(), setup["begin"]
    length = min(forces.duration, float(done.t[-1])) - begin
    t = np.arange(0.0, length, _GRID)
    # There is one row per cycle, taken from the world at the cycle's time.
    handle = _on(t + begin, done.t, done.value("world.person_tool"))
    whole = np.linspace(0.0, forces.duration - begin, len(original.path))
    recorded = _on(t, whole, original.path)
    force = np.array([forces.at(v + begin)[:3] for v in t])
    handle, recorded = handle - handle[0], recorded - recorded[0]
    ideal = _on(t, *law(forces, begin, length, setup["dead_band"][0]))
    axes = original.axes
    shape, scale = alike(recorded[:, axes], handle[:, axes])
    pace, then = _pace(handle[:, axes]), _pace(recorded[:, axes])
    return Compared(
        t, recorded, handle, force,
        law=float(np.sqrt(((handle - ideal) ** 2).sum(axis=1).mean()) / np.linalg.norm(np.ptp(ideal, axis=0))),
        shape=shape, scale=scale,
        direction=_correlation(pace, then), own=_correlation(force[:, axes], then), axes=axes,
    )  # fmt: skip


def law(forces: Forces, begin: float, length: float, dead: float) -> tuple[Array, Array]:
    """Solves eq. 1 for a recorded force alone: times (n,) s and positions (n, 3) m."""
    config, dt = AdmittanceConfig(), 0.001
    mass, damping = np.array(config.mass[:3]), np.array(config.damping[:3])
    n = int(length / dt) + 2
    path, velocity = np.zeros((n, 3)), np.zeros(3)
    for k in range(1, n):
        force = np.array(forces.at(begin + (k - 0.5) * dt)[:3])
        size = float(np.linalg.norm(force))
        force *= max(size - dead, 0.0) / size if size > 0 else 0.0
        velocity = velocity + dt * (force - damping * velocity) / mass
        path[k] = path[k - 1] + dt * velocity
    return cast(Array, np.arange(n) * dt), path


def alike(first: Array, second: Array) -> tuple[float, float]:
    """Returns correlation of two paths (n, d) after the best shift, rotation and scale, and size of second to first."""
    a, b = first - first.mean(axis=0), second - second.mean(axis=0)
    size_a, size_b = float(np.linalg.norm(a)), float(np.linalg.norm(b))
    if min(size_a, size_b) < 1e-9:
        return 0.0, 0.0
    u, s, v = np.linalg.svd(a.T @ b)
    s[-1] *= np.sign(np.linalg.det(u @ v))  # a rotation, no reflection
    return float(s.sum() / (size_a * size_b)), size_b / size_a


def fitted(first: Array, second: Array) -> Array:
    """Returns the second path (n, d), optimally shifted, turned and scaled onto the first."""
    a, b = first - first.mean(axis=0), second - second.mean(axis=0)
    u, s, v = np.linalg.svd(b.T @ a)
    flip = np.ones(len(s))
    flip[-1] = np.sign(np.linalg.det(u @ v))
    scale = float((s * flip).sum() / (b**2).sum())
    return np.asarray(scale * b @ (u * flip) @ v + first.mean(axis=0))


def claims(compared: dict[str, Compared], setup: dict[str, Any]) -> list[Claim]:
    """Returns our claims; the paper has nothing comparable."""
    panda = [c.shape for name, c in compared.items() if name.startswith("panda")]
    handover = [c.shape for name, c in compared.items() if name == "handover"]
    law_worst = max((c.law for c in compared.values()), default=None)
    least = setup["same_shape"]

    def same(id_: str, who: str, shapes: list[float]) -> Claim:
        mean = float(np.mean(shapes)) if shapes else None
        text = f"the path is like that of {who}: mean correlation {least:g} at least"
        return Claim(id=id_, text=text, paper="", measured=mean, unit="", holds=mean is not None and mean >= least)

    return [
        Claim(
            id="recorded-forces-law",
            text=f"the handle goes as eq. 1 says of the recorded force, within {setup['same_law']:g} of its way (RMS)",
            paper="",
            measured=law_worst,
            unit="of the way's extent, worst",
            holds=law_worst is not None and law_worst <= setup["same_law"],
        ),
        same("panda-same-shape", "the led Panda", panda),
        same("handover-same-shape", "the handed-over baton", handover),
    ]


def row(name: str, found: Compared) -> dict[str, Any]:
    """Returns a row of the table."""
    return {
        "recording": name,
        "s": float(found.t[-1]),
        "force RMS (N)": float(np.sqrt((found.force**2).sum(axis=1).mean())),
        "off eq. 1 (of extent)": found.law,
        "shape (r)": found.shape,
        "size, simulated/recorded": found.scale,
        "velocity (r)": found.direction,
        "recorded force and velocity (r)": found.own,
    }


def draw(compared: dict[str, Compared], file: Path) -> None:
    """Draws the paths in the world's x-y plane above, the forces below."""
    figure = Figure(figsize=(3.4 * max(len(compared), 2), 6.4), layout="constrained")
    grid = figure.subplots(2, len(compared), squeeze=False, height_ratios=(1.4, 1))
    for column, (name, found) in enumerate(compared.items()):
        top, bottom = grid[0, column], grid[1, column]
        best = fitted(found.recorded[:, found.axes], found.simulated[:, found.axes])
        for path, color, style, word in (
            (found.recorded, "#0072B2", "-", "recorded"),
            (found.simulated, "#D55E00", "-", "simulated"),
            (best, "#D55E00", ":", "simulated, fitted"),
        ):
            top.plot(1000 * path[:, 0], 1000 * path[:, 1], style, color=color, lw=1.2, label=word)
        top.set_aspect("equal", adjustable="datalim")
        top.set_title(f"{name}: shape r = {found.shape:.2f}", fontsize=10)
        top.set_xlabel("x (mm)")
        for k, color in enumerate(("#0072B2", "#009E73", "#D55E00")):
            bottom.plot(found.t, found.force[:, k], color=color, lw=0.8, label="xyz"[k])
        bottom.set_xlabel("s")
        if column == 0:
            top.set_ylabel("y (mm)")
            bottom.set_ylabel("force of the hand (N)")
            top.legend(fontsize=7)
            bottom.legend(fontsize=7, ncols=3)
    figure.suptitle("Recorded forces at MOCA's handle, simulated, beside the recorded paths")
    figure.savefig(file, dpi=110)


def _on(t: Array, times: Array, values: Array) -> Array:
    return np.stack([np.interp(t, times, values[:, k]) for k in range(values.shape[1])], axis=1)


def _pace(path: Array) -> Array:
    speed: Any = np.gradient(path, _GRID, axis=0)
    window = np.ones(_SMOOTH) / _SMOOTH
    return np.stack([np.convolve(speed[:, k], window, "same") for k in range(speed.shape[1])], axis=1)


def _correlation(first: Array, second: Array) -> float:
    """Returns the correlation of vectors over time, about zero, all axes together."""
    size = float(np.linalg.norm(first) * np.linalg.norm(second))
    return float((first * second).sum() / size) if size > 0 else 0.0
