"""Options of a profile: unknown keys are refused, an old key is read or refused with what to write instead."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Self

from pydantic import ConfigDict, ModelWrapValidatorHandler, PrivateAttr, model_validator

from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import OptionError


class Options(BaseModel):
    """A group of options.

    Attributes:
        gone: keys that are no more, and what to write instead.
        renamed: the new key by the old one, which is still read.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    gone: ClassVar[Mapping[str, str]] = {}
    renamed: ClassVar[Mapping[str, str]] = {}
    _old_keys: tuple[str, ...] = PrivateAttr(())

    @property
    def old_keys(self) -> dict[str, str]:
        """The new key by the old one, of those old keys that were given."""
        return {old: self.renamed[old] for old in self._old_keys}

    @model_validator(mode="wrap")
    @classmethod
    def _read_old_keys(cls, value: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        if not isinstance(value, Mapping):
            return handler(value)
        for old, instead in cls.gone.items():
            if old in value:
                raise OptionError(f"the key '{old}' is gone", instead[:1].upper() + instead[1:])
        given = {}
        for key, content in value.items():
            new = cls.renamed.get(key, key)
            if new != key and new in value:
                raise OptionError(f"'{key}' and '{new}' are the same option", f"Take '{key}' out: it is the old name")
            given[new] = content
        made = handler(given)
        made._old_keys = tuple(key for key in value if key in cls.renamed)
        return made
