"""The paper's figures 6 (c) and 7: a recording's node tree, and the text of its BVH file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from helpers.body_run import GROUPS, TREE, body_layout, body_rows
from matplotlib.figure import Figure

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.models.skeleton import bvh
from srl.runtime.pictures.bvh_page import ACROSS, draw_page, excerpt
from srl.runtime.pictures.node_tree import draw_tree
from srl.runtime.recording.reader import Recording

ARM = [name for name, group in zip(TREE.names, GROUPS, strict=True) if group == "right SRL"]


@pytest.fixture(scope="module")
def recording() -> Recording:
    layout = body_layout()
    return Recording(Path("run.rrd"), layout, np.arange(1, 4), body_rows(layout, 3), [], [], 0)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file of all nodes, at rest."""
    path = tmp_path_factory.mktemp("bvh") / "x.bvh"
    offsets = np.array([node.offset for node in TREE.nodes])
    still = np.tile([1.0, 0.0, 0.0, 0.0], (5, len(TREE), 1))
    bvh.write(path, TREE, still, np.tile(offsets, (5, 1, 1)), 0.05)
    return path


@pytest.fixture
def kept(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """The figures that are drawn; they stay open."""
    found: list[Figure] = []
    monkeypatch.setattr(plt, "close", found.append)
    return found


def places(figure: Figure) -> dict[str, tuple[float, float]]:
    return {text.get_text(): text.get_position() for text in figure.axes[0].texts}


@pytest.mark.slow
def test_the_tree_has_every_node_below_its_parent(recording: Recording, tmp_path: Path, kept: list[Figure]) -> None:
    assert draw_tree(recording, tmp_path / "t.png") == 90
    assert (tmp_path / "t.png").read_bytes().startswith(b"\x89PNG")
    found = places(kept[0])
    assert set(found) == set(TREE.names)
    lines = [line.get_xydata() for line in kept[0].axes[0].lines]
    assert len(lines) == 89
    joined = {(tuple(line[0]), tuple(line[-1])) for line in lines}
    for i, parent in enumerate(TREE.parents):
        if i:
            (x, y), (x_up, y_up) = found[TREE.names[i]], found[TREE.names[parent]]
            assert y == y_up - 1
            assert ((x_up, y_up), (x, y)) in joined
    assert len(set(found.values())) == 90


def test_a_part_is_drawn_with_what_it_hangs_on(recording: Recording, tmp_path: Path, kept: list[Figure]) -> None:
    assert draw_tree(recording, tmp_path / "t.png", ["right SRL"]) == 10
    assert set(places(kept[0])) == {"Spine", *ARM}


def test_what_is_no_tree_is_refused(tmp_path: Path, recording: Recording) -> None:
    with pytest.raises(RecordingError, match="no part is called 'right'"):
        draw_tree(recording, tmp_path / "t.png", ["right"])
    with pytest.raises(RecordingError, match="can't be written"):
        draw_tree(recording, tmp_path)
    layout = body_layout()
    del layout.fields["skeleton.nodes"]
    with pytest.raises(RecordingError, match="no signal in it is a skeleton"):
        draw_tree(replace(recording, layout=layout), tmp_path / "t.png")


def test_the_page_shows_a_part_with_its_ancestors_and_all_brackets(file: Path) -> None:
    lines = excerpt(file.read_text().splitlines(), ARM)
    titles = [line.split()[-1] for line in lines if line.strip().startswith(("ROOT", "JOINT"))]
    assert titles == ["Hips", "Spine", *ARM[:-1]]  # the arm's end is an end site
    assert [line.strip() for line in lines].count("{") == [line.strip() for line in lines].count("}") == 11
    assert lines.index("MOTION") == len(lines) - 7  # two lines, three frames, and what is left out
    assert max(map(len, lines)) <= ACROSS
    assert lines[-1] == "..."


def test_without_a_part_it_shows_the_first_branch(file: Path) -> None:
    lines = [line.strip() for line in excerpt(file.read_text().splitlines(), ())]
    assert [line for line in lines if line.startswith("JOINT")] == [
        "JOINT RightUpLeg",
        "JOINT RightLeg",
        "JOINT RightFoot",
    ]
    assert lines.count("{") == lines.count("}") == 5


@pytest.mark.slow
def test_keywords_are_bold(recording: Recording, file: Path, tmp_path: Path, kept: list[Figure]) -> None:
    draw_page(recording, file, tmp_path / "p.png", ["right SRL"])
    bold = {text.get_text().strip() for text in kept[0].texts if text.get_weight() == "bold"}
    assert bold == {
        "HIERARCHY",
        "ROOT",
        "JOINT",
        "End Site",
        "OFFSET",
        "CHANNELS",
        "MOTION",
        "Frames:",
        "Frame Time:",
        "",
    }
    with pytest.raises(RecordingError, match="can't be written"):
        draw_page(recording, file, tmp_path)
