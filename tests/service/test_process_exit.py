"""A process's end, seen before its parent is told."""

from __future__ import annotations

import subprocess
from pathlib import Path

from helpers.wait import until

from srl.runtime.service.process_exit import ProcessExit


def test_a_killed_process_is_seen_until_it_is_reaped_and_after() -> None:
    process = subprocess.Popen(["sleep", "1000"])
    dying = ProcessExit(process.pid)
    assert not dying.seen()
    process.kill()
    until(dying.seen)
    process.wait()
    assert dying.seen()
    dying.close()


def test_a_stopped_process_isnt_dead() -> None:
    process = subprocess.Popen(["sh", "-c", "kill -STOP $$; exit"])
    dying = ProcessExit(process.pid)
    until(lambda: b") T " in Path(f"/proc/{process.pid}/stat").read_bytes())
    assert not dying.seen()
    process.kill()
    process.wait()
    dying.close()


def test_without_statistics_nothing_is_seen() -> None:
    dying = ProcessExit(1 << 30)
    assert not dying.seen()
    dying.close()
