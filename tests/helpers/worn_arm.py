"""The profile `worn-arm` with changes: as worn, and as a bench on its strap; what its weight truly is."""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, tostring

import mujoco
import numpy as np
from ruamel.yaml import YAML

from srl import profiles
from srl.runtime.contracts.files import KeptFile
from srl.runtime.contracts.rotation import conjugate, turned
from srl.runtime.contracts.signals import Array
from srl.runtime.models.robot_model import RobotModel
from srl.sim.world.mjcf import add
from srl.sim.world.part import Mjcf
from srl.sim.world.robot_mjcf import add_chain

FOLDER = Path(profiles.__file__).parent
RATE = 500  # Hz, of the profile


def worn(upright: str = "imu") -> dict[str, Any]:
    """The profile's keys, with where its limb's file is; `upright: base` doesn't compensate the tilt."""
    plain: dict[str, Any] = YAML(typ="safe", pure=True).load(FOLDER / "worn-arm.yaml")
    plain["models"]["limb"]["urdf"] = str(FOLDER / "worn-arm.urdf")
    body = impedance(plain)
    body["upright"] = upright
    if upright == "base":
        del body["in"]["orientation"]
    return plain


def impedance(plain: dict[str, Any]) -> dict[str, Any]:
    """The entry of `joint-impedance`."""
    (found,) = (law for law in plain["controllers"] if law["use"] == "joint-impedance")
    assert isinstance(found, dict)
    return found


def bench(rate: int = RATE, wall: dict[str, Any] | None = None) -> dict[str, Any]:
    """The arm holds a posture, on its strap and nobody; 50 N push its tool sideways for 0.15 s, against a wall."""
    plain = deepcopy(worn())
    plain["rate"] = rate
    del plain["devices"]["mocap"], plain["sim"]["devices"]["mocap"]
    body = impedance(plain)
    plain["controllers"] = [body]
    body["follow"] = False
    del body["in"]["wanted"]
    plain["models"]["limb"]["home"] = {"yaw": 0.0, "shoulder": 0.6, "elbow": -1.2, "wrist": 0.3}
    plain["frames"]["plate"] = {"parent": "world", "position": [0.0, 0.0, 1.0]}
    case, arm = plain["sim"]["parts"]["base_case"], plain["sim"]["parts"]["arm"]
    del arm["at"]
    case["at"]["parent"] = "plate/plate"
    plain["sim"]["parts"] = {
        "plate": {"part": "strap"},
        "arm": arm,
        "base_case": case,
        "knock": {"part": "push", "pushes": "arm/tip", "force": [0.0, 50.0, 0.0], "times": [[0.6, 0.75]]},
        "wall": {"part": "wall", "touches": "arm/flange", "normal": [0.0, -1.0, 0.0], "gap": 0.03} | (wall or {}),
    }
    return plain


class TrueWeight:
    """The limb's weight by MuJoCo, for any tilt of its base."""

    def __init__(self) -> None:
        file = KeptFile(FOLDER / "worn-arm.urdf", (FOLDER / "worn-arm.urdf").read_bytes())
        robot = RobotModel.model_validate({"urdf": file, "tip": "tool"}).robot
        root, mjcf = Element("mujoco"), Mjcf()
        add_chain(mjcf, mjcf.worldbody, robot, "arm", {name: {} for name in robot.labels})
        add(root, "compiler", angle="radian", autolimits=True)
        root.append(mjcf.worldbody)
        self._model = mujoco.MjModel.from_xml_string(tostring(root, encoding="unicode"))
        self._data = mujoco.MjData(self._model)

    def __call__(self, q: Array, base: Array) -> Array:
        """(n,) N m. `q` (n,) rad; `base` (4,) w x y z of its base in the world."""
        w, x, y, z = base.tolist()
        self._model.opt.gravity[:] = turned(conjugate((w, x, y, z)), (0.0, 0.0, -9.81))
        self._data.qpos[:] = q
        mujoco.mj_forward(self._model, self._data)
        found: Array = np.array(self._data.qfrc_bias)
        return found
