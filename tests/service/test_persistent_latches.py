"""Latches over the end of a run: what stood stands again; only a reset takes it away."""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from helpers.run import Running, call
from helpers.wait import until

from srl.runtime.contracts.errors import HostError
from srl.runtime.ipc.header import CYCLE, Latch
from srl.runtime.ipc.latches import NONE, names
from srl.runtime.ipc.ring import RingReader, RingWriter
from srl.runtime.service.persistent_latches import PersistentLatches


class Host:
    """A state folder and the rows of a loop."""

    def __init__(self, folder: Path) -> None:
        self.state, path = folder / "state", folder / "rows.ring"
        self.output: list[str] = []
        self.ring = RingWriter.create(path, len(CYCLE), 64)
        self.rows = RingReader(path)

    def begin(self) -> PersistentLatches:
        return PersistentLatches(self.state, self.output.append)

    def row(self, latches: Latch) -> None:
        words = np.zeros(len(CYCLE), np.int64)
        words[CYCLE.latches] = latches
        self.ring.append(words)

    def kept(self) -> list[str]:
        """What the next run would find."""
        path = self.state / "latches.json"
        return json.loads(path.read_text())["latches"] if path.exists() else []


@pytest.fixture
def host(tmp_path: Path) -> Iterator[Host]:
    made = Host(tmp_path)
    yield made
    made.ring.close()


def test_a_run_that_ends_well_leaves_what_stands(host: Host) -> None:
    run = host.begin()
    assert run.latches == NONE
    assert host.kept() == ["restart"]  # if the host lost its power now
    host.row(Latch.PERSON)
    run.follow(host.rows)
    until(lambda: host.kept() == ["person", "restart"])
    run.close(well=True)
    assert host.kept() == ["person"]
    assert host.begin().latches == Latch.PERSON


@pytest.mark.parametrize("latch", [latch for latch in Latch if latch is not Latch.START])
def test_every_latch_but_that_of_the_first_start_outlives_its_run(host: Host, latch: Latch) -> None:
    run = host.begin()
    host.row(latch | Latch.START)
    run.follow(host.rows)
    run.close(well=True)
    assert host.begin().latches == latch


def test_a_bad_end_is_gone_only_once_a_reset_released_it(host: Host) -> None:
    run = host.begin()
    host.row(NONE)
    run.follow(host.rows)
    run.close(well=False)
    for _ in range(2):  # runs that end well before anybody resets
        run = host.begin()
        assert run.latches == Latch.RESTART
        host.row(Latch.RESTART)
        run.follow(host.rows)
        run.close(well=True)
    run = host.begin()
    host.row(NONE)  # reset
    run.follow(host.rows)
    run.close(well=True)
    assert host.kept() == []
    assert host.begin().latches == NONE


def test_it_needs_no_run_folder(host: Host) -> None:
    run = host.begin()
    host.row(Latch.PERSON)
    host.rows.path.unlink()
    run.follow(host.rows)
    run.close(well=True)
    assert host.kept() == ["person"]


@pytest.mark.parametrize("before", [NONE, Latch.PERSON | Latch.RESTART])
def test_a_run_without_a_cycle_leaves_what_stood(host: Host, before: Latch) -> None:
    host.state.mkdir()
    (host.state / "latches.json").write_text(json.dumps({"latches": names(before)}))
    run = host.begin()
    assert run.latches == before
    assert not run.began
    run.close(well=True)
    assert host.kept() == names(before)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        '{"latches": ["persn"]}',
        '{"latches": 3}',
        "\x00" * 40,
        "{}",
        '{"latches": ""}',
        '{"latches": {}}',
        "[" * 9999,
    ],
)
def test_a_damaged_file_counts_as_the_worst(host: Host, text: str) -> None:
    host.state.mkdir()
    (host.state / "latches.json").write_text(text)
    run = host.begin()
    assert run.latches == Latch.PERSON | Latch.RESTART
    assert len(host.output) == 1
    assert "latches.json can't be read" in host.output[0]
    assert "srl reset" in host.output[0]
    run.close(well=True)
    assert host.kept() == ["person", "restart"]


def test_the_mark_of_an_earlier_version_counts(host: Host) -> None:
    host.state.mkdir()
    (host.state / "running").touch()
    run = host.begin()
    assert run.latches == Latch.RESTART
    assert not (host.state / "running").exists()
    run.close(well=True)
    assert host.kept() == ["restart"]


def test_a_state_folder_that_cant_be_written_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(HostError, match="can't be written"):
        PersistentLatches(tmp_path / "file" / "state", print)


def test_a_slow_disk_holds_up_nobody_and_the_newest_state_is_written_last(
    host: Host, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = host.begin()
    disk, asked = threading.Event(), threading.Event()
    write = run._write

    def slow(wanted: Latch) -> None:
        asked.set()
        disk.wait()
        write(wanted)

    monkeypatch.setattr(run, "_write", slow)
    for latches in (Latch.BUS, Latch.PERSON, Latch.PERSON | Latch.FAULT):
        host.row(latches)
        run.follow(host.rows)
    asked.wait()
    disk.set()
    run.close(well=True)
    assert host.kept() == ["person", "fault"]


def test_what_stands_is_on_the_disk_before_it_takes_the_place_of_what_stood(
    host: Host, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A power cut leaves the old file or the new one, and after a good end none: no name without its content."""
    done: list[str] = []
    sync, replace, unlink = os.fsync, Path.replace, Path.unlink

    def named(descriptor: int) -> str:
        return Path(os.readlink(f"/proc/self/fd/{descriptor}")).name

    monkeypatch.setattr(os, "fsync", lambda fd: (done.append(f"{named(fd)} kept"), sync(fd))[1])
    monkeypatch.setattr(Path, "replace", lambda self, to: (done.append(f"{self.name} moved"), replace(self, to))[1])
    monkeypatch.setattr(Path, "unlink", lambda self, **how: (done.append(f"{self.name} gone"), unlink(self, **how))[1])
    run = host.begin()
    assert done[:3] == ["latches.new kept", "latches.new moved", "state kept"]
    done.clear()
    run.close(well=True)
    assert done == ["latches.json gone", "state kept"]


# The whole runtime


@pytest.mark.slow
def test_a_simulated_run_neither_obeys_nor_touches_what_stands(tmp_path: Path) -> None:
    """It deleted the mark of a bad run on real actuators when it ended well."""
    path = tmp_path / "state" / "sixth-finger" / "latches.json"
    path.parent.mkdir(parents=True)
    path.write_text('{"latches": ["person", "restart"]}')
    arguments = ("sixth-finger", "--sim", "--fast", "--duration", "1", "--set", "bus=null", "--json")
    found = json.loads(call(tmp_path, "run", *arguments).stdout)
    assert found["latches"] == []
    assert found["result"]["guard"]
    assert path.read_text() == '{"latches": ["person", "restart"]}'


@pytest.mark.slow
def test_the_summary_says_what_stands(tmp_path: Path) -> None:
    with Running(tmp_path, "sixth-finger", "--sim", "--duration", "60", "--set", "bus=null") as run:
        run.started()
        answer = json.loads(call(tmp_path, "stop", "--json").stdout)
        assert answer["latches"] == ["person"]
        call(tmp_path, "stop", "--exit")
        found = run.finish()
    assert (found["latches"], found["refused"]) == (["person"], 0)
