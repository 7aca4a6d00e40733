"""Which robots a picture of a run shows, and with which links: what the layout's `meta` says of them.

A device's robot is what its driver says, or `robot:` of its entry: a description, a finger, a worn arm or a robot of
`models:`, a chain of axes, or a URDF.
Nothing here keeps a run from beginning: what can't be used is told, and the picture has the shapes of the description,
or none.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import asdict
from importlib import metadata
from math import isfinite
from pathlib import Path
from typing import Any, Final

from pydantic import ConfigDict, Field, field_validator

from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import OptionError, nearest
from srl.runtime.contracts.files import Files, KeptFile
from srl.runtime.contracts.frames import FrameEntry
from srl.runtime.contracts.linkage import Linkage
from srl.runtime.contracts.rotation import Vector
from srl.runtime.contracts.signals import Signal
from srl.runtime.contracts.terms import PLANAR
from srl.runtime.models.models import ArmsModel, FingerModel, Model
from srl.runtime.models.robot_model import RobotModel
from srl.runtime.models.robots import ARMS, SUMMIT_XL, chains, linkages, softhand, urdf
from srl.runtime.models.skeleton.arms import Side

MESHES: Final = "example-robot-data"  # the package of the extra `meshes`
_LONGEST: Final = 10.0  # m, a link
_SHARED: Final = Path("cmeel.prefix/share/example-robot-data/robots")
# By description, its file in that package, and the links of its base and its flange.
_FILES: Final = {"panda": ("panda_description/urdf/panda.urdf", "panda_link0", "panda_link8")}


class RobotFile(BaseModel):
    """`robot: {urdf: FILE, base: LINK, tip: LINK}`: a robot as a file describes it."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    urdf: str = Field(min_length=1, description="the file, from the profile's folder on")
    base: str | None = Field(None, description="link whose frame is the device's own; left out: the root")
    tip: str | None = Field(None, description="link at the chain's end; left out: all joints that move")


class RobotNamed(BaseModel):
    """`robot: {name: NAME, side: SIDE, at: DEVICE/LINK}`: a description, which of two arms, and what it hangs on."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str = Field(min_length=1, description="a description, or a finger or the arms of `models:`")
    side: Side | None = Field(None, description="which of the arms; left out: the only one")
    at: str = Field("", pattern=r"^([^/]+/[^/]+)?$", description="the drawn link on which it is mounted: arm/flange")


class AxisEntry(BaseModel):
    """One axis of `robot: {axes: ...}`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    axis: Vector = Field((0.0, 0.0, 1.0), description="in the frame of the link before; all are parallel at zero")
    link: Vector = Field((0.08, 0.0, 0.0), description="m, from this axis to the next, or to the tip")
    slides: bool = Field(False, description="it slides, in m")

    @field_validator("axis")
    @classmethod
    def _points(cls, value: Vector) -> Vector:
        if not all(map(isfinite, value)) or max(map(abs, value)) < 1e-6:
            raise ValueError("an axis points somewhere")
        return value

    @field_validator("link")
    @classmethod
    def _near(cls, value: Vector) -> Vector:
        if not all(abs(v) < _LONGEST for v in value):  # nan isn't less
            raise ValueError(f"a link is shorter than {_LONGEST:g} m")
        return value


