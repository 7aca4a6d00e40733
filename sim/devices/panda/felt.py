"""What a simulated Franka's controller makes of its joints' external torques: the wrench at K, and what is touched.

In C where it can be (native/felt_wrench.c); the Python here is the specification.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import pinocchio as pin

from srl.runtime.contracts.compiled import bind_or_python, numbers
from srl.runtime.contracts.signals import Array
from srl.runtime.models.robots.description import RobotDescription
from srl.runtime.models.robots.pinocchio_model import FLANGE, pinocchio_model
from srl.sim.devices.panda.motion import DT
from srl.sim.devices.panda.settings import Settings

FILTER: Final = 1 - np.exp(-2 * np.pi * 50.0 * DT)  # of the external torques: 50 Hz
ROUNDING: Final = 1e-4  # added to J J^T: near a singularity some forces can't be estimated


class Felt:
    """What one robot feels. The arrays are filled in place.

    Attributes:
        external: N m (7,), external torques, filtered.
        wrench: (6,) N, N m, acting on the robot at frame K, base axes.
        pose: (4, 4), the end effector in the base frame.
        touching: (2, 13), 1 where a load is above its threshold: lower ones, then upper ones; joints, then axes.
    """

    def __init__(self, robot: RobotDescription) -> None:
        self.external, self.wrench = np.zeros(7), np.zeros(6)
        self.pose, self.touching = np.eye(4), np.zeros((2, 13))
        self._settings = Settings()
        self._q, self._torque = np.zeros(7), np.zeros(7)  # measured: position and external torques
        self._tool, self._point = np.zeros(12), np.zeros(3)  # the end effector at the flange, and K's origin in it
        self._thresholds = np.zeros((2, 2, 13))  # as `touching`; the second ones while the desired motion accelerates
        self._model = model = pinocchio_model(robot)  # what is carried changes no place
        self._work, self._flange = model.createData(), model.getFrameId(FLANGE)
        mount = model.frames[self._flange].placement
        places = [part for at in list(model.jointPlacements)[1:] for part in (at.rotation, at.translation)]
        self._in_c = bind_or_python(
            "felt-wrench", self._q, self._torque, np.array([FILTER]), numbers(*places),
            numbers(mount.rotation, mount.translation), self._tool, self._point, self._thresholds,
            self.external, self.wrench, self.pose, self.touching,
        )  # fmt: skip

    def know(self, settings: Settings) -> None:
        """Takes the frames and thresholds of the settings, which have changed."""
        self._settings, ee = settings, settings.F_T_EE
        self._tool[:9], self._tool[9:] = ee[:3, :3].ravel(), ee[:3, 3]
        self._point[:] = settings.EE_T_K[:3, 3]
        for i, kind in enumerate(("", "_acceleration")):
            for j, bound in enumerate(("lower", "upper")):
                loads = [getattr(settings, f"{bound}_{what}{kind}") for what in ("torque", "force")]
                np.concatenate(loads, out=self._thresholds[i, j])

    def update(self, q: Array, torque: Array, accelerates: bool) -> None:
        """Takes the measured values of a millisecond.

        Args:
            q: rad (7,).
            torque: N m (7,), external.
            accelerates: whether the desired motion does.
        """
        self._q[:], self._torque[:] = q, torque
        if self._in_c(DT, accelerates) < 0:
            self._compute(accelerates)

    def _compute(self, accelerates: bool) -> None:
        model, work, external = self._model, self._work, self.external
        external += FILTER * (self._torque - external)
        pin.computeJointJacobians(model, work, self._q)
        pin.updateFramePlacement(model, work, self._flange)
        jacobian = pin.getFrameJacobian(model, work, self._flange, pin.LOCAL_WORLD_ALIGNED)
        flange = work.oMf[self._flange].homogeneous
        self.pose[:] = flange @ self._settings.F_T_EE
        # At K instead of the flange: v_K = v_F + w x r.
        x, y, z = (self.pose @ self._settings.EE_T_K[:, 3] - flange[:, 3]).tolist()[:3]
        a, b, c = jacobian[3:]
        jacobian[:3] += (b * z - c * y, c * x - a * z, a * y - b * x)
        square = jacobian @ jacobian.T
        square.flat[::7] += ROUNDING
        self.wrench[:] = np.linalg.solve(square, jacobian @ external)
        loads = np.concatenate((external, self.wrench))
        np.greater(np.abs(loads), self._thresholds[int(accelerates)], out=self.touching)
