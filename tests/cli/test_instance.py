"""Which instance a command means, and what it says of one that isn't there or isn't to be seen."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from srl.runtime.cli import main
from srl.runtime.cli.instance import choose
from srl.runtime.contracts.errors import RequestError
from srl.runtime.ipc import run_folder
from srl.runtime.ipc.run_folder import RunFolder

NOBODY = 65534


@pytest.fixture
def base(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder of instances that every user may enter, as `/run/srl`."""
    with tempfile.TemporaryDirectory(prefix="srl-") as folder:
        os.chmod(folder, 0o755)
        monkeypatch.setenv("SRL_RUNTIME_DIR", folder)
        monkeypatch.setattr(run_folder, "check_owners", lambda *_: None)  # of what is above a test's folder
        yield Path(folder)


@pytest.fixture
def running(base: Path) -> Iterator[RunFolder]:
    found = RunFolder(base / "sixth-finger")
    found.claim()
    yield found
    found.release()


def test_an_instance_is_found_by_its_name_and_by_that_of_its_keys(running: RunFolder) -> None:
    for name in ("sixth-finger", "sixth_finger", None):
        assert choose(name).path == running.path


@pytest.mark.parametrize("command", [["stop"], ["start"], ["reset"], ["set"], ["top"]])
def test_a_name_that_isnt_there_is_said(
    command: list[str], running: RunFolder, base: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*command, "sixt-finger"]) == 2
    output = capsys.readouterr().err
    assert f"instance 'sixt-finger': it isn't running (looked in {base} and /run/srl). Did you mean" in output


@pytest.mark.parametrize("mode", [0o750, 0o000])
def test_another_users_instance_isnt_said_not_to_run(running: RunFolder, mode: int) -> None:
    folder = running.path if mode else running.path.parent
    owner = os.geteuid()
    os.chmod(folder, mode)
    if owner == 0:
        os.setegid(NOBODY)
        os.seteuid(NOBODY)
    elif mode:
        os.chmod(folder, 0o000)
    try:
        with pytest.raises(RequestError, match=rf"{folder} is of user \S+ and can't be read, so whether it runs"):
            choose("sixth-finger")
    finally:
        os.seteuid(owner)
        if owner == 0:
            os.setegid(0)
        os.chmod(folder, 0o755)
