"""What signals look like in space: colours by distance and by part, and where frames are."""

from __future__ import annotations

import json
from dataclasses import asdict

import numpy as np
import pytest
from helpers.body_run import CAPSULES, GROUPS, TREE, body_layout, body_rows, upright
from helpers.recording import make_layout, make_rows
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from srl.runtime.contracts.rotation import from_z, matrices
from srl.runtime.contracts.signals import Signal
from srl.runtime.ipc.layout import Layout
from srl.runtime.recording.shapes import RAMP, UNKNOWN, color_numbers, distance_colors, visuals
from srl.runtime.recording.solids import GAP, Solids

UNIT = st.floats(-1.0, 1.0)


@given(arrays(float, (5, 3), elements=UNIT))
def test_a_turn_from_z_takes_z_to_the_direction(directions: np.ndarray) -> None:
    lengths = np.linalg.norm(directions, axis=1)
    q = from_z(directions)
    assert np.linalg.norm(q, axis=1) == pytest.approx(1.0)
    z = matrices(q)[:, :, 2]
    long = lengths > 1e-9
    assert z[long] * lengths[long, None] == pytest.approx(directions[long], abs=1e-9)


def test_straight_back_and_no_length_are_turns_too() -> None:
    q = from_z(np.array([[0.0, 0.0, -2.0], [0.0, 0.0, 0.0], [1e-9, 0.0, -1.0]]))
    assert matrices(q)[:, :, 2] == pytest.approx(np.array([[0, 0, -1], [0, 0, 1], [0, 0, -1]]), abs=1e-5)


def test_a_distance_has_the_ramps_colours_and_what_is_not_known_is_grey() -> None:
    for m, color in RAMP:
        assert tuple(distance_colors(np.array([m]))[0]) == color
    first, last = RAMP[0][1], RAMP[-1][1]
    assert distance_colors(np.array([-0.2, 9.0])).tolist() == [list(first), list(last)]
    assert tuple(distance_colors(np.array([np.nan]))[0]) == UNKNOWN
    between = distance_colors(np.array([0.05]))[0].astype(float)
    assert between == pytest.approx(np.mean([RAMP[0][1], RAMP[1][1]], axis=0), abs=0.5)


def test_each_part_has_a_colour_of_its_own_and_the_next_signal_another() -> None:
    layout = body_layout()
    numbers = color_numbers(visuals(layout))
    nodes = numbers["skeleton.nodes"]
    assert len(nodes) == 90
    assert set(zip(GROUPS, nodes, strict=True)) == {("body", 0), ("right SRL", 1), ("left SRL", 2)}
    assert GROUPS.count("right SRL") == GROUPS.count("left SRL") == 9
    assert numbers["collision.envelope"] == (3,)


def test_a_row_is_drawn_in_the_root_frame() -> None:
    layout = body_layout()
    row = body_rows(layout, 1, 150)[0]
    nodes, envelope, gaps = Solids(layout).of(row)
    own = layout.value(row, "skeleton.nodes")
    assert nodes == pytest.approx(upright(own))
    head, foot = TREE.index("Head"), TREE.index("LeftFoot_End")
    assert nodes[head, 2] - nodes[foot, 2] > 1.4  # it stands
    solids = layout.value(row, "collision.envelope")
    assert envelope[:, :3] == pytest.approx(upright(solids[:, :3]))
    assert envelope[:, 3:6] == pytest.approx(upright(solids[:, 3:6]))
    assert envelope[:, 6].tolist() == [radius for *_, radius in CAPSULES]
    assert gaps[0, 6] == GAP
    assert not np.isfinite(gaps[1, :6]).any()


def test_every_kind_of_shape_is_drawn_in_measured_frames_too() -> None:
    layout = make_layout()
    things = Solids(layout)
    row = make_rows(layout, 1, 2000)[0]
    found = dict(zip((thing.name for thing in things.things), things.of(row), strict=True))
    assert {name: values.shape for name, values in found.items()} == {
        "hand.tips": (5, 3), "mapping.sphere": (1, 8), "world.tip": (1, 3),
    }  # fmt: skip
    tip, tips = found["world.tip"][0], found["hand.tips"]
    own = layout.value(row, "hand.tips") - layout.value(row, "world.tip")
    assert np.linalg.norm(tips - tip, axis=1) == pytest.approx(np.linalg.norm(own, axis=1))  # one rigid frame
    unseen = dict(zip(found, things.of(make_rows(layout, 1, 1)[0]), strict=True))
    assert not np.isfinite(unseen["hand.tips"]).any()  # its pose isn't known yet


def test_groups_are_kept_in_the_layout_and_older_layouts_have_none() -> None:
    layout = body_layout()
    content = {
        "devices": layout.devices, "words": {"cycle": layout.recorded[0], "device": layout.recorded[1]},
        "fields": [asdict(f) for f in layout.fields.values()], "meta": layout.meta,
    }  # fmt: skip
    assert Layout.from_json(json.dumps(content)).fields == layout.fields
    for field in content["fields"]:
        del field["groups"]
    assert Layout.from_json(json.dumps(content)).fields["skeleton.nodes"].groups == ()


def test_a_group_is_given_for_each_row_or_for_none() -> None:
    signal = Signal(
        name="p", shape=(2, 3), unit="m", labels=("a", "b"), components=(("x", "y", "z"),), groups=("left",)
    )
    assert "1 groups for 2 rows" in signal.naming_fault()
