"""The lit picture in a real browser without a graphics card: bodies with shadows, whole, and with their frames."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from helpers.body_run import CAPSULES, body_layout
from helpers.chromium import Chromium
from helpers.picture_seen import BodyLoop, Seen
from helpers.wait import until

from srl.runtime.contracts.linkage import Link, Solid
from srl.runtime.recording.person import RADII, thicknesses
from srl.runtime.web.operator.client import OperatorPage
from srl.runtime.web.panel import three
from srl.runtime.web.panel.picture import View

SIZES = ((1280, 800), (390, 844))


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    with Chromium(tmp_path_factory.mktemp("chromium")) as made:
        yield made


@pytest.fixture
def seen(tmp_path: Path, browser: Chromium) -> Iterator[Seen]:
    if not three.there():
        assert not shutil.which("npm"), "three.js isn't here, though npm is: python -m srl.runtime.web.panel.three"
        pytest.skip("no npm to fetch three.js")
    loop = BodyLoop(tmp_path / "run")
    with loop.running(), OperatorPage(loop.folder) as process:
        page = browser.open(process.address)
        made = Seen(loop, process, page)
        until(lambda: made.now("solid") and made.now("drawn"))
        assert not made.text("flat")
        yield made
        page.close()


def body(picture: np.ndarray) -> np.ndarray:
    """Where a person's body is seen: its colour is warm, in light and shade."""
    return (picture[..., 0] - picture[..., 2] > 12) & (picture[..., 0] >= picture[..., 1])


def resized(seen: Seen, size: tuple[int, int]) -> None:
    seen.page.ask(
        "Emulation.setDeviceMetricsOverride", width=size[0], height=size[1], deviceScaleFactor=1, mobile=False
    )
    frames = seen.now("frames")
    until(lambda: seen.now("frames") > frames + 3)


def in_colour(seen: Seen, folder: Path) -> np.ndarray:
    """The picture with the body in its colour: where a host under load sends no data for a while it is grey."""
    taken: list[np.ndarray] = []
    until(lambda: body(taken[-1]).any() if taken else False, lambda: taken.append(seen.picture(folder)))
    return taken[-1]


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("theme", ["dark", "light"])
def test_a_body_is_lit_and_whole_and_nothing_covers_it(
    seen: Seen, tmp_path: Path, size: tuple[int, int], theme: str
) -> None:
    seen.page.ask("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": theme}])
    resized(seen, size)
    picture = in_colour(seen, tmp_path)
    there = body(picture)
    rows, columns = np.nonzero(there)
    height, width = there.shape
    assert 0.45 * height < np.ptp(rows) or 0.45 * width < np.ptp(columns)  # it fills the picture
    border = np.concatenate([there[[0, -1]].ravel(), there[:, [0, -1]].ravel()])
    assert not border.any()  # and is in it
    shades = picture[there].sum(axis=1)
    assert np.percentile(shades, 90) > 1.25 * np.percentile(shades, 10)  # lit from one side
    covers = seen.page.value("""(() => { const b = document.getElementById('space').getBoundingClientRect();
        let covered = 0;
        for (let i = 1; i < 20; i++) for (let j = 1; j < 20; j++)
          covered += document.elementFromPoint(b.x + b.width * i / 20, b.y + b.height * j / 20).id !== 'space';
        return covered; })()""")
    assert covers == 0


