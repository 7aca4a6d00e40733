"""How far the tip of a worn arm is from where a rigid base would have it, with straps that give way.

A simulated person walks and carries an arm of seven Dynamixel axes at the waist, which moves between two postures. The
reference is the same trial with the strap replaced by a weld: so the servos' own lag and sag are in both.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from math import radians
from typing import Any, Final, Literal, cast

import numpy as np

from srl.control.strap.axes import Axis
from srl.control.strap.correction import Correction
from srl.control.strap.law import StrapBase, StrapBaseConfig
from srl.drivers.bno085 import Bno085Config
from srl.drivers.dynamixel.config import DynamixelConfig
from srl.drivers.noitom import NoitomConfig
from srl.drivers.noitom.skeleton import Skeleton
from srl.runtime.contracts.frames import IDENTITY, as_pose
from srl.runtime.contracts.rotation import Quaternion, composed, conjugate, exp, inverted, product
from srl.runtime.contracts.signals import Array
from srl.runtime.contracts.world import Fake
from srl.runtime.testing.bound import bound
from srl.sim.devices.bno085.fake import FakeBno085, FakeBno085Config
from srl.sim.devices.dynamixel.fake import FakeDynamixel, FakeDynamixelConfig
from srl.sim.devices.noitom.fake import FakeNoitom, FakeNoitomConfig
from srl.sim.parts.body.strap import Firmness, StrapPart
from srl.sim.world.cell import Cell, CellConfig
from srl.studies.tasks.task import Value

# By the law with two inertial sensors, or with a suit in place of the belt's; by what the sensors say of all three
# axes, one yaw having drifted; by the true rotation.
Compensation = Literal["none", "roll-pitch", "by-suit", "with-yaw", "perfect"]

RATE: Final = 100  # Hz
SKELETON: Final = Skeleton("axis-neuron")
YAW: Final = radians(4.0)  # after eight minutes of the datasheet's 0.5 degrees a minute
SETTLE: Final = 3.0  # s, that aren't judged: the compensation fades in
MOVE: Final = 2.0  # s, from posture to posture
KEPT: Final = 2  # of the tip's places every second one is kept in a row
# z up, x forward, y to the left, at the back of the right hip. The suit's axes are x left, y up, z forward.
WORN: Final[dict[str, Any]] = {
    "parent": "wearer/Spine", "position": [-0.15, 0.02, 0.1], "quaternion": [0.5, -0.5, -0.5, -0.5]
}  # fmt: skip
ARM_ON_PLATE: Final = (0.03, 0.0, 0.02)  # m
# By axis: servo, direction, m to the next axis, whether it slides. Ours; three meet in the shoulder, as the paper's.
AXES: Final[dict[str, tuple[str, tuple[float, float, float], float, bool]]] = {
    "j1": ("MX-106", (0.0, 1.0, 0.0), 0.0, False),
    "j2": ("MX-106", (0.0, 0.0, 1.0), 0.0, False),
    "j3": ("MX-64", (1.0, 0.0, 0.0), 0.22, False),
    "j4": ("MX-106", (0.0, 1.0, 0.0), 0.10, False),
    "j5": ("MX-64", (1.0, 0.0, 0.0), 0.10, True),
    "j6": ("MX-28", (0.0, 0.0, 1.0), 0.06, False),
    "j7": ("MX-28", (0.0, 1.0, 0.0), 0.10, False),
}
POSTURES: Final = np.array([[0.2, -0.3, 0.0, -0.4, 0.0, 0.1, 0.2], [-0.3, 0.2, 0.3, -0.7, 0.02, -0.2, 0.3]])  # rad, m
SLIDE: Final = 0.04  # m, travel of a prismatic axis to either side
PITCH: Final = 0.01  # m/rad, of its rack


def arm() -> dict[str, Axis]:
    """The arm for the law."""
    return {
        name: Axis.model_validate(
            {"axis": axis, "link": (length, 0.0, 0.0), "slides": slides}
            | ({"lower": -SLIDE, "upper": SLIDE} if slides else {})
        )
        for name, (_, axis, length, slides) in AXES.items()
    }


@dataclass(frozen=True)
class Result:
    """What a trial gave.

    Attributes:
        tip: (k, 3), m, of the tip in the axes of a rigid base, RATE times a second after `SETTLE`.
        shift: m, rms of the strap's translation.
        tilt: rad, rms of its rotation about the base's x and y. yaw: about its z, which is up but for how the person
            leans.
        law: the law's own figures.
    """

    tip: Array
    shift: float
    tilt: float
    yaw: float
    law: Mapping[str, object]

    def error(self, reference: Result) -> float:
        """m, rms of the distance from where the tip is in `reference`."""
        return float(np.sqrt(np.mean(np.sum((self.tip - reference.tip) ** 2, axis=1))))


class Trial:
    """One person, one strap, one way to compensate it."""

    def __init__(
        self, firmness: Firmness, compensation: Compensation, *, seed: int = 1,
        base: Mapping[str, Any] | None = None, belt: Mapping[str, Any] | None = None,
        strap: Mapping[str, Any] | None = None, scale: float = 1.0, begin: float = 0.0, yaw: float = YAW,
        mount: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:  # fmt: skip
        """Args:
        base, belt: options of the fake inertial sensors on the arm's base and on the person.
        strap: options of the strap.
        scale: of the person.
        begin: s, by which the arm's motion is ahead: how it meets the steps.
        yaw: rad, by which the base's sensor has drifted, where yaw is used.
        mount: rad, rotation vector by which the base's sensor is mounted otherwise than the law is told.
        """
        self.compensation, self._begin = compensation, begin
        self.world = Cell(CellConfig.model_validate({"parts": _parts(firmness, strap or {}, scale, begin)}), seed)
        self._strap = self.world.part(StrapPart, "strap")
        self._arm = _device(FakeDynamixel("arm", _bus(), self.world, FakeDynamixelConfig()))
        off = {"base": {"yaw": yaw if compensation == "with-yaw" else 0.0} | dict(base or {}), "belt": dict(belt or {})}
        self._imu = {
            name: _device(
                FakeBno085(
                    name, Bno085Config(port="/dev/null", frame=name), self.world,
                    FakeBno085Config.model_validate({"part": name} | off[name]),
                )
            )
            for name in off
        }  # fmt: skip
        self._correction = Correction(tuple(arm().values()), 0.02)
        reference = "suit" if compensation == "by-suit" else "imu"
        self._law = _law(StrapBaseConfig.model_validate({"axes": arm(), "reference": reference}), mount)
        self._suit: Fake | None = None
        if reference == "suit":
            suit = NoitomConfig(port="udp://:7012")
            self._suit = _device(FakeNoitom("suit", suit, self.world, FakeNoitomConfig()))
        self._started = False

    def run(self, seconds: float) -> Result:
        """Runs the trial; it can be run once."""
        tips, shifts, tilts = [], [], []
        for k in range(round(seconds * RATE)):
            now = round((k + 1) * 1e9 / RATE)
            self.world.advance(now)
            for device in (self._arm, *self._imu.values(), *([self._suit] if self._suit else [])):
                device.read(now)
            self._arm.command_arrays["position_command"][:] = self._command(k / RATE)
            self._arm.write(now)
            if k >= SETTLE * RATE:
                tips.append(self._tip())
                shifts.append(self.world.truth_arrays["strap_shift"].copy())
                tilts.append(self.world.truth_arrays["strap_tilt"].copy())
        shift, tilt = np.array(shifts), np.array(tilts)
        return Result(np.array(tips), _rms(shift), _rms(tilt[:, :2]), _rms(tilt[:, 2:]), self._law.metrics())

    # -- one cycle

    def _command(self, t: float) -> Array:
        wanted = _wanted(t + self._begin)
        if self.compensation == "none" or t < 0.2:
            return wanted
        if self.compensation in ("roll-pitch", "by-suit"):
            return self._by_law(wanted)
        rotation = self._true_turn() if self.compensation == "perfect" else self._measured_turn()
        return wanted + self._correction.solve(wanted, rotation)

    def _by_law(self, wanted: Array) -> Array:
        law, given = self._law, self._law.input
        given["q"][:], given["wanted"][:] = self._arm.state_arrays["position"], wanted
        given["orientation"][:] = self._imu["base"].state_arrays["orientation"]
        if self._suit is None:
            given["body"][:] = self._imu["belt"].state_arrays["orientation"]
        else:
            names = SKELETON.names
            given["rotation"][:] = self._suit.state_arrays["rotation"][[names.index("Hips"), names.index("Spine")]]
        if not self._started:
            law.applied["command"][:] = wanted
            law.reset()
            self._started = True
        law.update(1.0 / RATE)
        return law.output["command"]

    def _true_turn(self) -> Quaternion:
        _, _, _, w, x, y, z = composed(inverted(as_pose(self._strap.rigid())), self._plate())
        return (w, x, y, z)

    def _measured_turn(self) -> Quaternion:
        base, belt = (tuple(self._imu[name].state_arrays["orientation"].tolist()) for name in ("base", "belt"))
        return product(conjugate(belt), base)

    def _plate(self) -> Any:
        body = self.world.data.body("strap/plate")
        return as_pose(np.concatenate([body.xpos, body.xquat]))

    def _tip(self) -> Array:
        x, y, z = self.world.truth_arrays["arm_tip"][0].tolist()
        return np.array(composed(inverted(as_pose(self._strap.rigid())), (x, y, z, 1.0, 0.0, 0.0, 0.0))[:3])


def trial(text: str, parameters: dict[str, Any], seed: int) -> Mapping[str, Value]:
    """One trial as a task.

    Args:
        text: unused.
        parameters: `firmness`, `compensation`, `seconds`; `options`, of `Trial`.
        seed: of the world.
    Returns:
        tip: JSON, mm, (k, 3) of `Result`, every second one; shift, tilt, yaw: as there; left: mm that the law's joints
        couldn't give.
    """
    made = Trial(parameters["firmness"], parameters["compensation"], seed=seed, **parameters["options"])
    found = made.run(parameters["seconds"])
    tip = np.round(1e3 * found.tip[::KEPT], 2).tolist()
    left = float(cast(float, found.law["error_left_mm"]))
    return {"tip": json.dumps(tip), "shift": found.shift, "tilt": found.tilt, "yaw": found.yaw, "left": left}


def _wanted(t: float) -> Array:
    """To and fro between the postures, with minimum jerk."""
    k, s = divmod(t / MOVE, 1.0)
    s = s**3 * (10.0 + s * (6.0 * s - 15.0))
    here, there = (POSTURES[int(k) % 2], POSTURES[(int(k) + 1) % 2])
    wanted: Array = here + s * (there - here)
    return wanted


def _parts(firmness: Firmness, strap: Mapping[str, Any], scale: float, begin: float) -> dict[str, Any]:
    start = _wanted(begin).tolist()
    axes = {
        name: {"model": model, "axis": axis, "link": (length, 0.0, 0.0), "start": start[i], "mass": 0.06}
        | ({"m_per_rad": PITCH, "lower": -SLIDE, "upper": SLIDE} if slides else {})
        for i, (name, (model, axis, length, slides)) in enumerate(AXES.items())
    }
    return {
        "wearer": {"part": "body", "script": "walk", "scale": scale},
        "strap": {"part": "strap", "firmness": firmness, "at": WORN} | dict(strap),
        "arm": {
            "part": "dynamixel-chain", "axes": axes, "at": {"parent": "strap/plate", "position": list(ARM_ON_PLATE)}
        },
        "base": {"part": "imu", "at": {"parent": "strap/plate", "position": [-0.03, 0.0, 0.01]}},
        "belt": {"part": "imu", "at": WORN | {"position": [-0.1, 0.02, -0.1]}},
    }  # fmt: skip


def _bus() -> DynamixelConfig:
    motors = {
        name: {"id": i + 1, "model": model} | ({"m_per_rad": PITCH, "lower": -SLIDE, "upper": SLIDE} if slides else {})
        for i, (name, (model, _, _, slides)) in enumerate(AXES.items())
    }
    return DynamixelConfig.model_validate({"port": "/dev/null", "motors": motors})


def _device(fake: Fake) -> Fake:
    bound(fake).open()
    return fake


def _law(config: StrapBaseConfig, mount: tuple[float, float, float]) -> StrapBase:
    law = StrapBase("strap", config)
    w, x, y, z = WORN["quaternion"]
    # Both sensors are mounted along the base's axes; a suit's spine has its own.
    body = (0.0, 0.0, 0.0, w, -x, -y, -z) if config.reference == "suit" else IDENTITY
    return bound(law, {"mount": (0.0, 0.0, 0.0, *exp(*(-v for v in mount))), "body": body})


def _rms(rows: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(rows**2, axis=1))))
