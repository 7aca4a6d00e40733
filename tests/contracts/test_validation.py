"""What is refused is said in words of the reader's file; pydantic's own types and branches aren't in it."""

from __future__ import annotations

import re
from enum import StrEnum
from fractions import Fraction
from typing import Annotated, Any, Literal

import pytest
from pydantic import ConfigDict, Field, PositiveFloat, ValidationError

from srl.runtime.cli.check import examine
from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import SrlError
from srl.runtime.contracts.validation import Refusal, refusal
from srl.runtime.profile import library

OWN = re.compile(
    r"constrained|str-enum|literal|tagged|function-|dictionary|tuple|instance of|Fraction object|validation|Input"
    r"|pydantic|list\[|dict\[|\.(str|int|float|bool)\b",
    re.IGNORECASE,
)


class Stop(StrEnum):
    HOLD = "hold"
    LIMP = "limp"


class Part(BaseModel):
    model_config = ConfigDict(extra="forbid")
    mass: PositiveFloat


class Everything(BaseModel):
    model_config = ConfigDict(extra="forbid")
    stop: Stop | dict[str, Stop] = Stop.HOLD
    limit: PositiveFloat | list[PositiveFloat] | dict[str, PositiveFloat] = 1.0
    part: Part | str = ""
    rate: Fraction = Fraction(1)
    sensors: Literal[18, 22] = 18
    pair: tuple[float, float] = (0.0, 0.0)
    few: Annotated[tuple[float, ...], Field(min_length=1, max_length=2)] = (1.0,)
    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_-]*$")] = "a"
    joints: dict[str, float] = Field(default_factory=dict)


def refused(given: dict[str, Any]) -> Refusal:
    with pytest.raises(ValidationError) as caught:
        Everything.model_validate(given)
    return refusal(caught.value, given)


@pytest.mark.parametrize(
    ("given", "path", "problem"),
    [
        ({"stop": "wait"}, "stop", "it should be 'hold' or 'limp' or keys with values, not 'wait'"),
        ({"stop": {"arm": "wait"}}, "stop.arm", "it should be 'hold' or 'limp', not 'wait'"),
        ({"limit": "x"}, "limit", "it should be a number or a list or keys with values, not 'x'"),
        ({"limit": -1}, "limit", "it should be greater than 0, not -1"),
        ({"limit": [1.0, "x"]}, "limit.1", "it should be a number, not 'x'"),
        ({"part": 7}, "part", "it should be keys with values or a text, not 7"),
        ({"part": {"mas": 1.0}}, "part.mas", "the key 'mas' isn't known here (1 more after this one)"),
        ({"part": {}}, "part.mass", "the key 'mass' is missing"),
        ({"rate": []}, "rate", "it should be a number"),
        ({"sensors": 20}, "sensors", "it should be 18 or 22, not 20"),
        ({"pair": [1.0]}, "pair", "the list is too short"),
        ({"pair": {"x": 1}}, "pair", "it should be a list"),
        ({"few": []}, "few", "it has 0 entries, not at least 1"),
        ({"few": [1, 2, 3]}, "few", "it has 3 entries, not at most 2"),
        (
            {"name": "A B"},
            "name",
            "it should be a lower-case letter, then lower-case letters, digits, - and _, not 'A B'",
        ),
        ({"joints": {"Part": "x"}}, "joints.Part", "it should be a number, not 'x'"),
    ],
)
def test_it_says_where_and_what_belongs_there(given: dict[str, Any], path: str, problem: str) -> None:
    found = refused(given)
    assert (found.path, found.problem) == (path, problem)


WRONG = ("wrong", "-1e9", "[]", "{}", "{odd: 1}", "[{odd: 1}]", "null", "true")


@pytest.mark.parametrize(
    ("profile", "path"),
    [
        ("sixth-finger", "name"), ("sixth-finger", "rate"), ("sixth-finger", "devices"),
        ("sixth-finger", "devices.finger"), ("sixth-finger", "devices.finger.robot"), ("sixth-finger", "stop"),
        ("sixth-finger", "devices.finger.servos.abduction.lower"), ("sixth-finger", "controllers"),
        ("sixth-finger", "stop.finger"), ("sixth-finger", "record.plots"), ("sixth-finger", "faults"),
        ("sixth-finger", "sim.parts"), ("moca-man", "clock"), ("moca-man", "devices.arm.collision"),
        ("moca-man", "frames.handle"), ("moca-man", "bus"), ("moca-man", "emergency"),
    ],
)  # fmt: skip
def test_no_error_of_a_profile_has_a_word_of_the_library(profile: str, path: str) -> None:
    """Whatever is written in a key's place, what is said of it is for who wrote it."""
    assert profile in library.shipped()
    refusals = 0
    for value in WRONG:
        try:
            examine(profile, [f"{path}={value}"], [])
        except SrlError as error:
            refusals += 1
            said = f"{error.place}: {error.problem}"
            assert not OWN.search(said.replace(value, "")), said
    assert refusals > len(WRONG) / 2


def test_a_remedy_that_asks_ends_as_a_question() -> None:
    assert str(SrlError("bus", "nobody is there", "Is it running?")) == "bus: nobody is there. Is it running?"
    assert str(SrlError("bus", "it has ended.", "Start it")) == "bus: it has ended. Start it."
