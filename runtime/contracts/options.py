"""Options of a profile: unknown keys are refused, and an old key with the place of what it said."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from pydantic import ConfigDict, model_validator

from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import OptionError


class Options(BaseModel):
    """A group of options.

    Attributes:
        gone: old keys, and what to write instead.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    gone: ClassVar[Mapping[str, str]] = {}

    @model_validator(mode="before")
    @classmethod
    def _old_keys(cls, value: Any) -> Any:
        if isinstance(value, Mapping):
            for old in cls.gone:
                if old in value:
                    raise OptionError(f"the key '{old}' is gone", cls.gone[old][:1].upper() + cls.gone[old][1:])
        return value
