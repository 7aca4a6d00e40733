"""Object-based mapping of the human hand's motion onto robotic extra fingers.

Prattichizzo et al., IEEE/ASME AIM 2014, section II. Errata and additions: docs/object-mapping.md.
"""

from __future__ import annotations

from itertools import pairwise
from math import exp, inf, isfinite, nan, sqrt
from operator import add
from typing import Any, ClassVar, Final, Literal, Self, cast

import numpy as np
from pydantic import Field, model_validator

from srl.control.hand.concentric import ConcentricObject
from srl.control.hand.extra_finger import ExtraFinger, FingerKinematics
from srl.control.hand.sphere import MinimumSphere
from srl.control.hand.virtual_object import Deformation, Psi, Similarity, VirtualObject
from srl.control.shared.symmetric import Vector
from srl.runtime.contracts.controller import Controller, ControllerConfig, Parameter
from srl.runtime.contracts.errors import OptionError, ProfileError
from srl.runtime.contracts.rotation import homogeneous
from srl.runtime.contracts.signals import Signal
from srl.runtime.contracts.terms import POINT
from srl.runtime.contracts.transforms import Transform, coordinates, frame
from srl.runtime.models.human_hand import FINGERS

FingerName = Literal["thumb", "index", "middle", "ring", "little"]

_SMOOTHING: Final = 0.03  # s, time constant of the tips' velocity: the data of a glove slower than the loop has steps

_NO_DAMPING: Final = 1e-6  # m/rad: of a division by zero alone
_OURS: Final = (Deformation.SCALING, Deformation.CONCENTRIC)


class ObjectMappingConfig(ControllerConfig):
    """Options of `object-mapping`."""

    renamed: ClassVar[dict[str, str]] = {"leash": "max_following_error"}

    points: tuple[FingerName, ...] = Field(
        FINGERS, min_length=1, description="human fingertips that take part; a similarity needs three or more"
    )
    fingers: tuple[ExtraFinger, ...] = Field(
        default=cast(tuple[ExtraFinger, ...], ("finger",)),
        validate_default=True,
        min_length=1,
        description="the extra fingers: names of models, or {model, name}",
    )
    deformation: Deformation | None = Field(
        None, description="of the virtual object; rigid for one or two points, else isotropic; scaling doesn't turn"
    )
    psi: Psi = Field(Psi.NONE, description="what fills the null space, where the points leave one")
    gain_limit: float = Field(
        4.0,
        gt=0.0,
        description="m at a robotic tip per m at the fingertips; a direction of the object's "
        "motion beyond it is damped; .inf for none",
    )
    damping: float = Field(
        0.01, gt=0.0, description="m/rad; singular values of the finger's Jacobian below it are damped"
    )
    max_following_error: float = Field(
        0.03, gt=0.0, description="m, how far a tip's target may be ahead of what the guard let through"
    )
    as_published: bool = Field(
        False,
        description="the paper's law without what is added here: gain limit, damping, bound of following error, and "
        "at first drift pull",
    )

    @model_validator(mode="after")
    def _alone(self) -> Self:
        extras = {"gain_limit", "damping", "max_following_error"} & self.model_fields_set
        if self.as_published and (extras or self.deformation in _OURS):
            problem = f"as_published has no {', '.join(sorted(extras)) or f'deformation {self.deformation}'}"
            raise OptionError(problem, "Take it out, or as_published")
        return self

    @property
    def bounds(self) -> tuple[float, float, float]:
        """`gain_limit`, `damping`, `max_following_error` as they hold."""
        return (
            (inf, _NO_DAMPING, inf) if self.as_published else (self.gain_limit, self.damping, self.max_following_error)
        )


