from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers.bus import Run, reach, spawn

from srl.runtime.cli import top
from srl.runtime.contracts.errors import RequestError
from srl.runtime.ipc.header import Latch
from srl.runtime.ipc.run_folder import RunFolder


@pytest.fixture
def base(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("SRL_RUNTIME_DIR", str(tmp_path))
    return tmp_path


@pytest.fixture
def instance(base: Path) -> Iterator[Run]:
    run_folder = RunFolder.of("sixth-finger")
    run_folder.claim()
    run = Run(run_folder, 200)
    run.start()
    process = spawn(run_folder)
    reach(run_folder).close()
    yield run
    run.end()
    assert process.wait(10) == 0
    run_folder.release()


def call(*words: str) -> int:
    parser = argparse.ArgumentParser()
    top.add_parser(parser.add_subparsers())
    args = parser.parse_args(["top", *words])
    return int(args.run(args))


def test_one_frame_as_text(instance: Run, capsys: pytest.CaptureFixture[str]) -> None:
    assert call("--once") == 0
    frame = capsys.readouterr().out
    for word in (
        "sixth-finger",
        "ready",
        "glove",
        "cyberglove",
        "connected, active",
        "of 200 Hz",
        "█",
        "(rad)",
        "1.000",
    ):
        assert word in frame
    assert "\x1b" not in frame


def test_latches_are_shown_with_what_ends_them(instance: Run, capsys: pytest.CaptureFixture[str]) -> None:
    instance.refused = 17
    instance.latches = Latch.PERSON | Latch.FAULT  # a change is told at once
    assert call("--once") == 0
    frame = " ".join(capsys.readouterr().out.split())
    assert "ready; latched: person, fault" in frame
    assert "`srl reset sixth-finger` on its machine ends this" in frame
    assert "requests refused 17" in frame
    assert call("--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["latches"], found["refused"]) == (["person", "fault"], 17)


def test_one_object(instance: Run, capsys: pytest.CaptureFixture[str]) -> None:
    assert call("sixth-finger", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["state"], found["devices"]["finger"]["driver"]) == ("ready", "firmata")
    assert found["signals"]["glove/pose"]["values"] == [1, 2, 3, 0.5, -0.5, 0.5, -0.5]
    assert found["signals"]["glove/position"]["unit"] == "rad"


def test_which_instance_is_asked_for(base: Path) -> None:
    with pytest.raises(RequestError, match="nothing runs on this host"):
        call()
    claimed = [RunFolder.of(name) for name in ("left", "right")]
    for run_folder in claimed:
        run_folder.claim()
    with pytest.raises(RequestError, match="left, right"):
        call()
    with pytest.raises(RequestError, match="Did you mean 'left'"):
        call("letf")
    with pytest.raises(RequestError, match="no bus listens"):
        call("left")
    for run_folder in claimed:
        run_folder.release()
