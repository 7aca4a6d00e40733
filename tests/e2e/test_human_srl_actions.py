"""The paper's test with its person: 1000 steps at 20 Hz, ten actions, and what the skeleton shows at ten instants."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from helpers.run import call, summary

from srl.runtime.contracts.wearer import Action
from srl.runtime.ipc.header import State
from srl.runtime.recording.reader import read
from srl.sim.parts.body.whole_body_wearer import ACTION

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]
PAUSE = 2.0  # s; so ten actions take 50 s, 1000 steps at 20 Hz
POSTURES = np.array(
    [[0.0] * 7, [-0.8727, -0.8727, -0.5236, 0.0, 0.0, 0.0, 0.8727], [-0.6, -0.3, 0.4, -0.9, 0.08, -0.5, 0.2]]
)
NEAR = np.array([0.08, 0.08, 0.08, 0.08, 0.005, 0.08, 0.08])
X, Y, Z = 0, 1, 2  # left, up, forward


@pytest.mark.exhaustive
def test_ten_actions_are_seen_at_ten_instants(tmp_path: Path) -> None:
    done = summary(
        call(
            tmp_path,
            *("run", "human-srl", "--sim", "--fast", "--duration", "50", "--record", "x.rrd", "--json"),
            *("--set", "rate=20", "--set", "devices.suit.max_age=0.2"),
            *("--set", "sim.parts.wearer.script=actions", "--set", f"sim.parts.wearer.pause={PAUSE}"),
            *("--set", "guard.arm.position_command.clear=null"),  # the test is of the skeleton, at the paper's pace
            timeout=400,
        )
    )
    assert (done["cause"], done["recording_complete"]) == ("end", True)
    recording = read(tmp_path / "x.rrd")
    now, nodes = (recording.int("now") - recording.int("now")[0]) / 1e9, recording.value("skeleton.nodes")
    active = recording.int("state") == State.ACTIVE
    assert abs(np.count_nonzero(active) - 1000) <= 5
    labels = recording.layout.fields["skeleton.nodes"].labels
    for k, action in enumerate(get_args(Action)):
        row = int(np.searchsorted(now, (k + 1) * (PAUSE + ACTION) - 0.5))
        shown(action, {name: nodes[row, labels.index(name)] for name in labels})
    # The arm goes round its three postures meanwhile; there is no left arm, which hangs straight from its base.
    found = [np.flatnonzero((np.abs(POSTURES - q) <= NEAR).all(axis=1)) for q in recording.value("arm.position")]
    visited = [int(each[0]) for each in found if len(each)]
    changes = [k for i, k in enumerate(visited) if i == 0 or visited[i - 1] != k]
    assert len(changes) > 9
    assert changes == [k % 3 for k in range(len(changes))]
    left = nodes[:, labels.index("LEnd")] - nodes[:, labels.index("LBase")]
    size = np.linalg.norm(left[active][1:], axis=1)
    np.testing.assert_allclose(size, size[0], atol=1e-9)


def shown(action: Action, at: dict[str, np.ndarray]) -> None:
    """Checks that the nodes (3,), m, by name, show this action and no other."""
    raised = [side for side in ("Left", "Right") if at[f"{side}Hand"][Y] > at["Head"][Y]]
    assert raised == {"overhead": ["Left", "Right"], "wave": ["Right"]}.get(action, []), action
    ahead = [at[f"{side}Hand"][Z] - at[f"{side}Arm"][Z] > 0.4 for side in ("Left", "Right")]
    assert all(ahead) == (action == "forward"), action
    aside = [side for side in ("Left", "Right") if abs(at[f"{side}Hand"][X] - at["Hips"][X]) > 0.6]
    assert aside == {"reach-left": ["Left"], "reach-right": ["Right"]}.get(action, []), action
    assert (at["Hips"][Y] < 0.7) == (action == "squat"), action
    assert (at["Head"][Z] - at["Hips"][Z] > 0.35) == (action == "bend"), action
    elbows = [at[f"{side}Hand"][Y] - at[f"{side}ForeArm"][Y] for side in ("Left", "Right")]
    level = all(abs(rise) < 0.12 for rise in elbows) and at["LeftHand"][Z] - at["LeftForeArm"][Z] > 0.15
    assert level == (action in ("carry", "forward")), (action, elbows)
    # Turned by the shoulders' line: its left end goes back in a turn to the left.
    back = at["RightArm"][Z] - at["LeftArm"][Z]
    assert (back > 0.15) == (action == "turn-left"), (action, back)
    assert (back < -0.15) == (action == "turn-right"), (action, back)
