"""The signals between devices and controllers: named arrays of fixed shape in SI units."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal, NoReturn

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_RESERVED = frozenset(",[]")


class Arrays(dict[str, Array]):
    """Arrays by name, which the loop has bound: their values are written, and none is put in another's place.

    Another array in its place would be nobody's: the loop would go on with the values of before.
    """

    def __setitem__(self, name: str, value: Array) -> None:
        if self.get(name) is not value:  # it is after `+=`
            self._fixed()

    def _fixed(self, *_: object, **__: object) -> NoReturn:
        raise TypeError("the arrays stay as they were bound. Write the values: output['NAME'][:] = ...")

    __delitem__ = __ior__ = update = setdefault = pop = popitem = clear = _fixed


@dataclass(frozen=True, kw_only=True)
class Signal:
    """One named array of float64.

    Attributes:
        name: the field's standard term, as a slug: "position", "wrench", "tips".
        shape: e.g. (22,) or (5, 3).
        unit: SI: "rad", "m", "N", "N m", "rad/s"; "1" for a pure number or a button (0 or 1).
        frame: the frame of its coordinates, in the profile's tree; None for joint space, or where it isn't known. A
            law's signal may say `=INPUT`: the frame that this input's signal has.
        of: the frame whose pose, twist or wrench it is; `=INPUT` as above.
        labels: a name for each row (joints, fingertips, x y z). Wiring goes by them, never by place. More than one row
            needs labels or `slots`; `srl.runtime.contracts.terms` has the names of what lives in space.
        slides: joints among its labels that slide, and are in m (m/s, N) where the unit is that of a turn; None: nobody
            knows. Where both ends of a wire know, they must agree.
        slots: the rows have no identity (unlabelled markers). They go as a whole to a port that takes slots.
        components: names along each further axis, one tuple an axis: x y z for (5, 3), joints for a Jacobian's columns.
        plausible: the least and the greatest value that its device can give, each one number or one for each element;
            None: what anything of this unit can be (`srl.runtime.contracts.plausible`). Of measured signals alone.
        visual: how a viewer shows it: "points" for shape (k, 3), or (3,), which is one; "robot" for the same, drawn as
            thick as an arm; "sphere" for (x, y, z, radius); "path" for a position (3,) or pose (7,) that leaves a
            trail; "arrow" for (2, 3), its start point (m) and a force (N) at that point; "skeleton" as "points", drawn
            as thick as a body's bones; "capsules" for (k, 8) with the components `terms.CAPSULE` and "gaps" for (k, 7)
            with `terms.GAP`, both coloured by their distance; a row with a coordinate that isn't finite isn't drawn.
        links: polylines through the points' rows, for visuals "points", "skeleton" and "robot".
        groups: for the same visuals, the name of the part of the body to which each row belongs. Each part has a colour
            of its own; a link has that of its first row.
    """

    name: str
    shape: tuple[int, ...]
    unit: str
    frame: str | None = None
    of: str | None = None
    labels: tuple[str, ...] = ()
    slides: tuple[str, ...] | None = None
    slots: bool = False
    components: tuple[tuple[str, ...], ...] = ()
    plausible: tuple[float | tuple[float, ...], float | tuple[float, ...]] | None = None
    visual: Literal["", "points", "skeleton", "robot", "sphere", "path", "arrow", "capsules", "gaps"] = ""
    links: tuple[tuple[int, ...], ...] = ()
    groups: tuple[str, ...] = ()

    @property
    def size(self) -> int:
        """Number of float64 elements."""
        return int(np.prod(self.shape, dtype=int))

    @property
    def names(self) -> tuple[str, ...]:
        """A name for each row; a single row without a label is called as the signal. Empty for slots and shape ()."""
        return self.labels or ((self.name,) if self.shape[:1] == (1,) and not self.slots else ())

    def naming_fault(self) -> str:
        """Returns what its names lack; "" if each element has one, as wiring by name needs it."""
        rows = self.shape[0] if self.shape else 0
        if self.labels and self.slots:
            return "it has labels and says that its rows are slots"
        if not self.labels and not self.slots and rows > 1:
            return f"it has {rows} rows and declares neither `labels` nor `slots`"
        if self.labels and len(self.labels) != rows:
            return f"it has {len(self.labels)} labels for {rows} rows"
        if tuple(map(len, self.components)) != self.shape[1:]:
            return f"it has components of {list(map(len, self.components))} for further axes of {list(self.shape[1:])}"
        if self.groups and len(self.groups) != rows:
            return f"it has {len(self.groups)} groups for {rows} rows"
        for names in (self.labels, *self.components):
            if twice := next((n for n in names if names.count(n) > 1), None):
                return f"'{twice}' is the name of two of its elements"
            if odd := next((n for n in names if not n or set(n) & _RESERVED), None):
                return f"'{odd}' can't be an element's name: commas and brackets can't stand in one"
        return ""


class Kind(StrEnum):
    """The physical quantity of a command. It decides how the guard limits the command."""

    POSITION = "position"
    VELOCITY = "velocity"
    TORQUE = "torque"
    INTENSITY = "intensity"  # what the wearer feels: vibration, squeeze, electrotactile; 0 to 1


class Stop(StrEnum):
    """Stop categories of an actuator. Rows hold a category's number, so a new one goes to the end."""

    HOLD = "hold"  # stay at the last command, braking within limits
    DAMP = "damp"  # oppose motion, yield to force
    LIMP = "limp"  # no torque (with gravity compensation where the device offers it)
    RETRACT = "retract"  # go to the rest configuration slowly
    BRAKE = "brake"  # ramp the velocity to zero; the device may then brake by itself
    OFF = "off"  # no output at once; of what the wearer feels


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits of a command, each of the command's own shape. None means that the source gives no limit.

    Units follow the command. `lower` and `upper` bound the position (rad or m), for kinds position, velocity
    and torque alike. `velocity`, `acceleration` and `jerk` bound its derivatives. `effort` bounds the torque
    (N m), `effort_rate` its rate (N m/s). `inertia` (kg m^2 or kg) is the least inertia that the joint moves;
    it bounds the damping of a torque command. The last four are an intensity's: `level` (1) its most, `level_rate`
    (1/s) how fast it rises, `on_time` (s) how long it is on without a pause, `duty` (1) its mean.
    """

    lower: Array | None = None
    upper: Array | None = None
    velocity: Array | None = None
    acceleration: Array | None = None
    jerk: Array | None = None
    effort: Array | None = None
    effort_rate: Array | None = None
    inertia: Array | None = None
    level: Array | None = None
    level_rate: Array | None = None
    on_time: Array | None = None
    duty: Array | None = None


@dataclass(frozen=True, kw_only=True)
class Command(Signal):
    """A signal that a device obeys.

    Attributes:
        kind: position, velocity, torque or intensity.
        feedback: the device's state signal that measures the same coordinates; None for a device
            without feedback (a hobby servo). A command without feedback starts at the profile's `home`.
        stops: the stop categories this interface supports, the default first.
        period: s; in normal operation a command leaves for the device at least this often while it is active. The
            runtime takes a longer pause for a stalled link. Required for every command that is wired.
        timeout: s; without a further command the device ends a velocity by itself within this, and keeps to the guard's
            acceleration at least in doing so. None: it doesn't, or nobody knows.
        lag: s; the measured position follows the command within this. With `window` it says what a limb that follows is
            measured to do (`srl.runtime.guard.following`).
        window: how far a limb that follows may be from where its command was within the lag: a load, friction, a soft
            gear. In the unit of the position; one number, or one for each element. None: the usual of this unit.
        resolution: the largest difference between a command and what leaves for the device that is normal
            (rounding, a filter in the driver), in the command's unit; one number, or one for each element.
        ordered: the order of the labels is the robot's own, known to everybody who works with it (joint1 to joint7), so
            limits may be given as a list. Not where the profile chooses it.
    """

    kind: Kind
    feedback: str | None = None
    stops: tuple[Stop, ...] = (Stop.HOLD,)
    period: float | None = None
    timeout: float | None = None
    lag: float = 0.2
    window: float | tuple[float, ...] | None = None
    resolution: float | tuple[float, ...] = 0.0
    ordered: bool = False

    @property
    def unseen(self) -> bool:
        """Whether it moves something, and nothing measures where that is."""
        return self.feedback is None and self.kind is not Kind.INTENSITY
