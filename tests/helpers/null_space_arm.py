"""An arm of a person who moves it while the hand stays: seven joints, with a clavicle of two more on request.

Shoulder x y z, elbow, pronation, two of the wrist. Lengths of a person of 1.75 m. The frame is the chest's: x to the
front, y to the left, z up; the arm is a right one.
"""

from __future__ import annotations

from datetime import date
from itertools import product
from pathlib import Path
from typing import cast

import numpy as np
import pinocchio as pin

from srl.control.ikns.calibration import Recording, calibrate
from srl.control.ikns.record import Record, write
from srl.control.ikns.thresholds import Thresholds
from srl.runtime.contracts.signals import Array

UPPER, FORE, HAND, CLAVICLE = 0.326, 0.256, 0.09, 0.16  # m
MIDDLE = np.array([0.33, -0.17, -0.12])  # m, of the workspace
HALF = np.array([0.08, 0.10, 0.09])  # m
# As a person gets there: up to two centimetres beside the corners of a box and the centres of two of its faces.
POINTS = MIDDLE + HALF * np.array([*product((-1, 1), repeat=3), (0, 0, -1), (0, 0, 1)])
POINTS += np.random.default_rng(8).uniform(-0.02, 0.02, POINTS.shape)
POSTURE = np.deg2rad([-20.0, -35.0, 10.0, -95.0, 10.0, 5.0, 5.0])


class Arm:
    """The arm; `chain` is "arm" (7 joints) or "clavicle" (protraction and elevation first, 9)."""

    def __init__(self, chain: str = "arm") -> None:
        model = pin.Model()
        x, y, z = (pin.JointModelRX(), pin.JointModelRY(), pin.JointModelRZ())
        down = lambda length: pin.SE3(np.eye(3), np.array([0.0, 0.0, -length]))  # noqa: E731
        root = pin.SE3(np.eye(3), np.array([0.0, -0.02, 0.0]))
        shoulder = pin.SE3(np.eye(3), np.array([0.0, -CLAVICLE, 0.0]))
        parts = [("shoulder_x", x, shoulder), ("shoulder_y", y, down(0)), ("shoulder_z", z, down(0))]
        parts += [("elbow", y, down(UPPER)), ("pronation", z, down(0))]
        parts += [("wrist_y", y, down(FORE)), ("wrist_x", x, down(0))]
        if chain == "clavicle":
            parts = [("protraction", z, root), ("elevation", x, down(0)), *parts]
        else:
            parts[0] = ("shoulder_x", x, root * shoulder)
        joint = 0
        for name, kind, place in parts:
            joint = model.addJoint(joint, kind, place, name)
        self.hand = model.addFrame(pin.Frame("hand", joint, 0, down(HAND), pin.FrameType.OP_FRAME))
        self.elbow = model.getJointId("elbow")
        self.shoulder, self.wrist = model.getJointId("shoulder_x"), model.getJointId("wrist_y")
        self.model, self.data, self.n = model, model.createData(), model.nq
        self.names = tuple(model.names)[1:]
        self.posture = np.concatenate([np.zeros(self.n - 7), POSTURE])

    def pose(self, q: Array) -> pin.SE3:
        """The hand's pose in the chest's frame."""
        pin.framesForwardKinematics(self.model, self.data, q)
        return self.data.oMf[self.hand].copy()

    def jacobian(self, q: Array) -> Array:
        """(6, n) of the hand, in its own frame."""
        found = pin.computeFrameJacobian(self.model, self.data, q, self.hand, pin.ReferenceFrame.LOCAL)
        return cast(Array, found.copy())

    def null(self, q: Array) -> Array:
        """(m, n): an orthonormal basis of the motions that leave the hand still."""
        return cast(Array, np.linalg.svd(self.jacobian(q))[2][6:])

    def swivel(self, q: Array) -> float:
        """rad, angle of the elbow about the line from shoulder to wrist, against the plane that contains z."""
        pin.forwardKinematics(self.model, self.data, q)
        s, e, w = (self.data.oMi[j].translation for j in (self.shoulder, self.elbow, self.wrist))
        axis = (w - s) / np.linalg.norm(w - s)
        down = np.array([0.0, 0.0, -1.0]) - axis * -axis[2]
        out = (e - s) - axis * (axis @ (e - s))
        return float(np.arctan2(np.cross(down, out) @ axis, down @ out))

    def reach(self, q: Array, target: pin.SE3, free: slice = slice(None)) -> Array:
        """Joint angles near q that bring the hand to the target, by steps of least norm of the free joints."""
        q = q.copy()
        for _ in range(100):
            error = pin.log6(self.pose(q).inverse() * target).vector
            if np.linalg.norm(error) < 1e-11:
                return q
            step = np.linalg.pinv(self.jacobian(q)[:, free]) @ error
            q[free] += step * min(1.0, 0.3 / np.linalg.norm(step))
        raise AssertionError("the hand can't get there")

    def at(self, place: Array, turn: Array | None = None) -> Array:
        """A posture with the hand at `place` (3,) m; oriented as in a resting posture, and turned by (3,) rad."""
        home = self.pose(self.posture)
        rotation = home.rotation if turn is None else home.rotation @ pin.exp3(turn)
        free = slice(self.n - 7, None)
        q, start = self.posture, home.translation
        for s in np.linspace(0.1, 1.0, 10):
            turned = pin.exp3(s * pin.log3(rotation @ home.rotation.T)) @ home.rotation
            q = self.reach(q, pin.SE3(turned, start + s * (place - start)), free)
        return self.turned(q, 0.6)  # the elbow out to the side

    def turned(self, q: Array, swivel: float) -> Array:
        """The posture of that swivel angle, rad; the hand and the clavicle stay."""
        target, free = self.pose(q), slice(self.n - 7, None)
        for _ in range(400):
            gap = swivel - self.swivel(q)
            if abs(gap) < 1e-10:
                return q
            along = np.zeros(self.n)
            along[free] = np.linalg.svd(self.jacobian(q)[:, free])[2][6]
            rate = (self.swivel(q + 1e-6 * along) - self.swivel(q - 1e-6 * along)) / 2e-6
            q = self.reach(q + along * np.clip(gap / rate, -0.05, 0.05), target, free)
        raise AssertionError("no such swivel angle")

    def swing(self, q: Array, half: float, n: int) -> Array:
        """(n, joints): n postures from `half` rad of swivel below that of q to `half` above, the hand still."""
        middle = self.swivel(q)
        below = self.turned(q, middle - half)
        found = [below]
        for angle in np.linspace(middle - half, middle + half, n)[1:]:
            found.append(self.turned(found[-1], angle))
        return np.array(found)

    def shrug(self, q: Array, joint: int, half: float, n: int) -> Array:
        """(n, joints): the clavicle's joint goes from -half to half rad, the arm gives way, the hand is still."""
        target, found = self.pose(q), []
        free = slice(self.n - 7, None)
        middle = self.swivel(q)
        for angle in np.linspace(-half, half, n):
            q = q.copy()
            q[joint] = angle
            q = self.turned(self.reach(q, target, free), middle)
            found.append(q)
        return np.array(found)


