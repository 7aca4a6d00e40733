"""`srl new NAME --from PROFILE --split DEVICE`: one profile becomes two, for two computers."""

from __future__ import annotations

from pathlib import Path

import pytest
from helpers.run import refused

from srl.runtime.cli import main
from srl.runtime.profile import profile, wiring
from srl.runtime.profile.graph import Graph


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SRL_RUNTIME_DIR", str(tmp_path))
    return tmp_path


def graph(name: str, sim: list[str] | None = None) -> Graph:
    return wiring.build(*profile.load(name), sim)


def signals(made: Graph, device: str) -> dict[str, tuple[object, ...]]:
    (found,) = (d for d in made.devices if d.name == device)
    return {s.name: (s.shape, s.unit, s.labels, s.frame, s.slots, s.components) for s in found.states}


def test_the_limbs_half_reads_what_the_other_gives(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["new", "mocap", "--from", "sixth-finger", "--split", "glove", "--host", "mocap.lab"]) == 0
    said = capsys.readouterr().out
    for words in ("srl keys srl-keys mocap --host mocap.lab", "--role observer", "sixth-finger-with-mocap.yaml"):
        assert words in said
    whole, near, far = (graph(name) for name in ("sixth-finger", "mocap.yaml", "sixth-finger-with-mocap.yaml"))
    assert signals(near, "glove") == signals(far, "glove") == signals(whole, "glove")
    assert [d.name for d in near.devices] == ["glove"]
    assert [law.name for law in far.controllers] == [law.name for law in whole.controllers]
    assert far.profile.guard == whole.profile.guard
    (glove,) = (d for d in far.devices if d.name == "glove")
    assert glove.config.signals["position"].key == "srl/mocap/state/glove/position"
    assert glove.config.port == "tls://mocap.lab:7447"
    assert near.profile.bus is not None
    assert near.profile.bus.tls is not None
    assert glove.config.tls.ca == near.profile.bus.tls.ca
    assert near.profile.bus.roles == {"observer": ("sixth-finger-with-mocap",)}
    assert near.profile.bus.decimate == 1


def test_on_one_computer_both_are_at_the_buss_socket(folder: Path) -> None:
    assert main(["new", "near", "--from", "sixth-finger", "--split", "glove"]) == 0
    (glove,) = (d for d in graph("sixth-finger-with-near.yaml").devices if d.name == "glove")
    assert glove.config.port == f"unixsock-stream/{folder}/near/zenoh.sock"
    assert graph("near.yaml", []).simulated == ["glove"]  # its simulation came along


def test_a_profile_of_ones_own_keeps_its_files_and_comments(folder: Path) -> None:
    (folder / "there").mkdir()
    assert main(["new", "mine", "--from", "sixth-finger", "--out", "there/mine.yaml"]) == 0
    (folder / "there" / "mine.yaml").open("a").write("# my own remark\n")
    assert main(["new", "near", "--from", "there/mine.yaml", "--split", "glove"]) == 0
    assert "# my own remark" in (folder / "there" / "mine-with-near.yaml").read_text()
    before = (folder / "there" / "near.yaml").read_text()
    assert "a file is there already" in refused("new", "near", "--from", "there/mine.yaml", "--split", "glove")
    assert (folder / "there" / "near.yaml").read_text() == before


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--from", "sixth-finger", "--split", "finger"], "--split finger: 'finger' takes commands"),
        (["--from", "sixth-finger", "--split", "glov"], "Did you mean 'glove'?"),
        (["--split", "glove"], "--split: it isn't said of which profile"),
        (["--from", "sixth-finger", "--host", "mocap.lab"], "--host: it is for --split"),
    ],
)
def test_what_cant_be_split_is_refused_and_nothing_written(arguments: list[str], words: str, folder: Path) -> None:
    assert words in refused("new", "near", *arguments)
    assert list(folder.iterdir()) == []


def test_signals_with_dots_in_their_names_cross_too(folder: Path) -> None:
    assert main(["new", "cameras", "--from", "vicon-station", "--split", "mocap"]) == 0
    far = graph("vicon-station-with-cameras.yaml")
    assert signals(far, "mocap").keys() == signals(graph("vicon-station"), "mocap").keys()
    (mocap,) = far.devices
    assert mocap.config.signals["wand.pose"].key == "srl/cameras/state/mocap/wand/pose"
