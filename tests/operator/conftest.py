"""A made-up loop, and a panel of it that nobody has opened yet."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from helpers.operated import OperatedLoop

from runtime.ipc.words import State
from runtime.operator.client import OperatorPage


@pytest.fixture(scope="module")
def loop(tmp_path_factory: pytest.TempPathFactory) -> Iterator[OperatedLoop]:
    with OperatedLoop(tmp_path_factory.mktemp("o") / "made-up").running() as made:
        yield made


@pytest.fixture(scope="module")
def process(loop: OperatedLoop, tmp_path_factory: pytest.TempPathFactory) -> Iterator[OperatorPage]:
    with OperatorPage(loop.folder, tmp_path_factory.mktemp("recordings")) as made:
        yield made


@pytest.fixture
def page(loop: OperatedLoop, process: OperatorPage) -> OperatorPage:
    """A panel that nobody has opened yet, of an active run."""
    loop.state, loop.refuses = State.ACTIVE, ""
    loop.asked.clear()
    loop.judged.clear()
    loop.presses.clear()
    process.new_address()
    return process
