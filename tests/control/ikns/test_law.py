"""The law: c by the paper's formula, held without inputs, and never a jump."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.control import bound
from helpers.null_space_arm import MIDDLE, POINTS, Arm, calibrated
from pydantic import ValidationError

from runtime.contracts.errors import ProfileError, WiringError
from runtime.contracts.signals import Array
from runtime.control.ikns.law import Ikns, IknsConfig, matters
from runtime.control.ikns.record import Record, RecordError, parse
from runtime.profile import profile, wiring

DT = 0.01


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("ikns") / "p07.json"
    calibrated(path)
    return path


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Record]:
    path = tmp_path_factory.mktemp("ikns") / "two.json"
    return path, calibrated(path, "clavicle", 2)


def law(file: Path, **options: Any) -> Ikns:
    return bound(Ikns("ikns", IknsConfig(calibration=str(file), **options)))


def put(law: Ikns, arm: Arm, q: Array) -> None:
    law.input["angles"][:] = q
    law.input["hand"][:] = (*arm.pose(q).translation, 1.0, 0.0, 0.0, 0.0)


def follow(law: Ikns, arm: Arm, qs: Array) -> Array:
    """c (T, k) over a motion, from a reset at its beginning."""
    put(law, arm, qs[0])
    law.reset()
    found = [law.output["c"].copy()]
    for q in qs[1:]:
        put(law, arm, q)
        before = law.output["c"].copy()
        law.update(DT)
        assert law.output["c_rate"] == pytest.approx((law.output["c"] - before) / DT)
        found.append(law.output["c"].copy())
    return np.array(found)


@pytest.mark.parametrize(("inset", "close"), [(0.0, 0.02), (0.05, 0.025)])
def test_c_goes_from_0_to_1_with_the_swivel_at_every_point_and_between(file: Path, inset: float, close: float) -> None:
    arm = Arm()
    for place in (*POINTS, MIDDLE):
        swing = arm.swing(arm.at(place), 0.6, 21)
        c = follow(law(file, clamp=False, inset=inset), arm, swing)[:, 0]
        c = c if c[-1] > c[0] else 1.0 - c
        assert (np.diff(c) > 0.0).all()
        assert c[[0, -1]] == pytest.approx([0.0, 1.0], abs=close if place is not MIDDLE else 0.1)


def test_a_hand_that_moves_by_a_millimetre_at_a_nearly_flat_face_hardly_moves_c(file: Path, tmp_path: Path) -> None:
    """A lower face whose points are 3 mm off a plane, with directions that differ: at the hull c is steep there."""
    values = json.loads(file.read_text())
    low = sorted(values["points"], key=lambda point: float(point["site"][2]))[:5]
    for i, point in enumerate(low):
        point["site"][2] = low[0]["site"][2] + 0.003 * (i % 2)
        point["lower"] = [point["lower"][0] + 0.4 * (-1) ** i]
        point["upper"] = [point["upper"][0] + 0.4 * (-1) ** i]
    flat = tmp_path / "flat.json"
    flat.write_text(json.dumps(values))
    arm, rng = Arm(), np.random.default_rng(0)
    corners = np.array([point["site"] for point in low])
    begin = rng.dirichlet(np.ones(5), 100) @ corners
    worst = {}
    for inset in (0.0, 0.05):
        made = law(flat, clamp=False, inset=inset, catch_up=1e6)
        put(made, arm, arm.at(MIDDLE))
        made.reset()
        steps = []
        for at in begin:
            found = []
            for up in (-0.002, -0.001, 0.0, 0.001, 0.002, 0.003, 0.004):
                made.input["hand"][:3] = at + np.array([0.0, 0.0, up])
                made.update(DT)
                found.append(float(made.output["c"][0]))
            steps.append(np.abs(np.diff(found)).max())
        worst[inset] = max(steps)
    assert worst[0.05] < 0.02
    assert worst[0.0] > 4.0 * worst[0.05]


def test_flipped_it_goes_the_other_way(file: Path) -> None:
    arm = Arm()
    swing = arm.swing(arm.at(MIDDLE), 0.6, 21)
    for clamp in (True, False):
        c = follow(law(file, clamp=clamp), arm, swing)
        assert follow(law(file, clamp=clamp, flip=("swivel",)), arm, swing) == pytest.approx(1.0 - c)


def test_beyond_the_range_it_is_clamped_or_not(file: Path) -> None:
    arm = Arm()
    far = arm.swing(arm.at(MIDDLE), 0.8, 21)
    c, free = follow(law(file), arm, far), follow(law(file, clamp=False), arm, far)
    assert free.min() < -0.1
    assert free.max() > 1.1
    assert c == pytest.approx(free.clip(0.0, 1.0))


def test_two_degrees_of_freedom_have_names(two: tuple[Path, Record]) -> None:
    path, record = two
    arm, made = Arm("clavicle"), law(path, flip=("shrug",))
    assert made.inputs[0].labels == arm.names
    assert made.inputs[1].frame == "chest"
    assert made.outputs[0].labels == made.outputs[1].labels == ("swivel", "shrug")
    site = np.array(record.points[0].site)
    place = POINTS[np.linalg.norm(POINTS - site, axis=1).argmin()]
    q = arm.at(place)
    shrug = arm.shrug(q, 1, 0.25, 21)
    c, other = follow(made, arm, shrug), follow(law(path), arm, shrug)
    assert np.ptp(c[:, 1]) > 0.9
    assert np.ptp(c[:, 0]) < 0.1
    assert c == pytest.approx(np.column_stack([other[:, 0], 1.0 - other[:, 1]]))


@pytest.mark.parametrize("missing", ["angles", "hand"])
def test_without_inputs_it_holds_and_comes_back_without_a_jump(file: Path, missing: str) -> None:
    arm, made = Arm(), law(file, catch_up=2.0)
    swing = arm.swing(arm.at(MIDDLE), 0.6, 41)
    c = follow(made, arm, swing[:21])[-1]
    truth = follow(law(file), arm, swing)[-1]
    assert abs(truth - c) > 0.3
    for _ in range(5):
        made.input[missing][1] = np.nan
        made.update(DT)
        assert made.output["c"] == c
        assert made.output["c_rate"] == 0.0
    assert made.figures()["held"] == pytest.approx(5 / 25)
    assert made.figures()["longest_hold_s"] == pytest.approx(5 * DT)
    put(made, arm, swing[-1])
    steps = []
    for _ in range(40):
        before = made.output["c"].copy()
        made.update(DT)
        steps.append(float((made.output["c"] - before)[0]))
    assert np.abs(steps).max() < 2.0 * DT + 1e-9
    assert made.output["c"] == pytest.approx(truth)


def test_a_hold_that_lasts_is_the_loss_of_the_person(file: Path) -> None:
    arm, made = Arm(), law(file, max_hold=0.1)
    put(made, arm, arm.at(MIDDLE))
    made.reset()
    made.input["hand"][0] = np.nan
    lost = []
    for _ in range(15):
        made.update(DT)
        lost.append(made.lost)
    assert lost == [False] * 10 + [True] * 5
    made.reset()
    assert not made.lost  # it may try again, as long as before
    put(made, arm, arm.at(MIDDLE))
    made.update(DT)
    assert not made.lost


def hold(law: Ikns, arm: Arm, *joints: str) -> None:
    law.input["held"][:] = [name in joints for name in arm.names]


WRIST = ("wrist_y", "wrist_x")


@pytest.mark.parametrize("joints", [WRIST, ("shoulder_x",), ("elbow",), ("pronation",), ("shoulder_y", "pronation")])
def test_the_bound_by_which_it_decides(file: Path, joints: tuple[str, ...]) -> None:
    """Angles stay as they were while the person goes through the range; the hand is told as it is."""
    arm, record, wrong, bounds = Arm(), parse(file.read_bytes(), ""), [], []
    which = [arm.names.index(name) for name in joints]
    for place in POINTS:
        (point,) = [p for p in record.points if np.linalg.norm(np.array(p.site) - place) < 0.02]
        swing = arm.swing(arm.at(place), 0.6, 21)
        made = law(file, clamp=False, inset=0.0)
        truth = follow(made, arm, swing)
        put(made, arm, swing[0])
        made.reset()
        gaps = []
        for q, c in zip(swing, truth, strict=True):
            put(made, arm, q)
            made.input["angles"][which] = swing[0, which]
            made.update(DT)
            gaps.append(float(np.abs(made.output["c"] - c)[0]))
        wrong.append(max(gaps))
        span = point.upper[0] - point.lower[0]
        bounds.append(sum(abs(point.directions[0][j]) * point.travel[0][j] for j in which) / span)
    assert (np.array(wrong) < np.array(bounds) + 1e-6).all()
    assert np.mean(wrong) > 0.5 * np.mean(bounds) - 1e-9  # it isn't idle


def test_without_the_wrist_half_of_the_motion_is_unseen(file: Path, two: tuple[Path, Record]) -> None:
    """The table of docs/ikns.md: least and greatest bound over the points, of each DoF."""

    def bounds(path: Path, chain: str, *joints: str) -> list[tuple[float, float]]:
        which = [Arm(chain).names.index(name) for name in joints]
        found = matters(parse(path.read_bytes(), "").calibration())[:, :, which].sum(axis=2)
        return list(zip(found.min(axis=0).round(2).tolist(), found.max(axis=0).round(2).tolist(), strict=True))

    assert bounds(file, "arm", *WRIST) == [(0.42, 0.57)]
    assert bounds(file, "arm", "pronation") == [(0.0, 0.1)]
    assert bounds(file, "arm", "elbow") == [(0.0, 0.0)]
    assert bounds(two[0], "clavicle", *WRIST) == [(0.52, 0.82), (0.34, 1.0)]
    assert bounds(two[0], "clavicle", "pronation") == [(0.01, 0.15), (0.0, 0.21)]
    assert bounds(two[0], "clavicle", "elbow") == [(0.0, 0.02), (0.01, 0.12)]
    assert bounds(two[0], "clavicle", "elevation") == [(0.03, 0.1), (0.3, 0.57)]


def test_while_a_joint_that_matters_is_held_so_is_c(file: Path) -> None:
    arm, made = Arm(), law(file)
    swing = arm.swing(arm.at(MIDDLE), 0.6, 41)
    c = follow(made, arm, swing[:21])[-1]
    assert made.output["held"] == 0.0
    for q in swing[21:]:
        put(made, arm, q)
        hold(made, arm, *WRIST)
        made.update(DT)
        assert made.output["c"] == c
        assert made.output["c_rate"] == 0.0
        assert made.output["held"] == 1.0
    truth = follow(law(file), arm, swing)[-1]
    assert abs(truth - c) > 0.3
    hold(made, arm)
    for n in range(1, 100):
        made.update(DT)
        assert made.output["held"] == 0.0
        assert made.output["c"] == pytest.approx(c + np.clip(truth - c, -n * DT, n * DT))


def test_a_joint_that_hardly_moves_doesnt_hold_c(file: Path) -> None:
    arm, made = Arm(), law(file)
    swing = arm.swing(arm.at(MIDDLE), 0.6, 41)
    truth = follow(law(file), arm, swing)
    put(made, arm, swing[0])
    hold(made, arm, "elbow")
    made.reset()
    for q, c in zip(swing[1:], truth[1:], strict=True):
        put(made, arm, q)
        made.input["angles"][arm.names.index("elbow")] = swing[0, arm.names.index("elbow")]
        made.update(DT)
        assert made.output["held"] == 0.0
        assert made.output["c"] == pytest.approx(c, abs=0.1)
    # It comes back elsewhere, as somebody's angles might: c doesn't jump.
    hold(made, arm)
    made.input["angles"][arm.names.index("elbow")] += 0.5
    before = made.output["c"].copy()
    for _ in range(10):
        made.update(DT)
        assert np.abs(made.output["c"] - before).max() < DT + 1e-9
        before = made.output["c"].copy()


def test_each_degree_of_freedom_is_held_for_itself(two: tuple[Path, Record]) -> None:
    arm, made = Arm("clavicle"), law(two[0], unseen=0.2)
    q = arm.at(MIDDLE)
    put(made, arm, q)
    made.reset()
    hold(made, arm, "elevation")
    made.update(DT)
    assert made.output["held"].tolist() == [0.0, 1.0]
    hold(made, arm, *arm.names)
    made.update(DT)
    assert made.output["held"].tolist() == [1.0, 1.0]


def test_whether_angles_are_held_must_be_known_or_waived(file: Path) -> None:
    assert [s.name for s in law(file, held=False).inputs] == ["angles", "hand"]
    arm, made = Arm(), law(file)
    put(made, arm, arm.at(MIDDLE))
    made.input["held"][0] = np.nan
    made.reset()
    made.update(DT)
    assert made.output["held"] == 1.0


def test_it_begins_where_what_it_commands_is(file: Path) -> None:
    arm, made = Arm(), law(file)
    made.applied = {"c": np.array([0.9])}
    q = arm.at(MIDDLE)
    put(made, arm, q)
    made.reset()
    assert made.output["c"] == 0.9
    rest = follow(law(file), arm, q[None])[0]
    for n in range(1, 100):
        made.update(DT)
        assert made.output["c"] == pytest.approx(max(rest[0], 0.9 - n * DT))
    made.input["hand"][:] = np.nan
    made.reset()
    assert made.output["c"] == 0.9


def test_the_share_of_cycles_outside_counts_no_reset(file: Path) -> None:
    arm, made = Arm(), law(file)
    put(made, arm, arm.at(MIDDLE))
    made.input["hand"][:3] = MIDDLE + 1.0
    made.reset()
    for _ in range(3):
        made.update(DT)
    assert made.figures()["outside"] == 1.0


def test_across_the_hull_c_is_continuous(file: Path) -> None:
    """The hand moves out of the points' hull and back in elsewhere; the arm's angles stay."""
    arm, made = Arm(), law(file, clamp=False)
    q = arm.at(MIDDLE)
    put(made, arm, q)
    angle = np.linspace(0.0, 2 * np.pi, 20_001)
    path = MIDDLE + np.column_stack([0.09 * np.cos(angle), 0.11 * np.sin(angle), 0.05 * np.sin(3 * angle)])
    made.input["hand"][:3] = path[0]
    made.reset()
    before, steps = made.output["c"].copy(), []
    for place in path[1:]:
        made.input["hand"][:3] = place
        made.update(DT)
        steps.append(float(np.abs(made.output["c"] - before)[0]))
        before = made.output["c"].copy()
    assert 0.05 < made.figures()["outside"] < 1.0  # type: ignore[operator]
    assert max(steps) < 0.02  # of 50 um each; at the hull's flat faces Sibson's weights are steep


def test_what_cant_be_used_is_refused_with_place_and_remedy(file: Path, tmp_path: Path) -> None:
    with pytest.raises(ValidationError, match=r"there is no file .*none\.json\. Make it with `srl calibrate"):
        law(tmp_path / "none.json")
    (tmp_path / "odd.json").write_text("{")
    with pytest.raises(RecordError, match=r"odd\.json: .*Calibrate again"):
        law(tmp_path / "odd.json")
    with pytest.raises(
        ProfileError, match=r"controllers\.ikns\.flip: .* no degree of freedom 'swiwel'\. Did you mean 'swivel'"
    ):
        law(file, flip=("swiwel",))
    values = json.loads(file.read_text())
    values["points"][2]["samples"] = [3]
    (tmp_path / "few.json").write_text(json.dumps(values))
    with pytest.raises(
        ProfileError, match=r"controllers\.ikns\.calibration: .*few\.json: point 3: samples kept: 3.*Redo"
    ):
        law(tmp_path / "few.json")


@pytest.mark.filterwarnings("ignore:overflow", "ignore:invalid value")
def test_numbers_that_arent_finite_never_come_out(file: Path) -> None:
    arm, made = Arm(), law(file)
    put(made, arm, arm.at(MIDDLE))
    made.reset()
    for value in (np.nan, np.inf, -np.inf, 1e308, -1e200):
        for name in ("angles", "hand"):
            put(made, arm, arm.at(MIDDLE))
            made.input[name][0] = value
            made.update(DT)
            assert np.isfinite(made.output["c"]).all()
            assert np.isfinite(made.output["c_rate"]).all()
            made.reset()
            assert np.isfinite(made.output["c"]).all()


PROFILE = """
name: null-space
rate: 100
devices:
  mocap: {driver: vicon, port: "tcp://127.0.0.1:801", segments: {hand: Hand}, frame: chest}
