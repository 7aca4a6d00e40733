"""The report of a frame's calibration: text, figures and a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from srl.commissioning.calibration.frames.fit import Mount
from srl.commissioning.calibration.picture import plt, save
from srl.commissioning.calibration.result import Result
from srl.runtime.contracts.rotation import homogeneous
from srl.runtime.contracts.signals import Array


def lines(result: Result[Mount]) -> list[str]:
    """The report as text."""
    mount, options = result.found, result.options
    place, turn = mount.uncertain
    found = [
        f"{options.frame} in {options.parent}{result.when}, {len(mount.numbers)} {mount.what}",
        f"{_pose_text(mount.pose)} (uncertain by {1000 * place:.2f} mm, {np.degrees(turn):.3f} degrees)",
    ]
    if mount.body is not None:
        found.append(f"{options.parent_signal} in {options.frame_signal}: {_pose_text(mount.body)}")
    worst = int(mount.without.argmax())
    turned = f", {np.degrees(mount.askew.max()):.3f} degrees" if mount.what == "poses" else ""
    found.append(
        f"left at most: {1000 * mount.left.max():.2f} mm{turned}; from where the others say: "
        f"{1000 * mount.without[worst]:.2f} mm ({mount.what[:-1]} {mount.numbers[worst]})"
    )
    return found


def metrics(result: Result[Mount]) -> dict[str, Any]:
    """The report as JSON types; SI units."""
    mount, options = result.found, result.options
    each = zip(mount.numbers, mount.left, mount.askew, mount.without, strict=True)
    return {
        "frame": options.frame, "parent": options.parent, "what": mount.what, "pose": mount.pose.tolist(),
        "body": None if mount.body is None else mount.body.tolist(),
        "uncertain": {"position_m": mount.uncertain[0], "rotation_rad": mount.uncertain[1]},
        "spread": mount.spread,
        "each": [
            {"number": n, "left_m": float(m), "left_rad": float(r), "without_m": float(w)} for n, m, r, w in each
        ],
    }  # fmt: skip


def draw(result: Result[Mount], png: Path) -> None:
    """Draws what was measured in both frames, laid on each other, and what is left. Raises RecordError."""
    mount, limits = result.found, result.options.thresholds
    parent, found = mount.parent[:, :3], placed(mount)
    figure = plt.figure(figsize=(13, 5), constrained_layout=True)
    space, bars, turns = figure.add_subplot(131, projection="3d"), figure.add_subplot(132), figure.add_subplot(133)
    space.scatter(*parent.T, color="#0072B2", label=f"measured in {result.options.parent}")
    space.scatter(*found.T, color="#D55E00", marker="+", s=60, label=f"measured in {result.options.frame}")
    for number, at in zip(mount.numbers, parent, strict=True):
        space.text(*at, f" {number}", fontsize=8)
    T = homogeneous(mount.pose)
    for axis, color in zip(T[:3, :3].T, ("#CC0000", "#009900", "#0000CC"), strict=True):
        space.plot(*np.array([T[:3, 3], T[:3, 3] + 0.15 * axis]).T, color=color)
    space.set_xlabel("x, m")
    space.set_ylabel("y, m")
    space.set_zlabel("z, m")
    space.set_aspect("equal")
    space.legend(fontsize=8)
    at, names = np.arange(len(mount.numbers)), [str(n) for n in mount.numbers]
    bars.bar(at - 0.2, 1000 * mount.left, 0.4, color="#0072B2", label="left")
    bars.bar(at + 0.2, 1000 * mount.without, 0.4, color="#E69F00", label="from where the others say")
    bars.axhline(1000 * limits.position, color="#D55E00", linestyle="--", label="allowed")
    bars.set_ylabel("mm")
    turns.bar(at, np.degrees(mount.askew), 0.4, color="#0072B2", label="left")
    turns.axhline(np.degrees(limits.rotation), color="#D55E00", linestyle="--", label="allowed")
    turns.set_ylabel("degrees")
    for axes in (bars, turns):
        axes.set_xticks(at, names)
        axes.set_xlabel(mount.what[:-1])
        axes.legend(fontsize=8)
    turns.set_visible(mount.what == "poses")
    figure.suptitle("\n".join(lines(result)), fontsize=9)
    save(figure, png)


def placed(mount: Mount) -> Array:
    """(n, 3) m in the parent: what was measured in the frame, brought there."""
    T = homogeneous(mount.pose)
    if mount.body is None:
        found: Array = mount.frame @ T[:3, :3].T + T[:3, 3]
        return found
    body = homogeneous(mount.body)
    return np.array([(T @ homogeneous(pose) @ body)[:3, 3] for pose in mount.frame])


def _pose_text(pose: Array) -> str:
    x, y, z, qw, qx, qy, qz = pose.round(6) + 0.0
    return f"position {x:.5f} {y:.5f} {z:.5f} m, quaternion {qw:.6f} {qx:.6f} {qy:.6f} {qz:.6f}"
