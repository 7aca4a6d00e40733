"""A bench that fails, crashes or hangs is said in words, and ends no other one."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from helpers.wait import until

from bench import __main__ as command
from bench import one
from bench.catalogue import BENCHES, Bench
from srl.studies.faults.live_run import lives

_BENCHES = """
import os, pathlib, signal, subprocess, sys, time
from bench.pairs import PartlyError, Row

ROW = Row(id="good", what="it", ours=1.0, other=2.0, other_name="that", ratio=0.5, control=1.0, unit="us")

def good():
    return [ROW]

def raises():
    raise ValueError("the twin said nothing")

def exits():
    raise SystemExit("nothing is compiled here")

def crashes():
    os.kill(os.getpid(), signal.SIGSEGV)

def commands():
    subprocess.run([sys.executable, "-c", "raise KeyError('no arm')"], check=True, capture_output=True)

def partly():
    raise PartlyError("ring: it is silent", [ROW])

def hangs():
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
    pathlib.Path(os.environ["SRL_TEST_STARTED"]).write_text(str(child.pid))
    time.sleep(600)
"""


@pytest.fixture(autouse=True)
def benches(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The benches above, for the processes that `one` starts."""
    (tmp_path / "benches_of_a_test.py").write_text(_BENCHES)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))


def _only(monkeypatch: pytest.MonkeyPatch, *names: str) -> None:
    for name in list(BENCHES):
        monkeypatch.delitem(BENCHES, name)
    for name in names:
        monkeypatch.setitem(BENCHES, name, Bench(f"benches_of_a_test:{name}"))


@pytest.mark.slow
def test_a_bench_that_fails_is_said_and_the_others_go_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    _only(monkeypatch, "raises", "exits", "crashes", "commands", "partly", "good")
    monkeypatch.setattr(sys, "argv", ["bench", "--json"])
    assert command.main() == 1
    output = json.loads(capsys.readouterr().out)
    assert [row["id"] for row in output["benches"]] == ["good", "good"]  # of `partly` as well
    failed = output["failed"]
    assert set(failed) == {"raises", "exits", "crashes", "commands", "partly"}
    assert failed["raises"] == "ValueError: the twin said nothing"
    assert failed["exits"] == "nothing is compiled here"
    assert "SIGSEGV" in failed["crashes"]
    assert failed["commands"].endswith("said: KeyError: 'no arm'")
    assert failed["partly"] == "ring: it is silent"


def test_a_bench_that_hangs_is_ended_with_all_that_it_started(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    started = tmp_path / "started"
    monkeypatch.setenv("SRL_TEST_STARTED", str(started))
    rows, why = [], ""
    longest = 2.0
    while not started.exists():  # a slow machine: it may not have begun by then
        rows, why = one.run("benches_of_a_test:hangs", longest=longest)
        longest *= 2
    assert (rows, why) == ([], f"it had no figures after {longest / 2:g} s")
    until(lambda: not lives(int(started.read_text())), what="the end of what it started")


def test_without_failures_the_exit_code_is_0(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    _only(monkeypatch, "good")
    monkeypatch.setattr(sys, "argv", ["bench"])
    assert command.main() == 0
    assert "it: 1 us, that 2, ratio 0.5, A/A 1" in capsys.readouterr().out


def test_every_bench_of_the_catalogue_is_there() -> None:
    for bench in BENCHES.values():
        module, _, name = bench.function.partition(":")
        text = (Path(one.__file__).parents[1] / Path(*module.split("."))).with_suffix(".py").read_text()
        assert f"\ndef {name}(" in text
