"""A kind of calibration of another package, that of docs/extending-calibration.md; a bad one disturbs no other."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from helpers import ROOT
from helpers.completion import offered
from helpers.lever import write_installed
from helpers.run import refused

from srl import wearer
from srl.commissioning.calibration.request import KINDS
from srl.commissioning.calibration.session import kind_of, method_of
from srl.runtime.cli import main
from srl.runtime.contracts import registry
from srl.runtime.contracts.errors import HostError, ProfileError
from srl.runtime.contracts.files import KeptFile
from srl.testing import PartConformance, bound

SIMULATED = ("calibrate", "grip.yaml", "grip", "--person", "P07", "--sim")


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page's package, as if it were installed."""
    folder = tmp_path_factory.mktemp("grip")
    assert write_installed(folder, "extending-calibration.md")["tool"]["setuptools"]["packages"] == ["srl_grip"]
    return folder


@pytest.fixture
def folder(package: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where its profile is; the package can be imported."""
    monkeypatch.syspath_prepend(package)
    monkeypatch.setenv("PYTHONPATH", f"{package}{os.pathsep}{ROOT}")
    shutil.copy(package / "grip.yaml", tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def claim(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The list of entry points of one more package, which a test fills."""
    info = tmp_path / "gadget-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: gadget\nVersion: 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    return info / "entry_points.txt"


def test_it_is_named_beside_srl_s_own(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["calibrate", "--help"])
    assert f"{{{','.join(KINDS)},grip}}" in capsys.readouterr().out
    assert offered("srl calibrate grip.yaml g", folder) == {"glove", "grip"}


def test_the_simulated_person_s_file_is_written_and_the_law_takes_it(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*SIMULATED, "--record", "grip.rrd"]) == 0
    assert (folder / "p07.json.report.png").read_bytes()[:4] == b"\x89PNG"
    made = json.loads((folder / "p07.json").read_text())
    assert (made["format"], made["person"], made["simulated"]) == ("acme-grip-1", "P07", True)
    assert made["rest"] == pytest.approx(1.0 - 0.06 * 9.81, abs=0.02)  # the sensor's offset, and the tool's weight
    assert made["strength"] == pytest.approx(-60.0, abs=0.1)
    capsys.readouterr()
    assert main(["check", "grip.yaml"]) == 0
    assert "controllers.0.calibration: it was made in simulation, and 'sensor' is real" in capsys.readouterr().out
    law_of = registry.load("controllers", "grip-share", "test")
    law = bound(law_of("share", law_of.Config(calibration=KeptFile.read(folder / "p07.json"))))
    for share in (0.0, 0.5, 1.0):
        law.input["wrench"][2] = made["rest"] + share * made["strength"]
        law.update(0.01)
        assert law.output["share"][0] == pytest.approx(share)
    # The same of the recording; and again, with one hold done again.
    assert main(["calibrate", "grip.yaml", "grip", "--recording", "grip.rrd", "-o", "same.json"]) == 0
    assert (folder / "same.json").read_bytes() == (folder / "p07.json").read_bytes()
    assert main([*SIMULATED, "--redo", "2", "--from", "grip.rrd", "-o", "again.json"]) == 0
    again = json.loads((folder / "again.json").read_text())
    assert again["rest"] == made["rest"]
    assert again["strength"] != made["strength"]
    # Nobody may change the file.
    (folder / "p07.json").write_text(json.dumps(made | {"strength": -30.0}))
    assert "p07.json" in (answer := refused("check", "grip.yaml"))
    assert "changed" in answer


def test_a_weak_grip_is_refused_and_writes_nothing(folder: Path) -> None:
    before = sorted(folder.iterdir())
    assert "hold 2: 60.0 N above rest, at least 100 are needed" in refused(*SIMULATED, "--option", "least=100")
    assert sorted(folder.iterdir()) == before


def test_a_mark_that_a_run_would_refuse_is_an_error_in_simulation_too(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(registry.load("controllers", "grip-marks", "test"), "most", 0)
    assert "the mark 1 is beyond the greatest of grip-marks, 0" in refused(*SIMULATED)


def test_a_person_who_can_t_do_it_is_named(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    hand = registry.load("parts", "gripping-hand", "test")

    def no(self: object, what: object) -> None:
        raise ValueError("this hand can't")

    monkeypatch.setattr(hand, "instruct", no)
    assert "this world's person can't do it: this hand can't" in refused(*SIMULATED)


@pytest.mark.usefixtures("folder")
class TestGrippingHand(PartConformance):
    part = "gripping-hand"

    def test_it_obeys_and_refuses_what_it_can_t_do(self) -> None:
        hand = self.made().wearer  # type: ignore[attr-defined]
        hand.instruct(wearer.Do("grip"))
        assert not hand.done
        with pytest.raises(ValueError, match="isn't told to"):
            hand.instruct(wearer.Do("dance"))


# What other packages may get wrong


def test_the_name_of_a_kind_of_srl_s_own_is_refused_and_the_others_work(claim: Path) -> None:
    claim.write_text("[srl.calibrations]\nft = gadget:Kind\n")
    assert "a package claims 'ft', which is srl's own kind" in refused("calibrate", "kairos-man", "ft", "--sim")
    assert kind_of("glove") is method_of("glove")


def test_one_that_can_t_be_imported_disturbs_no_other(claim: Path, capsys: pytest.CaptureFixture[str]) -> None:
    claim.write_text("[srl.calibrations]\ngadget = no_such_module:Kind\n")
    with pytest.raises(SystemExit):
        main(["calibrate", "--help"])
    assert "gadget" in capsys.readouterr().out
    assert kind_of("ft") is method_of("ft")
    assert "no_such_module:Kind) can't be imported" in refused("calibrate", "kairos-man", "gadget", "--sim")


@pytest.mark.parametrize(
    "text", ["Kind = 3", "class Kind: name = 'gadget'", "from srl.calibrating import *\nKind = Method"]
)
def test_what_is_no_kind_of_that_name_is_refused(claim: Path, monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    monkeypatch.delitem(sys.modules, "gadget_kind", raising=False)
    (claim.parents[1] / "gadget_kind.py").write_text(text)
    claim.write_text("[srl.calibrations]\ngadget = gadget_kind:Kind\n")
    with pytest.raises(HostError, match=r"'gadget' is no Method of srl\.calibrating with this name"):
        kind_of("gadget")


def test_a_name_of_two_packages_disturbs_no_other(claim: Path, folder: Path) -> None:
    claim.write_text("[srl.calibrations]\ngrip = gadget:Kind\n")
    assert "'grip' is claimed twice" in refused(*SIMULATED)
    assert kind_of("ft") is method_of("ft")
    assert registry.names("calibrations") == ["grip"]
    with pytest.raises(ProfileError, match="no calibration is called 'grap'"):
        kind_of("grap")


def test_what_the_loop_loads_of_a_kind_is_light(package: Path) -> None:
    """A law and its marks: not the guide, nor what draws."""
    code = (
        "import sys, srl_grip.law, srl_grip.marks; print(*sorted({'matplotlib', 'mujoco', 'rich', 'zenoh', "
        "'srl.commissioning.calibration.method'} & set(sys.modules)))"
    )
    variables = os.environ | {"PYTHONPATH": f"{package}{os.pathsep}{ROOT}"}
    done = subprocess.run(
        [sys.executable, "-c", code], env=variables, capture_output=True, text=True, timeout=100, check=True
    )
    assert done.stdout.split() == []
