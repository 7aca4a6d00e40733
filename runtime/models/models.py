"""Descriptions of limbs and hands that laws and the simulated world share: the profile's `models:`.

An entry is `NAME: {kind: KIND, ...}`. An option of a law or of a simulated part names an entry. So what is changed
there is changed for both. A new kind is a class here, and a line in KINDS.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property, partial
from math import pi
from typing import Annotated, Any, ClassVar, Final, Literal, Self

import numpy as np
from pydantic import (
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    WithJsonSchema,
    WrapValidator,
    model_validator,
)

from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import OptionError, nearest
from srl.runtime.contracts.per_element import Listed, in_order
from srl.runtime.contracts.signals import Array
from srl.runtime.models.body import Body, Marker, Side, Vector, average
from srl.runtime.models.human_hand import FINGER_JOINTS, JOINTS, MODEL_LENGTH, RANGES, hand_geometry
from srl.runtime.models.model import Model, made
from srl.runtime.models.robot_model import RobotModel
from srl.runtime.models.skeleton import arms as srl_arms


def _still_listed(given: Any, check: ValidatorFunctionWrapHandler) -> tuple[float, ...]:
    values: tuple[float, ...] = check(given)
    return Listed.of(values, given.names) if isinstance(given, Listed) else values


_Angles = Annotated[
    tuple[float, ...],
    WrapValidator(_still_listed),
    WithJsonSchema(
        {
            "anyOf": [
                {"type": "object", "additionalProperties": {"type": "number"}},
                {"type": "array", "items": {"type": "number"}},
                {"type": "number"},
            ]
        }
    ),
]


class FingerModel(Model):
    """A robotic finger: a chain of revolute joints. The default is the sixth finger.

    The size of its modules is the paper's. The paper's Denavit-Hartenberg table is lost, so the rows are ours: at zero
    the finger is straight, along x of its base. z of the base is the abduction axis.
    """

    kind: Literal["finger"] = "finger"
    rows: tuple[tuple[float, float], ...] = Field(
        default=((pi / 2, 0.015), (0.0, 0.042), (0.0, 0.042), (0.0, 0.042)),
        min_length=1,
        description="standard Denavit-Hartenberg rows [alpha rad, a m], one a joint, from the base on",
    )
    joints: tuple[str, ...] = Field(
        default=(), description="their names; left out: the sixth finger's, or joint_1, joint_2 and on"
    )
    lower: _Angles = Field(default=(-pi / 3, -pi / 2, -pi / 2, -pi / 2), description="rad, a joint each")
    upper: _Angles = Field(default=(pi / 3, pi / 2, pi / 2, pi / 2), description="rad, a joint each")

    @model_validator(mode="before")
    @classmethod
    def _by_name(cls, given: Any) -> Any:
        """Puts limits that are given by name in the joints' order."""
        rows = given.get("rows", cls.model_fields["rows"].default) if isinstance(given, Mapping) else None
        joints = given.get("joints") or () if isinstance(given, Mapping) else ()
        if not isinstance(rows, list | tuple) or not isinstance(joints, list | tuple):
            return given
        names, made = tuple(map(str, joints)) or _plain_names(len(rows)), dict(given)
        for key in {"lower", "upper"} & made.keys():
            value = made[key]
            if isinstance(value, Mapping | int | float):
                try:
                    made[key] = in_order(value, names)
                except OptionError as error:
                    raise OptionError(f"{key}: {error.problem}", error.remedy) from None
            elif isinstance(value, list) and len(value) == len(names):
                made[key] = Listed.of(tuple(value), names)
        return made

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if not len(self.names) == len(self.rows) == len(self.lower) == len(self.upper):
            raise ValueError("joints, rows, lower and upper must have one entry a joint")
        if len(set(self.names)) < len(self.names):
            raise ValueError("each joint needs a name of its own")
        if not np.isfinite([*np.ravel(self.rows), *self.lower, *self.upper]).all():
            raise ValueError("rows, lower and upper must be finite")
        if any(low >= high for low, high in zip(self.lower, self.upper, strict=True)):
            raise ValueError("every lower limit must be below its upper limit")
        return self

    @property
    def names(self) -> tuple[str, ...]:
        """The joints' names, from the base on."""
        return self.joints or _plain_names(len(self.rows))


