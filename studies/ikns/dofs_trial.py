"""Trials of the study of several degrees of freedom (DoFs) from one null space; each is a pure task.

The profile `ikns-two` runs in lockstep without its finger: simulated cameras, `arm-angles` with the clavicle, `ikns`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, cast

import numpy as np

from srl.control.ikns import record
from srl.runtime.contracts.errors import SrlError
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.wearer import Dof, Follow, Hold
from srl.studies.ikns.curves import SECONDS, SETTLE, curve
from srl.studies.ikns.rig import DOFS, FILE, Rig, angles_alone, instructed, sensing
from srl.studies.tasks.task import Value

MIDDLE: Final = 0.5  # target of a DoF that isn't to move
_MOVED: Final = 4.5  # s of a trial in which one DoF moves through its whole range
_STILL: Final = 10.0  # s
_NOISE: Final = 0.001  # m, along each axis, of each marker


def calibration(text: str, parameters: dict[str, Any], seed: int) -> Mapping[str, Value]:
    """A wearer's instructed trials of all DoFs, and the calibrations for sets of them.

    Args:
        text: the profile's.
        parameters: `set`, overrides by key path; `sets`, by name, the DoFs of each.
        seed: of the world.
    Returns:
        range_DOF: degrees, mean over the points of the range of the DoF's own angle. For each set, behind its name and
        a dot: calibration, the file's content, empty if it is `refused`, which says why; span_A_B, how far A goes while
        B moves through its range, as a share of A's, mean over the points; condition, least sine of a direction to
        the others'; wander, m, the worst point's.
    """
    sets: dict[str, list[Dof]] = parameters["sets"]
    done = instructed(Rig(angles_alone(text), parameters["set"], seed), DOFS)
    row: dict[str, Value] = {
        f"range_{dof}": float(degrees) for dof, degrees in zip(DOFS, np.rad2deg(done.ranges.mean(axis=0)), strict=True)
    }
    for name, dofs in sets.items():
        try:
            made, found = done.calibrated(dofs)
        except SrlError as error:
            row |= {f"{name}.refused": f"{error.place}: {error.problem}", f"{name}.calibration": ""}
            continue
        own = _pairs("span", dofs, found.crosstalk.mean(axis=0))
        own |= {"condition": float(found.condition.min()), "wander": float(found.wander.max())}
        own |= {"refused": "", "calibration": made.model_dump_json()}
        row |= {f"{name}.{what}": value for what, value in own.items()}
    return row


def crosstalk(text: str, parameters: dict[str, Any], seed: int) -> Mapping[str, Value]:
    """One DoF after another moves through its range at some points, and c is read.

    Args:
        text: the profile's.
        parameters: `set`, `dofs`, `calibration`; `where`: "points" (those of the calibration, in new trials) or
            "between" (halfway from their middle, where directions are interpolated).
        seed: of the world.
    Returns:
        linear_A_B: slope of A's c over B's while B moves, its mean size over the points. span_A_B: how far A's c goes
        meanwhile, as a share of how far B's goes; with curvature, noise and the wearer's own errors. span_A_A is 1.
        own_A: how far A's c goes in its own trials.
        leak_rms_A, leak_max_A: m, of the hand while A moves.
    """
    dofs: list[Dof] = parameters["dofs"]
    k = len(dofs)
    rig = _rig(text, parameters, seed, clamp=False)
    sites = _sites(parameters)
    middle = sites.mean(axis=0)
    some = sites[::3]  # corners of different faces, and the middle of one
    places = some if parameters["where"] == "points" else middle + 0.5 * (some - middle)
    linear, span = np.zeros((k, k)), np.zeros((k, k))
    own, leaks = np.zeros(k), [list[Array]() for _ in dofs]
    for x, y, z in places.tolist():
        for j, dof in enumerate(dofs):
            rig.tell(Hold((x, y, z)), 1.0)
            c, leak = rig.tell(Hold((x, y, z), dof), _MOVED, "intent.c", "world.wearer_leak")
            away = c - c.mean(axis=0)
            linear[:, j] += np.abs(away.T @ away[:, j]) / (away[:, j] @ away[:, j]) / len(places)
            span[:, j] += np.ptp(c, axis=0) / np.ptp(c[:, j]) / len(places)
            own[j] += np.ptp(c[:, j]) / len(places)
            leaks[j].append(leak)
    row = {**_pairs("linear", dofs, linear), **_pairs("span", dofs, span)}
    for j, dof in enumerate(dofs):
        leak = np.concatenate(leaks[j])
        row |= {f"own_{dof}": float(own[j]), f"leak_rms_{dof}": _rms(leak), f"leak_max_{dof}": float(leak.max())}
    return row


def noise(text: str, parameters: dict[str, Any], seed: int) -> Mapping[str, Value]:
    """The same still wearer twice, with exact markers and with 1 mm of noise: what the noise alone does to c.

    Args:
        text: the profile's.
        parameters: `set`, `dofs`, `calibration`.
        seed: of the world.
    Returns:
        noise_DOF: standard deviation of c per mm of markers' noise.
    """
    x, y, z = _sites(parameters).mean(axis=0).tolist()
    found = []
    for sd in (0.0, _NOISE):
        given = parameters["set"] | {"sim.devices.mocap": {"noise": sd}}
        rig = _rig(text, parameters | {"set": given}, seed, clamp=False)
        rig.tell(Hold((x, y, z)), 1.0)
        found += rig.tell(Hold((x, y, z)), _STILL, "intent.c")
    made = np.std(found[1] - found[0], axis=0) / (1e3 * _NOISE)
    return {f"noise_{dof}": float(sd) for dof, sd in zip(parameters["dofs"], made, strict=True)}


def tracking(text: str, parameters: dict[str, Any], seed: int) -> Mapping[str, Value]:
    """The wearer follows a curve with each DoF at once; 5 s to settle and 25 s that count.

    Args:
        text: the profile's.
        parameters: `set`, `dofs`, `calibration`; `targets`: T1, T2, T3 or "hold" for each DoF; `display`: s until a
            pointer is seen.
        seed: of the world.
    Returns:
        rmse_DOF: % of the greatest value; leak_rms, leak_max: m of the hand; at_end, held: share of the 25 s in which
        some c is at its end, and is held.
    """
    dofs: list[Dof] = parameters["dofs"]
    rig = _rig(text, parameters, seed)
    x, y, z = _sites(parameters).mean(axis=0).tolist()
    times = np.arange(0.0, SETTLE + SECONDS + 1.0, 0.02)
    shown = np.column_stack([target(name, times - SETTLE) for name in parameters["targets"]])
    rig.tell(Hold((x, y, z)), 1.0)
    rig.wearer.instruct(Follow(cast(Any, times), cast(Any, shown), tuple(dofs)))
    count, late = round((SETTLE + SECONDS) * rig.rate), round(parameters["display"] * rig.rate)
    c, leak, held = np.full((count, len(dofs)), np.nan), np.zeros(count), np.zeros(count)
    for i in range(count):
        rig.wearer.see(c[max(i - 1 - late, 0)].tolist())
        rig.step()
        c[i], leak[i] = rig.views["intent.c"], rig.views["world.wearer_leak"].item()
        held[i] = rig.views["intent.held"].max()
    t = np.arange(1, count + 1) / rig.rate - SETTLE
    counts = t > 0.0
    wanted = np.column_stack([target(name, t) for name in parameters["targets"]])
    row: dict[str, Value] = {f"rmse_{dof}": 100.0 * _rms((c - wanted)[counts, j]) for j, dof in enumerate(dofs)}
    ends = np.any((c <= 0.0) | (c >= 1.0), axis=1)
    return row | {
        "leak_rms": _rms(leak[counts]), "leak_max": float(leak[counts].max()),
        "at_end": float(np.mean(ends, where=counts)), "held": float(held[counts].mean()),
    }  # fmt: skip


def target(name: str, t: Array) -> Array:
    """A displayed curve at t (n,) s since its beginning; "hold": the middle."""
    return np.full(len(t), MIDDLE) if name == "hold" else curve(name, t)


def _rig(text: str, parameters: Mapping[str, Any], seed: int, **options: Any) -> Rig:
    return Rig(sensing(text, **options), parameters["set"], seed, parameters["calibration"])


def _sites(parameters: Mapping[str, Any]) -> Array:
    return record.parse(parameters["calibration"].encode(), FILE).calibration().sites


def _pairs(what: str, dofs: Sequence[str], matrix: Array) -> dict[str, Value]:
    return {f"{what}_{a}_{b}": float(matrix[i, j]) for i, a in enumerate(dofs) for j, b in enumerate(dofs)}


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