setpoints:
  client.angles: {shape: [7], unit: rad, labels: [LABELS], max_age: 0.5}
controllers:
  - {use: ikns, name: null-space, calibration: FILE, held: false, in: {angles: client.angles, hand: mocap.hand.pose}}
frames:
  chest: {}
sim:
  world: cell
  parts:
    hand: {part: mocap-body, subject: Hand, at: {position: [0.3, 0.0, 1.0]}, motion: {kind: sine}}
"""


def test_wiring_goes_by_the_calibrations_names_and_frame(file: Path) -> None:
    labels = ", ".join(Arm().names[::-1])
    text = PROFILE.replace("FILE", str(file)).replace("LABELS", labels)
    wiring.build(*profile.parse("p.yaml", text))
    elsewhere = text.replace("frame: chest", "frame: room").replace("  chest: {}", "  room: {}\n  chest: {}")
    with pytest.raises(WiringError, match=r"is in 'room', .*hand expects 'chest'"):
        wiring.build(*profile.parse("p.yaml", elsewhere))
    with pytest.raises(WiringError, match="elbow"):
        wiring.build(*profile.parse("p.yaml", text.replace("elbow", "ellbow")))


FROM_MARKERS = """
name: null-space
rate: 100
devices:
  mocap:
    driver: vicon
    port: "tcp://127.0.0.1:801"
    frame: room
    markers: {clav: A/CLAV, c7: A/C7, strn: A/STRN, t10: A/T10, rsho: A/RSHO, rupa: A/RUPA, relb: A/RELB, rfrm: A/RFRM,
              rwra: A/RWRA, rwrb: A/RWRB, rfin: A/RFIN}
models:
  body: {kind: body, sides: [right]}
frames:
  room: {}
  chest: {parent: room, pose: arm.chest}
controllers:
  - {use: arm-angles, name: arm, chest: chest, in: {markers: mocap.markers, marker_visible: mocap.marker_visible}}
  - {use: ikns, name: intent, calibration: FILE, in: {angles: arm.angles, held: arm.held, hand: arm.hand}}
"""


def test_it_takes_from_arm_angles_what_that_gives(file: Path, tmp_path: Path) -> None:
    values = json.loads(file.read_text())
    turns = ("shoulder_abduction", "shoulder_flexion", "shoulder_rotation", "elbow_flexion", "forearm_pronation")
    values["joints"] = [f"right_{name}" for name in (*turns, "wrist_flexion", "wrist_deviation")]
    (tmp_path / "p08.json").write_text(json.dumps(values))
    text = FROM_MARKERS.replace("FILE", str(tmp_path / "p08.json"))
    wiring.build(*profile.parse("p.yaml", text))
    with pytest.raises(WiringError, match=r"input 'held' \(7 1\) of intent isn't bound"):
        wiring.build(*profile.parse("p.yaml", text.replace("held: arm.held, ", "")))