def _plain_names(n: int) -> tuple[str, ...]:
    return FINGER_JOINTS if n == len(FINGER_JOINTS) else tuple(f"joint_{j + 1}" for j in range(n))


class HandModel(Model):
    """A human hand of 20 joints (`srl.runtime.models.human_hand`), with its wearer's own ranges where they are known.

    Attributes:
        names: (20) of the joints.
    """

    kind: Literal["hand"] = "hand"
    side: Literal["right", "left"] = "right"
    length: float = Field(
        default=MODEL_LENGTH, gt=0.12, lt=0.26, description="m, from the wrist crease to the tip of the middle finger"
    )
    lower: dict[str, float] = Field(default_factory=dict, description="rad, of joints whose lower limit is known")
    upper: dict[str, float] = Field(default_factory=dict, description="rad, of joints whose upper limit is known")
    names: ClassVar[tuple[str, ...]] = JOINTS

    @model_validator(mode="after")
    def _whole(self) -> Self:
        for joint in (*self.lower, *self.upper):
            if joint not in JOINTS:
                raise OptionError(f"a hand has no joint '{joint}'", nearest(joint, JOINTS))
        if not np.isfinite(self.ranges).all():
            raise ValueError("lower and upper must be finite")
        for joint, (low, high) in zip(JOINTS, self.ranges.tolist(), strict=True):
            if low >= high:
                raise ValueError(f"{joint}: the lower limit {low:g} must be below the upper one, {high:g}")
        return self

    @property
    def ranges(self) -> Array:
        """(20, 2) rad, lower and upper limit of each joint: the wearer's where given, else an average hand's."""
        ranges = RANGES.copy()
        for column, limits in enumerate((self.lower, self.upper)):
            for joint, limit in limits.items():
                ranges[JOINTS.index(joint), column] = limit
        return ranges

    @property
    def scale(self) -> float:
        """Its size divided by the unscaled model's."""
        return self.length / MODEL_LENGTH

    def geometry(self) -> tuple[Array, Array]:
        """Bases (5, 4, 4) in frame `hand`, m, and Denavit-Hartenberg rows (5, 4, 2), alpha (rad) and a (m).

        A left hand is the right one mirrored in x. In terms of chains: z of every joint's frame is turned over, too,
        so that frames stay right-handed and the same angles give the mirrored posture.
        """
        bases, rows = hand_geometry(self.length)
        if self.side == "left":
            bases = np.diag([-1.0, 1.0, 1.0, 1.0]) @ bases @ np.diag([1.0, 1.0, -1.0, 1.0])
            rows = rows * [-1.0, 1.0]
        return bases, rows