def test_its_shadow_lies_on_the_ground(seen: Seen, tmp_path: Path) -> None:
    seen.page.ask("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "light"}])
    resized(seen, SIZES[0])
    picture = in_colour(seen, tmp_path)
    rows, _ = np.nonzero(body(picture))
    feet = picture[int(np.percentile(rows, 97)) :]
    dark = (feet.max(axis=2) < 190) & ~body(feet)
    assert dark.mean() > 0.002
    seen.page.value("document.querySelectorAll('#legend button').forEach((b) => b.click())")  # all is hidden
    until(lambda: not body(seen.picture(tmp_path)).any())
    assert seen.now("drawn") == {"points": 0, "links": 0, "capsules": 0}


def test_what_is_drawn_is_what_the_rows_have(seen: Seen) -> None:
    until(lambda: seen.now("drawn") == {"points": 90, "links": 89, "capsules": len(CAPSULES) + 1})


def test_frames_are_shown_on_demand_with_their_names(seen: Seen) -> None:
    assert seen.text("tags") == ""
    seen.page.value("document.getElementById('axes').click()")
    until(lambda: seen.text("tags") == "suit")
    seen.page.value("document.getElementById('axes').click()")
    until(lambda: seen.text("tags") == "")


def test_two_fingers_zoom_and_one_turns(seen: Seen) -> None:
    x, y = seen.page.value("(b => [b.x + b.width / 2, b.y + b.height / 2])"
                           "(document.getElementById('space').getBoundingClientRect())")  # fmt: skip

    def touch(kind: str, *apart: float) -> None:
        points = [{"x": x + dx, "y": y, "id": i} for i, dx in enumerate(apart)]
        seen.page.ask("Input.dispatchTouchEvent", type=kind, touchPoints=points)

    seen.page.ask("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=2)
    distance, turn = seen.now("distance"), seen.now("turn")
    touch("touchStart", -40, 40)
    touch("touchMove", -80, 80)
    touch("touchEnd")
    until(lambda: seen.now("distance") < 0.7 * distance)
    assert seen.now("turn") == turn
    touch("touchStart", 0)
    touch("touchMove", 50)
    touch("touchEnd")
    until(lambda: seen.now("turn") == pytest.approx(turn - 0.4, abs=0.05))
    seen.page.ask("Emulation.setTouchEmulationEnabled", enabled=False)


def test_a_robots_parts_go_with_its_links_and_what_stands_in_the_room_is_drawn_once() -> None:
    layout = body_layout()
    box = Solid("box", (0.1, 0.2, 0.3), color=(1, 2, 3))
    links = (Link("base", -1, solids=(box,)), Link("tip", 0, (0.5, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), solids=(box,)))
    table = {"kind": "box", "size": [1, 1, 0.1], "position": [0, 0, -1], "quaternion": [1, 0, 0, 0]}
    layout.meta["robots"] = [{"name": "suit", "links": [asdict(link) for link in links], "angles": "", "urdf": None}]
    layout.meta["scenery"] = [table | {"colour": [1.0, 0.5, 0.0, 1.0]}, table | {"colour": [0] * 4, "part": "suit"}]
    view = View(layout)
    robot = view.scene["things"][-1]
    assert [(part["link"], part["kind"], part["size"]) for part in robot["parts"]] == [
        (0, "box", (0.1, 0.2, 0.3)), (1, "box", (0.1, 0.2, 0.3)),
    ]  # fmt: skip
    assert view.scene["scenery"] == [
        {"kind": "box", "size": [1, 1, 0.1], "pose": [0, 0, -1, 1, 0, 0, 0], "color": [255, 128, 0]}
    ]
    frame = view.frame(np.zeros(layout.width, np.int64), [1.0, 2.0])
    assert frame["links"][:-1] == [None] * (len(frame["things"]) - 1)
    first, second = np.array(frame["links"][-1]).reshape(2, 3, 4)
    assert np.array(frame["frames"]).reshape(1, 3, 4)[0] == pytest.approx(first)  # it stands at the frame of its name
    assert second[:, 3] == pytest.approx(first @ [0.5, 0.0, 0.0, 1.0])
    assert (
        len({tuple(color) for thing in view.scene["things"] for color in thing["colors"]}) == 4
    )  # none is there twice


def test_a_person_is_as_thick_as_its_joints_say_and_an_arm_is_not() -> None:
    names = ("Hips", "Spine", "LeftForeArm", "RightHandThumb2", "Head_End", "RJ1")
    wanted = (RADII["Hips"], RADII["Spine"], RADII["ForeArm"], RADII["HandThumb"], RADII["Head"], None)
    assert thicknesses(names) == wanted
    assert thicknesses(("Hand", "RJ1")) == ()
