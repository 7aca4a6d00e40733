"""A Debian machine of its own for a test: a small tree, booted by systemd-nspawn, with systemd as its process 1.

The tree is made by debootstrap, or copied from the folder that SRL_TEST_TREE names. The packages that srl needs are
those of the test's own environment, bound in; srl itself is installed from a wheel, as its users do.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy
import pytest

from helpers import ROOT
from helpers.wait import until

RELEASE = "bookworm"
PACKAGES = ("systemd", "systemd-sysv", "dbus", "udev", "python3", "python3-venv")
# The machine's root may give what the unit's limits ask for, where the test itself has it to give.
CAPABILITIES = "CAP_SYS_RESOURCE,CAP_IPC_LOCK"
PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin"
SUDO = '#!/bin/sh\n[ "$1" = -u ] && user=$2 && shift 2 && exec runuser -u "$user" -- "$@"\nexec "$@"\n'


def why_not() -> str:
    """Why no machine can be had here; "" if nothing is known against it."""
    if os.geteuid() != 0:
        return "needs root"
    for program in ("systemd-nspawn", "debootstrap", "nsenter"):
        if shutil.which(program) is None:
            return f"no {program}"
    if sys.version_info[:2] != (3, 11):
        return f"{RELEASE} has Python 3.11, the packages here are for another"
    return ""


class Machine:
    """A booted machine; `call` runs a shell's line in it as root."""

    def __init__(self, process: int) -> None:
        """`process`: process 1 of the machine, as it is called outside."""
        self.process = process

    def call(self, line: str, code: int | None = 0, timeout: float = 200) -> str:
        """What the line prints, errors included; its exit code must be `code`."""
        done = subprocess.run(
            ["nsenter", "-t", str(self.process), "-m", "-u", "-i", "-n", "-p", "-C", "--",
             "/usr/bin/env", "-i", f"PATH={PATH}", "HOME=/root", "/bin/bash", "-c", line],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL,
            text=True, timeout=timeout, check=False,
        )  # fmt: skip
        assert code is None or done.returncode == code, f"{line}\nexit {done.returncode}\n{done.stdout}"
        return done.stdout


def _tree(folder: Path) -> Path:
    tree = folder / "tree"
    if kept := os.environ.get("SRL_TEST_TREE"):
        subprocess.run(["cp", "-a", kept, str(tree)], check=True)
    else:
        done = subprocess.run(
            ["debootstrap", "--variant=minbase", f"--include={','.join(PACKAGES)}", RELEASE, str(tree)],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=400, check=False,
        )  # fmt: skip
        if done.returncode != 0:
            pytest.skip(f"no tree of {RELEASE}: {done.stdout.strip().splitlines()[-1:]}")
    sudo = tree / "usr/local/bin/sudo"
    sudo.write_text(SUDO)
    sudo.chmod(0o755)
    return tree


@contextmanager
def booted(folder: Path, wheels: Path) -> Iterator[Machine]:
    """A machine with the checkout at /checkout, wheels at /wheels, the packages of this environment at /packages."""
    if reason := why_not():
        pytest.skip(reason)
    tree = _tree(folder)
    packages = Path(numpy.__file__).parents[1]
    log = (folder / "boot.log").open("w")
    nspawn = subprocess.Popen(
        ["systemd-nspawn", "--quiet", "--directory", str(tree), "--machine=srl-test", "--boot",
         "--register=no", "--keep-unit", "--private-network", f"--capability={CAPABILITIES}",
         f"--bind-ro={ROOT}:/checkout", f"--bind-ro={wheels}:/wheels", f"--bind-ro={packages}:/packages"],
        stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT,
    )  # fmt: skip
    try:
        until(lambda: nspawn.poll() is not None or _running(nspawn.pid), what="the machine", timeout=60)
        if nspawn.poll() is not None:
            pytest.skip(f"no boot: {(folder / 'boot.log').read_text()[-300:]}")
        machine = Machine(_children(nspawn.pid)[0])
        yield machine
        machine.call("systemctl poweroff", code=None)
        nspawn.wait(60)
    finally:
        for process in _children(nspawn.pid):  # nspawn's own death leaves them
            with contextlib.suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
        nspawn.kill()
        nspawn.wait()
        log.close()


def _children(process: int) -> list[int]:
    try:
        return [int(word) for word in Path(f"/proc/{process}/task/{process}/children").read_text().split()]
    except (FileNotFoundError, ProcessLookupError):  # it has ended
        return []


def _running(nspawn: int) -> bool:
    """Whether the machine's systemd answers and has done its start."""
    found = _children(nspawn)
    if not found:
        return False
    output = Machine(found[0]).call("systemctl is-system-running", code=None)
    return output.strip() in ("running", "degraded")