class MarkerPlace(BaseModel):
    """Where a marker sits."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    segment: str = Field(description="torso, or SIDE_clavicle, SIDE_upper_arm, SIDE_forearm, SIDE_hand")
    at: Vector = Field(description="m, in the segment's frame")


class BodyModel(Model):
    """An upper body (`srl.runtime.models.body`): an average adult, in which what was measured is replaced.

    Attributes:
        body: the description itself.
    """

    kind: Literal["body"] = "body"
    stature: float = Field(default=1.75, gt=1.2, lt=2.3, description="m, standing height")
    sides: tuple[Side, ...] = Field(default=("left", "right"), min_length=1, description="the arms it has")
    lengths: dict[str, float] = Field(
        default_factory=dict, description="m: upper_arm, forearm, palm, hand as measured, or for one side right_forearm"
    )
    shoulder: dict[Side, Vector] = Field(
        default_factory=dict, description="m, a side's shoulder joint from the clavicle's beginning, at rest"
    )
    markers: dict[str, Annotated[MarkerPlace | None, WithJsonSchema({"type": ["object", "null"]})]] = Field(
        default_factory=dict, description="marker places as measured; null takes a marker away"
    )

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if len(set(self.sides)) < len(self.sides):
            raise ValueError("each side once")
        parts = tuple(average(self.stature).sizes)
        valid = {*parts, *(f"{side}_{part}" for side in self.sides for part in parts)}
        for name, value in self.lengths.items():
            if name not in valid:
                raise OptionError(f"a body has no length '{name}'", nearest(name, valid))
            if not 0.02 < value < 0.6:
                raise ValueError(f"lengths.{name}: {value} m can't be right; lengths are in m")
        for side in self.shoulder:
            if side not in self.sides:
                raise ValueError(f"this body has no {side} arm, so no {side} shoulder")
        segments = self.body.segments
        for name, marker in self.markers.items():
            if marker is not None and marker.segment not in segments:
                raise OptionError(
                    f"marker {name}: a body has no segment '{marker.segment}'", nearest(marker.segment, segments)
                )
        if not np.isfinite([m.at for m in self.body.markers.values()]).all():
            raise ValueError("marker places must be finite")
        return self

    @cached_property
    def body(self) -> Body:
        """The body."""
        plain = average(self.stature, self.sides)
        sizes: dict[str, dict[Side, float]] = {
            part: {s: self.lengths.get(f"{s}_{part}", self.lengths.get(part, size)) for s, size in given.items()}
            for part, given in plain.sizes.items()
        }
        # Markers of the arm keep their distance from the joint at the segment's further end.
        further = {"upper_arm": "upper_arm", "forearm": "forearm", "hand": "palm"}
        markers = {}
        for name, (segment, at) in ((n, (m.segment, m.at)) for n, m in plain.markers.items()):
            side, _, part = segment.partition("_")
            x, y, z = at
            for s in self.sides:
                if s == side and part in further:
                    z += plain.sizes[further[part]][s] - sizes[further[part]][s]
                elif s == side and s in self.shoulder:
                    x, y, z = (float(v) for v in np.array(at) + self.shoulder[s] - np.array(plain.shoulder[s]))
            markers[name] = Marker(segment, (x, y, z))
        for name, place in self.markers.items():
            if place is None:
                markers.pop(name, None)
            else:
                markers[name] = Marker(place.segment, place.at)
        return replace(plain, shoulder={**plain.shoulder, **self.shoulder}, sizes=sizes, markers=markers)


class ArmJointEntry(BaseModel):
    """A joint of a supernumerary arm, as it is on the right side."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    at: Vector = Field(description="m, in the frame of the node before it")
    axis: srl_arms.Axis = Field(description="of the turn or the displacement; all axes are the suit's at zero")
    slides: bool = Field(False, description="it is prismatic: it moves the next node")


# Written out: a schema of `models:` can't point to definitions.
_JointOption = Annotated[ArmJointEntry, WithJsonSchema(ArmJointEntry.model_json_schema())]


class ArmsModel(Model):
    """Supernumerary arms on the body (`srl.runtime.models.skeleton.arms`). The axes are the paper's, the sizes ours.

    Attributes:
        arms: the description itself.
    """

    kind: Literal["srl-arms"] = "srl-arms"
    sides: tuple[srl_arms.Side, ...] = Field(("right",), min_length=1, description="the arms that exist")
    parent: str = Field("Spine", description="the suit's joint on which both bases hang")
    base: Vector = Field(srl_arms.BASE, description="m, the right base in the parent's frame")
    joints: tuple[_JointOption, ...] = Field(
        tuple(ArmJointEntry.model_validate(vars(joint)) for joint in srl_arms.STANDARD),
        min_length=1,
        description="from the base on",
    )
    end: Vector = Field(srl_arms.END, description="m, the end in the last joint's frame")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if len(set(self.sides)) < len(self.sides):
            raise ValueError("each side once")
        if not np.isfinite([self.base, self.end, *(joint.at for joint in self.joints)]).all():
            raise ValueError("places must be finite")
        return self

    @cached_property
    def arms(self) -> srl_arms.Arms:
        """The arms."""
        joints = tuple(srl_arms.ArmJoint(j.at, j.axis, j.slides) for j in self.joints)
        sides = tuple(side for side in srl_arms.SIDES if side in self.sides)
        return srl_arms.Arms(self.parent, self.base, joints, self.end, sides)


