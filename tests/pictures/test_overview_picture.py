"""The picture of a profile: no arrow goes through a box, no text lies on another, triads are where the frames are."""

from __future__ import annotations

import os
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest

from srl.runtime.cli import main
from srl.runtime.contracts.rotation import Pose
from srl.runtime.loop.guards import limits_of
from srl.runtime.overview.overview import overview
from srl.runtime.pictures import frames_picture, wiring_picture
from srl.runtime.pictures.wiring_picture import Wiring, laid_out
from srl.runtime.profile import library, profile, wiring


@cache
def of(name: str) -> dict[str, Any]:
    graph = wiring.build(*profile.load(name))
    return overview(graph, limits_of(graph))


@cache
def made_of(name: str) -> Wiring:
    return laid_out(of(name))


def painted(made: Wiring) -> Any:
    figure = plt.figure(figsize=(made.width, made.height))
    axis = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axis.set_xlim(0.0, made.width)
    axis.set_ylim(made.height - wiring_picture.ABOVE, -wiring_picture.ABOVE)
    wiring_picture.paint(axis, made)
    return axis


@pytest.mark.slow
def test_a_picture_is_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    png = tmp_path / "sixth-finger.png"
    assert main(["check", "--all", "sixth-finger", "--figure", str(png)]) == 0
    assert png.read_bytes().startswith(b"\x89PNG")
    assert plt.imread(png).std() > 0.02  # something is drawn
    assert capsys.readouterr().out.splitlines()[-1] == f"{png}: the wiring and the frames"
    assert not plt.get_fignums()


def test_words_are_drawn_as_they_are(tmp_path: Path) -> None:
    """Two dollars are no formula."""
    png = tmp_path / "it.png"
    summary = "summary=a $\\frac{1$ b of $5"
    frames = "frames={hand: {}, finger: {parent: hand}, 'tip$x^{$': {parent: hand, position: [0.1, 0, 0]}}"
    assert main(["check", "--all", "sixth-finger", "--set", summary, "--set", frames, "--figure", str(png)]) == 0


@pytest.mark.slow
def test_a_picture_that_cant_be_written_leaves_the_one_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine.yaml").write_text("mine\n")
    png = tmp_path / "it.png"
    png.symlink_to(tmp_path / "mine.yaml")
    assert main(["check", "--all", "servo-jog", "--figure", str(png)]) == 0
    assert (tmp_path / "mine.yaml").read_text() == "mine\n"  # a link is replaced, not followed
    before = png.read_bytes()

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    assert main(["check", "--all", "sixth-finger", "--figure", str(png)]) == 2
    assert "it.png: it can't be written: No space left on device" in capsys.readouterr().err
    assert png.read_bytes() == before
    assert {path.name for path in tmp_path.iterdir()} == {"mine.yaml", "it.png"}


def test_a_range_that_not_all_joints_have_says_so() -> None:
    assert notes_of("strap-jog")[:2] == ["position unbounded yet (rad)", "position -0.03 to 0.03 m"]
    motors = (
        "devices.finger.motors={proximal: {id: 1, model: MX-28}, distal: {id: 2, model: MX-28, lower: -1, upper: 1}}"
    )
    assert notes_of("servo-jog", motors)[0] == "position -1 to 1 rad, some unbounded"
    motors = "devices.finger.motors={proximal: {id: 1, model: MX-28}, distal: {id: 2, model: MX-28}}"
    assert notes_of("servo-jog", motors)[0] == "no bound of the position yet"


def notes_of(name: str, *overrides: str) -> list[str]:
    graph = wiring.build(*profile.load(name, overrides))
    made = laid_out(overview(graph, limits_of(graph)))
    (notes,) = (box.notes for column in made.made for box in column if box.kind == "guard")
    return notes


@pytest.mark.parametrize("name", library.shipped())
def test_no_arrow_goes_through_a_box(name: str) -> None:
    """Between columns arrows bend, and there is no box; within a column each has a slot, beside the boxes."""
    made = made_of(name)
    right = -1.0
    for column in made.made:
        assert min(box.x for box in column) > right
        right = max(box.x + box.width for box in column)
        ordered = sorted(column, key=lambda box: box.y)
        for above, below in pairwise(ordered):
            assert above.y + above.height < below.y
    for arrow in made.arrows:
        assert arrow.end.column == arrow.start.column + 1


@pytest.mark.parametrize("name", library.shipped())
def test_every_wire_is_an_arrow(name: str) -> None:
    found = of(name)
    made = made_of(name)
    ends = {(arrow.signal, arrow.end.title.partition(" ")[0], arrow.at) for arrow in made.arrows}
    for law in found["laws"]:
        for wire in law["reads"]:
            for signal in wire["signals"]:
                assert (signal, law["name"], wire["port"]) in ends
    for command in found["commands"]:
        assert (command["name"], command["name"], "asked") in ends
        for wire in (command["clear"] or {}).get("reads", ()):
            assert (wire["signals"][0], command["name"], f"clear {wire['port']}") in ends
        assert ("applied", command["device"], command["name"].partition(".")[2]) in ends


