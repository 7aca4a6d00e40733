"""What pydantic refuses, in words of the reader's file: its keys and what they take, and no type of ours."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from srl.runtime.contracts.errors import OptionError
from srl.runtime.contracts.printable import printable

CORRECT: Final = "Correct the value"
_KEYS, _LIST = "keys with values", "a list"
_EXPECTED: Final = {
    **dict.fromkeys(("dict_type", "model_type", "mapping_type", "dataclass_type", "model_attributes_type"), _KEYS),
    **dict.fromkeys(("list_type", "tuple_type", "set_type", "frozen_set_type", "iterable_type"), _LIST),
    **dict.fromkeys(("string_type", "string_sub_type", "string_unicode"), "a text"),
    **dict.fromkeys(("int_type", "int_parsing", "int_from_float", "int_parsing_size"), "a whole number"),
    **dict.fromkeys(("float_type", "float_parsing", "fraction_parsing", "decimal_type", "decimal_parsing"), "a number"),
    **dict.fromkeys(("bool_type", "bool_parsing"), "true or false"),
    "path_type": "a file's path",
}
"""What a value of a type should be, by pydantic's word for the error."""
_NEWER: Final = "newer"
_FORMAT: Final = re.compile(r"(srl-[a-z-]+)-(\d+)")
_CHOICES: Final = ("enum", "literal_error")
_PATTERNS: Final = {
    r"^[a-z][a-z0-9_-]*$": "a lower-case letter, then lower-case letters, digits, - and _",
    r"^[a-z][a-z0-9_]*$": "a lower-case letter, then lower-case letters, digits and _",
    r"^[A-Za-z0-9_.-]{1,64}$": "1 to 64 letters, digits, _, . and -",
    r"^[A-Za-z0-9_-]{1,32}$": "1 to 32 letters, digits, _ and -",
    r"^[A-Za-z0-9_-]{0,32}$": "at most 32 letters, digits, _ and -",
    r"^([A-Za-z0-9_.\-]+)(?:\[([^,\[\]]+(?:,[^,\[\]]+)*)\])?$": "a signal as in arm.position, or arm.position[joint1]",
    r"^([^/]+/[^/]+)?$": "two names as in arm/flange",
    r"^(|/[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*)$": "names as in /lab/arm",
    "^[0-9a-f]{8}$": "8 hexadecimal digits, lower-case",
    "^[0-9A-Fa-f]{8}([0-9A-Fa-f]{8})?$": "8 or 16 hexadecimal digits",
}
# What pydantic puts into a location for the branches of a union and for validators. A model's name is one of them, too.
_OWN: Final = re.compile(
    r"constrained-|function-|literal|is-(instance|subclass)|tagged-|(str-|int-|float-)?enum|lax-or-strict|json-or-python"
    r"|.*\[.*\]$|(str|int|float|bool|bytes|none|any|date|datetime|decimal|dict|list|tuple|callable|path)$|[A-Z]\w*$"
)


@dataclass(frozen=True)
class Refusal:
    """The first thing that is wrong.

    Attributes:
        keys: of the place, as the file has them.
        problem: what is wrong, and what was expected.
        remedy: empty where the caller knows better.
        type: pydantic's word for the error.
    """

    keys: tuple[str, ...]
    problem: str
    remedy: str
    type: str

    @property
    def path(self) -> str:
        """The keys, joined."""
        return ".".join(self.keys)

    def at(self, place: str) -> str:
        """The place with the key path, if there is one."""
        return f"{place}: {self.path}" if self.keys else place

    def remedy_or(self, remedy: str) -> str:
        """The remedy: the caller's, but for a file that only a newer srl reads."""
        return self.remedy if self.type == _NEWER else remedy


