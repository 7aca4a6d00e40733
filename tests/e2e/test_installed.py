"""What a user gets who installs a wheel: built from a copy of the checkout, and used in an empty folder.

The libraries are those of the environment that runs the tests; the wheel's own packages come first. Building needs no
network: `setuptools` is one of the packages for development.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest
from helpers.lever import write_package

from srl.runtime.cli import COMMANDS, others
from srl.runtime.profile import library
from srl.runtime.recording.reader import read

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

ROOT = Path(__file__).parents[2]
FOLDERS = ("runtime", "control", "commissioning", "drivers", "sim", "studies", "profiles")
"""Of the packages of the same names in `srl`."""
# One of each family of studies, the shortest. Each reads data files of its package.
STUDIES = ("grasp-isotropy", "peg-in-hole", "human-srl", "ikns-dofs")
CLEAN = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "SRL_"))}


def built(source: Path, wheels: Path, **variables: str) -> Path:
    """The wheel of a project's folder, with these variables."""
    subprocess.run(
        [sys.executable, "-m", "pip", "wheel", "--quiet", "--disable-pip-version-check", "--no-deps", "--no-index",
         "--no-build-isolation", "--wheel-dir", wheels, source],
        cwd=wheels, check=True, timeout=300, env=os.environ | variables,
    )  # fmt: skip
    (wheel,) = wheels.glob("*.whl")
    return wheel


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    copy = tmp_path_factory.mktemp("copy")  # a build leaves files in its folder, which a later one would take up
    for name in ("srl", *FOLDERS, "native"):
        ignored = shutil.ignore_patterns("__pycache__", "*.so")
        shutil.copytree(ROOT / name, copy / name, ignore=ignored, symlinks=True)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, copy)
    return built(copy, tmp_path_factory.mktemp("wheel"))


