"""`srl set`: what can be changed while an instance runs, and the loop's answer in words."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers.bus import Instance

from srl.runtime.cli import main
from srl.runtime.cli import set as command
from srl.runtime.ipc import run_folder
from srl.runtime.profile import profile, wiring

COMMAND = Path(command.__file__)
PULL = "object-mapping.pull"


@pytest.fixture(scope="module")
def one(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Instance]:
    instance = Instance(tmp_path_factory.mktemp("set") / "sixth-finger")
    yield instance
    instance.close()


@pytest.fixture(autouse=True)
def _running(one: Instance, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(run_folder, "check_owners", lambda _: None)  # of what is above a test's folder
    monkeypatch.setenv("SRL_RUNTIME_DIR", str(one.run_folder.path.parent))
    one.run.taken.clear()
    one.client.set_param(PULL, 1.0)
    one.run_folder.claim()
    yield
    one.run_folder.release()


def output(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main(["set", *arguments]) == 0
    return capsys.readouterr().out


def test_a_value_is_set_and_told_from_what_to_what(one: Instance, capsys: pytest.CaptureFixture[str]) -> None:
    assert output(capsys, "sixth-finger", PULL, "2.5") == "sixth-finger: object-mapping.pull: 1 N -> 2.5 N (0 to 5)\n"
    assert one.client.get_param(PULL)["value"] == 2.5
    output(capsys, "sixth-finger", "object_mapping.pull", "3")  # as it stands in the bus's keys
    assert one.client.get_param(PULL)["value"] == 3.0


@pytest.mark.parametrize("arguments", [[], ["sixth-finger"], ["sixth-finger", PULL]])
def test_without_a_value_the_parameters_are_listed(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert output(capsys, *arguments) == "sixth-finger: object-mapping.pull: 1 N (0 to 5; default 1): pull\n"


def test_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    reported = json.loads(output(capsys, "sixth-finger", PULL, "2", "--json"))
    assert reported["instance"] == "sixth-finger"
    parameter = reported["parameters"][PULL]
    assert (parameter["before"], parameter["value"], parameter["lower"], parameter["upper"]) == (1.0, 2.0, 0.0, 5.0)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["sixth-finger", PULL, "9"], "9 N is out of bounds. Send 0 to 5 N"),
        (["sixth-finger", PULL, "-1"], "-1 N is out of bounds. Send 0 to 5 N"),
        (["sixth-finger", PULL, "nan"], "a value is NaN or infinite"),
        (["sixth-finger", PULL, "much"], "'much' is no number"),
        (
            ["sixth-finger", "object-mapping.push", "1"],
            "parameter 'object-mapping.push': it isn't there. Did you mean 'object-mapping.pull'",
        ),
        (["sixth-fingers"], "it isn't running"),
    ],
)
def test_what_is_wrong_is_refused_in_words_and_changes_nothing(
    arguments: list[str], words: str, one: Instance, capsys: pytest.CaptureFixture[str]
) -> None:
    taken = len(one.run.taken)
    assert main(["set", *arguments]) == 2
    assert words in capsys.readouterr().err
    assert len(one.run.taken) == taken
    assert one.client.get_param(PULL)["value"] == 1.0


def test_an_instance_without_a_bus_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("SRL_RUNTIME_DIR", str(tmp_path))
    silent = run_folder.RunFolder(tmp_path / "silent")
    silent.claim()
    assert main(["set"]) == 2
    assert "instance 'silent': no bus listens" in capsys.readouterr().err
    silent.release()


def test_what_the_page_and_the_help_name_is_there() -> None:
    page = (Path(__file__).parents[2] / "docs" / "bus.md").read_text()
    named = {
        "sixth-finger": re.findall(r'set_param\("(.*?)"|srl set sixth-finger ([\w.-]+)', page + COMMAND.read_text()),
        "finger-jog": re.findall(r'setpoint\("(.*?)"()', page),
    }
    for name, found in named.items():
        meta = wiring.build(*profile.load(name), []).layout.meta
        there = {item["name"] for item in meta["parameters"] + meta["setpoints"]}
        assert found
        assert {first or second for first, second in found} <= there
