"""Whether another rotation order would keep the wearer's feet on the floor better than the profile's.

The stream names no order, and a wrong one moves hands by half a metre. Who walks or turns shows it: with the right
order one foot or the other stays at the height of the floor (2 to 4 cm in recordings of walking people), with a wrong
one both leave it by 60 cm and more. YXZ and YZX can't be told apart by this, nor anything by a person who sits still.
"""

from __future__ import annotations

from typing import Final, get_args

import numpy as np

from srl.drivers.noitom.skeleton import JOINTS, Skeleton
from srl.runtime.contracts.rotation import EulerQuaternions, Order, product, turned
from srl.runtime.contracts.signals import Array

STEP: Final = 20  # frames between two looks: each takes 0.4 ms
OFF, ON = 0.25, 0.10  # m: the lowest foot leaves the floor by more than this, or less


class Floor:
    """Follows the height of the lower foot under each of the six orders; y is up, as the device sends it."""

    def __init__(self, skeleton: Skeleton, order: str) -> None:
        """
        Args:
            skeleton: parents of the joints.
            order: the profile's.
        """
        self._order = order
        self._chains: list[list[int]] = []
        for end in ("RightFoot", "LeftFoot"):
            i, chain = skeleton.names.index(end), []
            while i >= 0:
                chain.append(i)
                i = skeleton.parents[i]
            self._chains.append(chain[::-1])
        self._orders = {order: EulerQuaternions(order, JOINTS, np.pi / 180) for order in get_args(Order)}
        self._range = {order: (np.inf, -np.inf) for order in self._orders}  # m, of the lower foot
        self._count = 0
        self._q = np.zeros((JOINTS, 4))

    def warning(self, degrees: Array, translation: Array) -> str:
        """Takes a frame; says which order fits better, "" as long as none does.

        Args:
            degrees: (JOINTS, 3), the angles as they came.
            translation: (JOINTS, 3), m, of each joint in its parent's frame.
        """
        self._count += 1
        if self._count % STEP:
            return ""
        for order, angles in self._orders.items():
            angles.fill(degrees, self._q)
            low = min(self._height(chain, translation) for chain in self._chains)
            least, most = self._range[order]
            self._range[order] = min(least, low), max(most, low)
        spans = {order: most - least for order, (least, most) in self._range.items()}
        best, own = min(spans, key=spans.__getitem__), spans[self._order]
        if own <= OFF or spans[best] >= ON:
            return ""
        return (
            f"the feet leave the floor by {own:.2f} m with 'order: {self._order}', by {spans[best]:.2f} m with {best}: "
            "check 'order'"
        )

    def _height(self, chain: list[int], translation: Array) -> float:
        q, p = (1.0, 0.0, 0.0, 0.0), np.zeros(3)
        for i in chain:
            p = p + turned(q, tuple(translation[i].tolist()))
            q = product(q, tuple(self._q[i].tolist()))
        return float(p[1])
