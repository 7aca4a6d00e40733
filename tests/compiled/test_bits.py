"""The laws in C give the same bits at every level of optimisation, and on both kinds of processor."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from helpers import ROOT

FLAGS = ["-std=c11", "-ffp-contract=off", "-fno-tree-slp-vectorize", "-Wall", "-Wextra", "-Werror"]
ARM = "aarch64-linux-gnu"
pytestmark = pytest.mark.slow
needs_cc = pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc here")
needs_arm = pytest.mark.skipif(
    shutil.which(f"{ARM}-gcc") is None or shutil.which("qemu-aarch64") is None or not Path(f"/usr/{ARM}").exists(),
    reason="no compiler and emulator for aarch64: apt install gcc-aarch64-linux-gnu libc6-dev-arm64-cross qemu-user",
)


def hashes(folder: Path, compiler: str, *flags: str, run: tuple[str, ...] = ()) -> str:
    """What `bits.c` prints, made by this compiler."""
    sources = [path for path in sorted((ROOT / "native").glob("*.c")) if path.name != "module.c"]
    made = folder / "bits"
    include = f"-I{ROOT / 'native'}"
    program = [compiler, *FLAGS, *flags, include, Path(__file__).with_name("bits.c"), *sources, "-lm", "-o", made]
    subprocess.run(program, check=True, timeout=100)
    return subprocess.run([*run, made], check=True, timeout=100, capture_output=True, text=True).stdout


def test_these_are_the_flags_of_the_package() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    (module,) = project["tool"]["setuptools"]["ext-modules"]
    assert set(FLAGS) - {"-Werror"} <= set(module["extra-compile-args"])
    assert {Path(path).name for path in module["sources"]} == {path.name for path in (ROOT / "native").glob("*.c")}
    assert {Path(path).name for path in module["depends"]} == {path.name for path in (ROOT / "native").glob("*.h")}


@pytest.mark.exhaustive
@needs_cc
def test_optimisation_changes_no_bit(tmp_path: Path) -> None:
    plain = hashes(tmp_path, "gcc", "-O0")
    assert len(plain.splitlines()) == 17
    assert all(int(line.split()[1]) > 100 for line in plain.splitlines())  # of 9000 cycles, those that C has computed
    assert hashes(tmp_path, "gcc", "-O2") == hashes(tmp_path, "gcc", "-O3") == plain


@needs_cc
def test_no_access_is_out_of_bounds_or_undefined(tmp_path: Path) -> None:
    checked = ("-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    assert hashes(tmp_path, "gcc", *checked) == hashes(tmp_path, "gcc", "-O2")


@needs_cc
@needs_arm
def test_an_arm_processor_gives_the_same_bits(tmp_path: Path) -> None:
    emulated = ("qemu-aarch64", "-L", f"/usr/{ARM}")
    assert hashes(tmp_path, f"{ARM}-gcc", "-O2", run=emulated) == hashes(tmp_path, "gcc", "-O2")


@needs_arm
def test_a_wheel_for_arm_is_cross_built(tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    for name in ("runtime", "native"):
        shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__", "*.so"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, copy)
    cross = {"CC": f"{ARM}-gcc", "LDSHARED": f"{ARM}-gcc -shared", "_PYTHON_HOST_PLATFORM": "linux-aarch64"}
    subprocess.run(
        [sys.executable, "-m", "pip", "wheel", "--quiet", "--disable-pip-version-check", "--no-deps", "--no-index",
         "--no-build-isolation", "--wheel-dir", tmp_path, copy],
        cwd=tmp_path, check=True, timeout=100, env=os.environ | cross,
    )  # fmt: skip
    (wheel,) = tmp_path.glob("*.whl")
    assert wheel.name.endswith("-cp311-abi3-linux_aarch64.whl")
    with zipfile.ZipFile(wheel) as archive:
        (library,) = (name for name in archive.namelist() if name.endswith(".so"))
        assert archive.read(library)[18:20] == b"\xb7\x00"  # ELF's e_machine: AArch64
