"""Options with a value for each joint or axis: by name in any order, as a list where the order is known."""

from __future__ import annotations

from itertools import permutations
from typing import Annotated, Any

import pytest
from pydantic import BaseModel, ValidationError

from srl.runtime.contracts.per_element import Listed, PerElement, Positive
from srl.runtime.contracts.terms import PLANAR_TWIST


class Some(BaseModel):
    """Options of each kind."""

    speed: Annotated[tuple[Positive, Positive, Positive], PerElement(PLANAR_TWIST)] | None = None
    chosen: Annotated[tuple[float, ...], PerElement(("a", "b"), ordered=False)] = (0.0, 0.0)
    torque: Annotated[tuple[Positive, ...], PerElement(("joint1", "joint2"), single=True)] = (1.0, 1.0)


@pytest.mark.parametrize("order", list(permutations(PLANAR_TWIST)))
def test_names_say_it_whatever_their_order(order: tuple[str, ...]) -> None:
    values = dict(zip(PLANAR_TWIST, (1.0, 2.0, 3.0), strict=True))
    found = Some(speed={name: values[name] for name in order}).speed  # type: ignore[arg-type]
    assert found == (1.0, 2.0, 3.0)
    assert not isinstance(found, Listed)


def test_a_list_is_taken_where_the_order_is_known_and_remembers_its_names() -> None:
    found = Some(speed=[1, 2, 3]).speed  # type: ignore[arg-type]
    assert isinstance(found, Listed)
    assert (found, found.names) == ((1.0, 2.0, 3.0), PLANAR_TWIST)
    assert Some(speed=None).speed is None
    assert Some(torque=20).torque == (20.0, 20.0)  # type: ignore[arg-type]
    assert Some(chosen={"b": 2, "a": 1}).chosen == (1.0, 2.0)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("given", "place", "text"),
    [
        ({"speed": {"vx": 1, "vy": 1, "wy": 1}}, ("speed",), "no element is called 'wy'. Known: vx, vy, wz"),
        ({"speed": {"vx": 1, "vy": 1}}, ("speed",), "'wz' is missing; there are vx, vy, wz"),
        ({"speed": {"vx": 1, "vy": -1, "wz": 1}}, ("speed", "vy"), "greater than 0"),
        ({"speed": [1, 1, -1]}, ("speed", "wz"), "greater than 0"),
        ({"speed": [1, 1]}, ("speed",), "2 values for 3 elements (vx, vy, wz)"),
        ({"speed": 1}, ("speed",), "a value for each of vx, vy, wz is expected, not 1. Name them, as in {vx: 1"),
        ({"chosen": [1, 2]}, ("chosen",), "a list goes by place, and the order of these isn't the robot's own"),
        ({"torque": [1]}, ("torque",), "Give one for each, or give one number for all"),
        ({"torque": "x"}, ("torque", "joint1"), "valid number"),
    ],
)
def test_what_cannot_be_meant_is_refused(given: dict[str, Any], place: tuple[str, ...], text: str) -> None:
    with pytest.raises(ValidationError) as caught:
        Some.model_validate(given)
    first = caught.value.errors()[0]
    assert first["loc"] == place
    assert text in first["msg"]


def test_the_schema_has_every_form() -> None:
    found = Some.model_json_schema()["properties"]
    forms = [form["type"] for form in found["torque"]["anyOf"]]
    assert forms == ["object", "array", "number"]
    assert found["torque"]["default"] == [1.0, 1.0]
    assert [form["type"] for form in found["chosen"]["anyOf"]] == ["object"]
    assert set(found["speed"]["anyOf"][0]["properties"]) == set(PLANAR_TWIST)
