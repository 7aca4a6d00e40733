"""The instructions of a simulated wearer, under the name by which the parts know them."""

from __future__ import annotations

from runtime.contracts.wearer import Dof, Explore, Follow, Hold, Instruction, Rest, Vector, Wearer

__all__ = ["Dof", "Explore", "Follow", "Hold", "Instruction", "Rest", "Vector", "Wearer"]
