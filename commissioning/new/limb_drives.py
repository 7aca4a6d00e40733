"""The drivers that can move a limb from its URDF: what of them only a person knows, and how their entries are written.

Which motors there are, and what they can, says the simulated part of the driver's name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil, floor, inf, isfinite, log10, sqrt
from typing import Any, ClassVar, Final, Literal, Protocol

from pydantic import ValidationError

from srl.runtime.contracts import registry
from srl.runtime.contracts.errors import nearest

DEVICE: Final = "arm"
LEAD: Final = 0.01  # m/rad
_HALF: Final = 3.0  # rad: an encoder at the shaft tells its angle in any travel of twice this
_SAG: Final = 0.05  # rad, by which the weight may pull a spring
_STIFFEST, _MOST_DAMPING = 400.0, 5.0  # N m/rad; N m s/rad, the most that MIT mode can say
_SOFTEST: Final = 5.0  # N m/rad
_DAMPED, _RINGING = 0.7, 0.3  # damping ratio that is aimed at, and the least
_MARGIN: Final = 2.0  # of a drive's own limit of speed over the guard's
_RAMP: Final = 20.0  # 1/s, of a drive's own acceleration over its speed


class Motor(Protocol):
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
class Joint:
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
class Asked:
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


class Drives:
    """A driver; this one is of a bus of servos with an angle at their shafts.

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

    slides: ClassVar[bool] = True
    parked: ClassVar[bool] = False
    entries: ClassVar[str] = "motors"
    prefix: ClassVar[str] = ""
    guessed: ClassVar[str] = ""

    def __init__(self, driver: str, words: str, part: str, port: str) -> None:
        self.driver, self.words, self.part, self.port = driver, words, part, port

    def asks(self, answers: Mapping[str, Any]) -> Asked | None:
        """What is to be asked next, after these answers."""
        return None

    def device(self, joints: list[Joint], answers: Mapping[str, Any]) -> dict[str, Any]:
        """The device's options, without its joints."""
        far = any(joint.slides or max(abs(joint.lower), abs(joint.upper)) > 3.09 for joint in joints)
        return {"mode": "extended"} if far else {}

    def motors(self, answers: Mapping[str, Any]) -> list[Motor]:
        """Those that it knows and that are simulated, the weakest first."""
        known = registry.load("parts", self.part, f"--driver {self.driver}").catalogue.values()
        fit = [motor for motor in known if motor.name.startswith(self.prefix) and self.takes(motor.name, answers)]
        return sorted(fit, key=lambda motor: float(motor.stall_torque))

    def takes(self, model: str, answers: Mapping[str, Any]) -> bool:
        """Whether the driver knows a model."""
        return True

    def lead(self, joint: Joint) -> float:
        """m/rad, of a joint that slides; else 1."""
        return LEAD if joint.slides else 1.0

    def travel(self, joint: Joint) -> tuple[float, float]:
        """rad, within which it moves: the URDF's, or less."""
        return joint.lower, joint.upper

    def entry(self, joint: Joint, motor: Motor, number: int, answers: Mapping[str, Any]) -> dict[str, Any]:
        """A joint's entry."""
        return {"id": number, "model": motor.name, **self.geared(joint), **self.bounds(joint)}

    def geared(self, joint: Joint) -> dict[str, float]:
        """What an entry says of a joint that slides."""
        return {"m_per_rad": self.lead(joint)} if joint.slides else {}

    def bounds(self, joint: Joint) -> dict[str, float]:
        """What an entry says of the travel."""
        lower, upper = self.travel(joint)
        # Towards zero: the file's limits may not be passed by what rounding adds.
        made = {"lower": _inwards(lower, up=True), "upper": _inwards(upper, up=False)}
        return {key: value for key, value in made.items() if isfinite(value)}

    def strained(self, joint: Joint, motor: Motor) -> str:
        """What a person should know of a joint, besides a motor that is too weak; "" for nothing."""
        return ""

    def chain(self, motors: list[Motor]) -> dict[str, Any]:
        """Further options of the simulated chain."""
        return {}


