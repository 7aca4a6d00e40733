"""The cell's force/torque sensor and handle, against statics done by hand."""

import numpy as np
import pytest
from helpers.ft import at_sensor, cell, push

MS = 1_000_000


def wrench(world):
    world.advance(world.time + 20 * MS)
    return world.parts["sensor"].wrench


def test_a_push_is_measured_with_its_lever():
    world = cell()
    for pushed in ((10, 0, 0, 0, 0, 0), (0, -4, 2, 0, 0, 0), (0, 0, 0, 0.1, 0.2, -0.3)):
        push(world, *pushed)
        np.testing.assert_allclose(wrench(world), at_sensor(world, *pushed), atol=1e-9)


def test_weights_hang_on_it_as_they_do():
    world = cell(gravity=True)
    weight = (0.05 + 0.15) * 9.81  # plate and handle
    np.testing.assert_allclose(wrench(world), [0, 0, -weight, 0, 0, 0], atol=1e-9)


def test_turned_upside_down_it_reads_the_other_sign():
    world = cell(gravity=True, sensor={"at": {"position": (0.0, 0.0, -0.035), "quaternion": (0.0, 1.0, 0.0, 0.0)}})
    assert wrench(world)[2] == pytest.approx(0.2 * 9.81)


def test_scripted_pushes_add_up_and_end():
    pushes = [
        {"start": 0.1, "end": 0.3, "wrench": (1, 0, 0, 0, 0, 0)},
        {"start": 0.2, "end": 0.4, "wrench": (2, 0, 0, 0, 0, 0)},
    ]
    world = cell(handle={"pushes": pushes})
    seen = []
    for end in (0.09, 0.15, 0.25, 0.35, 0.45):
        world.advance(round(end * 1e9))
        seen.append(round(float(world.parts["sensor"].wrench[0]), 9))
    assert seen == [0, 1, 3, 2, 0]


def test_truth_and_restore_bit_for_bit():
    world = cell(gravity=True)
    push(world, 3, 0, 0, 0, 0, 0)
    world.advance(50 * MS)
    kept = world.save()
    push(world, -9, 0, 1, 0, 0, 0)
    world.advance(100 * MS)
    changed = world.truth_arrays["sensor_wrench"].copy()
    world.restore(kept)
    world.advance(100 * MS)
    np.testing.assert_array_equal(world.truth_arrays["handle_push"], [3, 0, 0, 0, 0, 0])
    np.testing.assert_allclose(world.truth_arrays["sensor_wrench"][0], 3.0, atol=1e-9)
    assert changed[0] == pytest.approx(-9)
