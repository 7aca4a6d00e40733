"""The payload of a guided robot: identified from pick-up on, and watched, so that contact isn't taken for it."""

from __future__ import annotations

from math import inf, isfinite, nan, sqrt
from typing import Any, Final

from pydantic import Field

from srl.control.cobot.contact_wrench import ContactWrench, FlangeWrenchOptions, square
from srl.control.cobot.guide_buttons import GRIPPER, MODES
from srl.control.cobot.load_estimate import Motion
from srl.control.cobot.load_watch import LoadWatch, Phase, WatchConfig
from srl.control.cobot.whole_body import RobotName
from srl.runtime.contracts import rotation
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.errors import WiringError
from srl.runtime.contracts.gravity import GRAVITY
from srl.runtime.contracts.signals import Signal
from srl.runtime.contracts.terms import PLANAR, POSE, TWIST, WRENCH
from srl.runtime.contracts.transforms import Transform, device, measured
from srl.runtime.models.robots.pinocchio_model import FLANGE

LOAD: Final = ("mass", "x", "y", "z")
_UNKNOWN: Final = 1e3  # what stands for an infinite deviation: signals are finite


class PayloadConfig(RobotName, FlangeWrenchOptions, ControllerConfig):
    """Options of `payload`."""

    heaviest: float | None = Field(None, gt=0, le=100, description="kg, of any load; null: the arm's payload")
    filter: float = Field(
        0.01, gt=0, le=0.1, description="s, time constant of wrench and acceleration, the same for both"
    )
    watch: WatchConfig = WatchConfig()


