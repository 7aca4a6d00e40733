"""The JSON Schema for editors: it takes all shipped profiles, and finds misspelt options of devices, laws and parts."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from functools import cache
from typing import Any

import jsonschema
import pytest
from ruamel.yaml import YAML

from srl.runtime.cli import main
from srl.runtime.contracts import registry
from srl.runtime.profile import library
from srl.runtime.profile.schema import schema

PROFILES = sorted(library.files())


@cache
def validator() -> jsonschema.Draft202012Validator:
    made = schema()
    jsonschema.Draft202012Validator.check_schema(made)
    return jsonschema.Draft202012Validator(made)


def plain(name: str) -> dict[str, Any]:
    text = library.files()[name].read_text(encoding="utf-8")
    made: dict[str, Any] = json.loads(json.dumps(YAML(typ="safe", pure=True).load(text), default=str))
    return made


def entries(tree: dict[str, Any], path: tuple[str, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Where devices, laws, clearances, the world and its parts are, those of choices, too."""
    yield from ((*path, "devices", name) for name in tree.get("devices", {}))
    yield from ((*path, "controllers", i) for i in range(len(tree.get("controllers", []))))
    guards = tree.get("guard", {}).items()
    yield from ((*path, "guard", name, "clear") for name, each in guards if isinstance(each.get("clear"), dict))
    yield from ((*path, "sim", "parts", name) for name in (tree.get("sim") or {}).get("parts", {}))
    for choice, branches in tree.get("choices", {}).items():
        for word, branch in branches.items():
            yield from entries(branch, (*path, "choices", choice, word))


def at(tree: Any, path: tuple[str | int, ...]) -> Any:
    for key in path:
        tree = tree[key]
    return tree


@pytest.mark.parametrize("name", PROFILES)
def test_it_takes_the_shipped_profile(name: str) -> None:
    assert [f"{list(e.absolute_path)}: {e.message}" for e in validator().iter_errors(plain(name))] == []


@pytest.mark.parametrize("name", ["human-srl", "moca-man", "sixth-finger", "ikns-finger"])
def test_a_misspelt_option_of_any_entry_is_found(name: str) -> None:
    tree, count = plain(name), 0
    for path in entries(tree):
        kind = at(tree, path)
        if not {"driver", "use", "part"} & set(kind):
            continue  # a piece of an entry: the file's other part says whose
        for key in set(kind) - {"driver", "use", "part"}:
            wrong = copy.deepcopy(tree)
            entry = at(wrong, path)
            entry[f"{key}_"] = entry.pop(key)
            assert not validator().is_valid(wrong), (path, key)
            count += 1
    assert count > 10


def test_a_value_of_another_type_and_an_unknown_law_are_found() -> None:
    tree = plain("human-srl")
    for path, key, value in (
        (("controllers", 0), "use", "skeletton"),
        (("guard", "arm.position_command", "clear"), "least", "wide"),
        (("devices", "arm"), "baudrate", "fast"),
        ((), "start", "later"),
    ):
        wrong = copy.deepcopy(tree)
        at(wrong, path)[key] = value
        assert not validator().is_valid(wrong), (path, key)


def test_an_old_key_is_taken_and_marked() -> None:
    law = next(
        rule["then"]["properties"]
        for rule in schema()["$defs"]["ControllerEntry"]["allOf"]
        if rule["if"]["properties"]["use"]["const"] == "independent-operation"
    )
    assert law["patience"]["deprecated"]
    assert "timeout" in law["patience"]["description"]


def test_each_key_driver_law_and_part_is_described(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "--schema"]) == 0
    made = json.loads(capsys.readouterr().out)
    for key, given in made["properties"].items():
        assert given.get("description"), key
    for group, entry, key in (("drivers", "DeviceEntry", "driver"), ("controllers", "ControllerEntry", "use")):
        every = made["$defs"][entry]["properties"][key]["anyOf"]
        known = {each["const"]: each["description"] for each in every if "const" in each}
        assert set(known) == set(registry.names(group))
        assert all(known.values()), [name for name, text in known.items() if not text]


def test_it_is_json_that_any_editor_reads() -> None:
    """JSON has neither Infinity nor NaN, which Python would write."""
    json.dumps(schema(), allow_nan=False)
