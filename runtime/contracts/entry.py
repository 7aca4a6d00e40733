"""The base of everything that a profile's entries and options are checked by: numbers are numbers.

pydantic takes `true` for 1. In a profile that is a slip of the pen, and `velocity: true` is a limit of 1 rad/s.
"""

from __future__ import annotations

from typing import Any

import pydantic
from pydantic import GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema

_OPAQUE = ("metadata", "serialization", "config", "cls", "function", "default")  # keys whose values are no schemas


def _no_switch(value: Any) -> Any:
    if isinstance(value, bool):
        raise ValueError(f"{str(value).lower()} is a switch, not a number")
    return value


def _guarded(node: Any) -> Any:
    """The same schema with each number in it guarded."""
    if isinstance(node, list | tuple):
        return type(node)(_guarded(each) for each in node)
    if not isinstance(node, dict):
        return node
    kind = node.get("type")
    if kind in ("float", "int") or (kind == "literal" and _numeric(node["expected"])):
        return core_schema.no_info_before_validator_function(_no_switch, node)
    if kind == "function-before" and node["function"]["function"] is _no_switch:
        return node  # of a model within a model
    return {key: value if key in _OPAQUE else _guarded(value) for key, value in node.items()}


def _numeric(expected: list[Any]) -> bool:
    return any(isinstance(e, int) for e in expected) and not any(isinstance(e, bool) for e in expected)


class BaseModel(pydantic.BaseModel):
    """pydantic's, whose fields of numbers refuse a switch, wherever they are: in lists, by name, in unions."""

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        made: CoreSchema = _guarded(handler(source))
        return made