KINDS: Final[dict[str, type[Model]]] = {
    **{"finger": FingerModel, "hand": HandModel, "body": BodyModel},
    **{"srl-arms": ArmsModel, "robot": RobotModel},
}


def of_entry(given: Any, info: ValidationInfo) -> Model:
    """Makes the description of an entry of `models:`. Raises ValueError."""
    if isinstance(given, Model):
        return given
    if not isinstance(given, Mapping) or "kind" not in given:
        raise OptionError("the key 'kind' is missing", f"Write {{kind: KIND, ...}}; kinds: {', '.join(KINDS)}")
    if (kind := str(given["kind"])) not in KINDS:
        raise OptionError(f"no kind of model is called '{kind}'", nearest(kind, KINDS))
    keys = KINDS[kind].model_fields
    for key in given:
        if key not in keys:
            raise OptionError(f"a {kind} has no key '{key}'", nearest(str(key), keys))
    return made(KINDS[kind], given, info)


def context(models: Mapping[str, Model]) -> dict[str, Any]:
    """The context with which options are validated, so that they find the profile's models by name."""
    return {"models": models}


def _find(kind: type[Model], given: Any, info: ValidationInfo) -> Model:
    """The description that an option names."""
    if isinstance(given, kind):
        return given
    called = next(name for name, cls in KINDS.items() if cls is kind)
    models: Mapping[str, Model] = (info.context or {}).get("models", {})
    fitting = {name: model for name, model in models.items() if isinstance(model, kind)}
    if not isinstance(given, str):
        raise OptionError(f"the name of a {called} under `models:` is expected", nearest("", fitting))
    if given in fitting:
        return fitting[given]
    if given in models:
        raise OptionError(f"the model '{given}' is a {models[given].kind}, not a {called}", nearest("", fitting))
    if given == called and fitting:
        problem = f"`models:` has {', '.join(fitting)}, and this names none of them"
        raise OptionError(problem, f"Name one, or call it '{called}'")
    if given != called:
        raise OptionError(f"`models:` has no {called} called '{given}'", nearest(given, {called, *fitting}))
    return kind()


_NAME: Final = WithJsonSchema({"type": "string", "description": "name of an entry of `models:`"})
FingerOption = Annotated[FingerModel, BeforeValidator(partial(_find, FingerModel)), _NAME]
"""An option that names a finger."""
HandOption = Annotated[HandModel, BeforeValidator(partial(_find, HandModel)), _NAME]
"""An option that names a hand."""
BodyOption = Annotated[BodyModel, BeforeValidator(partial(_find, BodyModel)), _NAME]
"""An option that names a body."""
ArmsOption = Annotated[ArmsModel, BeforeValidator(partial(_find, ArmsModel)), _NAME]
"""An option that names supernumerary arms."""


def bodies(models: Mapping[str, Model]) -> dict[str, dict[str, Any]]:
    """A profile's bodies by name: their sizes, as JSON types, but not which sides they have."""
    return {n: m.model_dump(mode="json", exclude={"sides"}) for n, m in models.items() if isinstance(m, BodyModel)}


def named(name: str) -> Any:
    """The default of a FingerOption, HandOption, BodyOption or ArmsOption: the entry of that name.

    If it is the kind's own name, it is the standard description where the profile has no such entry.
    """
    return Field(default=name, validate_default=True)
