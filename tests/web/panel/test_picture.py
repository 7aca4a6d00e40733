"""The live picture in a real browser: what it draws is what the loop's rows say, and what is wrong is seen."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.body_run import CAPSULES, TREE, body_layout, upright
from helpers.chromium import NO_WEBGL, Chromium
from helpers.panel import MadeUpLoop
from helpers.picture_seen import ROWS, BodyLoop, Seen
from helpers.wait import until

from srl.runtime.contracts.errors import HostError
from srl.runtime.ipc.header import LINK_CONNECTED, LINK_STALE, State
from srl.runtime.recording.shapes import PERSON, RAMP, UNKNOWN, distance_colors
from srl.runtime.web.operator.client import OperatorPage as PageProcess
from srl.runtime.web.panel.picture import View

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    with Chromium(tmp_path_factory.mktemp("chromium")) as made:
        yield made


@pytest.fixture
def loop(tmp_path: Path) -> BodyLoop:
    return BodyLoop(tmp_path / "run")


@pytest.fixture
def seen(loop: BodyLoop, browser: Chromium) -> Iterator[Seen]:
    """The flat picture, whose colours are those of the things."""
    with loop.running(), PageProcess(loop.folder) as process:
        page = browser.open(process.address, NO_WEBGL)
        made = Seen(loop, process, page)
        made.until("condition", "live")
        until(lambda: made.now("drawn"))
        yield made
        page.close()


def same(shown: np.ndarray, values: np.ndarray) -> bool:
    return shown.shape == values.shape and bool(np.allclose(shown, values, atol=6e-5, equal_nan=True))


def test_nodes_segments_and_capsules_are_drawn_where_the_rows_have_them(seen: Seen) -> None:
    layout = seen.loop.layout
    for at in (0, 120, 200):
        seen.loop.at = at
        nodes = upright(layout.value(ROWS[at], "skeleton.nodes")).ravel()
        until(lambda nodes=nodes: same(seen.things()["skeleton.nodes"], nodes))
        solids = layout.value(ROWS[at], "collision.envelope")
        shown = seen.things()["collision.envelope"].reshape(-1, 8)
        assert same(shown[:, :3], upright(solids[:, :3]))
        assert same(shown[:, 3:6], upright(solids[:, 3:6]))
        assert same(shown[:, 6:], solids[:, 6:])
        assert seen.now("drawn") == {"points": 90, "links": 89, "capsules": len(CAPSULES) + 1}  # and one gap


def test_body_and_arm_have_colours_of_their_own_and_a_legend(seen: Seen) -> None:
    names = ["body", "right SRL", "left SRL", "envelope (collision)", "closest (collision)"]
    assert [name.strip() for name in seen.text("legend").split("\n") if name.strip()] == names
    assert "no WebGL" in seen.text("flat")
    found = seen.colors()
    assert {PERSON, (230, 159, 0), (0, 158, 115)} <= found
    assert "touches" in seen.text("ramp")
    seen.page.value("document.querySelectorAll('#legend button')[1].click()")
    until(lambda: (230, 159, 0) not in seen.colors())
    assert PERSON in seen.colors()


def test_a_distance_has_the_ramps_colour_on_the_page_too(seen: Seen) -> None:
    for distance in (-0.2, 0.0, 0.04, 0.1, 0.2, 0.3, 2.0, None):
        shown = seen.page.value(
            "import('/part.js').then(({ shade }) => "
            f"shade({json.dumps(RAMP)}, {list(UNKNOWN)}, {json.dumps(distance)}))"
        )
        wanted = distance_colors(np.array([np.nan if distance is None else distance]))[0]
        assert np.allclose(shown, wanted, atol=1), distance


def test_curves_come_from_the_profile_the_commands_and_the_loop(seen: Seen) -> None:
    plots = {title: labels for title, labels, _ in seen.now("plots")}
    assert plots == {
        "Distance": ["arm"], "position (arm)": [f"J{i}" for i in range(1, 8)], "Loop": ["period", "cycle"],
    }  # fmt: skip
    before = {title: n for title, _, n in seen.now("plots")}
    until(lambda: all(n > before[title] for title, _, n in seen.now("plots")))


def test_the_eye_turns_with_the_mouse_and_the_buttons(seen: Seen) -> None:
    before = seen.now("turn")
    for kind, x in (("mousePressed", 500), ("mouseMoved", 600), ("mouseReleased", 600)):
        seen.page.ask("Input.dispatchMouseEvent", type=kind, x=x, y=400, button="left", buttons=1, clickCount=1)
    until(lambda: seen.now("turn") == pytest.approx(before - 0.8))
    seen.page.value("document.getElementById('side').click()")
    until(lambda: seen.now("turn") == pytest.approx(-np.pi / 2))


@pytest.mark.parametrize(
    ("change", "condition", "words"),
    [
        ({"link": LINK_CONNECTED | LINK_STALE}, "held", "Nothing new from suit"),
        ({"state": State.STOPPED}, "stopped", "The limb is stopped"),
    ],
)
def test_what_is_wrong_is_said(seen: Seen, change: dict[str, Any], condition: str, words: str) -> None:
    until(lambda: seen.text("warning") == "")  # on a busy machine the picture may be late for a moment
    before = {name: getattr(seen.loop, name) for name in change}
    vars(seen.loop).update(change)
    seen.until("condition", condition)
    until(lambda: words in seen.text("warning"))
    until(lambda: seen.now("current"))  # rows come, so what is drawn is of now
    law = "state" not in change  # no law runs while the limb is stopped: what they gave is drawn as old
    until(lambda: {now for *_, now in seen.now("things")} == {law})
    assert ({PERSON, (230, 159, 0)} <= seen.colors()) == law
    until(lambda: ("Grey: as it was" in seen.text("warning")) != law)
    vars(seen.loop).update(before)
    seen.until("condition", "live")
    until(lambda: seen.text("warning") == "")


def test_a_loop_that_hangs_is_grey_and_the_next_run_is_shown(loop: BodyLoop, browser: Chromium) -> None:
    with PageProcess(loop.folder) as process:
        with loop.running():
            seen = Seen(loop, process, browser.open(process.address, NO_WEBGL))
            seen.until("condition", "live")
        seen.until("condition", "silent")
        assert "no" in seen.text("warning")
        seen.until("current", False)
        assert not {PERSON, (230, 159, 0)} & seen.colors()
        loop.ring.finish()
        seen.until("condition", "ended")
        assert "The run is over" in seen.text("warning")
        loop.begin()
        with loop.running():
            seen.until("condition", "live")
            assert (230, 159, 0) in seen.colors()
        seen.page.close()


def test_a_dead_server_is_seen(seen: Seen) -> None:
    os.kill(seen.process.pid, signal.SIGKILL)
    seen.until("condition", "lost")
    assert "lost" in seen.text("warning")
    with pytest.raises(HostError):
        seen.process.new_address()


def test_escape_and_the_button_stop_the_limb(seen: Seen) -> None:
    seen.page.key("Escape", "Escape", 27)
    until(lambda: seen.loop.stops == 1)
    seen.until("condition", "stopped")
    seen.page.value("document.getElementById('stop').click()")
    until(lambda: seen.loop.stops == 2)


def test_nothing_comes_from_elsewhere(seen: Seen) -> None:
    entries = seen.page.value("performance.getEntriesByType('resource').map(e => e.name)")
    origin = seen.page.value("location.origin")
    assert all(entry.startswith(origin) for entry in entries)
    assert "token" not in seen.page.value("location.href")


def test_a_run_without_shapes_or_commands_has_its_timing(tmp_path: Path, browser: Chromium) -> None:
    loop = MadeUpLoop(tmp_path / "run")
    with loop.running(), PageProcess(loop.folder) as process:
        seen = Seen(loop, process, browser.open(process.address))
        until(lambda: seen.now("plots"))
        assert [title for title, *_ in seen.now("plots")] == ["Loop"]
        seen.page.close()


def test_a_frame_has_null_for_what_is_not_known() -> None:
    layout = body_layout()
    view = View(layout)
    frame = view.frame(np.zeros(layout.width, np.int64), [1.0, 2.0])
    nodes = frame["things"][0]
    assert nodes == [None] * 270
    assert frame["curves"][-1] == [1.0, 2.0]
    assert len(view.scene["things"][0]["links"]) == len(TREE.polylines)
