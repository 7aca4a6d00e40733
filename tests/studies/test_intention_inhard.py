"""InHARD's format, on a data set that this test makes of simulated people: what is in it says nothing about people."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from helpers.intention import ACTIONS, SKELETON, law_of, play, record_of

from srl.control.intention.features import joints, trunk_of
from srl.control.intention.training import TrainingError
from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.rotation import euler_angles, matrices
from srl.runtime.contracts.wearer import Perform, Rest
from srl.runtime.models.skeleton import bvh
from srl.sim.wearer import inhard
from srl.sim.wearer.people import subject
from srl.sim.wearer.performer import Performer, measured
from srl.studies.intention.inhard import recogniser, trials

RATE = 120.0
PEOPLE = (1, 2, 3)
SOME = ("overhead", "bend", "wave")
LABELS = {"overhead": "Put down component", "bend": "Picking in front", "wave": "Turn sheets"}
HEADER = (
    "File_name", "Subject", "Operation", "Action_label", "Meta_action_number", "Meta_action_label",
    "Action_start_bvh_frame", "Action_end_bvh_frame", "Action_start_rgb_sec", "Duration_sec",
)  # fmt: skip


def write_bvh(path: Path, rotation: np.ndarray, translation: np.ndarray) -> None:
    """As Axis Neuron exports: six channels a joint, Y X Z, centimetres, end sites."""
    children = {i: [k for k, up in enumerate(SKELETON.parents) if up == i] for i in range(59)}
    lines, order = ["HIERARCHY"], list[int]()

    def joint(i: int, kind: str) -> None:
        order.append(i)
        x, y, z = SKELETON.offsets[i] * 100
        lines.extend([f"{kind} {SKELETON.names[i]}", "{", f"OFFSET {x:.6f} {y:.6f} {z:.6f}"])
        lines.append("CHANNELS 6 Xposition Yposition Zposition Yrotation Xrotation Zrotation")
        for child in children[i]:
            joint(child, "JOINT")
        if not children[i]:
            lines.extend(["End Site", "{", "OFFSET 0 0 0", "}"])
        lines.append("}")

    joint(0, "ROOT")
    lines.extend(["MOTION", f"Frames: {len(rotation)}", f"Frame Time: {1 / RATE:.6f}"])
    for q, p in zip(rotation, translation, strict=True):
        degrees = np.rad2deg(euler_angles(matrices(q), "YXZ"))
        lines.append(" ".join(f"{v:.4f}" for i in order for v in (*(p[i] * 100), *degrees[i])))
    path.write_text("\n".join(lines) + "\n")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("inhard")
    (made / "Skeleton").mkdir()
    table = []
    for number in PEOPLE:
        person, t, name = Performer(subject(number, SKELETON.names), SKELETON), 1.0, f"P{number:02d}_R01"
        for action in SOME:
            person.instruct(t, Perform(action))
            first, last = round((t + 0.4) * RATE), round((t + 2.5) * RATE)
            row = dict.fromkeys(HEADER, "0")
            row |= {"File_name": name, "Subject": f"P{number:02d}", "Operation": "OP010"}
            row |= {"Meta_action_label": LABELS[action], "Action_label": f"[OP010] {action}, as told"}
            table.append(row | {"Action_start_bvh_frame": str(first), "Action_end_bvh_frame": str(last)})
            person.instruct(t + 2.5, Rest())
            t += 4.0
        idle = dict.fromkeys(HEADER, "0") | {"File_name": name, "Subject": f"P{number:02d}"}
        table.append(idle | {"Meta_action_label": "No action", "Action_end_bvh_frame": "110"})
        write_bvh(made / "Skeleton" / f"{name}.bvh", *measured(person, np.arange(0.0, t, 1 / RATE)))
    with (made / "InHARD.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, HEADER)
        writer.writeheader()
        writer.writerows(table)
    return made


def test_labels_and_frames_are_those_of_the_table(folder: Path) -> None:
    found = inhard.actions(folder)
    assert len(found) == 12
    first = found[0]
    assert (first.file, first.subject, first.label) == ("P01_R01", "P01", "put-down-component")
    assert (first.first, first.last) == (168, 420)
    assert {a.label for a in found} == {"put-down-component", "picking-in-front", "turn-sheets", "no-action"}


def test_the_motion_is_the_files(folder: Path) -> None:
    """The oracle is the forward kinematics of the BVH reader, by matrices in file order."""
    motion = inhard.motion(folder, "P02_R01")
    file = bvh.read(folder / "Skeleton" / "P02_R01.bvh")
    assert motion.rate == pytest.approx(RATE, rel=1e-4)
    R, p = np.empty((59, 3, 3)), np.empty((59, 3))
    for i, (up, own) in enumerate(zip(SKELETON.parents, matrices(motion.rotation[300]), strict=True)):
        above = R[up] if up >= 0 else np.eye(3)
        R[i] = above @ own
        p[i] = (p[up] if up >= 0 else 0.0) + above @ motion.translation[300, i]
    oracle = file.world_positions()[300] * 0.01
    np.testing.assert_allclose(p, [oracle[file.index(name)] for name in SKELETON.names], atol=1e-9)


@pytest.mark.exhaustive
@pytest.mark.slow
def test_a_recogniser_of_several_people_comes_of_it(folder: Path) -> None:
    found = trials(folder)
    assert len(found) == 9
    assert {t.group for t in found} == {0, 1, 2}
    made, held, record = recogniser(folder)
    assert set(made.actions) == {label.lower().replace(" ", "-") for label in LABELS.values()}
    assert held.trials.tolist() == [3, 3, 3]
    assert held.accuracy > 0.7
    assert (record.person, record.simulated) == ("InHARD", False)
    law = law_of(record)
    motion = inhard.motion(folder, "P01_R01")
    own = [motion.names.index(name) for name in joints(trunk_of(motion.names))]
    out = play(law, motion.rotation[:420, own], motion.translation[:420, own], 1 / RATE)
    at = made.actions.index("put-down-component")
    assert out["posterior"][-1].argmax() == at
    assert record_of((made, held)).actions == made.actions
    assert not set(made.actions) & set(ACTIONS)


def test_other_delimiters_and_a_byte_order_mark_are_taken(folder: Path, tmp_path: Path) -> None:
    with (folder / "InHARD.csv").open(newline="") as file:
        table = list(csv.reader(file))
    with (tmp_path / "InHARD.csv").open("w", newline="", encoding="utf-8-sig") as out:
        csv.writer(out, delimiter=";").writerows(table)
    assert inhard.actions(tmp_path) == inhard.actions(folder)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda text: text.replace("Subject", "Person"), r"InHARD\.csv: it has no column 'Subject'"),
        (lambda text: text.replace(",168,", ",x,"), r"InHARD\.csv, line 2: it isn't an action"),
        (lambda text: text.replace(",168,", ",999,"), r"line 2: it isn't an action"),
        (lambda text: text.replace(",420,", ",42000,"), r"P01_R01: an action ends at frame 42000"),
        (lambda text: text.replace("P01_R01", "P01_R09"), r"P01_R09\.bvh"),
    ],
)
def test_what_isnt_right_is_named(folder: Path, tmp_path: Path, change, words: str) -> None:
    (tmp_path / "Skeleton").symlink_to(folder / "Skeleton")
    (tmp_path / "InHARD.csv").write_text(change((folder / "InHARD.csv").read_text()))
    with pytest.raises(RecordingError, match=words):
        trials(tmp_path)


def test_a_missing_folder_and_too_few_people_are_named(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="Name the unpacked folder of the data set"):
        trials(tmp_path / "none")
    (tmp_path / "Skeleton").symlink_to(folder / "Skeleton")
    lines = (folder / "InHARD.csv").read_text().splitlines()
    (tmp_path / "InHARD.csv").write_text("\n".join(line for line in lines if "P03" not in line) + "\n")
    with pytest.raises(TrainingError, match="it was done 2 times, 3 are needed"):
        recogniser(tmp_path)


def test_a_file_of_another_skeleton_is_named(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "Skeleton").mkdir()
    for path in (folder / "Skeleton").glob("*.bvh"):
        (tmp_path / "Skeleton" / path.name).write_text(path.read_text().replace("JOINT LeftArm", "JOINT Chest"))
    (tmp_path / "InHARD.csv").write_text((folder / "InHARD.csv").read_text())
    with pytest.raises(RecordingError, match="it has no joint 'LeftArm'"):
        trials(tmp_path)
