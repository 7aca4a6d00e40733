"""The law arm-angles: by its contract, in a profile with simulated cameras, from markers and from segments."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.control import bound
from helpers.mocap import made, reaching
from pydantic import ValidationError

from srl.control.ikns.arm_angles import ArmAngles, ArmAnglesConfig
from srl.runtime.contracts import rotation
from srl.runtime.contracts.errors import ProfileError, WiringError
from srl.runtime.models.body import average
from srl.runtime.models.models import BodyModel, MarkerPlace
from srl.runtime.profile import profile as profiles
from srl.runtime.profile import wiring
from srl.testing import check_controller, simulate

MODEL = BodyModel(stature=1.75)
ARM = average(1.75, ("right",))
ANGLES = ARM.chains["right_arm"]
SEGMENTS = ("torso", "right_clavicle", "right_upper_arm", "right_forearm", "right_hand")


def law(**options: Any) -> ArmAngles:
    return bound(ArmAngles("arm", ArmAnglesConfig(**{"body": MODEL, **options})))


def show(arm: ArmAngles, q: np.ndarray, *hidden: str) -> None:
    arm.input["markers"][:] = made(ARM, q)
    arm.input["marker_visible"][:] = [name not in hidden for name in arm.inputs[0].labels]


def pose(T: np.ndarray) -> np.ndarray:
    return np.array([*T[:3, 3], *rotation.from_matrix(T[:3, :3])])


def test_it_keeps_the_contract_of_controllers() -> None:
    arm = law(chains=("torso", "clavicle", "arm"))
    show(arm, reaching(ARM, 1)[0])
    check_controller(arm, inputs={name: np.copy(value) for name, value in arm.input.items()}, start={})
    assert arm.outputs[0].labels == ARM.names[3:]


def test_markers_give_angles_the_hand_in_the_chest_and_the_chest() -> None:
    arm = law()
    assert arm.inputs[0].labels == tuple(name.lower() for name in ARM.markers)
    motion = reaching(ARM, 50)
    for i, q in enumerate(motion):
        show(arm, q)
        arm.update(0.01) if i else arm.reset()
        poses = ARM.forward(q)
        grip = np.eye(4)
        grip[:3, 3] = ARM.grip("right")
        np.testing.assert_allclose(arm.output["angles"], q[list(ANGLES)], atol=3e-3)
        hand = rotation.homogeneous(arm.output["hand"])
        np.testing.assert_allclose(hand, np.linalg.inv(poses["torso"]) @ poses["right_hand"] @ grip, atol=3e-3)
        np.testing.assert_allclose(rotation.homogeneous(arm.output["chest"]), poses["torso"], atol=3e-3)
    assert arm.output["used"].tolist() == [1.0] * len(ARM.markers)
    assert not arm.output["held"].any()
    assert arm.metrics() == {"frames": 50, "misfits": 0, "missing": {}, "rejected": {}}


def test_the_hand_in_the_chest_doesnt_know_where_the_person_stands() -> None:
    arm, q = law(), reaching(ARM, 1)[0]
    hands = []
    for place in ((0.0, 0.0, 0.0), (3.0, -2.0, 0.4)):
        q[:3], q[3] = place, place[0]
        show(arm, q)
        arm.reset()
        hands.append(arm.output["hand"].copy())
    np.testing.assert_allclose(hands[0], hands[1], atol=1e-4)


def test_the_left_arm_is_the_mirrored_right_one() -> None:
    right, left = law(), law(side="left")
    q = reaching(ARM, 1)[0]
    q[:6] = 0.0
    show(right, q)
    left.input["markers"][:] = right.input["markers"] * (1.0, -1.0, 1.0)
    left.input["marker_visible"][:] = 1.0
    for arm in (right, left):
        arm.reset()
    np.testing.assert_allclose(left.output["angles"], right.output["angles"], atol=1e-6)
    np.testing.assert_allclose(left.output["hand"][:3], right.output["hand"][:3] * (1.0, -1.0, 1.0), atol=1e-6)


def test_what_isnt_seen_is_held_and_said() -> None:
    arm, motion = law(), reaching(ARM, 40)
    for i, q in enumerate(motion):
        show(arm, q, *(["rfin"] if i >= 20 else []))
        arm.update(0.01) if i else arm.reset()
    held = dict(zip(arm.outputs[1].labels, arm.output["held"], strict=True))
    assert {name for name, value in held.items() if value} == {"right_wrist_flexion", "right_wrist_deviation"}
    assert arm.output["used"][arm.inputs[0].labels.index("rfin")] == 0.0
    assert arm.metrics()["missing"] == {"rfin": 0.5}
    before = arm.output["angles"].copy()
    arm.input["marker_visible"][:] = 0.0
    arm.update(0.01)
    np.testing.assert_array_equal(arm.output["angles"], before)
    assert arm.output["held"].all()
    assert arm.metrics()["misfits"] == 1


@pytest.mark.parametrize("hidden", [("c7", "t10"), ("c7", "strn"), ("t10", "strn"), ("c7", "clav", "strn")])
@pytest.mark.parametrize("moved", ["right_clavicle_protraction", "torso_yaw"])
def test_an_arm_on_a_shoulder_that_isnt_seen_is_held(hidden: tuple[str, ...], moved: str) -> None:
    """The markers of the arm are all there; the joint beneath it goes by 20 degrees meanwhile."""
    arm, q = law(), reaching(ARM, 1)[0]
    show(arm, q)
    arm.reset()
    before = {name: arm.output[name].copy() for name in ("angles", "hand")}
    for share in np.linspace(0.0, 1.0, 50):
        there = q.copy()
        there[ARM.names.index(moved)] += share * np.deg2rad(20.0)
        show(arm, there, *hidden)
        arm.update(0.01)
        assert arm.output["held"].all()
        np.testing.assert_array_equal(arm.output["angles"], before["angles"])
        np.testing.assert_allclose(arm.output["hand"], before["hand"], atol=1e-12)
    show(arm, there)
    arm.update(0.01)
    assert not arm.output["held"].any()
    np.testing.assert_allclose(arm.output["angles"], there[list(ANGLES)], atol=0.02)


def test_a_swap_is_said() -> None:
    arm, q = law(), reaching(ARM, 1)[0]
    show(arm, q)
    arm.reset()
    a, b = (arm.inputs[0].labels.index(name) for name in ("rwra", "rwrb"))
    arm.input["markers"][[a, b]] = arm.input["markers"][[b, a]]
    arm.update(0.01)
    assert arm.output["used"][[a, b]].tolist() == [-1.0, -1.0]
    np.testing.assert_allclose(arm.output["angles"], q[list(ANGLES)], atol=3e-3)


def test_before_anybody_is_seen_there_is_no_pose() -> None:
    """Nobody measured one. The angles are finite, and held."""
    arm = law()
    for _ in range(2):  # also when somebody was there in the run before
        arm.input["marker_visible"][:] = 0.0
        arm.reset()
        arm.update(0.01)
        assert np.isnan(arm.output["chest"]).all()
        assert np.isnan(arm.output["hand"]).all()
        assert np.isnan(arm.output["residual"]).all()
        assert np.isfinite(arm.output["angles"]).all()
        assert arm.output["held"].all()
        show(arm, reaching(ARM, 1)[0])
        for _ in range(20):
            arm.update(0.01)
        assert all(np.isfinite(value).all() for value in arm.output.values())
        assert not arm.output["held"].any()


@pytest.mark.parametrize(
    ("hidden", "lost"),
    [(tuple(name.lower() for name in ARM.markers), True), (("c7", "t10"), True), (("rfin",), False)],
)
def test_a_chest_or_shoulder_that_stays_away_is_the_loss_of_the_person(hidden: tuple[str, ...], lost: bool) -> None:
    arm, q = law(max_hold=0.505), reaching(ARM, 1)[0]
    show(arm, q)
    arm.reset()
    chest = arm.output["chest"].copy()
    show(arm, q, *hidden)
    found = []
    for _ in range(60):
        arm.update(0.01)
        found.append(arm.lost)
    assert found == [False] * 50 + [lost] * 10
    np.testing.assert_allclose(arm.output["chest"], chest, atol=1e-6)
    assert np.isnan(arm.output["residual"]).any() == (len(hidden) == len(ARM.markers))
    show(arm, q)
    for _ in range(30):
        arm.update(0.01)
    assert not arm.lost
    arm.reset()
    assert not arm.lost


def test_holds_of_the_chest_add_up() -> None:
    arm, q = law(max_hold=0.5), reaching(ARM, 1)[0]
    show(arm, q)
    arm.reset()
    for _ in range(4):
        show(arm, q, "c7", "t10")
        for _ in range(20):
            arm.update(0.01)
        lost = arm.lost
        show(arm, q)
        for _ in range(8):
            arm.update(0.01)
    assert lost
    assert not law(max_hold=float("inf")).lost


def test_how_long_it_may_hold_is_a_time() -> None:
    for value in (0.0, -1.0, float("nan")):
        with pytest.raises(ValidationError):
            ArmAnglesConfig(body=MODEL, max_hold=value)


def test_segments_give_the_same_angles() -> None:
    """Each measured frame stands 3 cm beside the body's, turned."""
    beside = {"position": (0.03, -0.02, 0.01), "rpy": (0.3, -0.2, 0.5)}
    arm = law(segments={s.replace("_", "-"): {"segment": s, **beside} for s in SEGMENTS})
    assert [s.name for s in arm.inputs] == ["pose", "visible"]
    offset = np.eye(4)
    offset[:3, :3], offset[:3, 3] = rotation.matrix(rotation.from_rpy(*beside["rpy"])), beside["position"]
    for i, q in enumerate(reaching(ARM, 30)):
        poses = ARM.forward(q)
        arm.input["pose"][:] = [pose(poses[s] @ np.linalg.inv(offset)) for s in SEGMENTS]
        arm.input["visible"][:] = 1.0
        arm.update(0.01) if i else arm.reset()
        np.testing.assert_allclose(arm.output["angles"], q[list(ANGLES)], atol=3e-3)
    arm.input["visible"][SEGMENTS.index("right_hand")] = 0.0
    arm.update(0.01)
    assert arm.output["held"].tolist() == [0.0] * 5 + [1.0] * 2


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"side": "middle"}, "left"),
        ({"body": BodyModel(sides=("left",))}, "no right arm"),
        ({"segments": {"hand": {"segment": "right_hnd"}}}, "Did you mean 'right_hand'"),
    ],
)
def test_wrong_options_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        ArmAnglesConfig(**{"body": MODEL, **options})


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"body": BodyModel(markers={"RFIN": None})}, "don't show right_wrist_flexion.*Add markers of the hand"),
        ({"body": BodyModel(markers={"C7": None, "T10": None})}, "three markers of the torso"),
        ({"segments": {"hand": {"segment": "right_hand"}}}, "the torso's segment"),
    ],
)
def test_markers_that_cant_be_done_without_are_named(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ProfileError, match=words):
        law(**options)


