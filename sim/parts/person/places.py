"""Positions of objects in a cell, by the names that a plan uses."""

from __future__ import annotations

from typing import Any, cast

import mujoco

from srl.runtime.contracts.errors import WiringError, nearest
from srl.runtime.contracts.rotation import Quaternion, Vector, conjugate, from_matrix, product, turned
from srl.runtime.contracts.signals import Array
from srl.sim.parts.person.path import Pose


class Places:
    """Sites and bodies of a compiled world. Poses are present ones if the world's kinematics are up to date."""

    def __init__(self, model: Any, data: Any, part: str) -> None:
        """Args: part, the person's name, for errors."""
        self._model, self._data, self._part = model, data, part

    def pose(self, name: str) -> Pose:
        """The pose of a site or body.

        Raises:
            WiringError: there is no site or body with this name.
        """
        model, data = self._model, self._data
        site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, name)
        body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
        if site >= 0:
            place, turn = data.site_xpos[site], from_matrix(data.site_xmat[site].reshape(3, 3))
        elif body >= 0:
            place, turn = data.xpos[body], from_matrix(data.xmat[body].reshape(3, 3))
        else:
            raise self._unknown("plan", name)
        x, y, z = place.tolist()
        return (x, y, z, *turn)

    def sites(self, prefix: str) -> Array:
        """(n, 3) m, positions of the sites PREFIX0, PREFIX1, ...

        Raises:
            WiringError: there are fewer than two.
        """
        model = self._model
        numbers: list[int] = []
        while (site := mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, f"{prefix}{len(numbers)}")) >= 0:
            numbers.append(site)
        if len(numbers) < 2:
            raise self._unknown("plan", f"{prefix}0")
        return cast(Array, self._data.site_xpos[numbers].copy())

    def fixed_in(self, hand: int, named: str | None) -> tuple[Vector, Quaternion]:
        """Position and orientation of a site or body that is fixed in the body `hand`; None: the hand itself.

        Raises:
            WiringError: there is no such site or body, or it can move relative to the hand.
        """
        if named is None:
            return (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
        model = self._model
        site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, named)
        body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, named)
        if site < 0 and body < 0:
            raise self._unknown("tool", named)
        if model.body_weldid[model.site_bodyid[site] if site >= 0 else body] != model.body_weldid[hand]:
            raise WiringError(
                f"sim.parts.{self._part}.tool",
                f"'{named}' can move against the hand",
                "Name a site or body that is fixed to what the person holds",
            )
        x, y, z, *q = self.pose(named)
        hx, hy, hz = self._data.xpos[hand].tolist()
        w, i, j, k = self._data.xquat[hand].tolist()
        back = conjugate((w, i, j, k))
        return turned(back, (x - hx, y - hy, z - hz)), product(back, (q[0], q[1], q[2], q[3]))

    def _unknown(self, key: str, name: str) -> WiringError:
        model = self._model
        known = [model.site(i).name for i in range(model.nsite)] + [model.body(i).name for i in range(model.nbody)]
        return WiringError(
            f"sim.parts.{self._part}.{key}",
            f"no site or body is called '{name}'",
            nearest(name, [k for k in known if "/" in k]),
        )
