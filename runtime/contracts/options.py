"""Options of a profile: unknown keys are refused, an old key is read or refused with what to write instead."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar, Self

from pydantic import (
    ConfigDict,
    GetJsonSchemaHandler,
    ModelWrapValidatorHandler,
    PrivateAttr,
    ValidationError,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, InitErrorDetails

from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import OptionError


class Options(BaseModel):  # noqa: PLW1641  (pydantic makes the hash of a frozen model)
    """A group of options.

    Attributes:
        gone: keys that are no more, and what to write instead.
        renamed: the new key by the old one, which is still read. Those of base classes count, too.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    gone: ClassVar[Mapping[str, str]] = {}
    renamed: ClassVar[Mapping[str, str]] = {}
    _old_keys: tuple[str, ...] = PrivateAttr(())

    def __eq__(self, other: object) -> bool:
        """Whether the options are the same, by whatever names they were given."""
        return type(self) is type(other) and self.__dict__ == other.__dict__

    @classmethod
    def new_keys(cls) -> dict[str, str]:
        """The new key by the old one, of all that are read."""
        found: dict[str, str] = {}
        for base in reversed(cls.__mro__):
            found |= vars(base).get("renamed", {})
        return found

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """With the old keys, marked as such."""
        made = handler.resolve_ref_schema(handler(schema))
        for old, new in cls.new_keys().items():
            made.setdefault("properties", {})[old] = {"deprecated": True, "description": f"the old name of `{new}`"}
            made["required"] = [key for key in made.get("required", ()) if key != new]
        return made

    @model_validator(mode="wrap")
    @classmethod
    def _read_old_keys(cls, value: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        if not isinstance(value, Mapping):
            return handler(value)
        for old, instead in cls.gone.items():
            if old in value:
                raise OptionError(f"the key '{old}' is gone", instead[:1].upper() + instead[1:])
        names = cls.new_keys()
        old_by_new = {names[key]: key for key in value if key in names}
        for new, key in old_by_new.items():
            if new in value:
                raise OptionError(f"'{key}' and '{new}' are the same option", f"Take '{key}' out: it is the old name")
        if not old_by_new:
            return handler(value)
        try:
            made = handler({names.get(key, key): content for key, content in value.items()})
        except ValidationError as error:
            raise _by_given_names(error, old_by_new) from None
        made._old_keys = tuple(old_by_new.values())
        return made


def _by_given_names(error: ValidationError, old_by_new: Mapping[str, str]) -> ValidationError:
    """The error with the keys that are in the file."""
    details: list[InitErrorDetails] = []
    for each in error.errors(include_url=False):
        first, *rest = each["loc"] or ("",)
        loc = (old_by_new.get(str(first), first), *rest) if each["loc"] else ()
        details.append({"type": each["type"], "loc": loc, "input": each["input"], "ctx": each.get("ctx", {})})
    return ValidationError.from_exception_data(error.title, details)


def old_keys(options: object, path: str) -> Iterator[tuple[str, str]]:
    """Path and new name of each old key that was given in options, whatever they hold.

    Args:
        options: a group of options, or what is in one.
        path: its key in the profile.
    """
    if isinstance(options, BaseModel):
        if isinstance(options, Options):
            names = options.new_keys()
            for old in options._old_keys:
                yield f"{path}.{old}", names[old]
        for name in type(options).model_fields:
            yield from old_keys(getattr(options, name), f"{path}.{name}")
    elif isinstance(options, Mapping):
        for key, each in options.items():
            yield from old_keys(each, f"{path}.{key}")
    elif isinstance(options, Sequence) and not isinstance(options, str | bytes):
        for i, each in enumerate(options):
            yield from old_keys(each, f"{path}.{i}")
