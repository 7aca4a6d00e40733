"""MOCA and Kairos without the loop: the control laws of SUPER-MAN wired over a simulated or an ideal robot."""

from __future__ import annotations

from collections import deque
from typing import Any, cast

import mujoco
import numpy as np
import pinocchio as pin
from scipy.linalg import block_diag

from helpers.control import bound
from srl.control.cobot.admittance import Admittance, AdmittanceConfig
from srl.control.cobot.guide_buttons import GuideButtons, GuideButtonsConfig
from srl.control.cobot.kairos_clik import KairosClik, KairosClikConfig
from srl.control.cobot.moca_impedance import MocaImpedance, MocaImpedanceConfig
from srl.control.cobot.payload import Payload, PayloadConfig
from srl.control.cobot.tool_pose import ToolPose, ToolPoseConfig
from srl.runtime.contracts.controller import Controller
from srl.runtime.contracts.signals import Array
from srl.runtime.models.robots import PANDA, UR16E
from srl.runtime.models.robots.pinocchio_model import pinocchio_model
from srl.sim.parts.robots.arm import ArmPart
from srl.sim.parts.robots.summit_xl import SummitXlPart
from srl.sim.world.cell import Cell, CellConfig

MASS = (105.0, 21.0)
"""kg, kg m^2: MOCA's virtual mass."""
PANDA_MODEL = pinocchio_model(PANDA)
PANDA_DATA = PANDA_MODEL.createData()
MOUNT = (0.2, 0.0, 0.529, 1.0, 0.0, 0.0, 0.0)  # on base/deck, 0.509 above the ground, and a plate of 0.02 m
ON_DECK = {"at": {"parent": "base/deck", "position": (0.2, 0.0, 0.02)}}


class Chain:
    """Buttons, tool pose, admittance and a whole-body law, in the order of a profile.

    Attributes:
        buttons, wrench: inputs of a cycle: (4,) and (6,) N, N m in the control point's axes.
        locked: `desired_pose` and `desired_twist` of this chain are the test's, not the admittance's.
    """

    def __init__(self, law: MocaImpedance | KairosClik, robot: str, admittance: dict[str, Any] | None = None) -> None:
        self.law = bound(law)
        for name in ("torque", "velocity", "base_twist"):
            if name in law.output:
                law.applied = {**law.applied, name: law.output[name].copy()}
        self.keys = bound(GuideButtons("buttons", GuideButtonsConfig()))
        self.tool = bound(ToolPose("tool", ToolPoseConfig(robot=robot)), mount=MOUNT)
        self.admittance = bound(Admittance("admittance", AdmittanceConfig(**(admittance or {}))))
        self.buttons, self.wrench = self.keys.input["buttons"], self.admittance.input["wrench"]
        self.modes = self.keys.output["modes"]
        self.payload: Payload | None = None
        if "load" in law.input or "outside" in law.input:
            flange = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
            options = PayloadConfig(robot=robot, axes="world", watch={"threshold": (8.0, 2.0)})
            self.payload = bound(Payload("payload", options), flange=flange)
        self.locked = False

    def reset(self, q: Array, qd: Array, base_pose: Array, base_twist: Array) -> None:
        self._cycle(q, qd, base_pose, base_twist, None)

    def update(self, q: Array, qd: Array, base_pose: Array, base_twist: Array, dt: float) -> None:
        self._cycle(q, qd, base_pose, base_twist, dt)

    def _cycle(self, q: Array, qd: Array, base_pose: Array, base_twist: Array, dt: float | None) -> None:
        measured = {"q": q, "qd": qd, "base_pose": base_pose, "base_twist": base_twist}
        _run(self.keys, {}, dt)
        _run(self.tool, measured, dt)
        found = self.tool.output
        _run(self.admittance, {**found, "modes": self.modes}, dt)
        wanted = self.admittance.output
        given = {**measured, **found, "modes": self.modes}
        if self.payload is not None:
            _run(self.payload, {**given, "hand": wanted["hand"]}, dt)
            given |= self.payload.output
        if not self.locked:
            given |= {"desired_pose": wanted["pose"], "desired_twist": wanted["twist"], "hand": wanted["hand"]}
        _run(self.law, given, dt)

    def press(self, *names: str) -> None:
        """One cycle's buttons, by name; none: all let go."""
        self.buttons[:] = [name in names for name in "AMGP"]


def _run(controller: Controller, given: dict[str, Array], dt: float | None) -> None:
    for name, array in controller.input.items():
        if name in given:
            array[:] = given[name]
    if dt is None:
        controller.reset()
    else:
        controller.update(dt)


