"""The posture of an arm whose hand is held: from the hand's pose, the swivel angle and the clavicle, in closed form.

Seven joints and six conditions leave one dimension, the swivel angle: how far the elbow is turned out about the line
from shoulder to wrist, from where it hangs. Shoulder and wrist are each three axes through one point, so the joints
follow from triangles and Euler angles.
"""

from __future__ import annotations

from math import acos, cos, nan, pi, sin, sqrt
from typing import Any, Final, NamedTuple

import numpy as np
import pinocchio as pin

from srl.runtime.contracts import rotation
from srl.runtime.contracts.signals import Array
from srl.runtime.models.body import Body, Side

_STRETCHED: Final = 0.995  # share of the arm's length beyond which the hand can't go: the elbow would be straight
_FOLDED: Final = 0.3  # share below which it can't


class Hold(NamedTuple):
    """Where a hand is held, in the chest's frame: m (3,), and the hand's axes (3, 3)."""

    place: Array
    axes: Array


class ArmPosture:
    """One arm of a body with its clavicle: nine joints, protraction and elevation first.

    Attributes:
        joints: (9,) indices of its joints in the body's.
        lower, upper: (9,) rad, their ranges.
        reach: m, from shoulder to the palm's middle, stretched.
        shoulder: (3,) m, at rest, in the chest's frame.
    """

    def __init__(self, body: Body, side: Side) -> None:
        self.joints = np.array([*body.chains[f"{side}_clavicle"], *body.chains[f"{side}_arm"]])
        ranges = body.ranges[self.joints]
        self.lower, self.upper = ranges[:, 0], ranges[:, 1]
        self._middle = 0.5 * (self.lower + self.upper)
        self._sign = np.array([sum(body.joints[i].axis) for i in self.joints])
        self._turned = np.array([1.0, 1.0, *self._sign[2:5], 1.0, *self._sign[6:9]])  # of the angles that are found
        self._sternum, self._clavicle = np.array(body.sternum[side]), np.array(body.shoulder[side])
        self.shoulder = self._sternum + self._clavicle
        self._upper, self._fore = body.sizes["upper_arm"][side], body.sizes["forearm"][side]
        self._grip = np.array(body.grip(side))
        self._palm = float(np.linalg.norm(self._grip))
        self.reach = self._upper + self._fore + self._palm
        self._out = 1.0 if side == "left" else -1.0
        self._last: tuple[Any, tuple[Array, Array]] = (None, (np.empty(0), np.empty(0)))  # girdle, by the clavicle
        self._model: Any = body.model()
        self._data = self._model.createData()
        self._q = np.zeros(len(body.joints))
        self._J = self._data.J  # a view, as are those of the hand's pose
        hand = self._data.oMi[body.segments[f"{side}_hand"] + 1]
        self._place, self._turn = hand.translation, hand.rotation

    def solve(self, hold: Hold, swivel: float, clavicle: tuple[float, float] = (0.0, 0.0)) -> Array:
        """(9,) rad: the posture that holds the hand. Beyond the arm's reach the hand stays on its line.

        Args:
            swivel: rad, 0 with the elbow down, positive outwards.
            clavicle: rad, protraction and elevation.
        """
        C, shoulder = self._girdle(clavicle)
        wrist = hold.place - hold.axes @ self._grip
        U, flexion = self._upper_arm(shoulder, wrist, swivel, self._fore)
        shoulder_angles = rotation.euler(C.T @ U, "XYZ")
        wrist_angles = rotation.euler(_forearm(U, flexion).T @ hold.axes, "ZXY")
        q = np.array([*clavicle, *shoulder_angles, flexion, *wrist_angles])
        q *= self._turned
        away = q - self._middle
        if not -pi <= away.min() <= away.max() <= pi:
            q -= 2.0 * pi * (away / (2.0 * pi)).round()
        return q

    def natural(self, place: Array, swivel: float, pronation: float = 0.0) -> Hold:
        """The hand at a place (3,) m with a nearly straight wrist, as the forearm of that swivel angle has it."""
        _, shoulder = self._girdle((0.0, 0.0))
        U, flexion = self._upper_arm(shoulder, place, swivel, self._fore + self._palm)
        z = self._sign[6] * pronation
        turn = np.array([[cos(z), -sin(z), 0.0], [sin(z), cos(z), 0.0], [0.0, 0.0, 1.0]])
        return Hold(place, _forearm(U, flexion) @ turn)

    def fits(self, q: Array, margin: float) -> bool:
        """Whether every joint (9,) is inside its range by a margin, rad."""
        return bool((q >= self.lower + margin).all() and (q <= self.upper - margin).all())

    def reaches(self, hold: Hold) -> bool:
        """Whether the hand can be there."""
        distance = float(np.linalg.norm(hold.place - hold.axes @ self._grip - self.shoulder))
        length = self._upper + self._fore
        return _FOLDED * length <= distance <= _STRETCHED * length

    def place(self, q: Array) -> Array:
        """(3,) m: where the palm's middle is at q (9,); and the chain is there for `jacobian`."""
        self._q[self.joints] = q
        pin.computeJointJacobians(self._model, self._data, self._q)
        found: Array = self._place + self._turn @ self._grip
        return found

    def jacobian(self, q: Array) -> Array:
        """(6, 9): velocity of the palm's middle and of the hand's turning, in the chest's axes, of the joints."""
        x, y, z = self.place(q).tolist()
        J = np.ascontiguousarray(self._J[:, self.joints])
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        J[:3] -= cross @ J[3:]
        return J

    def _girdle(self, clavicle: tuple[float, float]) -> tuple[Array, Array]:
        """The clavicle's axes (3, 3), and where the shoulder is, (3,) m."""
        if clavicle == self._last[0]:  # it is still, mostly
            return self._last[1]
        a, b = self._sign[0] * clavicle[0], self._sign[1] * clavicle[1]
        ca, sa, cb, sb = cos(a), sin(a), cos(b), sin(b)
        C = np.array([[ca, -sa * cb, sa * sb], [sa, ca * cb, -ca * sb], [0.0, sb, cb]])
        self._last = clavicle, (C, self._sternum + C @ self._clavicle)
        return self._last[1]

    def _upper_arm(self, shoulder: Array, end: Array, swivel: float, fore: float) -> tuple[Array, float]:
        """The upper arm's axes (3, 3) and the elbow's flexion, rad, for a forearm of this length that ends there."""
        # Plain numbers: for three values, numpy's own overhead would be most of the cost.
        upper = self._upper
        x, y, z = (end - shoulder).tolist()
        distance = sqrt(x * x + y * y + z * z)
        along = ax, ay, az = _unit(x, y, z)
        length = upper + fore
        distance = min(max(distance, _FOLDED * length), _STRETCHED * length)
        down = dx, dy, dz = _unit(ax * az, ay * az, az * az - 1.0)
        sx, sy, sz = _cross(along, down)
        c, s = cos(swivel), self._out * sin(swivel)
        at = (upper**2 + distance**2 - fore**2) / (2.0 * upper * distance)
        off = sqrt(max(1.0 - at * at, 0.0))
        zx = -(at * ax + off * (c * dx + s * sx))
        zy = -(at * ay + off * (c * dy + s * sy))
        zz = -(at * az + off * (c * dz + s * sz))
        fx, fy, fz = ((distance * a + upper * b) / fore for a, b in ((ax, zx), (ay, zy), (az, zz)))
        cosine = -(fx * zx + fy * zy + fz * zz)
        forwards = xx, xy, xz = _unit(fx + cosine * zx, fy + cosine * zy, fz + cosine * zz)
        yx, yy, yz = _cross((zx, zy, zz), forwards)
        return np.array([[xx, yx, zx], [xy, yy, zy], [xz, yz, zz]]), acos(min(max(cosine, -1.0), 1.0))


def _forearm(U: Array, flexion: float) -> Array:
    """The forearm's axes (3, 3), not pronated."""
    c, s = cos(flexion), sin(flexion)
    return U @ np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])


def _unit(x: float, y: float, z: float) -> rotation.Vector:
    size = sqrt(x * x + y * y + z * z) or nan
    return (x / size, y / size, z / size)


def _cross(a: rotation.Vector, b: rotation.Vector) -> rotation.Vector:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