def refusal(error: ValidationError, given: Any = None) -> Refusal:
    """What `error` says first. `given`: what was validated; its keys aren't pydantic's own words."""
    found = [(_keys(item, given), item) for item in error.errors(include_url=False)]
    # A union complains of each of its branches. The branch that got further is the one that was meant.
    further = {k for k, i in found if _expected(i) is None}
    meant = [(k, i) for k, i in found if not (_expected(i) and (k in further or any(_within(k, o) for o, _ in found)))]
    # A misspelt key causes two errors: the unknown key says more than the missing one.
    keys, item = min(meant, key=lambda each: each[1]["type"] != "extra_forbidden")
    same = [words for k, i in meant if k == keys and (words := _expected(i)) is not None]
    keys = tuple(map(printable, keys))
    others = len({k for k, _ in meant}) - 1
    more = f" ({others} more after this one)" if others else ""
    if item["type"] == "extra_forbidden":
        return Refusal(keys, f"the key '{keys[-1]}' isn't known here{more}", "", item["type"])
    if item["type"] == "missing" and keys[-1].isdigit():
        return Refusal(keys[:-1], f"the list is too short{more}", "Add what is missing", item["type"])
    if item["type"] == "missing":
        return Refusal(keys, f"the key '{keys[-1]}' is missing{more}", "Add it", item["type"])
    cause = item.get("ctx", {}).get("error")
    if isinstance(cause, OptionError):
        return Refusal(keys, f"{cause.problem}{more}", cause.remedy, item["type"])
    if (newer := _newer(keys, item)) is not None:
        return newer
    message = f"it should be {' or '.join(dict.fromkeys(same))}" if same else _message(item)
    return Refusal(keys, f"{message}{_shown(item)}{more}", "", item["type"])


def _newer(keys: tuple[str, ...], item: ErrorDetails) -> Refusal | None:
    """The refusal of a file whose `format` is a later one of the same kind, srl-ikns-2; None where it isn't so."""
    if keys[-1:] != ("format",) or item["type"] not in _CHOICES:
        return None
    given, known = (_FORMAT.fullmatch(str(text).strip("'")) for text in (item["input"], item["ctx"]["expected"]))
    if given is None or known is None or given[1] != known[1] or int(given[2]) <= int(known[2]):
        return None
    problem = f"it is of the format {given[0]}, and this version of srl reads {known[0]}"
    return Refusal(keys, problem, "Use the newer srl that wrote it, or calibrate again with this one", _NEWER)


def _expected(item: ErrorDetails) -> str | None:
    """What the value should be, where it is of a wrong type or none of the choices."""
    if item["type"] in _CHOICES:
        return str(item["ctx"]["expected"])
    if item["type"] == "value_error" or item["type"] not in _EXPECTED:
        return "a number" if "Fraction" in item["msg"] else None
    return _EXPECTED[item["type"]]


def _message(item: ErrorDetails) -> str:
    context = item.get("ctx", {})
    if item["type"] in ("too_short", "too_long"):
        bound = f"at most {context['max_length']}" if "max_length" in context else f"at least {context['min_length']}"
        return f"it has {context['actual_length']} entries, not {bound}"
    if item["type"] == "string_pattern_mismatch" and context["pattern"] in _PATTERNS:
        return f"it should be {_PATTERNS[context['pattern']]}"
    text = re.sub(r"^(Value error|Assertion failed), ", "", item["msg"])
    text = re.sub(r"^(Input|String|Number|Value) should\b", "it should", text)
    return f"{text[:1].lower()}{text[1:]}" if text[1:2].islower() else text


def _shown(item: ErrorDetails) -> str:
    value = item.get("input")
    huge = isinstance(value, int) and value.bit_length() > 1000  # Python doesn't write such a number
    plain = isinstance(value, str | int | float | bool) or value is None
    return f", not {repr(value)[:200]}" if plain and not huge else ""


def _keys(item: ErrorDetails, given: Any) -> tuple[str, ...]:
    """Where it is wrong, without what pydantic adds."""
    keys: list[str] = []
    *_, last = item["loc"] or ("",)
    for part in item["loc"]:
        if isinstance(given, Mapping | list | tuple):
            known = part in given if isinstance(given, Mapping) else isinstance(part, int) and part < len(given)
            if known:
                given = given[part]  # type: ignore[index]
                keys.append(str(part))
                continue
        named = item["type"] in ("missing", "extra_forbidden") and part is last
        if named or not (isinstance(part, str) and _OWN.match(part)):
            keys.append(str(part))
    return tuple(keys)


def _within(keys: Sequence[str], other: Sequence[str]) -> bool:
    """Whether the other place is below that of `keys`."""
    return len(other) > len(keys) and tuple(other[: len(keys)]) == tuple(keys)