class MocaRig:
    """MOCA in MuJoCo at 1 kHz, with torque commands that act `delay` cycles late and no guard."""

    def __init__(
        self,
        parts: dict[str, Any] | None = None,
        delay: int = 1,
        admittance: dict[str, Any] | None = None,
        **options: Any,
    ) -> None:
        scene = {"base": {"part": "summit-xl", "slip": 0.0}, "arm": {"part": "panda", **ON_DECK}, **(parts or {})}
        self.world = Cell(CellConfig.model_validate({"parts": scene}), 1)
        self.arm, self.base = cast(ArmPart, self.world.parts["arm"]), cast(SummitXlPart, self.world.parts["base"])
        self.chain = Chain(MocaImpedance("moca", MocaImpedanceConfig(**options)), "panda", admittance)
        self._late: deque[Array] = deque([np.zeros(7)] * delay)
        self._flange = self.world.model.body("arm/flange").id
        self.push = np.zeros(6)  # N, N m on the flange's origin, world axes
        self.arm.command("torque", np.zeros(7))
        self.chain.reset(*self._measured())

    def _measured(self) -> tuple[Array, Array, Array, Array]:
        return self.arm.position, self.arm.velocity, self.base.pose(), self.base.twist()

    @property
    def tip(self) -> Array:
        """(3,) m, the flange in the world."""
        mujoco.mj_kinematics(self.world.model, self.world.data)
        return np.array(self.world.data.xpos[self._flange])

    def step(self, cycles: int = 1) -> None:
        data, law, payload = self.world.data, self.chain.law, self.chain.payload
        for _ in range(cycles):
            if payload is not None:  # as the Panda estimates it, from its joints' torques
                away = self.chain.tool.output["jacobian"][:, 3:].T
                payload.input["flange_wrench"][:] = np.linalg.lstsq(away, self.arm.external_effort, rcond=None)[0]
            self.chain.update(*self._measured(), 1e-3)
            for name, array in law.applied.items():
                array[:] = law.output[name]
            self._late.append(law.output["torque"].copy())
            self.arm.command("torque", self._late.popleft())
            self.base.command(*law.output["base_twist"].tolist())
            body = self._flange
            offset = data.xpos[body] - data.xipos[body]
            data.xfrc_applied[body, :3] = self.push[:3]
            data.xfrc_applied[body, 3:] = self.push[3:] + np.cross(offset, self.push[:3])
            self.world.advance(self.world.time + 1_000_000)


class KairosRig:
    """Kairos as an ideal velocity-controlled robot that takes each command one cycle late, or with a lag.

    Attributes:
        q, base: where arm (6,) rad and base (3,) m and rad are.
    """

    def __init__(
        self, q: Array | None = None, rate: float = 500.0, lag: float = 0.0, admittance: dict[str, Any] | None = None,
        **options: Any,
    ) -> None:  # fmt: skip
        self.dt, self._lag = 1 / rate, lag
        self.q, self.base = np.array(UR16E.home if q is None else q), np.zeros(3)
        self.qd, self.twist = np.zeros(6), np.zeros(3)
        self.chain = Chain(KairosClik("kairos", KairosClikConfig(**options)), "ur16e", admittance)
        self.chain.reset(self.q, self.qd, self.base, self.twist)

    def step(self, cycles: int = 1) -> None:
        for _ in range(cycles):
            self.chain.update(self.q, self.qd, self.base, self.twist, self.dt)
            law = self.chain.law
            for name, array in law.applied.items():
                array[:] = law.output[name]
            self.move(law.output["velocity"], law.output["base_twist"])

    def move(self, qd: Array, twist: Array) -> None:
        """Obeys a command for one cycle."""
        share = 1.0 if self._lag == 0.0 else self.dt / (self.dt + self._lag)
        self.qd = self.qd + share * (qd - self.qd)
        self.twist = self.twist + share * (twist - self.twist)
        self.q = self.q + self.dt * self.qd
        yaw = self.base[2] + self.dt * self.twist[2] / 2
        c, s = np.cos(yaw), np.sin(yaw)
        self.base = self.base + self.dt * np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ self.twist


def task_inertia(q: Array, J: Array, rotors: bool) -> Array:
    """Lambda of eq. 5 (6, 6) of MOCA at q (7,), J (6, 10), by another way than the law's."""
    upper = np.triu(pin.crba(PANDA_MODEL, PANDA_DATA, q))
    M = upper + np.triu(upper, 1).T + rotors * np.diag(PANDA.rotor_inertia)
    return np.linalg.inv(J @ np.linalg.inv(block_diag(np.diag([MASS[0], MASS[0], MASS[1]]), M)) @ J.T)
