"""Trials in processes of this machine: whatever is killed, the same rows come out."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers.run import alive
from helpers.toy_trials import installed, kept, lines, started
from helpers.wait import until

from srl.studies.tasks import environment, journal, runner, table
from srl.studies.tasks.local import LocalEngine
from srl.studies.tasks.task import Row
from srl.studies.tasks.worker import ProgramError
from srl.studies.toolkit.errors import StudyError


@pytest.fixture
def toy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """The toy package's module, installed here and in the workers."""
    installed(tmp_path / "toy")
    monkeypatch.syspath_prepend(str(tmp_path / "toy"))
    environment._environment.cache_clear()
    import toy_study  # type: ignore[import-not-found]

    yield toy_study
    environment._environment.cache_clear()
    sys.modules.pop("toy_study")


def run(toy: Any, folder: Path, workers: int, retry: bool = False) -> list[Row]:
    made = runner.runner(workers=workers, retry=retry)
    rows: list[Row] = made.rows(toy.tasks(folder), folder)
    assert made.failed == sum(not row.done for row in rows)
    return rows


def values(rows: list[Row]) -> str:
    """Their values, bit for bit."""
    return repr([(row.task.seed, row.state, row.values) for row in rows])


@pytest.mark.slow
def test_rows_are_the_same_with_any_number_of_workers_and_arent_computed_twice(toy: Any, tmp_path: Path) -> None:
    one = run(toy, tmp_path / "one", 1)
    two = run(toy, tmp_path / "two", 2)
    assert [row.task.seed for row in one] == list(range(12))
    assert values(one) == values(two)
    assert kept(tmp_path / "one") == kept(tmp_path / "two")
    workers = [row.worker for row in one]
    again = run(toy, tmp_path / "one", 2)
    assert [row.worker for row in again] == workers
    assert lines(tmp_path / "one") == 12


def test_a_folder_that_cannot_be_made_is_said(toy: Any, tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file")
    with pytest.raises(StudyError, match="can't be opened: Not a directory"):
        run(toy, tmp_path / "out" / "toy", 1)


@pytest.mark.slow
def test_a_worker_that_is_killed_costs_no_row(toy: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TOY_BOMB", str(tmp_path / "bomb"))
    rows = run(toy, tmp_path / "killed", 2)
    assert (tmp_path / "bomb").exists()
    assert all(row.done for row in rows)
    monkeypatch.delenv("TOY_BOMB")
    assert values(rows) == values(run(toy, tmp_path / "plain", 2))


@pytest.mark.slow
def test_a_trial_that_always_kills_its_worker_is_given_up_and_no_other_with_it(
    toy: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("TOY_ALWAYS", "1")
    rows = run(toy, tmp_path / "out", 2)
    assert {row.task.seed: row.state for row in rows if not row.done} == {5: "lost"}
    assert "1 of 12 trials have no values" in capsys.readouterr().err


@pytest.mark.slow
def test_a_trial_that_fails_is_kept_as_such_until_it_is_to_be_run_again(
    toy: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TOY_WRONG", "1")
    first = run(toy, tmp_path / "out", 1)
    failed = [row for row in first if not row.done]
    assert [(row.task.seed, row.state) for row in failed] == [(4, "failed")]
    assert failed[0].error.startswith("ValueError: no such wire? (toy_study.py line ")
    assert run(toy, tmp_path / "out", 1)[4] == failed[0]
    assert lines(tmp_path / "out") == 12
    again = run(toy, tmp_path / "out", 1, retry=True)
    assert (again[4].state, lines(tmp_path / "out")) == ("failed", 13)
    assert table.read(tmp_path / "out" / table.FILE)[4]["error"] == failed[0].error


@pytest.mark.slow
def test_rows_of_another_version_are_named_and_not_mixed(
    toy: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    old = environment.environment("toy") | {"numpy": "1.9"}
    with monkeypatch.context() as patch:
        patch.setattr("srl.studies.tasks.runner.environment", lambda trial: old)
        patch.setattr(LocalEngine, "run", _here)
        before = run(toy, tmp_path / "out", 1)
    capsys.readouterr()
    now = run(toy, tmp_path / "out", 1)
    assert "12 rows were made with another numpy" in capsys.readouterr().err
    assert {row.key for row in now}.isdisjoint(row.key for row in before)
    assert {row.environment["numpy"] for row in now} != {"1.9"}
    assert lines(tmp_path / "out") == 24
    assert len(table.read(tmp_path / "out" / table.FILE)) == 12


def _here(self: LocalEngine, orders: dict[str, Any]) -> Iterator[list[tuple[str, dict[str, Any]]]]:
    """An engine in this process."""
    for key, order in orders.items():
        answer = {"state": "done", "values": {}, "error": "", "seconds": 0.0, "worker": ""}
        yield [(key, answer | {"environment": order["environment"]})]


@pytest.mark.slow
def test_a_program_that_is_edited_while_the_study_runs_is_noticed(toy: Any, tmp_path: Path) -> None:
    environment.environment("toy")
    file = tmp_path / "toy" / "toy_study.py"
    file.write_text(file.read_text() + "\nTRIALS = 13\n")
    with pytest.raises(ProgramError, match=r"program: \w+ there, \w+ here"):
        run(toy, tmp_path / "out", 1)


@pytest.mark.sampled(1)
@pytest.mark.slow
@pytest.mark.parametrize("by", [signal.SIGKILL, signal.SIGINT], ids=lambda s: s.name)
def test_a_client_that_is_killed_half_way_goes_on_where_it_was(tmp_path: Path, by: signal.Signals) -> None:
    env = installed(tmp_path / "toy") | {"TOY_GATE": str(tmp_path / "gate")}
    out = tmp_path / "out" / "toy"
    with started(tmp_path / "out", env, "--workers", "2") as client:
        until(lambda: lines(out) == 6, what=lambda: f"six rows, not {lines(out)}")  # the others wait for the gate
        listed = Path(f"/proc/{client.pid}/task/{client.pid}/children")
        # Two workers, and what Python starts to clear up after their semaphores.
        until(lambda: len(listed.read_text().split()) == 3, what=lambda: f"three children, not {listed.read_text()}")
        children = listed.read_text().split()
        client.send_signal(by)
        output = client.communicate(timeout=60)[1]
        until(lambda: not any(alive(int(child)) for child in children), what="the workers end with their client")
    if by is signal.SIGINT:
        assert client.returncode == 130
        assert "6 of 12 trials are kept; give the same command again" in output
        assert "Traceback" not in output
        assert len(table.read(out / table.FILE)) == 6
    first = (out / journal.FILE).read_bytes()
    with open(out / journal.FILE, "ab") as file:
        file.write(first[: len(first) // 10])  # and the next row was being written
    (tmp_path / "gate").touch()
    with started(tmp_path / "out", env, "--workers", "2") as resumed:
        output = resumed.communicate(timeout=60)[1]
    assert resumed.returncode == 0, output
    assert "6 of 12 trials" in output
    assert "it was cut off" in output
    assert (out / journal.FILE).read_bytes().startswith(first)
    with started(tmp_path / "whole", env, "--workers", "1") as whole:
        whole.communicate(timeout=60)
    assert whole.returncode == 0
    assert kept(out) == kept(tmp_path / "whole" / "toy")