class Installed:
    """An environment with the wheel, and an empty folder in which its commands run."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / "empty"
        self.folder.mkdir()
        environment = folder / "venv"
        venv.create(environment, symlinks=True)
        self.bin = environment / "bin"
        site = next((environment / "lib").glob("python*/site-packages"))
        # After the wheel's own packages. The editable installation there isn't seen: its .pth file isn't read.
        libraries = sysconfig.get_path("purelib")
        (site / "libraries.pth").write_text(f"{libraries}\nimport cmeel_pth\n")

    def install(self, wheel: Path) -> None:
        # What the libraries' environment has of the same name must neither count as installed nor be removed.
        subprocess.run(
            [sys.executable, "-m", "pip", "--python", self.bin / "python", "install", "--quiet", "--no-deps",
             "--no-index", "--ignore-installed", "--disable-pip-version-check", wheel],
            check=True, timeout=300, env=CLEAN,
        )  # fmt: skip

    def run(self, *command: str) -> str:
        """What it prints; it must succeed, as a user without any variable of ours would see it."""
        done = subprocess.run(
            [self.bin / command[0], *command[1:]], cwd=self.folder, capture_output=True, text=True, timeout=500,
            env=CLEAN | {"SRL_RUNTIME_DIR": str(self.folder / "run"), "STATE_DIRECTORY": str(self.folder / "state")},
            check=False,
        )  # fmt: skip
        assert done.returncode == 0, f"{command}: exit {done.returncode}\n{done.stdout}\n{done.stderr}"
        assert "Traceback" not in done.stderr, done.stderr
        return done.stdout


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Installed:
    found = Installed(tmp_path_factory.mktemp("user"))
    found.install(wheel)
    return found


def test_the_wheel_has_every_file_of_its_packages(wheel: Path) -> None:
    inside = set(zipfile.ZipFile(wheel).namelist())
    files = [
        f"srl/{p.relative_to(ROOT)}"
        for name in FOLDERS
        for p in (ROOT / name).rglob("*")
        if p.is_file() and "__pycache__" not in p.parts and p.suffix != ".so"
    ]
    assert len(files) > 500
    assert sorted(set(files) - inside) == []
    assert {f"srl/{p.name}" for p in (ROOT / "srl").iterdir() if p.is_file()} <= inside
    assert {name.partition("/")[0].partition("-")[0] for name in inside} == {"srl", "srl_runtime"}


def test_the_laws_in_c_come_with_it_where_there_is_a_compiler(wheel: Path, installed: Installed) -> None:
    code = "from srl.runtime.contracts import compiled; print(compiled.available())"
    found = installed.run("python", "-c", code).strip()
    if shutil.which("cc") is None:
        assert found == "python"
        return
    assert wheel.name.partition("-cp")[2].startswith("311-abi3-linux_")
    assert found.startswith("c, ")


def test_without_a_compiler_the_wheel_is_built_and_python_computes(tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    (copy / "srl").mkdir(parents=True)
    (copy / "srl" / "runtime").symlink_to("../runtime")
    for name in ("runtime", "native"):
        shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__", "*.so"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, copy)
    (tmp_path / "wheel").mkdir()
    made = built(copy, tmp_path / "wheel", CC="/nowhere/cc")
    assert not [name for name in zipfile.ZipFile(made).namelist() if name.endswith(".so")]
    assert "srl/runtime/contracts/compiled.py" in zipfile.ZipFile(made).namelist()


def test_its_own_packages_are_used_and_not_the_checkout(installed: Installed) -> None:
    code = f"import importlib; [print(importlib.import_module('srl.' + name).__file__) for name in {FOLDERS}]"
    for line in installed.run("python", "-c", code).splitlines():
        assert Path(line).is_relative_to(installed.bin.parent), line


def in_one_process(installed: Installed, *commands: list[str]) -> list[str]:
    """What each command of `srl` prints; a start for each would take a second, and all of them would show the same."""
    code = (
        "import contextlib, io, json, sys; from srl.runtime.cli import main; found = []\n"
        "for command in json.loads(sys.argv[1]):\n"
        "    with contextlib.redirect_stdout(io.StringIO()) as said, contextlib.suppress(SystemExit):\n"
        "        main(command)\n"
        "    found.append(said.getvalue())\n"
        "print(json.dumps(found))"
    )
    found: list[str] = json.loads(installed.run("python", "-c", code, json.dumps(commands)))
    return found


def test_each_commands_help(installed: Installed) -> None:
    commands = (*COMMANDS, *others.commands())
    output = in_one_process(installed, *([command, "--help"] for command in commands))
    for command, words in zip(commands, output, strict=True):
        assert words.startswith(f"usage: srl {command}")


def test_every_shipped_profile_is_listed_and_checked(installed: Installed) -> None:
    names = [each["name"] for each in json.loads(installed.run("srl", "list", "--json"))["profiles"]]
    assert names == library.shipped()
    output = in_one_process(installed, *(["check", name, "--sim", "--json"] for name in names))
    assert [json.loads(each)["profile"] for each in output] == names


def test_a_run_is_recorded_drawn_and_replayed(installed: Installed) -> None:
    installed.run(
        "srl", "run", "sixth-finger", "--sim", "--fast", "--duration", "3", "--set", "bus=null", "--record", "r.rrd",
        "--figure", "r.png",
    )  # fmt: skip
    assert len(read(installed.folder / "r.rrd").rows) >= 300
    assert (installed.folder / "r.png").read_bytes().startswith(b"\x89PNG")
    assert json.loads(installed.run("srl", "replay", "r.rrd", "--json"))["identical"] is True


def test_the_panels_page_is_there(installed: Installed) -> None:
    code = "from srl.runtime.web.panel.pages import PAGE; print(*sorted(p.name for p in PAGE.iterdir()), sep='\\n')"
    files = installed.run("python", "-c", code).split()
    assert files == sorted(p.name for p in (ROOT / "runtime" / "web" / "panel" / "page").iterdir())


@pytest.mark.exhaustive
@pytest.mark.parametrize("study", STUDIES)
def test_a_study_of_each_family_runs(installed: Installed, study: str) -> None:
    output = installed.run("srl", "study", study, "--quick", "--workers", "2", "--json", "--out", "out")
    result = json.loads(output)
    assert result["simulated"] is True
    assert result["claims"]
    assert all((installed.folder / "out" / study / name).exists() for name in result["files"])


def test_another_packages_driver_and_law_run(
    installed: Installed, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """The package of docs/extending.md, built and installed as its own project file says."""
    write_package(tmp_path)
    installed.install(built(tmp_path, tmp_path_factory.mktemp("lever")))
    assert "lever" in [each["name"] for each in json.loads(installed.run("srl", "list", "--json"))["drivers"]]
    shutil.copy(tmp_path / "lever.yaml", installed.folder)
    installed.run(
        "srl", "run", "lever.yaml", "--sim", "--fast", "--duration", "3", "--set", "bus=null", "--record", "l.rrd"
    )
    assert json.loads(installed.run("srl", "replay", "l.rrd", "--json"))["identical"] is True
    assert "prints a lever's angle once" in installed.run("srl", "--help")
