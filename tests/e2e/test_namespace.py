"""A command from another network namespace, as of a container that shares the run folder: it says what it did."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path

import pytest
from helpers.run import Running, environment, srl
from helpers.wait import until

from srl.runtime.ipc.header import State

NAMESPACE = ("unshare", "-n") if os.geteuid() == 0 else ("unshare", "-rn")

pytestmark = pytest.mark.skipif(
    shutil.which("unshare") is None
    or subprocess.run([*NAMESPACE, "true"], check=False, capture_output=True).returncode != 0,
    reason="this machine gives no network namespaces",
)


def there(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """A command in a namespace of its own."""
    return subprocess.run(
        [*NAMESPACE, *srl(*arguments)],
        env=environment(folder), cwd=folder, capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip


@pytest.mark.slow
def test_a_command_says_what_it_did(tmp_path: Path) -> None:
    with Running(tmp_path, "sixth-finger", "--sim", "--set", "start=manual", "--duration", "60") as run:
        run.started()
        run.until(lambda: run.header("state") == State.READY, "the wait for a start")
        done = there(tmp_path, "start", "sixth-finger")
        assert (done.returncode, done.stdout, done.stderr) == (0, "sixth-finger: active\n", "")
        assert run.header("state") == State.ACTIVE
        done = there(tmp_path, "start")
        assert (done.returncode, done.stdout) == (2, "")
        assert "start refused, active: not possible in this state" in done.stderr
        done = there(tmp_path, "stop", "--json")
        assert json.loads(done.stdout) | {"state": ""} == {
            "ok": True, "state": "", "cause": "request", "fault_source": "", "latches": ["person"],
        }  # fmt: skip
        run.until(lambda: run.header("state") == State.STOPPED, "the stop")
        assert there(tmp_path, "reset").stdout == "sixth-finger: active\n"
        run.until(run.run_folder.bus_socket.exists, "the bus")
        until(lambda: "->" in there(tmp_path, "set", "sixth_finger", "mapping.drift_pull", "4").stdout)
        assert "active" in there(tmp_path, "top", "--once").stdout
        assert there(tmp_path, "stop", "--exit").returncode == 0
        run.finish()
