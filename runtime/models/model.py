"""The base of the descriptions that a profile's `models:` has."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import ConfigDict, ValidationError, ValidationInfo

from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import OptionError

M = TypeVar("M", bound=BaseModel)


class Model(BaseModel):
    """A description. Made without options it is the standard one of its kind, which goes by the kind's name."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: str = ""


def made(kind: type[M], given: Mapping[str, Any], info: ValidationInfo) -> M:
    """Makes a description within the validation of something else. Raises OptionError or ValidationError."""
    try:
        return kind.model_validate(dict(given), context=info.context)
    except ValidationError as error:
        first = error.errors()[0]
        cause = first.get("ctx", {}).get("error")
        where = ".".join(map(str, first["loc"]))
        if isinstance(cause, OptionError):
            raise OptionError(f"{where}: {cause.problem}" if where else cause.problem, cause.remedy) from None
        raise