class _OnCan(Drives):
    """A driver of actuators on CAN, which turn easily and need each joint's travel."""

    parked = True

    def __init__(self, driver: str, words: str) -> None:
        super().__init__(driver, words, "actuator-chain", "can://socketcan/can0")

    def device(self, joints: list[Joint], answers: Mapping[str, Any]) -> dict[str, Any]:
        return dict(answers)

    def travel(self, joint: Joint) -> tuple[float, float]:
        half = _HALF * self.lead(joint)
        ends = [end for end in (joint.lower, joint.upper) if isfinite(end)]
        middle = sum(ends) / 2 if len(ends) == 2 else joint.home
        middle = min(max(middle, joint.home - half / 2), joint.home + half / 2)
        return max(joint.lower, middle - half), min(joint.upper, middle + half)

    def chain(self, motors: list[Motor]) -> dict[str, Any]:
        return {"voltage": min(_number(motor, "nominal_voltage") for motor in motors)}


class MitCan(_OnCan):
    """MIT mode: stiffness and damping come from what the joint carries and moves."""

    guessed = "'kp' and 'kd'"

    def asks(self, answers: Mapping[str, Any]) -> Asked | None:
        if "maker" not in answers:
            return Asked("maker", "who made the actuators", ("damiao", "cubemars"), "damiao")
        if answers["maker"] == "damiao":
            return None
        if "firmware" not in answers:  # never guessed: an older command is a gain to a V3
            return Asked("firmware", "which generation their firmware is of", ("v1", "v2", "v3"), "v2")
        if "enable_at_open" not in answers:
            what = "whether they may be switched on at open, with damping alone: most don't say before where they are"
            to_do = "Nothing can be opened without: say yes, or choose another driver"
            return Asked("enable_at_open", what, (), "true", to_do, "yes")
        return None

    def takes(self, model: str, answers: Mapping[str, Any]) -> bool:
        entry = {"id": 1, "model": model, "lower": -1.0, "upper": 1.0, "kp": 1.0, "kd": 1.0}
        config = registry.load("drivers", self.driver, f"--driver {self.driver}").Config
        try:
            config.model_validate({"port": self.port, **answers, "motors": {"joint": entry}})
        except ValidationError:
            return False
        return True

    def lead(self, joint: Joint) -> float:
        if not joint.slides:
            return 1.0
        reach = max((abs(end) for end in (joint.lower, joint.upper) if isfinite(end)), default=0.0)
        return max(LEAD, _up(reach / _HALF))

    def entry(self, joint: Joint, motor: Motor, number: int, answers: Mapping[str, Any]) -> dict[str, Any]:
        kp, kd = self.gains(joint, motor)
        gains = {"kp": float(f"{kp:.2g}"), "kd": float(f"{kd:.2g}")}
        # A rotor's encoder tells the angle within a turn of the rotor alone.
        park = {"park": _plain(joint.home)} if answers["maker"] == "cubemars" else {}
        return {**super().entry(joint, motor, number, answers), **gains, **park}

    def gains(self, joint: Joint, motor: Motor) -> tuple[float, float]:
        """N m/rad and N m s/rad at the shaft: the weight pulls it by 3 degrees, unless that can't be damped."""
        lead = self.lead(joint)
        moved = joint.inertia * lead**2 + _number(motor, "inertia")
        kp = min(max(joint.torque * lead / _SAG, _SOFTEST), _STIFFEST, (_MOST_DAMPING / 2 / _RINGING) ** 2 / moved)
        return kp, min(2 * _DAMPED * sqrt(kp * moved), _MOST_DAMPING)

    def strained(self, joint: Joint, motor: Motor) -> str:
        sag = joint.torque * self.lead(joint) / self.gains(joint, motor)[0]
        return f"{joint.name}: a stiffness that can be damped lets the weight pull it by {sag:.2g} rad" \
            if sag > 3 * _SAG else ""  # fmt: skip


