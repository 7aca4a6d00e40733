"""Overruns that would stop the limb again let nothing begin."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from helpers.toy import Bench

from srl.runtime.ipc.header import State
from srl.runtime.ipc.requests import Answer


def test_overruns_that_would_stop_the_limb_again_refuse_a_reset(tmp_path: Path) -> None:
    """A reset that is granted and stops in the next cycle lets the limb move for one."""
    b = Bench(tmp_path)

    def script(k: int) -> None:
        if k == 20:
            b.loop.clock.tick.missed = 20
        if k in (50, 130):  # within the window of a second, and after it
            b.ask("reset")

    b.run(160, script)
    state, result = b.header("state"), b.header("request_result")
    assert result[50] == Answer.REFUSED_FAULT
    assert set(state[20:130].tolist()) <= {State.STOPPING, State.STOPPED}
    assert result[130] == Answer.DONE
    assert (state[131:-1] == State.ACTIVE).all()


def test_overruns_at_the_begin_are_waited_out(tmp_path: Path) -> None:
    b = Bench(tmp_path)

    def script(k: int) -> None:
        if k == 0:
            b.loop.clock.tick.missed = 20

    b.run(160, script)
    state = b.header("state")
    started = int(np.flatnonzero(state != State.READY)[0])
    assert started > 90, "the window of a second"
    assert not set(state[started:-1].tolist()) & {State.STOPPING, State.STOPPED}
    assert state[-2] == State.ACTIVE
