"""Commands of another package join `srl` by an entry point; the old import names say where things are."""

from __future__ import annotations

import importlib
import subprocess
import sys
from pathlib import Path

import pytest
from helpers import ROOT

import srl
from srl.runtime.cli import main
from srl.runtime.contracts import registry
from srl.runtime.contracts.errors import HostError

GADGET = """
COMMANDS = {"gadget": "greets the gadget"}

def add_parser(subparsers, name):
    parser = subparsers.add_parser(name, help=COMMANDS[name])
    parser.add_argument("whom")
    parser.set_defaults(run=lambda args: print("hello", args.whom) or 0)
"""


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    info = tmp_path / "gadget-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: gadget\nVersion: 1\n")
    (info / "entry_points.txt").write_text("[srl.commands]\ngadget = gadget_commands\n")
    (tmp_path / "gadget_commands.py").write_text(GADGET)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "gadget_commands", raising=False)
    return tmp_path


@pytest.mark.usefixtures("package")
def test_a_package_brings_its_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["gadget", "you"]) == 0
    assert capsys.readouterr().out == "hello you\n"
    with pytest.raises(SystemExit):
        main(["--help"])
    assert "greets the gadget" in capsys.readouterr().out


def reported(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    try:
        code = main(arguments)
    except SystemExit as ended:
        code = int(str(ended.code))
    output = capsys.readouterr()
    return code, output.out + output.err


def test_one_that_can_t_be_used_is_named_and_disturbs_no_other(
    package: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (package / "gadget_commands.py").write_text("import no_such_thing")
    code, output = reported(["gadget", "you"], capsys)
    assert code == 2
    assert "no_such_thing" in output
    code, output = reported(["--help"], capsys)
    assert code == 0
    assert "can't be used" in " ".join(output.split())
    (package / "gadget_commands.py").write_text("COMMANDS = {}")
    code, output = reported(["gadget", "you"], capsys)
    assert code == 2
    assert "has no COMMANDS with 'gadget'" in output


@pytest.mark.parametrize("text", ["1 / 0", "COMMANDS = ['gadget']", "raise SystemError('x')"])
def test_whatever_one_does_the_others_work(package: Path, capsys: pytest.CaptureFixture[str], text: str) -> None:
    (package / "gadget_commands.py").write_text(text)
    assert reported(["--help"], capsys)[0] == 0
    assert reported(["study", "--help"], capsys)[0] == 0
    code, output = reported(["gadget"], capsys)
    assert code == 2
    assert "Traceback" not in output


def test_a_name_that_is_taken_disturbs_no_other(package: Path, capsys: pytest.CaptureFixture[str]) -> None:
    points = package / "gadget-1.dist-info" / "entry_points.txt"
    points.write_text("[srl.commands]\nrun = gadget_commands\njog = gadget_commands\n")
    assert "runs a profile" in reported(["--help"], capsys)[1]
    assert reported(["study", "--help"], capsys)[0] == 0
    code, output = reported(["jog", "--help"], capsys)
    assert code == 2
    assert "is claimed by" in output


# The names from before


@pytest.mark.parametrize("name", ["runtime", "control", "commissioning", "drivers", "sim", "studies", "profiles"])
def test_a_checkout_is_no_second_copy(name: str) -> None:
    code = f"import {name}"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=100, check=False
    )
    assert done.returncode == 1
    assert f"ImportError: {name} is srl.{name} now" in done.stderr
    assert importlib.import_module(f"srl.{name}").__name__ == f"srl.{name}"


def test_a_part_that_imports_an_old_name_is_told_the_new_one(package: Path) -> None:
    points = "[srl.drivers]\ngadget = gadget_driver:Gadget\n"
    (package / "gadget-1.dist-info" / "entry_points.txt").write_text(points)
    (package / "gadget_driver.py").write_text("from runtime.contracts.driver import Driver\n")
    with pytest.raises(HostError, match=r"import 'srl\.runtime"):
        registry.load("drivers", "gadget", "here")


def test_srl_s_names_are_all_there_and_load_nothing_before_they_are_used() -> None:
    for name in srl.__all__:
        assert getattr(srl, name) is not None
    assert set(srl.__all__) <= set(dir(srl))
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = srl.nonsense  # type: ignore[attr-defined]
    code = "import srl, sys; print(*({'numpy', 'pydantic', 'zenoh'} & sys.modules.keys()))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=100, check=True)
    assert done.stdout.split() == []


@pytest.mark.parametrize(
    ("arguments", "beginning"),
    [
        (["study", "no-such-study"], "srl study no-such-study: no study"),
        (["check"], "srl check: no profile is named"),
        (["top", "nowhere"], "srl top: instance 'nowhere': it isn't running"),
    ],
)
def test_an_error_names_the_command_once(
    arguments: list[str], beginning: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code, output = reported(arguments, capsys)
    assert code == 2
    assert output.startswith(beginning)
    assert output.count("srl ") - output.count("`srl ") == 1


def test_the_help_of_study_names_the_studies(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "2000")  # else a line ends within a name
    code, output = reported(["study", "--help"], capsys)
    assert code == 0
    words = output.replace("\n", " ").replace(",", " ").split()
    assert set(registry.names("studies")) <= set(words)
