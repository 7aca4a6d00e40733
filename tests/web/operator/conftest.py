"""A made-up loop, and a panel of it: one that nobody has opened yet, or in a browser."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from helpers.chromium import Chromium
from helpers.operated import OperatedLoop
from helpers.operator_seen import Seen
from helpers.wait import until

from srl.runtime.ipc.header import LINK_ACTIVE, LINK_CONNECTED, Cause, Latch, State
from srl.runtime.web.operator.client import OperatorPage


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


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    with Chromium(tmp_path_factory.mktemp("chromium")) as made:
        yield made


@pytest.fixture
def seen(loop: OperatedLoop, process: OperatorPage, browser: Chromium) -> Iterator[Seen]:
    """A tab of its own, of a run that is active and well."""
    loop.state, loop.cause, loop.latches, loop.refuses = State.ACTIVE, Cause.NONE, Latch(0), ""
    loop.link, loop.stops = LINK_CONNECTED | LINK_ACTIVE, 0
    loop.asked.clear()
    loop.presses.clear()
    page = browser.open(process.new_address())
    page.ask("Emulation.setFocusEmulationEnabled", enabled=True)
    made = Seen(loop, process, page)
    until(lambda: made.now("condition") == "live" and made.now("takes"), timeout=100.0)
    yield made
    page.close()
