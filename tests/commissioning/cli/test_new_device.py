"""`srl new device`: a package that can be installed, and whose tests pass as written."""

from __future__ import annotations

import os
import re
import stat
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.run import refused
from helpers.somebody import environment, pytest_in

from srl.commissioning.cli import new_device
from srl.runtime.cli import main
from srl.runtime.contracts import registry


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def files(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_it_is_installed_and_its_tests_pass_as_written(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["new", "device", "force-plate"]) == 0
    package, site = folder / "srl-force-plate", folder / "site"
    assert f"  cd {package.name}\n" in capsys.readouterr().out
    subprocess.run(
        [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-deps", "--no-index",
         "--no-build-isolation", "--target", site, package],
        check=True, timeout=200,
    )  # fmt: skip
    reported = environment(folder, site)
    done = pytest_in(package, reported)
    assert done.returncode == 0, done.stdout + done.stderr
    (passed, skipped) = re.findall(r"(\d+) passed, (\d+) skipped", done.stdout)[0]
    assert (int(passed) > 20, skipped) == (True, "2")  # it takes no commands
    for command in (
        ["check", "force-plate.yaml", "--sim"],
        ["run", "force-plate.yaml", "--sim", "--fast", "--duration", "1"],
    ):
        run = subprocess.run(
            [sys.executable, "-m", "srl", *command], cwd=package, env=reported, capture_output=True, text=True,
            check=False, timeout=100,
        )  # fmt: skip
        assert run.returncode == 0, run.stdout + run.stderr


def test_its_tests_say_at_once_that_it_isnt_installed(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["new", "device", "force-plate"]) == 0
    said = capsys.readouterr().out
    assert "  pip install --no-deps --editable .\n" in said  # with its build tools fetched, as everywhere
    done = pytest_in(folder / "srl-force-plate", environment(folder))
    assert done.returncode == 4, done.stdout + done.stderr
    assert "srl-force-plate isn't installed here. Type: pip install --no-deps --editable ." in done.stdout + done.stderr
    assert "failed" not in done.stdout


def test_the_written_code_is_in_order(folder: Path) -> None:
    """Ruff's rules for the package as its author would run them; no word of the pattern is left."""
    for name in ("force-plate", "a", "next", "x2_and-more", "my-gadgets"):
        assert main(["new", "device", name]) == 0
        package = folder / f"srl-{name}"
        subprocess.run(
            [sys.executable, "-m", "ruff", "check", "--no-cache", "--isolated", "--line-length", "120", "--select",
             "E,F,W,I,B,UP,N,PT", "."],
            cwd=package, check=True, timeout=60,
        )  # fmt: skip
        for file in files(package):
            text = file + (package / file).read_text()
            assert "gadget" not in text.lower().replace("my_gadgets", "").replace("my-gadgets", "").replace(
                "mygadgets", ""
            )
        assert new_device.module(name).isidentifier()


def test_nothing_that_it_writes_is_secret_or_closed(folder: Path) -> None:
    assert main(["new", "device", "plate", "-o", "there"]) == 0
    assert stat.S_IMODE((folder / "there").stat().st_mode) == 0o777 & ~_umask()
    assert {path.name for path in folder.iterdir()} == {"there"}
    assert files(folder / "there") == set(new_device.package("plate"))


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def test_an_empty_folder_is_filled_and_one_with_something_is_left(folder: Path) -> None:
    (folder / "empty").mkdir()
    assert main(["new", "device", "plate", "--out", "empty"]) == 0
    (folder / "empty" / "mine").write_text("mine")
    (folder / "here").mkdir()
    os.chdir(folder / "here")
    assert main(["new", "device", "plate", "--out", "."]) == 0
    assert files(folder / "here") == files(Path.cwd()) == set(new_device.package("plate"))
    os.chdir(folder)
    (folder / "dangling").symlink_to(folder / "nowhere")
    for there in ("empty", "dangling", "empty/mine"):
        assert "there is something already" in refused("new", "device", "plate", "-o", there)
    assert (folder / "empty" / "mine").read_text() == "mine"
    assert "no such folder" in refused("new", "device", "plate", "-o", "not/there")


def test_what_cant_be_written_leaves_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(self: Path, *_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    assert "No space left on device" in refused("new", "device", "plate")
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("Force Plate", "For example force-plate"),
        ("9axis", "is no device's name"),
        ("plate-", "is no device's name"),
        ("a--b", "is no device's name"),
        ("../../etc", "For example etc"),
        ("plätte", "is no device's name"),
        ("x" * 41, "at most 40"),
        ("", "For example force-plate"),
        ("bno085", "there is a device 'bno085' already"),
        ("can_ft", "there is a device 'can-ft' already"),
        ("sensor", "would be called 'Sensor'"),
        ("signal", "would be called 'Signal'"),
        ("serial", "would be called 'SerialTwin'"),
        ("protocol", "is the name of another file"),
        ("device", "would be called 'DeviceConfig'"),
    ],
)
def test_a_name_that_no_device_can_have_is_refused(name: str, words: str, folder: Path) -> None:
    assert words in refused("new", "device", name)
    assert list(folder.iterdir()) == []


def test_every_registered_device_is_a_clash() -> None:
    for group in ("drivers", "fakes", "twins"):
        for name in registry.names(group):
            assert "already" in refused("new", "device", name)


def test_a_package_of_that_name_is_a_clash(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "srl_plate.py").write_text("")
    monkeypatch.syspath_prepend(str(folder))
    assert "there is a package 'srl_plate'" in refused("new", "device", "plate")


@pytest.mark.parametrize("option", [["--from", "sixth-finger"], ["--set", "rate=1"], ["--port", "a=b"], ["--yes"]])
def test_options_of_profiles_are_refused(option: list[str], folder: Path) -> None:
    assert "it is for a profile" in refused("new", "device", "plate", *option)
    assert list(folder.iterdir()) == []


def test_a_profile_can_still_be_called_device(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["new", "device", "--from", "sixth-finger"]) == 0
    assert "name: device" in (folder / "device.yaml").read_text()
    output = refused("new", "device")
    assert "it isn't said which device" in output
    assert "--from PROFILE" in output


def test_two_names_are_one_too_many() -> None:
    assert "one name too many" in refused("new", "mine", "yours")
