"""A process that the supervisor starts: no request to end is lost, from its first instruction on."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from helpers import environment

from srl.runtime.ipc.child import PARENT, starting

SLOW_TO_START = """
import sys
print("up", flush=True)
sys.stdin.readline()  # what happens until here comes before its first instruction
from srl.runtime.ipc.child import Ending
ending = Ending()
print(ending.asked, ending.orphan, flush=True)
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_that_comes_before_the_handler_is_remembered(number: signal.Signals) -> None:
    with starting():
        process = subprocess.Popen(
            [sys.executable, "-c", SLOW_TO_START], env=environment(), stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            text=True,
        )  # fmt: skip
    assert process.stdout is not None
    assert process.stdout.readline() == "up\n"
    process.send_signal(number)
    out, _ = process.communicate("\n", timeout=30)
    assert out == ("True False\n" if number == signal.SIGTERM else "False False\n")
    assert process.returncode == 0
    assert signal.pthread_sigmask(signal.SIG_BLOCK, ()) == set()


@pytest.mark.parametrize("module", ["srl.runtime.loop", "srl.runtime.bus"])
def test_one_whose_supervisor_has_gone_says_why_it_does_not_begin(module: str, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", module, str(tmp_path), "0"], env=environment() | {PARENT: str(os.getppid())},
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert "the supervisor that started it has ended" in done.stderr