def recorded(arm: Arm, trials: list[list[Array]], noise: float = 0.0, seed: int = 0) -> Recording:
    """100 samples a second of trials[point][dof] (T, n): each gone through once; rad of noise on every angle."""
    parts = [(q, j) for point in trials for j, q in enumerate(point)]
    angles = np.concatenate([q for q, _ in parts])
    angles = angles + np.random.default_rng(seed).normal(size=angles.shape) * noise
    hand = np.array([arm.pose(q).translation for q in angles])
    # A second between trials, in which nothing is recorded.
    starts = np.cumsum([0.0, *(len(q) / 100 + 1.0 for q, _ in parts[:-1])])
    times = np.concatenate([start + np.arange(len(q)) / 100 for start, (q, _) in zip(starts, parts, strict=True)])
    return Recording(times, angles, hand, np.concatenate([np.full(len(q), j) for q, j in parts]))


def calibrated(path: Path, chain: str = "arm", k: int = 1) -> Record:
    """Writes the calibration file of a person with this arm, and returns what is in it."""
    arm, thresholds = Arm(chain), Thresholds(samples=20)
    trials = []
    for place in POINTS:
        q = arm.at(place)
        trials.append([arm.swing(q, 0.6, 21), arm.shrug(q, 1, 0.25, 21), arm.shrug(q, 0, 0.25, 21)][:k])
    record = Record.of(
        calibrate(recorded(arm, trials), thresholds), thresholds, person="p07", simulated=True, date=date(2024, 5, 17),
        rate=100.0, frame="chest", joints=arm.names, dofs=("swivel", "shrug", "protraction")[:k],
    )  # fmt: skip
    write(path, record)
    return record
