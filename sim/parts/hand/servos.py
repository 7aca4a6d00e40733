"""The servos of all fingers in a cell, by name."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

from srl.sim.parts.hand.robotic_finger import RoboticFingerPart
from srl.sim.world.cell import Cell


class Servos:
    """The servos that boards can drive: one board may drive several fingers, and several boards one finger.

    Attributes:
        names: the joints'; with several fingers `<finger>_<joint>`, as `object-mapping` calls them.
    """

    def __init__(self, cell: Cell) -> None:
        fingers = [part for part in cell.parts.values() if isinstance(part, RoboticFingerPart)]
        alone = len(fingers) == 1
        found = [(joint if alone else f"{f.name}_{joint}", f, joint) for f in fingers for joint in f.joints]
        count = Counter(name for name, _, _ in found)
        self._where = {name: (finger, joint) for name, finger, joint in found if count[name] == 1}
        self.names = tuple(self._where)

    def taken(self, name: str, board: str) -> str:
        """Takes a servo for a board; returns the other board that has it, or "" if it is free."""
        finger, joint = self._where[name]
        owner = finger.boards.setdefault(joint, board)
        return "" if owner == board else owner

    def set(self, targets: Mapping[str, float | None], at: int = 0) -> None:
        """Sets the targets (rad; None: limp) that the servos' pulses encode from `at` (ns) on."""
        of: dict[RoboticFingerPart, dict[str, float | None]] = {}
        for name, target in targets.items():
            finger, joint = self._where[name]
            of.setdefault(finger, {})[joint] = target
        for finger, theirs in of.items():
            finger.set_servos(theirs, at)

    def place(self, angles: Mapping[str, float]) -> None:
        """Places servos at angles (rad) before the first step: where the user has put the fingers."""
        for name, angle in angles.items():
            finger, joint = self._where[name]
            finger.place_servos({joint: angle})

    def targets(self) -> dict[str, float]:
        """rad, by name: what each servo holds at present; NaN without pulses."""
        return {n: float(f.servo_targets()[f.joints.index(joint)]) for n, (f, joint) in self._where.items()}

    def angles(self) -> dict[str, float]:
        """rad, by name: where each joint is."""
        return {n: float(f.joint_angles()[f.joints.index(joint)]) for n, (f, joint) in self._where.items()}