class CubemarsServo(_OnCan):
    """CubeMars in servo mode: the drive's own ramp and speed, parked where it is switched on."""

    slides, entries, prefix, guessed = False, "axes", "AK", "'parked' and 'current'"

    def asks(self, answers: Mapping[str, Any]) -> Asked | None:
        what = "s of silence after which the drives let go, as set with the maker's program"
        return None if "timeout" in answers else Asked("timeout", what, example="1.0", kind="number")

    def entry(self, joint: Joint, motor: Motor, number: int, answers: Mapping[str, Any]) -> dict[str, Any]:
        speed = _MARGIN * joint.speed
        return {
            "id": number, "model": motor.name, "parked": _plain(joint.home), **self.bounds(joint),
            "velocity": speed, "acceleration": _RAMP * speed, "current": float(f"{motor.stall_current:.2g}"),
            "torque_constant": float(f"{motor.torque_constant:.3g}"),
        }  # fmt: skip


class Odrive(_OnCan):
    """ODrive: motor and gear are the lab's own."""

    slides, entries, prefix = False, "axes", "ODrive"
    guessed = "'parked', 'gear', 'current' and 'torque_constant' (a motor of 100 rpm/V with a gear of 8)"

    def asks(self, answers: Mapping[str, Any]) -> Asked | None:
        if "firmware" not in answers:
            what = "which firmware they have (0.5: v3.x boards; 0.6: S1, Pro, Micro)"
            return Asked("firmware", what, ("0.5", "0.6"), "0.6")
        if answers["firmware"] == "0.6":
            what = "where the maker's flat_endpoints.json of exactly their firmware and hardware is, for the watchdog"
            done = "endpoints" in answers
            return None if done else Asked("endpoints", what, example="flat_endpoints.json", kind="file")
        what = "whether each axis' watchdog was set with odrivetool (0.5 s), as nothing on CAN can"
        to_do = "Set axisN.config.watchdog_timeout = 0.5 and enable_watchdog = True, and save"
        return None if "watchdog_set" in answers else Asked("watchdog_set", what, (), "true", to_do, "yes")

    def travel(self, joint: Joint) -> tuple[float, float]:
        return joint.lower, joint.upper  # it counts turns from where it is switched on

    def entry(self, joint: Joint, motor: Motor, number: int, answers: Mapping[str, Any]) -> dict[str, Any]:
        gear, current = _number(motor, "gear"), motor.stall_current
        return {
            "node": number, "gear": gear, "parked": _plain(joint.home), **self.bounds(joint),
            "velocity": _MARGIN * joint.speed, "current": float(f"{current:.2g}"),
            "torque_constant": motor.torque_constant / gear,
        }  # fmt: skip


KINDS: Final = {
    kind.driver: kind
    for kind in (
        Drives("dynamixel", "Dynamixel MX servos", "dynamixel-chain", "/dev/ttyUSB0"),
        Drives("feetech", "Feetech STS servos", "feetech-chain", "/dev/ttyACM0"),
        MitCan("mit-can", "Damiao and CubeMars AK actuators on CAN, in MIT mode"),
        CubemarsServo("cubemars-servo", "CubeMars AK actuators on CAN, in servo mode"),
        Odrive("odrive", "ODrives on CAN, each with a geared motor"),
    )
}


def _number(motor: Motor, name: str) -> float:
    """A number that only actuators have: gear, inertia (kg m^2 at the shaft), nominal_voltage (V)."""
    return float(getattr(motor, name))


def _plain(value: float) -> float:
    return float(f"{value:.6g}")


def _inwards(value: float, up: bool) -> float:
    """With five digits behind the point, rounded into the travel."""
    if not isfinite(value):
        return inf
    return (ceil if up else floor)(round(value * 1e5, 3)) / 1e5


def _up(value: float) -> float:
    """Rounded up to two digits."""
    if value <= 0.0:
        return 0.0
    step = 10.0 ** (floor(log10(value)) - 1)
    return float(f"{ceil(value / step - 1e-9) * step:.2g}")
