"""`srl study`: sweeps, and what isn't there."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from srl.runtime.cli import main
from srl.runtime.contracts import registry
from srl.studies.result import Result
from srl.studies.superman import recorded_forces


def test_a_sweep_prints_a_row_for_each_change(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [{"changed": "push 30", "largest force N": 40.0}, {"changed": "push 8", "largest force N": None}]
    monkeypatch.setattr(recorded_forces, "sweep", lambda folder: rows if folder.is_dir() else [], raising=False)
    assert main(["study", "recorded-forces", "--sweep", "--json", "--out", str(tmp_path)]) == 0
    assert json.loads(capsys.readouterr().out)["sweep"] == rows
    assert json.loads((tmp_path / "recorded-forces" / "sweep.json").read_text())["sweep"] == rows
    assert main(["study", "recorded-forces", "--sweep", "--out", str(tmp_path)]) == 0
    assert "push 8" in capsys.readouterr().out


def test_what_came_out_is_kept_where_it_can_be_and_printed_in_any_case(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def study(folder: Path, quick: bool) -> Result:
        return Result("peg-in-hole", simulated=True, seeds=[1], table=[{"force N": float("nan")}])

    monkeypatch.setattr(registry, "load", lambda *_: study)
    assert main(["study", "peg-in-hole", "--out", str(tmp_path)]) == 0
    kept = tmp_path / "peg-in-hole" / "result.json"
    assert json.loads(kept.read_text(), parse_constant=pytest.fail)["table"] == [{"force N": None}]
    kept.unlink()
    kept.mkdir()
    capsys.readouterr()
    assert main(["study", "peg-in-hole", "--out", str(tmp_path)]) == 0
    output = capsys.readouterr()
    assert "force N" in output.out
    assert "result.json can't be written" in output.err


@pytest.mark.parametrize(
    ("arguments", "words"), [(["recorded-forces", "--sweep"], "nothing to sweep"), (["peg-in-hol"], "peg-in-hole")]
)
def test_what_isnt_there_is_named(
    arguments: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["study", *arguments, "--out", str(tmp_path)]) == 2
    assert words in capsys.readouterr().err


TRIAL_OPTIONS = pytest.mark.parametrize(
    "option",
    [["--workers", "2"], ["--workers", "0"], ["--on", "tcp://127.0.0.1:8786"], ["--tls", "keys"], ["--retry"],
     ["--insecure-no-tls"]],
)  # fmt: skip


@TRIAL_OPTIONS
def test_a_study_whose_trials_arent_tasks_takes_no_options_of_trials(
    option: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["study", "recorded-forces", *option, "--out", str(tmp_path)]) == 2
    assert f"{option[0]}: this study's trials aren't tasks" in capsys.readouterr().err


@TRIAL_OPTIONS
def test_a_persons_trials_take_no_options_of_tasks(
    option: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["study", "ikns-tracking", "--person", "P07", *option, "--out", str(tmp_path)]) == 2
    assert f"{option[0]}: a person's trials are run here" in capsys.readouterr().err
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize("option", [["--quick"], ["--person", "P07"]])
def test_a_sweep_takes_no_other_choice_of_persons(
    option: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["study", "ikns-tracking", "--sweep", *option, "--out", str(tmp_path)]) == 2
    assert "--sweep" in capsys.readouterr().err
    assert not any(tmp_path.iterdir())
