"""Old keys of options: read, named, refused together with the new ones, and never in the way of an error's place."""

from __future__ import annotations

from typing import ClassVar

import pytest
from pydantic import Field, ValidationError

from srl.runtime.contracts.options import Options, old_keys


class Inner(Options):
    renamed: ClassVar[dict[str, str]] = {"told": "instructed"}

    instructed: bool = False


class Outer(Options):
    renamed: ClassVar[dict[str, str]] = {"leash": "max_following_error"}

    max_following_error: float = Field(0.3, gt=0)
    inner: Inner = Inner()
    several: dict[str, Inner] = Field(default_factory=dict)


class Mine(Outer):
    renamed: ClassVar[dict[str, str]] = {"pace": "speed"}

    speed: float = 1.0


def test_an_old_key_is_read_wherever_it_is_and_named_with_its_place() -> None:
    given = {"leash": 0.2, "inner": {"told": True}, "several": {"a": {"told": True}}}
    made = Outer.model_validate(given)
    assert (made.max_following_error, made.inner.instructed, made.several["a"].instructed) == (0.2, True, True)
    assert dict(old_keys(made, "law")) == {
        "law.leash": "max_following_error", "law.inner.told": "instructed", "law.several.a.told": "instructed",
    }  # fmt: skip
    new = {"max_following_error": 0.2, "inner": {"instructed": True}, "several": {"a": {"instructed": True}}}
    assert made == Outer.model_validate(new)
    assert not dict(old_keys(Outer.model_validate(new), "law"))


def test_options_of_a_package_keep_the_old_keys_of_those_they_derive_from() -> None:
    made = Mine.model_validate({"leash": 0.2, "pace": 2.0})
    assert (made.max_following_error, made.speed) == (0.2, 2.0)


def test_both_names_at_once_are_refused() -> None:
    with pytest.raises(ValidationError, match="'leash' and 'max_following_error' are the same option"):
        Outer.model_validate({"leash": 0.2, "max_following_error": 0.3})


def test_an_error_names_the_key_that_was_given() -> None:
    with pytest.raises(ValidationError) as caught:
        Outer.model_validate({"leash": -1.0, "other": 1, "inner": {"instructed": "perhaps"}})
    places = {each["loc"] for each in caught.value.errors()}
    assert places == {("leash",), ("other",), ("inner", "instructed")}