class RobotAxes(BaseModel):
    """`robot: {axes: {NAME: {axis, link}}}`: a chain, by the names of the device's joints, from the base on."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    axes: dict[str, AxisEntry] = Field(min_length=1, description="by joint, from the base on")
    at: str = Field("", pattern=r"^([^/]+/[^/]+)?$", description="the drawn link on which it is mounted: arm/flange")


RobotEntry = str | RobotFile | RobotNamed | RobotAxes


def pictured(
    robots: Mapping[str, RobotEntry | None],
    models: Mapping[str, Model],
    frames: Mapping[str, FrameEntry],
    files: Files,
    signals: Mapping[str, Signal],
    devices: list[Driver],
) -> tuple[list[dict[str, Any]], dict[str, dict[str, Any]], list[tuple[str, str]]]:
    """The robots of a profile.

    Args:
        robots: by device, what its entry says.
        models, frames, files: the profile's.
        signals: all of the row.
        devices: in the profile's order.
    Returns:
        The robots and the frames that they need beside the profile's, of JSON types; and warnings, with its key.
    """
    found: list[dict[str, Any]] = []
    warnings: list[tuple[str, str]] = []
    for device in devices:
        entry = robots.get(device.name)
        signal = _angles(device, signals)
        names = signal[1].labels if signal is not None else ()
        linkage, file = None, None
        robot = device.pictured_as.format_map(vars(device.config)).lower()
        on = entry.at if isinstance(entry, RobotNamed | RobotAxes) else ""
        named = RobotNamed(name=entry) if isinstance(entry, str) else entry
        try:
            own = models.get(named.name) if isinstance(named, RobotNamed) else None
            if isinstance(own, RobotModel):
                named = RobotFile(urdf=str(own.urdf.path), base=own.base, tip=own.tip)
            if isinstance(named, RobotNamed):
                linkage = _described(named.name, models, True, named.side)
            elif isinstance(named, RobotAxes):
                linkage = chains.chain([chains.Axis(n, a.axis, a.link, a.slides) for n, a in named.axes.items()])
            elif robot:
                linkage = _described(robot, models, False)
            if linkage is not None and not {link.joint for link in linkage.links if link.joint} <= set(names):
                linkage = None
                if isinstance(named, RobotNamed | RobotAxes):
                    what = f"'{named.name}'" if isinstance(named, RobotNamed) else "`axes`"
                    problem = f"the joints of {what} aren't those of '{device.name}' ({', '.join(names) or 'none'})"
                    raise OptionError(problem, "Correct one of them")
            if isinstance(named, RobotFile):
                kept = own.urdf if isinstance(own, RobotModel) else _kept(named.urdf, files)
                read = urdf.read(kept.content, kept.path, names, named.base, named.tip)
                if linkage is None or not read.lacking:
                    linkage = read.linkage
                if read.lacking:
                    more = f" (and {len(read.lacking) - 1} more)" if len(read.lacking) > 1 else ""
                    raise OptionError(
                        f"{read.lacking[0]}{more}: drawn without meshes", "Correct the URDF, or set ROS_PACKAGE_PATH"
                    )
                file = {"path": str(kept.path), "packages": [str(p) for p in read.packages]}
            elif linkage is not None and entry is None and robot in _FILES and (whole := _installed(robot, names)):
                linkage, file = whole
        except OptionError as error:
            warnings.append((f"devices.{device.name}.robot", f"{error.problem}. {error.remedy}"))
        if linkage is None:
            continue
        found.append({
            "name": device.name,
            "angles": signal[0] if signal is not None and linkage.moving else "",
            "links": [asdict(link) for link in linkage.links],
            "urdf": file,
            "on": on,
        })  # fmt: skip
    return _placed(found, frames, signals, warnings)


def _kept(given: str, files: Files) -> KeptFile:
    """The URDF. The loop and a replay have what was read at the run's start, and read nothing themselves."""
    try:
        return files.keep(given, "Name an existing URDF, from the profile's folder on")
    except OptionError:
        if files.recorded is None:
            raise
        raise OptionError(f"{given} couldn't be read when the run was begun", "`srl check` says why") from None


def _angles(device: Driver, signals: Mapping[str, Signal]) -> tuple[str, Signal] | None:
    """What says where a device's joints are: its own state, else the simulation's truth, else what was applied."""
    name = device.name
    for candidate in (f"{name}.position", f"world.{name}_position"):
        if candidate in signals and len(signals[candidate].shape) == 1:
            return candidate, signals[candidate]
    command = next((c for c in device.commands if c.name == "position_command" and len(c.shape) == 1), None)
    return (f"{name}.position_command.applied", command) if command is not None else None


