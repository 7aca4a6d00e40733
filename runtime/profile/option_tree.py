"""The options of a wired profile's parts, each with its key path: for what looks at all of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from pydantic.fields import FieldInfo

from srl.runtime.contracts.clearance import Clearance
from srl.runtime.contracts.controller import Controller
from srl.runtime.contracts.driver import Driver
from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.files import KeptFile
from srl.runtime.contracts.per_element import Listed
from srl.runtime.contracts.world import Fake, World
from srl.runtime.models.models import Model
from srl.runtime.profile.profile import Profile


def options(
    profile: Profile,
    devices: Iterable[Driver],
    laws: Iterable[Controller],
    world: World | None,
    clearances: Mapping[str, Clearance],
) -> Iterator[tuple[str, FieldInfo, Any]]:
    """Key path, declaration and value of each option of devices, laws, clearances, frames, models and the world."""
    groups: list[tuple[str, BaseModel]] = [(f"devices.{d.name}", d.config) for d in devices]
    groups += [(f"controllers.{i}", law.config) for i, law in enumerate(laws)]
    groups += [(f"frames.{name}", entry) for name, entry in profile.frames.items()]
    groups += [(f"models.{name}", entry) for name, entry in profile.models.items()]
    groups += [(f"guard.{name}.clear", each.config) for name, each in clearances.items()]
    if world is not None:
        groups.append(("sim", world.config))
    groups += [(f"sim.devices.{d.name}", d.options) for d in devices if isinstance(d, Fake)]
    for path, model in groups:
        yield from _of_model(model, path)


def listed(
    profile: Profile,
    devices: Iterable[Driver],
    laws: Iterable[Controller],
    world: World | None,
    clearances: Mapping[str, Clearance],
) -> dict[str, dict[str, float]]:
    """The options that the profile gives as lists: by key path, the value of each joint or axis."""
    return {
        path: dict(zip(value.names, value, strict=True))
        for path, _, value in options(profile, devices, laws, world, clearances)
        if isinstance(value, Listed)
    }


def files(
    profile: Profile,
    devices: Iterable[Driver],
    laws: Iterable[Controller],
    world: World | None,
    clearances: Mapping[str, Clearance],
) -> dict[str, KeptFile]:
    """The files that the options name and the run keeps, by key path."""
    return {
        path: value
        for path, _, value in options(profile, devices, laws, world, clearances)
        if isinstance(value, KeptFile)
    }


def items(value: Any) -> list[tuple[Any, Any]]:
    """The items of a mapping or sequence; none of anything else."""
    if isinstance(value, Mapping):
        return list(value.items())
    return list(enumerate(value)) if isinstance(value, list | tuple) else []


def _of_model(model: BaseModel, path: str) -> Iterator[tuple[str, FieldInfo, Any]]:
    for name, field in type(model).model_fields.items():
        value, here = getattr(model, name), f"{path}.{field.alias or name}"
        yield here, field, value
        for place, part in _models(value, here):
            yield from _of_model(part, place)


def _models(value: Any, path: str) -> Iterator[tuple[str, BaseModel]]:
    if isinstance(value, Model):
        return  # its place is under `models:`
    if isinstance(value, BaseModel):
        yield path, value
    elif isinstance(value, tuple) and len(value) == 2 and isinstance(value[0], type):  # a part's class and options
        yield from _models(value[1], path)
    else:
        for key, item in items(value):
            yield from _models(item, f"{path}.{key}")
