"""The law: c by the paper's formula, and never a jump."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from helpers.edited import content
from helpers.ikns_law import DT, follow, law, put
from helpers.null_space_arm import MIDDLE, POINTS, Arm
from pydantic import ValidationError

from srl.control.ikns.record import Record, RecordError
from srl.runtime.contracts.errors import ProfileError, WiringError
from srl.runtime.profile import profile, wiring


@pytest.mark.slow
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
    values = content(file)
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
    assert made.metrics()["outside"] == 1.0


@pytest.mark.slow
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
    assert 0.05 < made.metrics()["outside"] < 1.0  # type: ignore[operator]
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
    values = content(file)
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
    values = content(file)
    turns = ("shoulder_abduction", "shoulder_flexion", "shoulder_rotation", "elbow_flexion", "forearm_pronation")
    values["joints"] = [f"right_{name}" for name in (*turns, "wrist_flexion", "wrist_deviation")]
    (tmp_path / "p08.json").write_text(json.dumps(values))
    text = FROM_MARKERS.replace("FILE", str(tmp_path / "p08.json"))
    wiring.build(*profile.parse("p.yaml", text))
    with pytest.raises(WiringError, match=r"input 'held' \(7 1\) of intent isn't bound"):
        wiring.build(*profile.parse("p.yaml", text.replace("held: arm.held, ", "")))
