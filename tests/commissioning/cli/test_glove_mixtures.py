"""`srl calibrate PROFILE glove`: what isn't of one person, one glove and one hand never makes one file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from helpers.edited import edited
from helpers.glove_calibration import NAMES, PROFILE, Gloved

from srl.commissioning.calibration import method
from srl.commissioning.calibration.glove import report as glove_report
from srl.commissioning.calibration.glove.fit import Thresholds
from srl.commissioning.calibration.glove.procedure import Procedure
from srl.commissioning.calibration.glove.samples import Plan
from srl.commissioning.calibration.glove.shapes import Angles
from srl.commissioning.calibration.sources import RowFile
from srl.drivers.cyberglove import calibration
from srl.runtime.cli import main
from srl.runtime.contracts.errors import ProfileError
from srl.runtime.contracts.files import KeptFile

Refused = Callable[..., str]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "worn.yaml").write_text(PROFILE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(glove_report, "draw", lambda _, png: png.touch())
    return tmp_path


@pytest.fixture
def refused(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Refused:
    """Why a calibration is refused, which writes no file."""

    def run(*arguments: str, actor: Gloved | None = None) -> str:
        monkeypatch.setattr(method, "Simulated", lambda *_: actor or Gloved())
        before = sorted(folder.iterdir())
        assert main(["calibrate", "worn.yaml", "glove", *arguments]) == 2
        assert sorted(folder.iterdir()) == before
        return capsys.readouterr().err

    return run


def recorded(path: Path, actor: Gloved) -> None:
    """Records a whole calibration."""
    procedure = Procedure(actor.channel_map.options.sensors, Plan(read=1.0), Angles(), Thresholds())
    while not procedure.done:
        if procedure.step is not actor.step:
            actor.begin(procedure)
        procedure.feed(actor.channel_map.samples(actor.take()))
    actor.begin(procedure)
    actor.take()
    file = RowFile(actor.graph.layout, path)
    for rows in actor.rows:
        file.add(rows)
    file.close()


def test_recordings_of_two_persons_make_no_file(refused: Refused, folder: Path) -> None:
    for person in ("P07", "P08"):
        recorded(folder / f"{person}.rrd", Gloved(person=person))
    assert "P08.rrd: it is of P08, the one before of P07" in refused("--recording", "P07.rrd", "P08.rrd")


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("devices.glove.hand=left", "it is of a right hand, the profile's glove of a left one"),
        ("devices.glove.sensors=18", "it is of a glove of 22 sensors, the profile's has 18"),
    ],
)
def test_another_glove_gives_no_shape(setting: str, words: str, refused: Refused, folder: Path) -> None:
    recorded(folder / "a.rrd", Gloved())
    redo = ("--sim", "--person", "P07", "--redo", "2", "--from", "a.rrd", "--set", setting)
    assert f"--from: {words}" in refused(*redo, actor=Gloved(settings=[setting]))
    assert f"--recording: {words}" in refused("--recording", "a.rrd", "--set", setting)


def test_a_glove_that_was_put_on_anew_isnt_taken_for_the_same(refused: Refused, folder: Path) -> None:
    """It sits otherwise by 0.2 rad, which the fist alone doesn't tell."""
    recorded(folder / "a.rrd", Gloved())
    anew = Gloved(off={number: dict.fromkeys(NAMES, 0.2) for number in range(1, 10)})
    output = refused("--sim", "--person", "P07", "--redo", "2", "--from", "a.rrd", actor=anew)
    assert anew.shaped == 2
    assert "index_mpj: the flat hand differs by 0." in output


def test_exchanged_fingers_that_bend_together_are_found(refused: Refused) -> None:
    """Ring and pinkie are exchanged, and neither bends alone: each takes the other 65 % along."""
    joints = {"mpj": 1.45, "pij": 1.75, "dij": 1.1}

    def alone(finger: str, other: str) -> dict[str, float]:
        reported = {f"{finger}_{joint}": -0.17 * angle for joint, angle in joints.items()}
        return reported | {f"{other}_{joint}": 0.65 * angle for joint, angle in joints.items()}

    exchanged = [(f"ring_{joint}", f"pinkie_{joint}") for joint in joints]
    off = {7: alone("ring", "pinkie"), 8: alone("pinkie", "ring")}
    output = refused("--sim", "--person", "P07", actor=Gloved(off=off, swapped=exchanged))
    assert "ring_pij: while the ring finger alone is bent it shows 65% of the fist, pinkie_pij 83%" in output
    assert "Are their cables exchanged?" in output


def test_a_file_that_the_driver_would_take_for_the_vendors_isnt_written(refused: Refused) -> None:
    assert "takes what ends in '.cal' for the vendor's file" in refused("--sim", "--person", "P07", "-o", "p07.cal")


@pytest.fixture
def made(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(method, "Simulated", lambda *_: Gloved())
    assert main(["calibrate", "worn.yaml", "glove", "--sim", "--person", "P07"]) == 0
    return folder / "p07.json"


@pytest.mark.parametrize("offset", [-300.0, 1e300, 0.0, 400.0])
def test_a_flat_hand_has_a_count(offset: float, made: Path) -> None:
    edited(made, lambda plain: plain["sensors"]["index_mpj"].update(offset=offset))
    with pytest.raises(ProfileError, match=r"index_mpj\.offset"):
        calibration.load(KeptFile.read(made), 22)


def test_counts_are_no_control_value(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """1 to 255 would be a stick that is pushed to its end."""
    (folder / "counts.yaml").write_text(
        "name: counts\nrate: 100\n"
        "devices: {glove: {driver: cyberglove, port: /dev/none, raw: true}}\n"
        "controllers: [{use: axis-position, in: {axis: {from: glove.raw, map: {axis: index_mpj}}}}]\n"
    )
    assert main(["check", "counts.yaml"]) == 2
    assert "units differ: glove.raw has 'count'" in capsys.readouterr().err
