"""Whether the axis that the profile takes for up can be: a person's head is above the hips.

A stream doesn't say which axis is up. Read with the wrong one, a person who stands seems to lie, and everything that
follows is turned by a quarter turn. So nothing counts until the person was seen upright once; from then on anything
may be done.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, radians
from typing import Final

LEAST: Final = cos(radians(50.0))  # a person who leans that far doesn't count as upright


class Upright:
    """Follows one person.

    Attributes:
        proven: whether the person was seen upright since the last `restart`.
        why: what is wrong meanwhile; "" once it is proven.
    """

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Forgets the proof: the stream may be another one."""
        self.proven, self.why = False, ""

    def judge(self, hips: Sequence[float], head: Sequence[float], option: str) -> bool:
        """Returns whether the person's sample may be used.

        Args:
            hips, head: m, z up as the profile has it.
            option: the profile's line to check, such as 'up: y'.
        """
        if self.proven:
            return True
        x, y, z = (b - a for a, b in zip(hips, head, strict=True))
        size = (x * x + y * y + z * z) ** 0.5
        self.proven = bool(z > LEAST * size > 0.0)
        self.why = "" if self.proven else f"the person seems to lie: stand upright once, or check '{option}'"
        return self.proven
