"""docs/testing.md, done as it says, from an empty folder: its commands, its files, its count of lines."""

from __future__ import annotations

import os
import re
import stat
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers import ROOT
from helpers.somebody import environment, pytest_in

from srl.commissioning.cli import new_device
from srl.runtime.testing.faults import FAULTS
from srl.testing import ControllerConformance, DriverConformance, PartConformance

PAGE = (ROOT / "docs" / "testing.md").read_text()
FENCE = re.compile(r"^```(\w+)\n(?:# ([\w./]+)\n)?(.*?)^```$", re.MULTILINE | re.DOTALL)
MOST = 100  # lines of an author's own


def changed(written: dict[str, str]) -> dict[str, str]:
    """The written package's files with the page's changes, and nothing else of the page."""
    made = dict(written)
    for kind, path, body in FENCE.findall(PAGE):
        if kind == "python" and path in written:
            made[path] = body
        if kind == "diff":
            for old, new in replacements(body):
                assert made[path].count(old) == 1, f"{path} hasn't once:\n{old}"
                made[path] = made[path].replace(old, new)
    return made


def replacements(diff: str) -> Iterator[tuple[str, str]]:
    """Each run of lines that go, and of those that come in their place."""
    strip = lambda lines: re.sub("^.", "", lines, flags=re.MULTILINE)  # noqa: E731
    for old, new in re.findall(r"((?:^-.*\n)+)((?:^\+.*\n)*)", diff, re.MULTILINE):
        yield strip(old), strip(new)


def own_lines() -> int:
    """Lines that the author writes: whole files, and what a change puts in. Blank ones aren't counted."""
    written, lines = new_device.package("force-plate"), []
    for kind, path, body in FENCE.findall(PAGE):
        if kind == "python" and path in written:
            lines += body.splitlines()
        if kind == "diff":
            lines += [line[1:] for line in body.splitlines() if line.startswith("+")]
    return sum(bool(line.strip()) for line in lines)


def test_the_authors_own_lines_are_few_and_the_page_says_how_many() -> None:
    (output,) = re.findall(r"That is (\d+) lines of the author's own", PAGE)
    assert own_lines() == int(output)
    assert int(output) < MOST


def test_the_page_has_every_rule_and_every_fault() -> None:
    for suite in (DriverConformance, ControllerConformance, PartConformance):
        rules = [name for name in vars(suite) if name.startswith("test_")]
        (table,) = re.findall(rf"^\| `{suite.__name__}` \| .*\n\|.*\n((?:\|.*\n)+)", PAGE, re.MULTILINE)
        assert re.findall(r"^\| `(\w+)`", table, re.MULTILINE) == rules
    for kind, text in FAULTS.items():
        assert f"| `{kind}` | {text} |" in PAGE


class Shell:
    """An empty folder, in which `srl`, `python` and `pip` are those of an environment that has srl."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.site, programs = folder / "w", folder / "site", folder / "bin"
        for each in (self.folder, self.site, programs):
            each.mkdir()
        install = "install --quiet --no-deps --no-index --no-build-isolation --disable-pip-version-check --target"
        for name, line in (
            ("srl", '-m srl "$@"'),
            ("python", '"$@"'),
            ("pip", f'-m pip {install} "{self.site}" .'),  # never into the environment of these tests
        ):
            (programs / name).write_text(f'#!/bin/sh\nexec "{sys.executable}" {line}\n')
            (programs / name).chmod(0o755 | stat.S_IXUSR)
        self.environment = environment(folder, self.site)
        self.environment["PATH"] = f"{programs}{os.pathsep}{os.environ['PATH']}"

    def types(self, lines: str) -> str:
        done = subprocess.run(
            ["sh", "-ec", f"{lines}\npwd > '{self.site}/../there'"],
            cwd=self.folder, env=self.environment, capture_output=True, text=True, timeout=200, check=False,
        )  # fmt: skip
        assert done.returncode == 0, f"{lines}\n{done.stdout}\n{done.stderr}"
        self.folder = Path((self.site.parent / "there").read_text().strip())  # where `cd` has led
        return done.stdout


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_newcomer_writes_the_force_plate(tmp_path: Path) -> None:
    lab, write, use = [body for kind, _, body in FENCE.findall(PAGE) if kind == "sh"]
    shell = Shell(tmp_path)
    assert lab.startswith("python -m pytest test_lab.py")
    reported = shell.types(write)
    assert "26 passed, 2 skipped" in reported
    for path, text in changed(new_device.package("force-plate")).items():
        (shell.folder / path).write_text(text)
    subprocess.run(
        [sys.executable, "-m", "ruff", "check", "--no-cache", "--isolated", "--line-length", "120", "."],
        cwd=shell.folder, check=True, timeout=60,
    )  # fmt: skip
    shell.types("pip")  # the command above installs in place; here it copies
    reported = shell.types(use)
    assert "2 skipped" in reported
    assert "force plate (wrench of six axes" in reported


@pytest.mark.slow
def test_the_labs_tests_pass_and_fail_with_what_is_wrong(tmp_path: Path) -> None:
    (text,) = (body for _, path, body in FENCE.findall(PAGE) if path == "test_lab.py")
    (tmp_path / "test_lab.py").write_text(text)
    reported = environment(tmp_path)
    done = pytest_in(tmp_path, reported, "test_lab.py")
    assert "3 passed" in done.stdout, done.stdout + done.stderr
    (tmp_path / "test_wrong.py").write_text(
        text.replace('run.fault("glove", "silent")', 'run.fault("glove", "frozen")')
    )
    done = pytest_in(tmp_path, reported, "test_wrong.py")
    assert "1 failed, 2 passed" in done.stdout, done.stdout + done.stderr
    assert "state active, glove is frozen" in done.stdout