@pytest.mark.parametrize("name", ["sixth-finger", "ikns-finger", "moca-man", "human-srl", "kairos-man"])
def test_no_text_lies_on_another_or_outside_its_box(name: str) -> None:
    made = made_of(name)
    axis = painted(made)
    try:
        renderer = axis.figure.canvas.get_renderer()
        extents = [text.get_window_extent(renderer) for text in axis.texts]
        for i, one in enumerate(extents):
            for other in extents[i + 1 :]:
                assert not one.overlaps(other), (axis.texts[i].get_text(), name)
        boxes = [box for column in made.made for box in column if box.kind != "slot"]
        for text, extent in zip(axis.texts, extents, strict=True):
            (x0, y1), (x1, y0) = axis.transData.inverted().transform(extent.get_points())
            inside = [b for b in boxes if b.x < x0 and x1 < b.x + b.width and b.y < y0 and y1 < b.y + b.height]
            assert inside or text.get_style() == "italic", text.get_text()  # a column's head
    finally:
        plt.close(axis.figure)


def test_triads_stand_at_the_profiles_own_numbers() -> None:
    drawn, alone = frames_picture.groups(of("moca-man"))
    assert alone == []
    (_, world), (caption, flange) = drawn
    assert caption == "in arm/flange, which moves with the joints of arm"
    places = {name: pose[:3] for name, pose, _ in (*world, *flange)}
    assert places == {
        "world": (0.0, 0.0, 0.0), "base (by base.pose)": (0.0, 0.0, 0.0), "arm": (0.2, 0.0, 0.529),
        "arm/flange": (0.0, 0.0, 0.0), "tool": (0.0, 0.0, 0.1), "handle": (0.095, 0.0, 0.02),
    }  # fmt: skip
    assert [flange[parent][0] for _, _, parent in flange if parent >= 0] == ["arm/flange", "arm/flange"]


def test_a_frame_without_others_is_named() -> None:
    drawn, alone = frames_picture.groups(of("strap-jog"))
    assert [caption for caption, _ in drawn] == ["in plate"]
    assert alone == ["world"]


def test_axes_point_where_the_frame_is_turned() -> None:
    """A quarter turn about z: its x is drawn along the parent's y."""
    half = 0.5**0.5
    turned: Pose = (1.0, 0.0, 0.0, half, 0.0, 0.0, half)
    figure = plt.figure(figsize=(4.0, 3.0))
    try:
        axis = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        triads = [("root", (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), -1), ("turned", turned, 0)]
        frames_picture.paint(axis, "in root", triads, (4.0, 3.0))
        colours = [line.get_color() for line in axis.lines if line.get_color() in frames_picture.AXES.values()]
        assert colours == 2 * list(frames_picture.AXES.values())
        ways = [np.diff(line.get_xydata(), axis=0)[0] for line in axis.lines if line.get_color() in colours]
        assert ways[3] == pytest.approx(ways[1])
        assert ways[4] == pytest.approx(-ways[0])
        assert ways[5] == pytest.approx(ways[2])
    finally:
        plt.close(figure)


SIZE = (4.2, 2.6)  # inches


def names_of(caption: str, triads: list[tuple[str, Pose, int]]) -> Any:
    figure = plt.figure(figsize=SIZE)
    axis = figure.add_axes((0.0, 0.0, 1.0, 0.85))
    frames_picture.paint(axis, caption, triads, (SIZE[0], 0.85 * SIZE[1]))
    return axis


@pytest.mark.parametrize("name", library.shipped())
def test_no_name_of_a_frame_is_cut_off_or_lies_on_another(name: str) -> None:
    graph = wiring.build(*profile.load(name), [])
    drawn, _ = frames_picture.groups(overview(graph, limits_of(graph)))
    for caption, triads in drawn:
        axis = names_of(caption, triads)
        try:
            renderer = axis.figure.canvas.get_renderer()
            names = [text for text in axis.texts if text.get_text() not in frames_picture.AXES]
            extents = [text.get_window_extent(renderer) for text in names]
            for i, extent in enumerate(extents):
                assert extent.x0 >= 0.0, names[i].get_text()
                assert extent.x1 <= axis.figure.bbox.width, names[i].get_text()
                for other in extents[i + 1 :]:
                    assert not extent.overlaps(other), names[i].get_text()
        finally:
            plt.close(axis.figure)


def test_many_frames_at_one_place_and_long_names_are_cut_short_and_say_so() -> None:
    place: Pose = (0.1, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    root: Pose = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    many = [("root", root, -1), *((f"f{i}", place, 0) for i in range(40)), ("l" * 200, (0.0, 0.1, *place[2:]), 0)]
    axis = names_of("in root", many)
    try:
        texts = [text.get_text() for text in axis.texts]
        assert "f0\nf1\nf2\nf3\nand 36 more" in texts
        (long,) = (text for text in texts if text.startswith("lll"))
        assert long.endswith("...")
        assert len(long) <= 40
    finally:
        plt.close(axis.figure)
