"""A run of Python's is replayed in C to 1e-13 of each signal's scale, and a run in C to the bit."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.compiled import needs_c

from srl.runtime.ipc import latches
from srl.runtime.ipc.layout import Layout
from srl.runtime.ipc.row import Row
from srl.runtime.loop import process
from srl.runtime.loop.guards import limits_of
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.loop.replay import Comparison, replay
from srl.runtime.profile import profile, wiring

pytestmark = needs_c


def recorded(name: str, cycles: int, backend: str) -> tuple[Layout, np.ndarray]:
    """The rows of a simulated run."""
    checked, source = profile.load(name, (f"backend={backend}",))
    graph = wiring.build(checked, source, [])
    steps = Lockstep(graph)
    assert isinstance(graph.row, Row)
    rows = np.empty((cycles, graph.layout.width), np.int64)
    for k in range(cycles):
        steps.step()
        rows[k] = graph.row.words
    rows[:, 0] -= rows[0, 0]  # a run's cycles begin at zero
    limits = {command: process._plain(value) for command, value in limits_of(graph).items()}
    graph.layout.meta |= {"limits": limits, "automatic": True, "latches": latches.names(latches.NONE)}
    return graph.layout, rows


def scales(layout: Layout, rows: np.ndarray) -> dict[str, float]:
    return {name: float(np.nanmax(np.abs(layout.value(rows, name)), initial=0.0)) for name in layout.fields}


def in_c(layout: Layout, rows: np.ndarray) -> Comparison:
    layout.meta["backend"]["computed"] = "c, of a test"
    return replay(layout, rows, "a test")


@pytest.mark.slow
def test_the_sixth_finger() -> None:
    layout, rows = recorded("sixth-finger", 300, "python")
    assert replay(layout, rows, "a test").identical
    assert in_c(layout, rows).identical  # its mapping and its guard have the same operations
    layout, rows = recorded("sixth-finger", 300, "c")
    assert layout.meta["backend"]["laws"]["mapping"] == "c"
    assert replay(layout, rows, "a test").identical


@pytest.mark.slow
def test_the_finger_of_moca_finger() -> None:
    """The robot's laws make other last bits; the finger's don't."""
    layout, rows = recorded("moca-finger", 400, "python")  # the hand has begun to close
    command = layout.value(rows, "finger.position_command")
    assert np.ptp(command, axis=0).max() > 1e-2
    found = in_c(layout, rows)
    assert {n: d for n, d in found.signals.items() if n.startswith(("mapping.", "finger.")) and d} == {}


@pytest.mark.slow
def test_kairos() -> None:
    layout, rows = recorded("kairos-man", 3200, "python")  # the gripper has closed, and the base drives
    assert np.abs(layout.value(rows, "base.twist_command")).max() > 0.05
    assert replay(layout, rows, "a test").identical
    found, scale = in_c(layout, rows), scales(layout, rows)
    assert {n: d / scale[n] for n, d in found.signals.items() if d > 1e-13 * scale[n]} == {}
    layout, rows = recorded("kairos-man", 800, "c")
    assert layout.meta["backend"]["laws"]["body"] == "c"
    assert replay(layout, rows, "a test").identical


@pytest.mark.slow
def test_moca() -> None:
    layout, rows = recorded("moca-man", 3500, "python")  # the person has taken the handle, and the gripper closes
    assert replay(layout, rows, "a test").identical
    found, scale = in_c(layout, rows), scales(layout, rows)
    # Its flags may differ: what was sent isn't to the last bit what this guard applied, so it begins at that.
    # F stays near its zero: its scale is the stiffness' times a hand's breadth.
    assert {n: d / scale[n] for n, d in found.signals.items() if d > 1e-13 * scale[n] and n != "body.force"} == {}
    assert found.signals["body.force"] < 1e-13 * 500.0 * 0.1
    assert any("backend: recorded with c, of a test" in warning for warning in found.warnings)
    layout, rows = recorded("moca-man", 1500, "c")
    assert layout.meta["backend"]["laws"]["body"] == "c"
    assert replay(layout, rows, "a test").identical
