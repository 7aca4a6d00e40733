"""Pictures at single instants: what is on the paper is what the recording has then."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import combinations, pairwise
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from helpers.body_run import CAPSULES, GROUPS, TREE, body_file, body_layout, upright
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure

from srl.runtime.cli import main
from srl.runtime.contracts.errors import RecordingError
from srl.runtime.pictures import stills
from srl.runtime.pictures.naming import write_names
from srl.runtime.recording.reader import Recording, read
from srl.runtime.recording.shapes import distance_colors


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return body_file(tmp_path_factory.mktemp("r"))


@pytest.fixture(scope="module")
def recording(file: Path) -> Recording:
    return read(file)


@pytest.fixture
def kept(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """The figures that are drawn; they stay open."""
    found: list[Figure] = []
    monkeypatch.setattr(stills.plt, "close", found.append)
    return found


def test_each_instant_shows_all_segments_and_capsules_in_their_colours(
    recording: Recording, tmp_path: Path, kept: list[Figure]
) -> None:
    times = [0.5, 1.995, 3.0]
    stills.draw(recording, tmp_path / "s.png", times)
    assert (tmp_path / "s.png").read_bytes().startswith(b"\x89PNG")
    (figure,) = kept
    shown = [axis for axis in figure.axes if axis.get_title()]
    assert [axis.get_title().partition(" ")[0] for axis in shown] == ["(a)", "(b)", "(c)"]
    for axis, t in zip(shown, times, strict=True):
        i = int(np.searchsorted((recording.int("now") - recording.int("now")[0]) / 1e9, t + 1e-6, "right")) - 1
        lines = next(c for c in axis.collections if isinstance(c, LineCollection))
        assert sum(len(line) - 1 for line in lines.get_segments()) == 89
        solids = recording.value("collision.envelope")[i]
        faces = next(
            c for c in axis.collections if isinstance(c, PolyCollection) and len(c.get_paths()) == len(CAPSULES)
        )
        colors = {tuple(np.round(255 * c).astype(int)) for c in faces.get_facecolor()[:, :3]}
        assert colors == {tuple(c) for c in distance_colors(solids[:, 7]).astype(int).tolist()}
        # From the front, heights are heights: the picture is as tall as the body.
        nodes = upright(recording.value("skeleton.nodes")[i])
        heights = np.concatenate(lines.get_segments())[:, 1]
        assert np.ptp(heights) == pytest.approx(np.ptp(nodes[:, 2]), rel=0.15)
    plt.close("all")


def test_the_nodes_of_a_part_are_named(recording: Recording, tmp_path: Path, kept: list[Figure]) -> None:
    stills.draw(recording, tmp_path / "s.png", [1.0], ["right SRL"])
    names = {text.get_text() for axis in kept[0].axes for text in axis.texts}
    assert names == {name for name in TREE.names if name.startswith("R") and not name.startswith("Right")}
    assert len(names) == 9
    assert any(isinstance(c, PolyCollection) for axis in kept[0].axes for c in axis.collections)


def test_signals_and_parts_can_be_chosen(recording: Recording, tmp_path: Path, kept: list[Figure]) -> None:
    stills.draw(recording, tmp_path / "s.png", [1.0, 2.0], show=["skeleton.nodes"])
    assert not any(isinstance(c, PolyCollection) for axis in kept[0].axes for c in axis.collections)
    stills.draw(recording, tmp_path / "s.png", [1.0], ["left SRL"], show=["right SRL", "left SRL"])
    (axis,) = kept[1].axes
    lines = next(c for c in axis.collections if isinstance(c, LineCollection))
    assert sum(len(line) - 1 for line in lines.get_segments()) == 16  # without that to the body
    assert {text.get_text() for text in axis.texts} == {name for name in TREE.names if name[:2] in ("LB", "LJ", "LE")}
    with pytest.raises(RecordingError, match=r"skeleton\.nodes"):
        stills.draw(recording, tmp_path / "s.png", [1.0], show=["skeleton.node"])
    with pytest.raises(RecordingError, match="no part that is drawn is called 'body'"):
        stills.draw(recording, tmp_path / "s.png", [1.0], ["body"], show=["right SRL"])


@pytest.mark.parametrize(("side", "across"), [("front", 1), ("back", -1), ("left", 0), ("right", 0)])
def test_one_may_look_from_a_side(
    recording: Recording, tmp_path: Path, kept: list[Figure], side: str, across: int
) -> None:
    stills.draw(recording, tmp_path / "s.png", [1.0], show=["skeleton.nodes"], side=side)
    i = int(np.searchsorted((recording.int("now") - recording.int("now")[0]) / 1e9, 1.0 + 1e-6, "right")) - 1
    nodes = upright(recording.value("skeleton.nodes")[i])
    # Its left is on the right of somebody in front of it; its front is on the right of somebody on its right.
    expected = across * nodes[:, 1] if across else {"right": 1, "left": -1}[side] * nodes[:, 0]
    dots = next(c for c in kept[0].axes[0].collections if not isinstance(c, LineCollection))
    np.testing.assert_allclose(dots.get_offsets(), np.stack([expected, nodes[:, 2]], axis=1), atol=1e-12)


def test_the_body_keeps_its_colour_where_an_arm_hangs_on_it(
    recording: Recording, tmp_path: Path, kept: list[Figure]
) -> None:
    stills.draw(recording, tmp_path / "s.png", [1.0], show=["skeleton.nodes"])
    links = recording.layout.fields["skeleton.nodes"].links
    for line in links:
        for child, parent in pairwise(line):
            assert GROUPS[child] == GROUPS[line[0]], (TREE.names[child], TREE.names[parent])


@pytest.mark.slow
@given(
    spots=st.lists(st.tuples(st.floats(0.3, 0.7), st.floats(0.3, 0.7)), min_size=2, max_size=6),
)
@settings(max_examples=10, deadline=None)
def test_names_cover_neither_each_other_nor_the_points(spots: list[tuple[float, float]]) -> None:
    figure, axis = plt.subplots(figsize=(6.0, 6.0))
    try:
        figure.draw_without_rendering()
        points, names = np.array(spots), [f"RJ{i}" for i in range(len(spots))]
        write_names(axis, names, points)
        boxes = [text.get_window_extent() for text in axis.texts]
        assert [text.get_text() for text in axis.texts] == names
        for box, other in combinations(boxes, 2):
            assert not box.overlaps(other)
        for x, y in axis.transData.transform(points):
            assert not any(box.contains(x, y) for box in boxes)
    finally:
        plt.close(figure)


def test_instants_are_spread_over_the_motion(recording: Recording) -> None:
    times = stills.spread(recording, 10)
    assert len(times) == 10
    assert np.diff(times) == pytest.approx(0.399)
    assert times[0] == pytest.approx(3.99 - times[-1])


@pytest.mark.slow
def test_the_command_writes_them_and_says_what_it_cannot_do(
    file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    png = tmp_path / "s.png"
    assert main(["export", str(file), "--stills", str(png), "--at", "1", "2", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["at"] == [1.0, 2.0]
    assert png.exists()
    for options, words in (
        ([], "nothing is to be written"), (["--bvh", "x.bvh", "--at", "1"], "Add --stills"),
        (["--bvh", "x.bvh", "--side", "left"], "Add --stills"), (["--tree", "t.png", "--page", "p.png"], "Add --bvh"),
        (["--stills", str(png), "--law", "x"], "Add --bvh"), (["--stills", str(png), "--at", "77"], "no 77 s"),
        (["--stills", str(png), "--names", "right srl"], "right SRL"),
        (["--stills", str(tmp_path)], "can't be written"),
    ):  # fmt: skip
        assert main(["export", str(file), *options]) == 2
        assert words in capsys.readouterr().err


def test_a_recording_without_shapes_is_refused(recording: Recording, tmp_path: Path) -> None:
    layout = body_layout()
    for name in ("skeleton.nodes", "collision.envelope", "collision.closest"):
        layout.fields[name] = replace(layout.fields[name], visual="")
    with pytest.raises(RecordingError, match="no signal"):
        stills.draw(replace(recording, layout=layout), tmp_path / "s.png", [1.0])
