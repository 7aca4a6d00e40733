"""`srl new law`: a law in a file with its profile and tests; what it prints works."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.run import call, environment, refused

from srl.commissioning.cli import new_law
from srl.runtime.cli import main
from srl.runtime.profile import profile, wiring


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def printed(capsys: pytest.CaptureFixture[str]) -> list[list[str]]:
    """The commands under "Next:"."""
    _, after = capsys.readouterr().out.split("Next:\n")
    return [shlex.split(line) for line in after.splitlines() if line.startswith("  ")]


@pytest.mark.slow
@pytest.mark.timeout(400)
@pytest.mark.parametrize("where", [[], ["-o", "my laws"]])
def test_what_it_prints_works_as_typed(where: list[str], folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "my laws").mkdir()
    assert main(["new", "law", "follow-hand", *where]) == 0
    check, run, tests = printed(capsys)
    assert "follow-hand.x" in call(folder, *check[1:]).stdout
    call(folder, *run[1:], "--fast", "--set", "bus=null")  # simulated time, so that nothing waits
    assert [each[0] for each in (check, run, tests)] == ["srl", "srl", "python"]
    command = [sys.executable, *tests[1:], "-p", "no:cacheprovider"]
    done = subprocess.run(
        command, cwd=folder, env=environment(folder), capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stdout
    assert "8 passed" in done.stdout


def test_the_written_code_is_in_order_whatever_its_name(folder: Path) -> None:
    for name in ("follow-hand", "a", "x2_and-more", "my-gadget", "gadget"):
        assert main(["new", "law", name]) == 0
        (law,) = wiring.build(*profile.load(f"{name}.yaml"), []).controllers
        assert law.name == name
        assert type(law).__name__ == "".join(part.capitalize() for part in name.replace("_", "-").split("-"))
        module = name.replace("-", "_")
        assert set(new_law.files(name)) == {f"{module}.py", f"{name}.yaml", f"test_{module}.py"}
        assert f"from {module} import" in (folder / f"test_{module}.py").read_text()
    rules = ["--isolated", "--line-length", "120", "--select", "E,F,W,I,B,UP,N,PT"]
    subprocess.run([sys.executable, "-m", "ruff", "check", "--no-cache", *rules, "."], check=True, timeout=60)
    assert "gadget" not in "".join(new_law.files("follow-hand").values()).lower()


def test_nothing_is_replaced_and_nothing_is_left_half_written(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for file in ("plate.py", "plate.yaml", "test_plate.py"):
        (folder / file).symlink_to("nowhere")
        assert f"{file}: there is something already" in refused("new", "law", "plate")
        (folder / file).unlink()
    assert "no such folder" in refused("new", "law", "plate", "-o", "not/there")
    synced: list[int] = []

    def full_at_the_second(number: int) -> None:
        synced.append(number)
        if len(synced) == 2:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full_at_the_second)
    assert "No space left on device" in refused("new", "law", "plate")
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("Follow Hand", "For example follow-hand"),
        ("9axis", "is no law's name"),
        ("../../etc", "For example etc"),
        ("", "For example follow-hand"),
        ("x" * 41, "at most 40"),
        ("class", "no module of Python can be called 'class'"),
        ("conftest", "no module of Python"),
        ("signal", "would be called 'Signal'"),
        ("controller", "would be called 'Controller'"),
        ("path", "would be called 'Path'"),
        ("numpy", "there is a module 'numpy'"),
        ("json", "there is a module 'json'"),
        ("so101", "a profile that comes with srl"),
    ],
)
def test_a_name_that_no_law_can_have_is_refused(name: str, words: str, folder: Path) -> None:
    assert words in refused("new", "law", name)
    assert list(folder.iterdir()) == []


def test_the_word_law_alone_is_a_profiles_name(folder: Path) -> None:
    assert "it isn't said which law" in refused("new", "law")
    assert "--from" in refused("new", "law", "plate", "--from", "servo-jog")
    assert main(["new", "law", "--from", "servo-jog"]) == 0
    assert (folder / "law.yaml").exists()