def test_a_marker_of_ones_own_takes_the_place_of_another() -> None:
    place = MarkerPlace(segment="right_hand", at=(0.02, 0.0, -0.07))
    arm = ArmAngles("arm", ArmAnglesConfig(body=BodyModel(markers={"RFIN": None, "KNUCKLE": place})))
    assert arm.inputs[0].labels[-1] == "knuckle"


# In a profile: bodies with the arm's markers stand still in the cell, cameras see them

POSTURE = reaching(ARM, 1)[0] + np.eye(15)[0] * 0.4 + np.eye(15)[2] * 1.3


def profile(occlusion: str = "{}") -> str:
    poses = ARM.forward(POSTURE)
    parts, markers = [], []
    for segment in SEGMENTS:
        at, body = pose(poses[segment]).tolist(), segment.replace("_", "-")
        places = {n: list(m.at) for n, m in ARM.markers.items() if m.segment == segment}
        parts.append(
            f"    {body}: {{part: mocap-body, subject: {segment}, markers: {places}, "
            f"motion: {{kind: still}}, contact: false, "
            f"at: {{position: {at[:3]}, quaternion: {at[3:]}}}}}"
        )
        markers += [f"{n.lower()}: {segment}/{n}" for n in places]
    return "\n".join(
        [
            "name: arm-sight\nrate: 100\nbus: null",
            "devices:\n  mocap:\n    driver: vicon\n    port: tcp://127.0.0.1:801\n    frame: room",
            f"    markers: {{{', '.join(markers)}}}",
            "models: {body: {kind: body, stature: 1.75}}",
            "frames: {room: {}, chest: {parent: room, pose: arm.chest}}",
            "controllers:",
            "  - use: arm-angles\n    name: arm\n    chest: chest",
            "    in: {markers: mocap.markers, marker_visible: mocap.marker_visible}",
            "  - {use: pose-in-frame, name: back, frame: room, in: {pose: arm.hand}}",
            "sim:\n  world: cell\n  parts:",
            *parts,
            f"  devices: {{mocap: {{noise: 0.0005, delay: 0.0, occlusion: {occlusion}}}}}",
        ]
    )


