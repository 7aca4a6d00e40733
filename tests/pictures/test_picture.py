"""What a viewer draws of a person with supernumerary arms: nodes, segments, capsules and their colours, from a file."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.body_run import CAPSULES, GROUPS, TREE, body_layout, body_rows
from helpers.drawn import Drawn

from srl.runtime.contracts.field import Field
from srl.runtime.contracts.rotation import matrices
from srl.runtime.ipc.layout import Layout
from srl.runtime.pictures.camera import look
from srl.runtime.recorder import blueprint
from srl.runtime.recorder.capsules import capsule_columns
from srl.runtime.recorder.stream import Stream
from srl.runtime.recording.reader import read
from srl.runtime.recording.shapes import distance_colors, visuals

COUNT = 400


@pytest.fixture(scope="module")
def layout() -> Layout:
    return body_layout()


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory, layout: Layout) -> Path:
    folder = tmp_path_factory.mktemp("r")
    layout.save(folder / "layout.json")
    rows = body_rows(layout, COUNT)
    stream = Stream((folder / "layout.json").read_text())
    stream.recording.save(folder / "run.rrd")
    stream.prologue(rows[-1])
    for at in range(0, COUNT, 20):
        stream.rows(np.arange(at + 1, at + 21), rows[at : at + 20])
    stream.recording.disconnect()
    return folder / "run.rrd"


@pytest.fixture(scope="module")
def drawn(file: Path) -> Drawn:
    return Drawn(file)


def bytes_of(color: int) -> tuple[int, ...]:
    return tuple(color.to_bytes(4, "big"))[:3]


def test_all_nodes_and_segments_are_drawn_where_they_are_thirty_times_a_second(
    drawn: Drawn, file: Path, layout: Layout
) -> None:
    points = drawn.moving["/skeleton/nodes", "Points3D:positions"]
    strips = drawn.moving["/skeleton/nodes", "LineStrips3D:strips"]
    recording = read(file)
    cycles = recording.int("cycle")
    assert 30 * COUNT / 100 - 2 <= len(points) <= 30 * COUNT / 100 + COUNT / 20 + 2  # and each batch's last
    for cycle, shown in points.items():
        nodes = recording.value("skeleton.nodes")[np.searchsorted(cycles, cycle)]
        assert np.array(shown) == pytest.approx(nodes, abs=1e-6)
        assert len(shown) == 90
        at = {tuple(place): i for i, place in enumerate(nodes.astype(np.float32).tolist())}
        segments = [(at[tuple(b)], at[tuple(a)]) for strip in strips[cycle] for a, b in pairwise(strip)]
        assert len(segments) == 89
        assert set(segments) == set(TREE.segments)
    assert drawn.static["/skeleton/nodes", "Points3D:labels"] == list(TREE.names)
    assert drawn.static["/skeleton/nodes", "CoordinateFrame:frame"] == ["suit"]


def test_the_arm_is_told_from_the_body_by_its_colour(drawn: Drawn) -> None:
    colors = drawn.static["/skeleton/nodes", "Points3D:colors"]
    assert len(colors) == 90
    by_part = {group: {c for c, g in zip(colors, GROUPS, strict=True) if g == group} for group in set(GROUPS)}
    assert [len(found) for found in by_part.values()] == [1, 1, 1]
    assert len(set.union(*by_part.values())) == 3
    lines = drawn.static["/skeleton/nodes", "LineStrips3D:colors"]
    assert lines == [colors[line[0]] for line in TREE.polylines]


def test_capsules_stand_where_the_law_says_in_the_colour_of_their_distance(drawn: Drawn, file: Path) -> None:
    recording = read(file)
    cycles = recording.int("cycle")

    def row(what: str, cycle: int) -> Any:
        return np.array(drawn.moving["/collision/envelope", f"Capsules3D:{what}"][cycle])

    seen = set()
    for cycle in drawn.moving["/collision/envelope", "Capsules3D:colors"]:
        solids = recording.value("collision.envelope")[np.searchsorted(cycles, cycle)]
        lengths, start, (x, y, z, w) = row("lengths", cycle), row("translations", cycle), row("quaternions", cycle).T
        ends = start + lengths[:, None] * matrices(np.stack([w, x, y, z], axis=1))[:, :, 2]
        assert start == pytest.approx(solids[:, :3], abs=1e-6)
        assert ends == pytest.approx(solids[:, 3:6], abs=1e-6)
        assert row("radii", cycle) == pytest.approx([radius for *_, radius in CAPSULES])
        shown = [bytes_of(color) for color in row("colors", cycle).tolist()]
        assert shown == [tuple(color) for color in distance_colors(solids[:, 7]).tolist()]
        seen |= set(shown)
    assert len(seen) > 20  # the arm comes and goes
    assert len(drawn.static["/collision/envelope", "Capsules3D:labels"]) == len(CAPSULES)


def test_a_gap_is_a_line_of_its_distances_colour_and_one_that_is_not_known_is_not_drawn(
    drawn: Drawn, file: Path
) -> None:
    recording = read(file)
    cycles = recording.int("cycle")
    strips = drawn.moving["/collision/closest", "LineStrips3D:strips"]
    for cycle, (first, second) in strips.items():
        gap = recording.value("collision.closest")[np.searchsorted(cycles, cycle), 0]
        assert np.ravel(first) == pytest.approx(gap[:6], abs=1e-6)
        assert second == []
        color = drawn.moving["/collision/closest", "LineStrips3D:colors"][cycle][0]
        assert bytes_of(color) == tuple(distance_colors(gap[6:])[0])


def test_a_capsule_that_is_not_known_is_nothing_and_leaves_the_others_their_places() -> None:
    field = Field("envelope", "internal", 0, (3, 8), "m", visual="capsules")
    values = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.3, 0.05, 0.2], (2, 3, 1))
    values[0, 1, 4] = np.nan
    (columns,) = capsule_columns(field, values)
    by_name = {column.component_descriptor().component: column.as_arrow_array().to_pylist() for column in columns}
    radii = by_name["Capsules3D:radii"]
    assert radii[0] == pytest.approx([0.05, 0.0, 0.05])
    assert radii[1] == pytest.approx([0.05] * 3)


def test_the_view_opens_on_the_whole_body_from_its_front(layout: Layout) -> None:
    row = body_rows(layout, 1)[0]
    eye = look(layout, row, visuals(layout))
    assert eye is not None
    position, target = (np.array(v.as_arrow_array()[0].as_py()) for v in (eye.position, eye.look_target))
    assert position[0] - target[0] > 1.0  # the body faces x
    assert target[2] == pytest.approx(0.9, abs=0.25)
    assert blueprint.make(layout, row) is not None
