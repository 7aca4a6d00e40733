"""A joint's trim, direction and scale from where its servo stands at one or two known angles of the joint.

The profile's entry gives the servo's angle n. With the entry turned round it is m = mirror - n. The joint's angle is
q = scale (m - trim), where m is n or turned round, so that the scale is positive.
"""

from __future__ import annotations

from dataclasses import dataclass

from pydantic import Field

from srl.runtime.contracts.errors import SrlError
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.servo_record import SHARE, TRIM


class ServoError(SrlError):
    """Servos can't be calibrated from these angles."""


class Thresholds(Options):
    """What a calibration must reach."""

    steady: float = Field(0.005, gt=0, le=0.05, description="rad, by which a joint may move while it is held")
    apart: float = Field(0.25, ge=0.1, description="rad, by which a joint's two places must differ")
    trim: float = Field(TRIM, gt=0, le=TRIM, description="rad, the greatest trim")
    share: float = Field(SHARE, gt=0, le=SHARE, description="by which a scale may be off")
    agree: float = Field(0.1, gt=0, le=0.3, description="rad, by which a servo's own measure may differ from yours")
    home: float = Field(0.01, gt=0, le=0.05, description="rad, how near its home a joint is left")


@dataclass(frozen=True)
class HornFit:
    """What was found of one joint: q = scale (m - trim).

    Attributes:
        trim: rad.
        direction: -1: m = mirror - n, else m = n.
        scale: rad of the joint for a rad of the entry.
        known: whether the scale was found; else it is 1.
        mirror: rad.
    """

    trim: float = 0.0
    direction: int = 1
    scale: float = 1.0
    known: bool = False
    mirror: float = 0.0

    def entry(self, q: float) -> float:
        """The entry's angle n of a joint's angle, rad."""
        m = q / self.scale + self.trim
        return m if self.direction > 0 else self.mirror - m

    def joint(self, n: float) -> float:
        """The joint's angle of the entry's angle n, rad."""
        return self.scale * ((n if self.direction > 0 else self.mirror - n) - self.trim)


def horn_fit(
    n: tuple[float, float], first: float, second: float | None, mirror: float, measures: bool, apart: float
) -> HornFit:
    """The seat of a joint.

    Args:
        n: rad, the entry's angles at the first and second place.
        first: rad, the joint's known angle there.
        second: rad; None: not known, but on the positive side of the first.
        mirror: rad; see `HornFit`.
        measures: the servo measures its angle: its scale is known better than any person sees.
        apart: rad, by which the places must differ.
    Raises:
        ServoError: the places are one, or the known angles are.
    """
    if abs(n[1] - n[0]) < apart or (second is not None and abs(second - first) < apart):
        by = abs(n[1] - n[0]) if second is None else min(abs(n[1] - n[0]), abs(second - first))
        remedy = "Move it further between them"
        raise ServoError("the two places", f"they differ by {by:.2f} rad, {apart:g} are needed", remedy)
    along = 1.0 if second is None or second > first else -1.0
    direction = 1 if (n[1] - n[0]) * along > 0 else -1
    m = n[0] if direction > 0 else mirror - n[0]
    known = second is not None and not measures
    scale = abs((second - first) / (n[1] - n[0])) if known and second is not None else 1.0
    return HornFit(m - first / scale, direction, scale, known, mirror)


def refusals(
    joint: str, found: HornFit, n: tuple[float, float], second: float | None, home: float | None,
    reach: tuple[float, float], thresholds: Thresholds,
) -> list[ServoError]:  # fmt: skip
    """Why a joint's seat can't be used; none if it can.

    Args:
        joint: as the person knows it: "joint 2 (tip)".
        n: rad, the entry's angles at both places.
        second: rad, the second known angle.
        home: rad, of the joint, where a run begins; None: where it is measured.
        reach: rad, the entry's angles that the servo may take.
    """
    refused = []
    if abs(found.trim) > thresholds.trim:
        problem = f"its trim is {found.trim:.2f} rad, {thresholds.trim:g} are allowed"
        remedy = "Seat the horn anew, or correct the profile's entry (lower, upper, zero); was it the right joint?"
        refused.append(ServoError(joint, problem, remedy))
    if abs(found.scale - 1.0) > thresholds.share:
        problem = f"its scale is {found.scale:.2f}, off by more than {thresholds.share:.0%}"
        remedy = "Check the two angles, and the profile's entry (min_us, max_us, lower, upper)"
        refused.append(ServoError(joint, problem, remedy))
    if second is not None and not found.known and (off := abs(found.joint(n[1]) - second)) > thresholds.agree:
        problem = f"its servo measured {found.joint(n[1]):.2f} rad where you gave {second:.2f}, off by {off:.2f}"
        refused.append(ServoError(joint, problem, "Check the two angles; between servo and joint there may be a gear"))
    if home is not None and not reach[0] <= found.entry(home) <= reach[1]:
        ends = sorted(found.joint(end) for end in reach)
        problem = f"its home, {home:g} rad, is out of its reach, {ends[0]:.2f} to {ends[1]:.2f}"
        refused.append(ServoError(joint, problem, "Change `home` in the profile, or seat the horn anew"))
    return refused
