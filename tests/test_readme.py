"""The lines that the README tells to type are typed, in its order and in an empty folder. No device is needed.

Of the last step, with a real device, the first half is done: the host is asked whether it is fit.
"""

from __future__ import annotations

import os
import re
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers.run import ended, environment
from helpers.wait import until

from srl.recordings import read
from srl.runtime.contracts import registry

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()
TIMEOUT = 100  # s


def block(name: str) -> str:
    """The lines after the comment `<!-- name... -->`."""
    (found,) = re.findall(rf"^ *<!-- {name}\b.*? -->\n *```sh\n(.*?)^ *```$", README, re.MULTILINE | re.DOTALL)
    return "\n".join(line.strip() for line in found.splitlines())


class Shell:
    """An empty folder, in which `srl` and `python` are those of this environment."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / "w"
        programs = folder / "bin"
        for each in (self.folder, programs):
            each.mkdir()
        for name, arguments in (("srl", "-m srl "), ("python", "")):
            program = programs / name
            program.write_text(f'#!/bin/sh\nexec "{sys.executable}" {arguments}"$@"\n')
            program.chmod(program.stat().st_mode | stat.S_IXUSR)
        self.environment = environment(folder) | {"PATH": f"{programs}{os.pathsep}{os.environ['PATH']}"}

    def run(self, lines: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            ["sh", "-ec", lines], cwd=self.folder, env=self.environment, capture_output=True, text=True,
            timeout=TIMEOUT, check=False,
        )  # fmt: skip

    def runs(self, lines: str) -> bool:
        return self.run(lines).returncode == 0

    def types(self, lines: str) -> str:
        done = self.run(lines)
        assert done.returncode == 0, f"{lines}\n{done.stdout}\n{done.stderr}"
        return done.stdout


@pytest.fixture
def shell(tmp_path: Path) -> Shell:
    return Shell(tmp_path)


@pytest.mark.slow
@pytest.mark.timeout(500)
def test_five_minutes(shell: Shell) -> None:
    output = "".join(map(shell.types, block("simulation").splitlines()))
    assert "identical" in output
    assert (shell.folder / "hand.png").read_bytes().startswith(b"\x89PNG")
    assert "sixth-finger" in output


@pytest.mark.slow
@pytest.mark.serial  # a twin in real time: beside other tests it is late, and looks like a device that fails
@pytest.mark.timeout(400)
def test_half_an_hour_as_far_as_it_goes_without_a_device(shell: Shell) -> None:
    shell.types(block("profile"))
    shell.types(block("rehearsal"))
    assert (shell.folder / "cycle.png").read_bytes().startswith(b"\x89PNG")
    recorded = read(shell.folder / "cycle.rrd").value("finger.position")
    assert float(np.ptp(recorded[:, 0])) > 0.3  # rad: the servo on the wire has moved
    reported = {"cwd": shell.folder, "env": shell.environment}
    start, stop = block("requests").splitlines()
    for _ in range(5):
        with ended(["sh", "-c", f"exec {block('run')}"], **reported) as run:
            until(lambda process=run: ready(shell) or process.poll() is not None, timeout=TIMEOUT)
            # A twin that a busy machine holds up is stale for a moment, and then the start is refused.
            until(lambda: shell.runs(start), pause=0.5, what="the start", timeout=TIMEOUT)
            shell.types(stop)
            out, output = run.communicate(timeout=TIMEOUT)
        if "device_loss finger" not in output:  # as when the twin is stale just after the start
            break
    assert run.returncode == 0, out + output
    assert "identical" in shell.types("srl replay rehearsal.rrd")
    (doctor,) = re.findall(r"`(srl doctor [^`]*)`", README)
    done = subprocess.run(
        doctor.split(), **reported, capture_output=True, text=True, timeout=TIMEOUT, check=False,
        executable=str(shell.folder.parent / "bin" / "srl"),
    )  # fmt: skip
    assert "ttyUSB0" in done.stdout + done.stderr  # the real port, which isn't here
    assert "Traceback" not in done.stderr


def ready(shell: Shell) -> bool:
    """Whether the run waits for its start."""
    done = subprocess.run(
        ["srl", "top", "--once"], cwd=shell.folder, env=shell.environment, capture_output=True, text=True,
        timeout=TIMEOUT, check=False, executable=str(shell.folder.parent / "bin" / "srl"),
    )  # fmt: skip
    return done.returncode == 0 and "ready" in done.stdout


def test_the_table_has_each_driver_with_what_there_is() -> None:
    rows = re.findall(
        r"^\| \[([\w-]+)\]\(docs/devices/\1\.md\) \| [^|]* \| (yes|none) \| (yes|none) \| .* \|", README, re.M
    )
    there = {kind: set(registry.names(kind)) for kind in ("drivers", "fakes", "twins")}
    ours = {name for name in there["drivers"] if name != "lever"}  # the example's, while its own tests run
    assert {name for name, _, _ in rows} == ours
    for name, fake, twin in rows:
        assert (fake == "yes", twin == "yes") == (name in there["fakes"], name in there["twins"]), name


def test_the_moving_picture_is_small() -> None:
    (gif,) = re.findall(r"\]\((docs/[\w-]+\.gif)\)", README)
    assert (ROOT / gif).stat().st_size < 1_000_000
    assert (ROOT / gif).read_bytes().startswith(b"GIF89a")


def test_the_citation_has_this_version() -> None:
    text = (ROOT / "CITATION.cff").read_text()
    project = (ROOT / "pyproject.toml").read_text()
    version = re.compile(r"^version(?: =|:) \"?([\d.]+)\"?$", re.MULTILINE)
    assert version.findall(text) == version.findall(project)
