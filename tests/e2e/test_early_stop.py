"""A stop that a person asks for while the run begins: nothing moves afterwards."""

from __future__ import annotations

from pathlib import Path

import pytest
from helpers.run import Running, call

from srl.runtime.ipc.header import Latch, State

pytestmark = pytest.mark.slow


def test_a_stop_during_the_start_is_a_stop(tmp_path: Path) -> None:
    """It found no socket, said that the loop didn't answer, and the limb began to move a moment later."""
    with Running(tmp_path, "sixth-finger", "--sim", "--duration", "60", "--set", "bus=null") as run:
        run.until(run.run_folder.is_claimed, "the claim")
        # On a slow machine the loop's answer takes longer than a person should wait, or the command comes after the
        # limb has begun. The stop counts all the same.
        output = call(tmp_path, "stop", "sixth-finger", code=None)
        answered = output.stdout in ("sixth-finger: stopped\n", "sixth-finger: stopping\n")
        assert answered or "use the hardware stop" in output.stderr.lower()
        run.started()
        run.until(lambda: run.header("state") == State.STOPPED, "the stop")
        assert run.header("latches") == Latch.PERSON
        call(tmp_path, "stop", "--exit")
        assert run.finish()["latches"] == ["person"]