class Payload(Controller):
    """Identifies what the gripper holds and tells it from contact: `LoadWatch` and `LoadEstimate` say how.

    Inputs: `q` (n,) rad, only for the place of the flange; `base_pose` (3,) m and rad; `pose` (7,) and `twist` (6,) of
    the control point, measured, world; `flange_wrench` (6,) N and N m on the tool; with the option `hand` also `hand`
    (6,) from the admittance; `modes` (4,): -, -, gripper closed, -.

    Outputs: `outside` (6,) N and N m, what the surroundings do to tool and load, at the control point, world axes,
    without the load's weight and inertia; `load` (4,): mass (kg) and centre of mass in the flange's frame (m), zeros
    without one; `deviation` (4,) of them, 1000 where unknown; `phase` (1,): 0 open, 1 picking, 2 carrying, 3 releasing.

    Attributes:
        watch: what it has found.

    Contact of the closed gripper beyond `watch.stop` stops the limb (`faults.contact`).
    """

    Config = PayloadConfig
    summary = "identifies what a gripper holds, and tells it from contact, which can stop the limb"

    def __init__(self, name: str, config: PayloadConfig) -> None:
        super().__init__(name, config)
        robot = config.robot
        if config.heaviest is None and not isfinite(robot.payload):
            problem = f"nobody says what {robot.name} may carry"
            raise WiringError(f"controllers.{name}.heaviest", problem, "Give it, in kg")
        self.inputs = (
            Signal(name="q", shape=(robot.n,), unit="rad", labels=robot.labels),
            Signal(name="base_pose", shape=(3,), unit="m, rad", labels=PLANAR),
            Signal(name="pose", shape=(7,), unit="m", frame="=base_pose", labels=POSE),
            Signal(name="twist", shape=(6,), unit="m/s, rad/s", frame="=pose", of="=pose", labels=TWIST),
            Signal(name="flange_wrench", shape=(6,), unit="N, N m", labels=WRENCH),
            Signal(name="modes", shape=(4,), unit="1", labels=MODES),
        )
        if config.hand:
            hand = Signal(name="hand", shape=(6,), unit="N, N m", frame="=pose", of="=pose", labels=WRENCH)
            self.inputs += (hand,)
        self.outputs = (
            Signal(name="outside", shape=(6,), unit="N, N m", frame="=pose", of="=pose", labels=WRENCH),
            Signal(name="load", shape=(4,), unit="kg, m", labels=LOAD),
            Signal(name="deviation", shape=(4,), unit="kg, m", labels=LOAD),
            Signal(name="phase", shape=(1,), unit="1"),
        )
        self._config = config
        self._sensor = ContactWrench(config)
        need = "the flange, for the load's centre of mass in its frame"
        self.transforms = (
            *self._sensor.transforms(),
            Transform("flange", device("q", FLANGE), measured("pose"), need),
        )
        self.watch = LoadWatch(config.watch, config.heaviest or robot.payload)
        self._twist, self._wrench = [0.0] * 6, [0.0] * 6  # filtered, world axes
        self._raw = [0.0] * 6
        self._turn: rotation.Quaternion = (1.0, 0.0, 0.0, 0.0)  # the tool's, filtered alike
        self._expected = [0.0] * 6
        self._heaviest = 0.0

    def bind(self, *arrays: Any) -> None:
        super().bind(*arrays)
        self._sensor.place(self.transform)
        x, y, z, *turn = self.transform["flange"].tolist()
        self._flange = (x, y, z), rotation.conjugate((turn[0], turn[1], turn[2], turn[3]))

    def reset(self) -> None:
        self._sensor.reset()
        self.contact = False
        self._expected = [0.0] * 6
        if self._sound():
            self._filter(0.0)
            self.watch.reset(*self._seen([0.0] * 6))
        self._write()

    def update(self, dt: float) -> None:
        if not self._sound():
            self.output["outside"][:] = nan  # so that a guard refuses what is made of it; the state is kept
            return
        if dt > 0.0:
            change = self._filter(dt)
            self.watch.update(*self._seen([v / dt for v in change]), dt)
            self.contact = self.watch.stopping
        self._write()

    def metrics(self) -> dict[str, object]:
        """Returns the heaviest load that was carried, and how often there was contact, a drop and a putting down."""
        w = self.watch
        return {"heaviest_kg": self._heaviest, "contacts": w.contacts, "drops": w.drops, "put_down": w.put_down}

    def _sound(self) -> bool:
        return all(isfinite(sum(array.tolist())) for name, array in self.input.items() if name != "q")

    def _filter(self, dt: float) -> list[float]:
        """Filters wrench, twist and orientation alike; returns the change of the twist (6,), m/s and rad/s."""
        _, _, _, w, x, y, z = self.input["pose"].tolist()
        orientation: rotation.Quaternion = (w, x, y, z)
        hand = self.input["hand"].tolist() if self._config.hand else [0.0] * 6
        yaw = self.input["base_pose"].item(2)
        f = self._sensor.take(self.input["flange_wrench"].tolist(), hand, orientation, yaw, dt, self._expected)
        self._raw = f
        k = dt / (self._config.filter + dt) if dt > 0.0 else 1.0
        before = self._twist
        self._twist = _towards(before, self.input["twist"].tolist(), k)
        self._wrench = _towards(self._wrench, f, k)
        near = rotation.nearer(orientation, self._turn)
        w, x, y, z = _towards(self._turn, near, k)
        self._turn = rotation.normalised((w, x, y, z))
        return [a - b for a, b in zip(self._twist, before, strict=True)]

    def _seen(self, acceleration: list[float]) -> tuple[list[float], Motion, list[float], bool]:
        """What the watch takes: wrench (6,), motion, place (3,) and whether the gripper is closed; the tool's axes."""
        back = rotation.conjugate(self._turn)
        a, z, v, f = acceleration[:3], acceleration[3:], self._twist, self._wrench
        at = Motion(
            rotation.turned(back, (-a[0], -a[1], -GRAVITY - a[2])),
            rotation.turned(back, (v[3], v[4], v[5])),
            rotation.turned(back, (z[0], z[1], z[2])),
            sqrt(square(v[:3])),
        )
        force, torque = rotation.turned(back, (f[0], f[1], f[2])), rotation.turned(back, (f[3], f[4], f[5]))
        place = self.input["pose"].tolist()[:3]
        return [*force, *torque], at, place, bool(self.input["modes"].item(GRIPPER) > 0.5)

    def _write(self) -> None:
        out, watch = self.output, self.watch
        out["phase"][0] = watch.phase
        outside = self._world(watch.outside)
        if watch.phase is Phase.OPEN:  # without a load there is no acceleration to wait for
            outside = [a + b - c for a, b, c in zip(outside, self._raw, self._wrench, strict=True)]
        out["outside"][:] = outside
        mass = watch.share * watch.estimate.mass
        if mass > 0.0:
            at, back = self._flange
            x, y, z = watch.estimate.com
            out["load"][:] = mass, *rotation.turned(back, (x - at[0], y - at[1], z - at[2]))
        else:
            out["load"][:] = 0.0
        out["deviation"][:] = [v if v < inf else _UNKNOWN for v in watch.estimate.deviations()]
        self._expected = self._world(watch.expected) if mass > 0.0 else [0.0] * 6
        if watch.phase is Phase.CARRYING:
            self._heaviest = max(self._heaviest, mass)

    def _world(self, v: list[float]) -> list[float]:
        force = rotation.turned(self._turn, (v[0], v[1], v[2]))
        return [*force, *rotation.turned(self._turn, (v[3], v[4], v[5]))]


def _towards(a: Any, b: Any, k: float) -> list[float]:
    return [u + k * (v - u) for u, v in zip(a, b, strict=True)]
