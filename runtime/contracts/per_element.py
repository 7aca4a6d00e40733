"""Options with a value for each joint or axis: by name, or as a list where everybody knows the order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, get_args

from pydantic import Field, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

from srl.runtime.contracts.errors import OptionError, nearest

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class Listed(tuple[Any, ...]):
    """The values of an option that was given as a list: what each of them means can't be read in the profile.

    Attributes:
        names: what each value is for.
    """

    names: tuple[str, ...]

    @classmethod
    def of(cls, values: tuple[Any, ...], names: tuple[str, ...]) -> Listed:
        """The values with their names."""
        made = cls(values)
        made.names = names
        return made


@dataclass(frozen=True)
class PerElement:
    """Marks an option of the type `tuple` as one that may be given by name; the law gets the tuple.

    For example `Annotated[tuple[Positive, Positive, Positive], PerElement(PLANAR_TWIST)]` takes `{wz: 1, vx: 2, vy: 2}`
    and `[2, 2, 1]`.

    Attributes:
        names: of the values, in the tuple's order.
        ordered: whether this order is the robot's own (joint1 to joint7) or one of the runtime's fixed terms
            (`srl.runtime.contracts.terms`), so that a list can be read.
        single: whether one number for all makes sense.
    """

    names: tuple[str, ...]
    ordered: bool = True
    single: bool = False

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        types = get_args(source)
        if types[-1] is Ellipsis:
            types = types[:1] * len(self.names)
        fields = {
            name: core_schema.typed_dict_field(handler.generate_schema(each))
            for name, each in zip(self.names, types, strict=True)
        }
        return core_schema.no_info_wrap_validator_function(
            self._validate,
            core_schema.typed_dict_schema(fields),
            serialization=core_schema.plain_serializer_function_ser_schema(tuple),
        )

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        named = handler(schema["schema"])  # the wrapped one
        value = handler.resolve_ref_schema(named)["properties"][self.names[0]]
        value = {key: entry for key, entry in value.items() if key != "title"}
        forms = [named | {"additionalProperties": False}]
        if self.ordered:
            n = len(self.names)
            forms.append({"type": "array", "items": value, "minItems": n, "maxItems": n})
        return {"anyOf": [*forms, value] if self.single else forms}

    def _validate(self, given: Any, check: Any) -> tuple[Any, ...]:
        values = in_order(given, self.names, ordered=self.ordered, single=self.single)
        checked = tuple(check(dict(zip(self.names, values, strict=True))).values())
        return Listed.of(checked, self.names) if isinstance(given, list) else checked


def in_order(
    given: Any, names: tuple[str, ...], *, size: int | None = None, ordered: bool = True, single: bool = True
) -> list[Any]:
    """The values of an option in the order of its names.

    Args:
        given: the values by name, a list of them, or one number for all.
        names: all that there are; empty if they have none.
        size: number of values, if it isn't that of the names.
        ordered: whether a list can be read.
        single: whether one number may stand for all.
    Raises:
        OptionError: a name is unknown or missing, or the form is another one.
    """
    size = len(names) if size is None else size
    listed = ", ".join(names)
    all_alike = ", or give one number for all" if single else ""
    if isinstance(given, Mapping):
        if unknown := [name for name in given if name not in names]:
            raise OptionError(f"no element is called '{unknown[0]}'", nearest(str(unknown[0]), names))
        if missing := [name for name in names if name not in given]:
            raise OptionError(f"'{missing[0]}' is missing; there are {listed}", f"Name each once{all_alike}")
        return [given[name] for name in names]
    if isinstance(given, list | tuple):
        if isinstance(given, list) and not ordered and size > 1 and names:
            example = ", ".join(f"{name}: {_short(value)}" for name, value in zip(names, given, strict=False))
            problem = "a list goes by place, and the order of these isn't the robot's own"
            raise OptionError(problem, f"Name them: {{{example}}}")
        if len(given) != size:
            of = f" ({listed})" if names else ""
            raise OptionError(f"{len(given)} values for {size} elements{of}", f"Give one for each{all_alike}")
        return list(given)
    if single or size == 1:
        return [given] * size
    example = ", ".join(f"{name}: {_short(given)}" for name in names)
    raise OptionError(f"a value for each of {listed} is expected, not {given!r}", f"Name them, as in {{{example}}}")


def _short(value: Any) -> str:
    return f"{value:g}" if isinstance(value, int | float) else str(value)