def test_simulated_cameras_see_the_arm() -> None:
    run = simulate(profile("{right_hand/RFIN: [[1.0, 1.5]]}"), seconds=2.0)
    angles, held = run.value("arm.angles"), run.value("arm.held")
    settled = slice(30, None)
    assert np.rad2deg(np.abs(angles[settled] - POSTURE[list(ANGLES)])).max() < 5.0
    assert np.rad2deg(np.abs(angles[settled].mean(axis=0) - POSTURE[list(ANGLES)])).max() < 1.0
    assert 45 <= held[:, -1].sum() <= 55
    assert np.abs(np.diff(angles[settled], axis=0)).max() < np.deg2rad(6.0)
    # The chest is a frame of the tree, so the hand can be given in the room again.
    hand = ARM.forward(POSTURE)["right_hand"] @ np.array([*ARM.grip("right"), 1.0])
    np.testing.assert_allclose(run.value("back.pose")[settled, :3].mean(axis=0), hand[:3], atol=5e-3)


def test_before_the_chest_is_seen_what_is_in_its_frame_is_nowhere() -> None:
    hidden = ", ".join(f"torso/{name}: [[0.0, 0.5]]" for name in ("C7", "T10", "CLAV"))
    run = simulate(profile(f"{{{hidden}}}"), seconds=1.0)
    chest, back = run.value("arm.chest"), run.value("back.pose")
    assert np.isnan(chest[2:45]).all()  # in the first cycle no law has run
    assert np.isnan(back[2:45]).all()
    assert np.isfinite(chest[60:]).all()
    assert np.isfinite(back[60:]).all()


def test_a_speed_of_the_chest_is_refused() -> None:
    text = profile().replace("pose: arm.chest}", "pose: arm.chest, speed: 3.0}")
    with pytest.raises(WiringError, match=r"frames\.chest\.speed: 'arm\.chest' is a law's.*Remove it"):
        wiring.build(*profiles.parse("p.yaml", text))


def test_a_marker_that_isnt_wired_is_named() -> None:
    text = profile().replace(", rfin: right_hand/RFIN", "")
    with pytest.raises(WiringError, match="rfin"):
        wiring.build(*profiles.parse("p.yaml", text))
