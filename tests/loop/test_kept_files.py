"""A file that an option names: found beside the profile, kept with the run, replayed from the recording alone."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from helpers.edited import content
from helpers.null_space_arm import Arm, calibrated
from helpers.run import call, summary

from srl.drivers.cyberglove.protocol import LABELS_22
from srl.runtime.cli import main
from srl.runtime.contracts.errors import ProfileError, RecordingError
from srl.runtime.contracts.files import LARGEST, encoded
from srl.runtime.loop.replay import replay
from srl.runtime.profile import profile, wiring
from srl.runtime.recording.reader import read

# Fingers are taken for the arm: what the angles mean doesn't matter here, that they move does.
PROFILE = """
name: null-space
rate: 100
devices:
  mocap: {driver: vicon, port: "tcp://127.0.0.1:801", segments: {hand: Hand}, frame: chest}
  glove: {driver: cyberglove, port: /dev/none}
controllers:
  - use: ikns
    name: intent
    calibration: people/p07.json
    held: false
    in: {angles: {from: glove.position, map: MAP}, hand: mocap.hand.pose}
frames:
  chest: {}
bus: null
sim:
  world: cell
  parts:
    person: {part: human-hand}
    hand: {part: mocap-body, subject: Hand, at: {position: [0.3, 0.0, 0.2]}, motion: {kind: sine}}
"""


@pytest.fixture(scope="module")
def calibration(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("ikns") / "p07.json"
    calibrated(path)
    return path.read_bytes()


@pytest.fixture
def home(tmp_path: Path, calibration: bytes) -> Path:
    """A folder with a profile, and the calibration in a folder beside it."""
    names = json.dumps(dict(zip(Arm().names, LABELS_22[4:11], strict=True)))
    (tmp_path / "home" / "people").mkdir(parents=True)
    (tmp_path / "home" / "people" / "p07.json").write_bytes(calibration)
    (tmp_path / "home" / "intent.yaml").write_text(PROFILE.replace("MAP", names))
    return tmp_path / "home"


def test_it_begins_beside_the_profile_wherever_srl_runs(
    home: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = home / "people" / "p07.json"
    monkeypatch.chdir(home.parent)
    for name in (str(home / "intent.yaml"), "home/intent.yaml"):
        assert main(["check", name, "--json"]) == 0
        shown = json.loads(capsys.readouterr().out)["files"]["controllers.0.calibration"]
        assert shown["path"] == str(file)
    assert main(["check", "home/intent.yaml"]) == 0
    assert f"file controllers.0.calibration: {file}, sha256 {shown['sha256']}" in capsys.readouterr().out


def test_a_path_that_is_typed_begins_where_srl_runs(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(home / "people")
    (home / "people" / "p07.json").rename(home / "people" / "p08.json")
    wiring.build(*profile.load("../intent.yaml", ["controllers.0.calibration=p08.json"]), [])
    absolute = f"controllers.0.calibration={home / 'people' / 'p08.json'}"
    wiring.build(*profile.load("../intent.yaml", [absolute]), [])
    with pytest.raises(ProfileError, match=r"--set controllers\.0\.calibration: there is no file /.*people/no\.json"):
        wiring.build(*profile.load("../intent.yaml", ["controllers.0.calibration=no.json"]), [])


def test_what_cant_be_kept_is_refused_with_line_path_and_remedy(home: Path) -> None:
    file = home / "people" / "p07.json"
    build = lambda: wiring.build(*profile.load(str(home / "intent.yaml")), [])  # noqa: E731
    file.write_bytes(b" " * (LARGEST + 1))
    with pytest.raises(ProfileError, match=r"line 10: controllers\.0\.calibration: .* more than 1024 KiB"):
        build()
    file.unlink()
    with pytest.raises(ProfileError) as missing:
        build()
    assert missing.value.place.endswith("intent.yaml line 10: controllers.0.calibration")
    assert str(file) in missing.value.problem
    assert "srl calibrate PROFILE ikns" in missing.value.remedy
    file.mkdir()
    with pytest.raises(ProfileError, match=r"line 10: .*p07\.json can't be read: Is a directory"):
        build()


@pytest.mark.slow
def test_a_replay_needs_the_recording_alone(home: Path) -> None:
    file = home / "people" / "p07.json"
    call(home.parent, "run", "home/intent.yaml", "--sim", "--fast", "--duration", "4", "--record", "x.rrd")
    recording = read(home.parent / "x.rrd")
    assert recording.layout.value(recording.rows, "intent.c").std() > 0.01
    there = summary(call(home.parent, "replay", "x.rrd", "--json"))
    assert there["identical"]
    changed = content(file)
    for point in changed["points"]:
        point["lower"][0] += 0.2
        point["upper"][0] += 0.2
    file.write_text(json.dumps(changed))
    assert summary(call(home.parent, "replay", "x.rrd", "--json")) == there
    file.unlink()
    (home / "intent.yaml").unlink()
    assert summary(call(home.parent, "replay", "x.rrd", "--json")) == there

    # Were it another calibration, the replay would tell.
    layout = recording.layout
    kept = layout.meta["files"]
    assert kept.keys() == {"people/p07.json"}
    layout.meta["files"] = encoded({"people/p07.json": json.dumps(changed).encode()})
    other = replay(layout, recording.rows, "x.rrd")
    assert not other.identical
    assert other.signals["intent.c"] > 1e-4

    layout.meta["files"] = {"people/p07.json": kept["people/p07.json"] | {"sha256": "0" * 64}}
    with pytest.raises(RecordingError, match=r"x\.rrd: the content of people/p07\.json is damaged"):
        replay(layout, recording.rows, "x.rrd")
    del layout.meta["files"]
    with pytest.raises(RecordingError, match=r"people/p07\.json wasn't kept with the run"):
        replay(layout, recording.rows, "x.rrd")


def test_a_file_too_large_to_keep_begins_there_too(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    header = "time,x,y,z,qw,qx,qy,qz\n"
    (home / "people" / "reach.csv").write_text(header + "".join(f"{t},{t},0,0,1,0,0,0\n" for t in (0.0, 0.1, 0.2, 0.3)))
    text = (home / "intent.yaml").read_text()
    (home / "intent.yaml").write_text(text.replace("{kind: sine}", "{kind: recording, file: people/reach.csv}"))
    monkeypatch.chdir(home.parent)
    checked, source = profile.load("home/intent.yaml")
    graph = wiring.build(checked, source, [])
    assert graph.layout.meta["files"].keys() == {"people/p07.json"}
    (home / "people" / "reach.csv").rename(home.parent / "other.csv")
    with pytest.raises(RecordingError, match=r"home/people/reach\.csv"):
        wiring.build(checked, source, [])
    wiring.build(*profile.load("home/intent.yaml", ["sim.parts.hand.motion.file=other.csv"]), [])
