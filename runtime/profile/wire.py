"""One wire of a profile's `in:` or `out:`: the signals at its far end, and other names for their elements."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

from pydantic import BeforeValidator, ConfigDict, Field, field_validator

from srl.runtime.contracts.entry import BaseModel


class Wire(BaseModel):
    """The far end of a controller's input or output, with the keys that both kinds share.

    Attributes:
        signals: the full names of the signals.
        map: the far element of each of the controller's own that has another name there.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)

    signals: tuple[str, ...]
    map: dict[str, str] = Field(default_factory=dict, description="own element: element at the other end")

    @field_validator("signals", mode="before")
    @classmethod
    def _listed(cls, value: Any) -> Any:
        return (value,) if isinstance(value, str) else value

    @field_validator("signals")
    @classmethod
    def _once(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        if not value or len(set(value)) < len(value):
            raise ValueError("must name at least one signal, and each once")
        return value


class From(Wire):
    """`in.<input>`: `device.signal`, or `{from: device.signal, map: {A: green}}`; `from` may list several signals."""

    signals: Annotated[tuple[str, ...], Field(alias="from", json_schema_extra={"type": ["string", "array"]})]


class To(Wire):
    """`out.<output>`: `device.command`, or `{to: device.command, map: {q1: knee}}`; `to` may list several commands."""

    signals: Annotated[tuple[str, ...], Field(alias="to", json_schema_extra={"type": ["string", "array"]})]


def _long(key: str) -> Callable[[Any], Any]:
    return lambda value: {key: value} if isinstance(value, str) else value


Input = Annotated[From, BeforeValidator(_long("from"), json_schema_input_type=str | From)]
Output = Annotated[To, BeforeValidator(_long("to"), json_schema_input_type=str | To)]