def _described(name: str, models: Mapping[str, Model], asked: bool, side: Side | None = None) -> Linkage | None:
    """The links of a description. Raises OptionError if it was asked for and isn't there."""
    model = models.get(name) or (FingerModel() if name == "finger" else None)
    if isinstance(model, ArmsModel):
        return chains.worn_arm(model.arms, model.arms.side(side))
    if side is not None:
        raise OptionError(f"`side` is for worn arms, and '{name}' is none", "Remove it")
    if isinstance(model, FingerModel):
        return linkages.finger(model)
    if name == softhand.NAME:
        return softhand.linkage()
    if name in ARMS:
        return linkages.arm(ARMS[name])
    if name == SUMMIT_XL.name:
        return linkages.base(SUMMIT_XL)
    if asked:
        drawn = (n for n, m in models.items() if isinstance(m, FingerModel | ArmsModel | RobotModel))
        known = [*ARMS, SUMMIT_XL.name, softhand.NAME, "finger", *drawn]
        raise OptionError(f"no robot is called '{name}'", nearest(name, known))
    return None


def _installed(name: str, names: tuple[str, ...]) -> tuple[Linkage, dict[str, Any]] | None:
    """A robot with the meshes of the extra, where it is installed and whole."""
    relative, first, last = _FILES[name]
    try:
        file = Path(str(metadata.distribution(MESHES).locate_file(_SHARED / relative)))
        read = urdf.read(file.read_bytes(), file, names, first, last)
        chain = next(i for i, link in enumerate(read.linkage.links) if link.name == last)
        # What hangs on the flange there, the maker's own gripper, needn't be on this one.
        bare = Linkage(read.linkage.links[: chain + 1])
    except (metadata.PackageNotFoundError, OSError, OptionError):
        return None
    return None if read.lacking else (bare, {"path": str(file), "packages": [str(p) for p in read.packages]})


def _placed(
    found: list[dict[str, Any]], frames: Mapping[str, FrameEntry], signals: Mapping[str, Signal],
    warnings: list[tuple[str, str]],
) -> tuple[list[dict[str, Any]], dict[str, dict[str, Any]], list[tuple[str, str]]]:  # fmt: skip
    """Keeps the robots whose place is known: the link on which one hangs, or a frame's; else, without any frames, what
    it measures, or the root."""
    links = {f"{robot['name']}/{link['name']}" for robot in found for link in robot["links"]}
    for robot in found:
        if robot["on"] and robot["on"] not in links:
            problem = f"no robot that is drawn has a link {robot['on']}"
            warnings.append((f"devices.{robot['name']}.robot.at", f"{problem}. {nearest(robot['on'], links)}"))
    hung = [r for r in found if r["on"] in links and r["on"].partition("/")[0] != r["name"]]
    found = [robot for robot in found if not robot["on"]]
    if frames:
        return with_a_place([*found, *hung], frames), {}, warnings
    made = {}
    for robot in found:
        name = robot["name"]
        pose = next((n for n, s in signals.items() if s.of == name and s.labels == PLANAR), None)
        if pose is not None:
            made[name] = FrameEntry(pose=pose).model_dump()
    still = [robot for robot in found if robot["name"] not in made]
    # Two robots at the root would stand in each other.
    return _carried([r for r in found if r["name"] in made or len(still) == 1], hung), made, warnings


def with_a_place(robots: list[dict[str, Any]], frames: Container[str]) -> list[dict[str, Any]]:
    """The robots that have one of these frames, and those that hang on such."""
    stand = [robot for robot in robots if not robot["on"] and robot["name"] in frames]
    return _carried(stand, [robot for robot in robots if robot["on"]])


def _carried(stand: list[dict[str, Any]], hung: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The robots that stand, and those that hang on their links; each comes after what carries it."""
    ordered, waiting = list(stand), list(hung)
    while ready := [r for r in waiting if r["on"].partition("/")[0] in {each["name"] for each in ordered}]:
        ordered += ready
        waiting = [r for r in waiting if r not in ready]
    return ordered
