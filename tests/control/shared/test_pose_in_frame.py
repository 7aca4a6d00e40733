"""A hand that motion capture sees, in the frame of a chest that it sees, too: against scipy and the world's truth."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.control import bound
from scipy.spatial.transform import RigidTransform, Rotation

from srl.control.shared.pose_in_frame import PoseInFrame, PoseInFrameConfig
from srl.runtime.contracts.errors import WiringError
from srl.runtime.ipc.header import Cause, State
from srl.runtime.profile import profile, wiring
from srl.testing import simulate

PROFILE = """
name: sight
rate: 100
devices:
  mocap: {driver: vicon, port: "tcp://127.0.0.1:801", segments: {chest: Chest, hand: Hand}, frame: room}
controllers:
  - {use: pose-in-frame, name: near, frame: sternum, in: {pose: mocap.hand.pose}}
frames:
  room: {}
  chest: {parent: room, pose: mocap.chest.pose}
  sternum: {parent: chest, position: [0.0, 0.1, 0.2], rpy: [0.0, 0.0, 1.0]}
sim:
  world: cell
  parts:
    chest: {part: mocap-body, subject: Chest, at: {position: [1.0, 0.0, 1.2]}, motion: {kind: sine}}
    hand: {part: mocap-body, subject: Hand, at: {position: [1.3, 0.2, 1.0]}, motion: {kind: circle}}
  devices:
    mocap: {noise: 0.0, delay: 0.0, occlusion: {}}
bus: null
"""


def rigid(pose: Any) -> RigidTransform:
    return RigidTransform.from_components(pose[:3], Rotation.from_quat(pose[3:], scalar_first=True))


def test_it_multiplies() -> None:
    a, b = np.array([1, 2, 3, 0.5, -0.5, 0.5, 0.5]), np.array([0.1, -0.2, 0.3, 0.6, 0.0, 0.8, 0.0])
    law = bound(PoseInFrame("near", PoseInFrameConfig(frame="chest")), frame=a)
    law.input["pose"][:] = b
    law.reset()
    assert rigid(law.output["pose"]).as_matrix() == pytest.approx((rigid(a) * rigid(b)).as_matrix(), abs=1e-12)
    law.input["pose"][3:] = 0.0
    law.update(0.01)
    assert not np.isfinite(law.output["pose"]).any()


def test_the_hand_as_the_chest_sees_it() -> None:
    run = simulate(PROFILE, seconds=2.0)
    sternum = RigidTransform.from_components([0.0, 0.1, 0.2], Rotation.from_euler("z", 1.0))
    chest, hand, near = (run.value(n) for n in ("mocap.chest.pose", "mocap.hand.pose", "near.pose"))
    seen = np.flatnonzero(near.any(axis=1))
    assert len(seen) > 150
    assert np.ptp(chest[seen], axis=0).max() > 0.01  # it moves
    for c, h, n in zip(chest[seen], hand[seen], near[seen], strict=True):
        assert rigid(n).as_matrix() == pytest.approx(((rigid(c) * sternum).inv() * rigid(h)).as_matrix(), abs=1e-9)


def test_a_chest_that_is_hidden_stops_whoever_needs_it() -> None:
    """Its last pose is still there, and the hand is still seen."""
    run = simulate(PROFILE.replace("occlusion: {}", "occlusion: {Chest: [[1.0, 9.0]]}"), seconds=2.0)
    state, cause = (run.layout.header(run.rows, name) for name in ("state", "cause"))
    stopped = np.flatnonzero(np.isin(state, (State.STOPPING, State.STOPPED)) & (cause == Cause.INTENT_LOSS))
    assert len(stopped)
    assert run.value("mocap.visible")[-1].tolist() == [0.0, 1.0]


def test_a_hand_that_is_hidden_while_the_chest_is_seen() -> None:
    run = simulate(PROFILE.replace("occlusion: {}", "occlusion: {Hand: [[1.0, 9.0]]}"), seconds=2.0)
    assert State.STOPPED in run.states()
    assert np.isnan(run.value("mocap.hand.pose")[-1]).all()  # whoever plays or gets it sees that it is none
    assert np.isfinite(run.value("mocap.chest.pose")[-1]).all()


def test_the_cameras_measure_in_their_own_frame() -> None:
    """The origin stands elsewhere in the room, and turned: the hand in the chest's frame is the same."""
    moved = PROFILE.replace(
        "room: {}", "lab: {}\n  room: {parent: lab, position: [1.0, 2.0, 0.5], rpy: [0.3, 0.2, 1.0]}"
    )
    one, other = simulate(PROFILE, seconds=0.5), simulate(moved, seconds=0.5)
    assert np.linalg.norm(one.value("mocap.hand.pose")[-1, :3] - other.value("mocap.hand.pose")[-1, :3]) > 1.0
    np.testing.assert_allclose(other.value("near.pose")[20:], one.value("near.pose")[20:], atol=1e-9)


def test_a_frame_that_isnt_there_is_named() -> None:
    with pytest.raises(WiringError, match=r"near needs the frame of the pose in 'sternun'.*'sternum'"):
        wiring.build(*profile.parse("p.yaml", PROFILE.replace("frame: sternum", "frame: sternun")))
