"""A switch (`true`) is never taken for a number, in no option; and a tolerance is one."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Iterator, Mapping
from typing import Annotated, Any

import pytest
from helpers.run import refused
from pydantic import BaseModel, TypeAdapter, ValidationError

from srl.runtime.contracts.errors import OptionError
from srl.runtime.guard.limits import GuardLimits
from srl.runtime.profile.guard_entry import ClearEntry

PACKAGES = tuple(f"srl.{name}" for name in ("runtime", "control", "commissioning", "drivers", "sim"))
GIVEN = "guard.finger.position_command"
JOINTS = "{abduction: 1.0, flexion_1: 1.0, flexion_2: 1.0, flexion_3: true}"


@pytest.mark.parametrize(
    ("change", "place"),
    [
        (f"{GIVEN}.velocity=true", "velocity"),
        (f"{GIVEN}.velocity={JOINTS}", "velocity"),
        (f"{GIVEN}.tolerance=true", "tolerance"),
        ("controllers.1.damping=true", "damping"),
        ("devices.glove.max_age=true", "max_age"),
        ("devices.finger.servos.flexion_1.home=true", "home"),
        ("faults.overrun.tolerate=true", "tolerate"),
        ("frames.finger.position=[0.0, true, 0.0]", "position"),
        ("bus.decimate=true", "decimate"),
        ("seed=true", "seed"),
    ],
)
def test_a_switch_is_refused_where_a_number_belongs(change: str, place: str) -> None:
    output = refused("check", "sixth-finger", "--set", change)
    assert place in output
    assert "number" in output


@pytest.mark.parametrize("value", ["1e300", "100.0"])
def test_a_tolerance_by_which_nothing_is_ever_limited_is_refused(value: str) -> None:
    assert "tolerance" in refused("check", "sixth-finger", "--set", f"{GIVEN}.tolerance={value}")


def test_numbers_that_a_device_can_have_are_taken() -> None:
    limits = GuardLimits.model_validate({"lower": -3, "upper": [3.0, 2], "velocity": {"a": 1e3}, "tolerance": 0.01})
    assert (limits.lower, limits.upper, limits.velocity, limits.tolerance) == (-3.0, [3.0, 2.0], {"a": 1e3}, 0.01)


@pytest.mark.parametrize("name", ["lag", "least_lag", "tracking", "timeout"])
def test_a_clearance_takes_none(name: str) -> None:
    given = {"use": "body-clearance", "lag": 0.1, "tracking": 0.1}
    assert ClearEntry.model_validate(given | {name: 1}).lag > 0.0
    with pytest.raises(ValidationError, match=name):
        ClearEntry.model_validate(given | {name: True})


# Every option


def models() -> Iterator[type[BaseModel]]:
    """All models of options, records and files."""
    for name in PACKAGES:
        for module in pkgutil.walk_packages(importlib.import_module(name).__path__, f"{name}."):
            if not module.name.endswith("__main__"):
                importlib.import_module(module.name)
    waiting, known = [BaseModel], set[type[BaseModel]]()
    while waiting:
        for model in waiting.pop().__subclasses__():
            if model not in known:
                known.add(model)
                waiting.append(model)
                if model.__module__.startswith(PACKAGES) and not inspect.isabstract(model):
                    yield model


def number_in(value: Any) -> bool:
    """Whether there is a number in what was read of switches alone."""
    if isinstance(value, Mapping):
        return any(map(number_in, value.values()))
    if isinstance(value, list | tuple):
        return any(map(number_in, value))
    return isinstance(value, int | float) and not isinstance(value, bool)


def read(alone: TypeAdapter[Any], given: Any) -> Any:
    """What a field makes of it by itself; None: it refuses it."""
    try:
        return alone.validate_python(given)
    except (ValidationError, OptionError):
        return None


def refuses(model: type[BaseModel], key: str, given: Any) -> bool:
    """Whether a model of which only this is given has an objection to it, not only to what is missing."""
    try:
        model.model_validate({key: given})
    except OptionError:
        return True
    except ValidationError as error:
        return any(each["loc"][:1] in ((), (key,)) for each in error.errors())
    return False


def taken(model: type[BaseModel], name: str) -> Any:
    """A form of `true` that the field takes for a number; None: it takes none."""
    field = model.model_fields[name]
    whole: Any = Annotated[field.annotation, *field.metadata, None]
    alone = TypeAdapter(whole)
    forms = (True, {"a": True}, *([True] * n for n in (1, 2, 3, 4, 6, 7)))
    found = (given for given in forms if number_in(read(alone, given)))
    return next((given for given in found if not refuses(model, field.alias or name, given)), None)


@pytest.mark.slow
def test_no_option_takes_a_switch_for_a_number() -> None:
    wrong, count = [], 0
    for model in models():
        for name in model.model_fields:
            count += 1
            if (given := taken(model, name)) is not None:
                wrong.append(f"{model.__module__}.{model.__name__}.{name}: {given}")
    assert count > 1000
    assert not wrong, f"{len(wrong)} of {count}: {wrong[:20]}"
