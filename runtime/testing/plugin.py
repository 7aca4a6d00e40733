"""The pytest plugin: the fixture `srl_run`. pytest imports this module in every run, so it imports nothing itself."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from srl.runtime.testing.lab import Lab


@pytest.fixture
def srl_run() -> Iterator[Callable[..., Lab]]:
    """Runs a profile on its fakes, cycle by cycle: `run = srl_run("plate.yaml")`; arguments as of `srl.testing.Lab`.

    What was begun in a test is closed at its end.
    """
    started: list[Lab] = []

    def begin(given: object, *overrides: str) -> Lab:
        from srl.runtime.testing.lab import Lab

        started.append(Lab(given, overrides))  # type: ignore[arg-type]
        return started[-1]

    yield begin
    for lab in started:
        lab.close()
