"""JSON Schema of a profile, for editors: with the options of every installed driver, control law and clearance."""

from __future__ import annotations

from typing import Any, Final

from srl.runtime.contracts import code_file, registry
from srl.runtime.profile.profile import Profile

_ENTRIES: Final = (
    ("drivers", "DeviceEntry", "driver"),
    ("controllers", "ControllerEntry", "use"),
    ("clearances", "ClearEntry", "use"),
    ("worlds", "SimEntry", "world"),
)  # fmt: skip
_SECTIONS: Final = ("devices", "setpoints", "controllers", "guard", "frames", "sim")  # of a choice, checked in parts


def schema() -> dict[str, Any]:
    """The schema. A key that neither the runtime nor the named driver or law has is an error in it.

    What a choice adds is merged when the file is read, so what such a branch leaves out isn't missed here. A key of
    the file's first level that isn't known may be the word of a choice, so it must be a word.
    """
    content = Profile.model_json_schema(by_alias=True)
    content["additionalProperties"] = {"type": "string", "description": "which of the named `choices` is made"}
    definitions = content["$defs"]
    for group, entry, key in _ENTRIES:
        made = definitions[entry]
        rules, known = _rules(group, key, list(made["properties"]), definitions)
        made["allOf"] = rules
        if group in ("drivers", "controllers"):
            known.append({"pattern": code_file.PATTERN, "description": "a class in a file beside the profile"})
        made["properties"][key] = made["properties"][key] | {"anyOf": known}
    rules, known = _rules("parts", "part", ["part"], definitions)
    part = {"type": "object", "properties": {"part": {"anyOf": known}}, "required": ["part"], "allOf": rules}
    for rule in definitions["SimEntry"]["allOf"]:
        if parts := rule["then"]["properties"].get("parts"):
            parts["additionalProperties"] = part
    # The branch of a choice is a piece of a profile, in which an entry may be a piece, too.
    definitions |= {f"{name}.piece": _piece(each) for name, each in list(definitions.items())}
    branch = {section: _piece(content["properties"][section]) for section in _SECTIONS}
    each = content["properties"]["choices"]["additionalProperties"]["additionalProperties"]
    each["properties"] = branch
    return content


def _rules(group: str, key: str, common: list[str], definitions: dict[str, Any]) -> tuple[list[Any], list[Any]]:
    """Of each member of a group that is named at `key`: which keys there may be, and what it is."""
    rules, known = list[Any](), list[Any]()
    for name in registry.names(group):
        kind = registry.load(group, name, f"{group} {name}")
        options = _own(kind.Config.model_json_schema(), f"{group}.{name}.", definitions)
        then: dict[str, Any] = {
            "properties": dict.fromkeys(common, True) | options.get("properties", {}),
            "required": options.get("required", []), "additionalProperties": False,
        }  # fmt: skip
        rules.append({"if": {"properties": {key: {"const": name}}, "required": [key]}, "then": then})
        known.append({"const": name, "description": getattr(kind, "summary", "") or _first(kind)})
    return rules, known


def _piece(value: Any) -> Any:
    """The same where nothing is required, with references to such definitions."""
    if isinstance(value, list):
        return [_piece(each) for each in value]
    if not isinstance(value, dict):
        return value
    made = {}
    for key, each in value.items():
        if key == "if":
            made[key] = each
        elif key == "$ref":
            made[key] = f"{each}.piece"
        elif key not in ("required", "minProperties", "minItems") or not isinstance(each, list | int):
            made[key] = _piece(each)
    return made


def _first(kind: type) -> str:
    """The first line of what it says of itself."""
    return (kind.__doc__ or "").strip().partition("\n")[0]


def _own(options: dict[str, Any], prefix: str, definitions: dict[str, Any]) -> dict[str, Any]:
    """The options, whose definitions are added; one that another has under the same name gets a name of its own."""
    given = options.pop("$defs", {})
    names = {name: name if definitions.get(name, each) == each else prefix + name for name, each in given.items()}

    def pointed(value: Any) -> Any:
        if isinstance(value, dict):
            made = {k: pointed(v) for k, v in value.items()}
            reference = made.get("$ref")
            if isinstance(reference, str):
                made["$ref"] = "#/$defs/" + names.get(name := reference.removeprefix("#/$defs/"), name)
            return made
        return [pointed(each) for each in value] if isinstance(value, list) else value

    definitions |= {names[name]: pointed(each) for name, each in given.items()}
    made: dict[str, Any] = pointed(options)
    return made