class ObjectMapping(Controller):
    """Makes extra fingers follow the virtual object that the fingertips hold.

    Input `tips` (5, 3) m. Outputs `q` (n,) rad and `q_velocity` (n,) rad/s of all extra fingers' joints in
    turn; `sphere` (4,) m, centre and radius of the smallest sphere around the reference points and robotic tips;
    `target` (m, 3) m, target positions of the robotic tips; `skeleton` (k, 3) m of the extra fingers. All
    coordinates are in the frame of `tips`. Each finger is worn where the frame with its name is.

    The fingers move only while the hand moves (or to make up for motion that the guard held back). So the drift pull
    and the joint centring are per metre of fingertip motion, not per second.
    """

    Config = ObjectMappingConfig
    c_version = "srl.control.hand.compiled_mapping:CompiledObjectMapping"
    summary = "extra fingers that follow the object held by the human fingertips (Prattichizzo 2014)"

    def __init__(self, name: str, config: ObjectMappingConfig) -> None:
        super().__init__(name, config)
        _check_unique(name, "points", config.points)
        _check_unique(name, "fingers", tuple(finger.name for finger in config.fingers))
        n_h, m = len(config.points), len(config.fingers)
        deformation = config.deformation or (Deformation.ISOTROPIC if n_h > 2 else Deformation.RIGID)
        gain_limit, self._damping, self._max_following_error = config.bounds
        self._rigid, self._turns = deformation is Deformation.RIGID, deformation is not Deformation.SCALING
        self._chosen = np.array([FINGERS.index(point) for point in config.points])
        self._concentric = deformation is Deformation.CONCENTRIC
        if self._concentric and config.psi is not Psi.NONE:
            problem = "an object that only grows and shrinks about its centre leaves nothing to choose"
            raise ProfileError(f"controllers.{name}.psi", problem, "Leave out psi, or choose another deformation")
        self._object = VirtualObject(deformation, config.psi, gain_limit)
        self._extra = config.fingers
        self.transforms = tuple(
            Transform(f.name, frame(f.name), coordinates("tips"), f"the base of '{f.name}' in the frame of the tips")
            for f in config.fingers
        )
        self._fingers: list[FingerKinematics] = []
        ends = np.cumsum([0, *(len(finger.model.rows) for finger in config.fingers)]).tolist()
        self._joints = [slice(a, b) for a, b in pairwise(ends)]
        # As the simulated hand does: with several fingers, a joint's name begins with its finger's.
        alone = len(config.fingers) == 1
        joints = tuple(j if alone else f"{f.name}_{j}" for f in config.fingers for j in f.model.names)
        names = tuple(finger.name for finger in config.fingers)
        # Each skeleton has one point more than the finger has joints.
        bones = [tuple(range(a + i, b + i + 1)) for i, (a, b) in enumerate(pairwise(ends))]
        n, links = ends[-1], tuple(bones)
        points = tuple(f"{finger.name}_{i}" for finger in config.fingers for i in range(len(finger.model.rows) + 1))
        self.inputs = (Signal(name="tips", shape=(5, 3), unit="m", labels=FINGERS, components=(POINT,)),)
        self.outputs = (
            Signal(name="q", shape=(n,), unit="rad", labels=joints),
            Signal(name="q_velocity", shape=(n,), unit="rad/s", labels=joints),
            Signal(name="sphere", shape=(4,), unit="m", frame="=tips", labels=(*POINT, "radius"), visual="sphere"),
            Signal(
                name="target", shape=(m, 3), unit="m", frame="=tips", labels=names, components=(POINT,), visual="points"
            ),
            Signal(
                name="skeleton",
                shape=(n + m, 3),
                unit="m",
                frame="=tips",
                labels=points,
                components=(POINT,),
                visual="points",
                links=links,
            ),
        )
        # A deformation richer than a similarity must not be pulled back to one. Increments of `scaling` don't add up to
        # the finite one: pulled, it would drift on closed paths.
        exact = deformation in (Deformation.NON_ISOTROPIC, Deformation.SHEAR, Deformation.SCALING)
        self.parameters = (
            Parameter(
                name="drift_pull",
                default=0.0 if exact or config.as_published else 5.0,
                lower=0.0,
                upper=100.0,
                unit="1/m",
                text="pull to the finite similarity, per metre of fingertip motion; 0 is the paper's law",
            ),
            Parameter(
                name="centring",
                default=5.0,
                lower=0.0,
                upper=100.0,
                unit="1/m",
                text="chi: pull of redundant joints to mid-range, per metre of fingertip motion",
            ),
        )
        self._before, self._measured = np.zeros((n_h, 3)), True
        self._finite = Similarity(self._before, self._rigid, self._turns)
        self._home = np.zeros((m, 3))
        self._closing = ConcentricObject(self._before, self._home, np.zeros(3))
        self._target = np.zeros((m, 3))
        self._tips: list[Vector] = [(0.0, 0.0, 0.0)] * m
        self._velocity = list(self._tips)
        self._enclosing = MinimumSphere()
        self._clear()

    def bind(self, *arrays: Any) -> None:
        super().bind(*arrays)
        bases = [homogeneous(self.transform[finger.name]) for finger in self._extra]
        self._fingers = [
            FingerKinematics(f.model, base, self._damping) for f, base in zip(self._extra, bases, strict=True)
        ]

    def _clear(self) -> None:
        self._enclosing.reset()
        self._radii = (inf, 0.0)
        self._nearest = inf
        self._error_limited = 0

    def reset(self) -> None:
        """Takes the present posture as the reference, and the applied joint angles as those of the fingers.

        While a fingertip isn't measured, there is no reference: the fingers stand until all are.
        """
        self._clear()
        q = self._where()
        self._before = self.input["tips"].take(self._chosen, axis=0)
        self._measured = bool(np.isfinite(self._before).all())
        self._finite = Similarity(self._before, self._rigid, self._turns)
        self._locate(q)
        self._home, self._target = np.array(self._tips), np.array(self._tips)
        self._velocity = [(0.0, 0.0, 0.0)] * len(self._tips)
        self._enclose()
        self._closing = ConcentricObject(self._before, self._home, self.output["sphere"][:3])
        self.output["q"][:] = q
        self.output["q_velocity"][:] = 0.0
        self.output["target"][:] = self._target

    def update(self, dt: float) -> None:
        if not self._measured:
            self.reset()
            return
        q = self._where()
        p_h = self.input["tips"].take(self._chosen, axis=0)
        self._locate(q)

        last = self._target.copy()
        squares = 0.0
        for way in (p_h - self._before).ravel().tolist():
            squares += way * way
        path = sqrt(squares / len(p_h))  # m, of the fingertips' rms motion
        if not isfinite(path):
            path = 0.0  # a fingertip that isn't measured moves nothing; damping a NaN would never end
        if path > 0.0 and self._concentric:
            self._target, self._before = self._closing.carry(p_h), p_h
        elif path > 0.0:
            self._target = self._object.move(self._before, p_h, last, self.output["sphere"])
            pull = self.param["drift_pull"].item()
            if pull > 0.0:
                finite = self._finite.carry(p_h, self._home)
                self._target += (1.0 - exp(-pull * path)) * (finite - self._target)
            self._before = p_h
        ahead = self._hold_back()
        smoothing = 1.0 - exp(-dt / _SMOOTHING)
        centring = 1.0 - exp(-self.param["centring"].item() * path)
        out: list[float] = []
        rates: list[float] = []
        motion = ((self._target - last) / dt).tolist()
        for i, (finger, joints) in enumerate(zip(self._fingers, self._joints, strict=True)):
            (x, y, z), (dx, dy, dz) = self._velocity[i], motion[i]
            self._velocity[i] = v = (
                x + smoothing * (dx - x),
                y + smoothing * (dy - y),
                z + smoothing * (dz - z),
            )
            dq, rate = finger.follow(q[joints], ahead[i], v, centring)
            out += map(add, q[joints], dq)
            rates += rate
        self._enclose()
        self.output["q"][:] = out
        self.output["q_velocity"][:] = rates
        self.output["target"][:] = self._target

    def _where(self) -> list[float]:
        """The guarded joint angles (`.applied`); the controller's last output if no device is wired to it."""
        q: list[float] = self.applied.get("q", self.output["q"]).tolist()
        return q

    def _locate(self, q: list[float]) -> None:
        """Computes tips and skeleton at the applied joint angles."""
        points: list[Vector] = []
        for i, (finger, joints) in enumerate(zip(self._fingers, self._joints, strict=True)):
            self._tips[i] = finger.chain.forward(q[joints])
            points += finger.chain.points
        self.output["skeleton"][:] = points

    def _hold_back(self) -> list[Vector]:
        """Draws in targets that are too far ahead. Returns the vectors from the tips to their targets, m."""
        ahead: list[Vector] = []
        error_limited = False
        for i, (target, tip) in enumerate(zip(self._target.tolist(), self._tips, strict=True)):
            x, y, z = target[0] - tip[0], target[1] - tip[1], target[2] - tip[2]
            distance = sqrt(x * x + y * y + z * z)
            if distance > self._max_following_error:
                error_limited, k = True, self._max_following_error / distance
                x, y, z = k * x, k * y, k * z
                self._target[i] = tip[0] + x, tip[1] + y, tip[2] + z
            ahead.append((x, y, z))
        self._error_limited += error_limited
        return ahead

    def _enclose(self) -> None:
        """Computes the sphere of the present points, for the viewer, the next step's psi and the figures.

        At a reset some may not be measured: those aren't in it.
        """
        points = self._before.tolist()
        if not self._measured:
            points = [point for point in points if isfinite(sum(point))]
        sphere = self._enclosing.around([*points, *self._tips])
        self.output["sphere"][:] = sphere
        self._radii = min(self._radii[0], sphere[3]), max(self._radii[1], sphere[3])
        a, b, c = self.input["tips"][0].tolist()
        for x, y, z in self._tips:
            dx, dy, dz = x - a, y - b, z - c
            self._nearest = min(self._nearest, sqrt(dx * dx + dy * dy + dz * dz))

    def metrics(self) -> dict[str, object]:
        """Returns the figures of the run, since the last reset.

        noise_gain, noise_gain_undamped: rms motion of the robotic tip divided by the fingertips' rms noise, at the
        present posture; sphere_radius_m: least and greatest; nearest_to_thumb_m: least distance of any robotic tip;
        error_limited: number of cycles in which a target was ahead of the guarded position by more than
        max_following_error. Without a reference there is no noise gain (NaN).
        """
        if not self._measured:
            damped = undamped = nan
        elif self._concentric:
            damped = undamped = self._closing.noise_gain(self._before)
        else:
            damped, undamped = self._object.noise_gain(self._before, np.array(self._tips))
        return {
            "noise_gain": damped,
            "noise_gain_undamped": undamped,
            "sphere_radius_m": list(self._radii),
            "nearest_to_thumb_m": self._nearest,
            "error_limited": self._error_limited,
        }


def _check_unique(name: str, option: str, values: tuple[str, ...]) -> None:
    doubled = {value for value in values if values.count(value) > 1}
    if doubled:
        raise ProfileError(
            f"controllers.{name}.{option}",
            f"'{sorted(doubled)[0]}' is there more than once",
            "Name each once",
        )
