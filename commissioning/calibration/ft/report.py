"""The report of a force/torque sensor's calibration: text, figures and a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from srl.commissioning.calibration.ft.fit import Load
from srl.commissioning.calibration.picture import plt, save
from srl.commissioning.calibration.result import Result
from srl.runtime.contracts.gravity import GRAVITY


def lines(result: Result[Load]) -> list[str]:
    """The report as text."""
    load = result.found
    f, t = load.bias[:3], load.bias[3:]
    sure = load.uncertain
    found = [
        f"{result.options.signal}{result.when}, {_poses(len(load.numbers))}",
        f"bias: {f[0]:.3f} {f[1]:.3f} {f[2]:.3f} N, {t[0]:.4f} {t[1]:.4f} {t[2]:.4f} N m "
        f"(uncertain by {sure[0]:.3f} N, {sure[1]:.4f} N m)",
    ]
    if len(load.numbers) == 1:
        return [*found, "the tool's weight in this pose is part of the bias: turned, the sensor shows it"]
    x, y, z = (1000.0 * load.com).round(1) + 0.0  # no "-0.0"
    found.append(
        f"tool: {load.mass:.4f} kg at {x:.1f} {y:.1f} {z:.1f} mm "
        f"(uncertain by {sure[2]:.4f} kg, {1000.0 * sure[3]:.2f} mm)"
    )
    limits = result.options.thresholds
    found.append(
        f"left at most: {load.most[0]:.3f} N of {limits.force:g}, {load.most[1]:.4f} N m of {limits.torque:g}; "
        f"spread {load.spread:.2f} of {limits.spread:g}"
    )
    return found


def metrics(result: Result[Load]) -> dict[str, Any]:
    """The report as JSON types; SI units."""
    load = result.found
    per_pose = [
        {
            "number": number,
            "wrench": wrench.tolist(),
            "force_left_n": float(np.linalg.norm(left[:3])),
            "torque_left_n_m": float(np.linalg.norm(left[3:])),
        }
        for number, wrench, left in zip(load.numbers, load.wrench, load.left, strict=True)
    ]
    names = ("bias_n", "bias_n_m", "tool_mass_kg", "tool_com_m")
    return {
        "signal": result.options.signal, "frame": result.channel_map.frame, "bias": load.bias.tolist(),
        "tool_mass": load.mass, "tool_com": load.com.tolist(),
        "uncertain": dict(zip(names, load.uncertain, strict=True)), "spread": load.spread, "poses": per_pose,
    }  # fmt: skip


def draw(result: Result[Load], png: Path) -> None:
    """Draws the forces on their sphere, and what is left of each pose. Raises RecordError."""
    load, limits = result.found, result.options.thresholds
    figure, axes = plt.subplots(1, 4, figsize=(15, 4.2), constrained_layout=True)
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    weight = load.mass * GRAVITY
    for view, (i, j) in zip(axes, ((0, 1), (2, 1)), strict=False):
        view.plot(load.bias[i] + weight * np.cos(turn), load.bias[j] + weight * np.sin(turn), color="0.7")
        view.plot(load.bias[i], load.bias[j], "+", color="#D55E00", markersize=12, label="bias")
        view.plot(load.wrench[:, i], load.wrench[:, j], "o", color="#0072B2", label="poses")
        for number, wrench in zip(load.numbers, load.wrench, strict=True):
            view.annotate(str(number), (wrench[i], wrench[j]), textcoords="offset points", xytext=(5, 4), fontsize=8)
        view.set_xlabel(f"F{'xyz'[i]}, N")
        view.set_ylabel(f"F{'xyz'[j]}, N")
        view.set_aspect("equal", "datalim")
    axes[0].legend(fontsize=8)
    for view, part, unit, limit in (
        (axes[2], load.left[:, :3], "N", limits.force), (axes[3], load.left[:, 3:], "N m", limits.torque),
    ):  # fmt: skip
        view.bar([str(n) for n in load.numbers], np.linalg.norm(part, axis=1), color="#0072B2")
        view.axhline(limit, color="#D55E00", linestyle="--", label="allowed")
        view.set_xlabel("pose")
        view.set_ylabel(f"left, {unit}")
    axes[2].legend(fontsize=8)
    figure.suptitle("\n".join(lines(result)[:3]), fontsize=9)
    save(figure, png)


def _poses(count: int) -> str:
    return "1 pose" if count == 1 else f"{count} poses"
