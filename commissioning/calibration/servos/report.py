"""The report of a calibration of servos: text, figures and a picture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from srl.commissioning.calibration.picture import plt, save
from srl.commissioning.calibration.result import Result
from srl.commissioning.calibration.servos.fit import HornFit


@dataclass(frozen=True)
class Found:
    """One joint.

    Attributes:
        name: of the joint.
        horn_fit: what was found.
        n: rad, the entry's angles at both places.
        known: rad, the joint's angles there, as the person gave them; None: on the positive side of the first.
        spread: rad, standard deviation while it was held, at most.
        home: rad, of the joint, where a run begins; None: where it is measured.
        reach: rad, the entry's angles that the servo may take.
    """

    name: str
    horn_fit: HornFit
    n: tuple[float, float]
    known: tuple[float, float | None]
    spread: float
    home: float | None
    reach: tuple[float, float]

    @property
    def ends(self) -> tuple[float, float] | None:
        """rad, lowest and highest angle of the joint that the servo reaches; None: it says so itself at its opening."""
        if not np.isfinite(self.reach).all() or abs(self.reach[0]) >= 1e9:
            return None
        low, high = sorted(self.horn_fit.joint(end) for end in self.reach)
        return low, high


@dataclass(frozen=True)
class Calibrated:
    """The `joints` that were calibrated, and the names of those that were `left` out."""

    joints: tuple[Found, ...]
    left: tuple[str, ...]


def lines(result: Result[Calibrated]) -> list[str]:
    """The report as text."""
    head = f"{result.options.device}{result.when}"
    found = [head + (f", by {result.options.plan.by}" if result.options.plan.by else "")]
    for joint in result.found.joints:
        horn_fit = joint.horn_fit
        way = "as the profile says" if horn_fit.direction > 0 else "the other way than the profile says"
        scale = f"scale {horn_fit.scale:.4f}" if horn_fit.known else "scale not measured"
        text = f"{joint.name}: trim {horn_fit.trim:+.4f} rad, turns {way}, {scale}"
        if joint.ends is not None:
            text += f"; reaches {joint.ends[0]:.2f} to {joint.ends[1]:.2f} rad"
        found.append(text)
    if result.found.left:
        found.append(f"as the profile says: {', '.join(result.found.left)}")
    return found


def metrics(result: Result[Calibrated]) -> dict[str, Any]:
    """The report as JSON types; SI units."""
    return {
        "device": result.options.device, "driver": result.options.driver, "by": result.options.plan.by,
        "left": list(result.found.left),
        "joints": {
            f.name: {
                "trim": f.horn_fit.trim, "direction": f.horn_fit.direction, "scale": f.horn_fit.scale,
                "known": f.horn_fit.known,
                "places": list(f.n), "angles": list(f.known), "spread": f.spread,
                "reach": None if f.ends is None else list(f.ends),
            }
            for f in result.found.joints
        },
    }  # fmt: skip


def draw(result: Result[Calibrated], png: Path) -> None:
    """Draws each joint's angle over the profile's own angle: as the profile says, and as found. Raises RecordError."""
    joints = result.found.joints
    n = len(joints)
    columns = min(n, 4)
    rows = -(-n // columns)
    figure, axes = plt.subplots(
        rows, columns, figsize=(4.2 * columns, 3.8 * rows), constrained_layout=True, squeeze=False
    )
    for view, joint in zip(axes.flat, joints, strict=False):
        ends = joint.reach if joint.ends is not None else (min(joint.n) - 0.5, max(joint.n) + 0.5)
        span = np.array(ends)
        view.plot(span, span, color="0.7", label="as the profile says")
        view.plot(span, [joint.horn_fit.joint(each) for each in ends], color="#0072B2", label="found")
        view.plot(joint.n[0], joint.known[0], "o", color="#D55E00", label="known angles")
        if joint.known[1] is not None:
            view.plot(joint.n[1], joint.known[1], "o", color="#D55E00")
        else:
            view.axvline(joint.n[1], color="#D55E00", linestyle=":", label="positive side")
        if joint.home is not None:
            view.plot(joint.horn_fit.entry(joint.home), joint.home, "s", color="#009E73", label="home")
        view.set_title(joint.name, fontsize=10)
        view.set_xlabel("the profile's own angle, rad")
        view.set_ylabel("the joint's angle, rad")
    for view in axes.flat[n:]:
        view.axis("off")
    axes[0, 0].legend(fontsize=7)
    figure.suptitle(lines(result)[0], fontsize=10)
    save(figure, png)
