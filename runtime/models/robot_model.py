"""A robot of one's own, from its URDF: an entry of `models:`, and the option by which laws and parts name an arm."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

from pydantic import (
    AfterValidator,
    ConfigDict,
    Field,
    PlainValidator,
    ValidationInfo,
    WithJsonSchema,
    field_serializer,
    model_validator,
)

from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import OptionError, nearest
from srl.runtime.contracts.files import FileOption, KeptFile
from srl.runtime.contracts.per_element import Finite, Positive
from srl.runtime.contracts.rotation import Vector
from srl.runtime.models.model import Model, made
from srl.runtime.models.robots import ARMS, Capsule, RobotDescription
from srl.runtime.models.robots.urdf import tree
from srl.runtime.models.robots.urdf_arm import UrdfArm, read


class JointLimits(BaseModel):
    """Limits of one joint, in place of the URDF's."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    lower: Finite | None = Field(None, description="rad, or m where it slides")
    upper: Finite | None = Field(None, description="rad, or m where it slides")
    velocity: Positive | None = Field(None, description="rad/s, or m/s where it slides")
    effort: Positive | None = Field(None, description="N m, or N where it slides")


class LinkCapsule(BaseModel):
    """A capsule round a link, in the link's frame."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    start: Vector = Field((0.0, 0.0, 0.0), description="m")
    end: Vector = Field(description="m")
    radius: Positive = Field(description="m")


# Written out: a schema of `models:` can't point to definitions.
_Limits = Annotated[JointLimits, WithJsonSchema(JointLimits.model_json_schema())]
_Capsule = Annotated[LinkCapsule, WithJsonSchema(LinkCapsule.model_json_schema())]


class RobotModel(Model):
    """An arm as a URDF describes it: the joints between two of its links.

    Attributes:
        arm: what was made of the file.
        robot: its description, by which laws, simulation and pictures know it.
    """

    kind: Literal["robot"] = "robot"
    urdf: Annotated[KeptFile, FileOption("Name an existing URDF, from the profile's folder on")] = Field(
        description="the file; no xacro"
    )
    base: str | None = Field(None, description="link whose frame is the arm's own; left out: the root")
    tip: str | None = Field(None, description="link whose frame is the flange's; left out: the only chain's end")
    limits: dict[str, _Limits] = Field(
        default_factory=dict, description="by joint, what the URDF doesn't say or says wrong"
    )
    capsules: dict[str, tuple[_Capsule, ...]] = Field(
        default_factory=dict, description="by link, contact shapes where the URDF has meshes"
    )
    home: dict[str, Finite] = Field(default_factory=dict, description="rad or m, by joint; left out: zero")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        assert self.arm
        return self

    @field_serializer("urdf")
    def _named(self, file: KeptFile) -> str:
        return str(file.path)

    @cached_property
    def arm(self) -> UrdfArm:
        """Reads the file. Raises OptionError: it can't be used."""
        capsules = {
            link: tuple(Capsule(each.start, each.end, each.radius) for each in given)
            for link, given in self.capsules.items()
        }
        limits = {joint: each.model_dump(exclude_none=True) for joint, each in self.limits.items()}
        name = Path(self.urdf.path.name)  # errors name no folder of this machine
        return read(tree(self.urdf.content, name), self.base, self.tip, limits, capsules, self.home)

    @property
    def robot(self) -> RobotDescription:
        """The description."""
        return self.arm.robot

    def remarks(self) -> list[str]:
        """What a person should know of it."""
        robot, arm = self.robot, self.arm
        mass = sum(joint.link.mass for joint in robot.joints)
        found = [f"{', '.join(robot.labels)} move between {arm.base} and {arm.tip}; {mass:.3g} kg move"]
        if arm.held:
            found.append(f"the file's other joints stay where they are at zero: {', '.join(arm.held)}")
        if robot.unseen:
            found.append(f"no contact shapes, as these are meshes there (add 'capsules'): {', '.join(robot.unseen)}")
        return found


def _robot(given: Any, info: ValidationInfo) -> RobotDescription:
    """The arm that an option names."""
    if isinstance(given, RobotDescription):
        return given
    if isinstance(given, Mapping):
        return _inline(given, info).robot
    models: Mapping[str, Model] = (info.context or {}).get("models", {})
    own = {name: model for name, model in models.items() if isinstance(model, RobotModel)}
    if not isinstance(given, str):
        raise OptionError("the name of an arm, or {urdf: FILE, base: LINK, tip: LINK} is expected",
                          f"One of: {', '.join([*ARMS, *own])}")  # fmt: skip
    if given in own:
        return own[given].robot
    if given in models:
        raise OptionError(f"the model '{given}' is a {models[given].kind}, not a robot", nearest(given, [*ARMS, *own]))
    if given not in ARMS:
        raise OptionError(f"there is no arm '{given}'", nearest(given, [*ARMS, *own]))
    return ARMS[given]


def _inline(given: Mapping[str, Any], info: ValidationInfo) -> RobotModel:
    for key in given:
        if key not in RobotModel.model_fields:
            raise OptionError(f"a robot has no key '{key}'", nearest(str(key), RobotModel.model_fields))
    if "urdf" not in given:
        raise OptionError("the key 'urdf' is missing", "Write {urdf: FILE, base: LINK, tip: LINK}")
    return made(RobotModel, given, info)


_JSON: Final = {
    "anyOf": [
        {"type": "string", "description": "name of an arm, or of a robot of `models:`"},
        {"type": "object", "required": ["urdf"]},
    ]
}
RobotOption = Annotated[RobotDescription, PlainValidator(_robot), WithJsonSchema(_JSON)]
"""An option that names an arm: one of the runtime's, a robot of `models:`, or {urdf: FILE, base: LINK, tip: LINK}."""
WeighedRobot = Annotated[RobotOption, AfterValidator(RobotDescription.with_masses)]
"""The same, for what needs its masses."""


def arm_named(name: str) -> Any:
    """The default of a RobotOption: one of the runtime's arms."""
    return Field(
        default=name,
        validate_default=True,
        description=f"the arm: {', '.join(sorted(ARMS))}, a robot of `models:`, or {{urdf, base, tip}}",
    )
