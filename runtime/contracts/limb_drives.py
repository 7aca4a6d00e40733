"""How a driver moves a limb of a URDF (`srl new --urdf`): what only a person knows, and how its entries are written.

A driver offers it as entry point `srl.limbs`, under its own name. Which motors there are, and what they can, says
the simulated part of the driver's name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil, floor, inf, isfinite
from typing import Any, ClassVar, Final, Literal, Protocol

from srl.runtime.contracts import registry
from srl.runtime.contracts.errors import nearest

LEAD: Final = 0.01  # m/rad


class LimbMotor(Protocol):
    """What is needed of a servo or an actuator, at its output shaft."""

    @property
    def name(self) -> str: ...

    @property
    def stall_torque(self) -> float:
        """N m."""

    @property
    def stall_current(self) -> float:
        """A."""

    @property
    def torque_constant(self) -> float:
        """N m/A."""


@dataclass(frozen=True)
class LimbJoint:
    """A joint as its motor feels it.

    Attributes:
        name: the URDF's.
        slides: it slides; rad below are then m, N m are N, kg m^2 are kg.
        lower, upper: rad, of the URDF.
        home: rad, where it begins.
        speed: rad/s, that the guard allows.
        torque: N m, the most that the limb's weight asks.
        inertia: kg m^2, the most that it moves, without its motor.
    """

    name: str
    slides: bool
    lower: float
    upper: float
    home: float
    speed: float
    torque: float
    inertia: float


@dataclass(frozen=True)
class Question:
    """An option of the device that can't be guessed.

    Attributes:
        option: its name.
        what: what it says, for people.
        answers: those that there are; () for any.
        example: one of them.
        to_do: of a question that only "yes" lets be made: what to do first.
        kind: how it is written: a word, a number above 0, yes, or the path of a file.
    """

    option: str
    what: str
    answers: tuple[str, ...] = ()
    example: str = ""
    to_do: str = ""
    kind: Literal["word", "number", "yes", "file"] = "word"

    def value(self, answer: str) -> Any:
        """What an answer means. Raises ValueError: it is none; the text is for people."""
        answer = answer.strip().strip("'\"")
        if self.kind == "yes":
            if answer.lower() in ("yes", "true", "y"):
                return True
            raise ValueError(self.to_do if answer.lower() in ("no", "false", "n") else "Answer yes or no")
        if self.kind == "number":
            try:
                number = float(answer)
            except ValueError:
                number = 0.0
            if 0.0 < number < inf:
                return number
            raise ValueError(f"'{answer}' is no number above 0. For example {self.example}")
        if not answer or (self.answers and answer not in self.answers):
            raise ValueError(nearest(answer, self.answers) if self.answers else f"For example {self.example}")
        return answer


class LimbDrives:
    """A driver's way to move a limb; this one is of a bus of servos with an angle at their shafts.

    Attributes:
        driver, words: its name, and what it drives, for people.
        part: the simulated chain of its motors.
        port: where it begins.
        entries: the device's option that has an entry for each joint.
        prefix: of the names of its motors.
        slides: its joints may slide.
        parked: nothing holds its joints before a run, so the limb begins where it hangs.
        guessed: what else than ids, directions and zeros is guessed.
    """

    driver: ClassVar[str]
    words: ClassVar[str]
    part: ClassVar[str]
    port: ClassVar[str]
    slides: ClassVar[bool] = True
    parked: ClassVar[bool] = False
    entries: ClassVar[str] = "motors"
    prefix: ClassVar[str] = ""
    guessed: ClassVar[str] = ""

    def asks(self, answers: Mapping[str, Any]) -> Question | None:
        """What is to be asked next, after these answers."""
        return None

    def device(self, joints: list[LimbJoint], answers: Mapping[str, Any]) -> dict[str, Any]:
        """The device's options, without its joints."""
        far = any(joint.slides or max(abs(joint.lower), abs(joint.upper)) > 3.09 for joint in joints)
        return {"mode": "extended"} if far else {}

    def motors(self, answers: Mapping[str, Any]) -> list[LimbMotor]:
        """Those that it knows and that are simulated, the weakest first."""
        known = registry.load("parts", self.part, f"--driver {self.driver}").catalogue.values()
        fit = [motor for motor in known if motor.name.startswith(self.prefix) and self.takes(motor.name, answers)]
        return sorted(fit, key=lambda motor: float(motor.stall_torque))

    def takes(self, model: str, answers: Mapping[str, Any]) -> bool:
        """Whether the driver knows a model."""
        return True

    def lead(self, joint: LimbJoint) -> float:
        """m/rad, of a joint that slides; else 1."""
        return LEAD if joint.slides else 1.0

    def travel(self, joint: LimbJoint) -> tuple[float, float]:
        """rad, within which it moves: the URDF's, or less."""
        return joint.lower, joint.upper

    def entry(self, joint: LimbJoint, motor: LimbMotor, number: int, answers: Mapping[str, Any]) -> dict[str, Any]:
        """A joint's entry."""
        return {"id": number, "model": motor.name, **self.geared(joint), **self.bounds(joint)}

    def geared(self, joint: LimbJoint) -> dict[str, float]:
        """What an entry says of a joint that slides."""
        return {"m_per_rad": self.lead(joint)} if joint.slides else {}

    def bounds(self, joint: LimbJoint) -> dict[str, float]:
        """What an entry says of the travel."""
        lower, upper = self.travel(joint)
        # Towards zero: the file's limits may not be passed by what rounding adds.
        made = {"lower": _inwards(lower, up=True), "upper": _inwards(upper, up=False)}
        return {key: value for key, value in made.items() if isfinite(value)}

    def strained(self, joint: LimbJoint, motor: LimbMotor) -> str:
        """What a person should know of a joint, besides a motor that is too weak; "" for nothing."""
        return ""

    def chain(self, motors: list[LimbMotor]) -> dict[str, Any]:
        """Further options of the simulated chain."""
        return {}


def _inwards(value: float, up: bool) -> float:
    """With five digits behind the point, rounded into the travel."""
    if not isfinite(value):
        return inf
    return (ceil if up else floor)(round(value * 1e5, 3)) / 1e5
