"""One vocabulary over all commands, and the page that is made of their parsers."""

from __future__ import annotations

import argparse
from collections import defaultdict
from typing import Any

import pytest
from helpers import ROOT

from srl.runtime.cli import main
from srl.runtime.cli.reference import PAGE, arguments, page, parsers

# Where one option means the same and still takes another thing.
OTHERS = {
    "--from": "what a new thing is made from: a profile, or recordings",
    "--out": "where to: a file, or a folder for several",
    "--port": "a port alone, or that of a device of the profile",
    "--profile": "of a recording, or of a run",
}
TEXTS = {
    "--json", "--set", "--sim", "--person", "--yes", "--duration", "--rate", "--record", "--view", "--panel", "--host",
}  # fmt: skip


def form(action: argparse.Action) -> tuple[Any, ...]:
    return action.metavar, action.nargs, type(action).__name__


def by_option() -> dict[str, dict[str, argparse.Action]]:
    found: dict[str, dict[str, argparse.Action]] = defaultdict(dict)
    for name, parser in parsers().items():
        for action in arguments(parser):
            for option in action.option_strings or [action.dest]:
                found[option][name] = action
    return found


def test_an_option_takes_the_same_in_each_command() -> None:
    for option, actions in by_option().items():
        if option not in {*OTHERS, "name", "folder", "device", "devices", "-o", "profile"}:
            forms = {name: form(action) for name, action in actions.items()}
            assert len(set(forms.values())) == 1, f"{option}: {forms}"


def test_an_option_has_one_text_where_it_means_one_thing() -> None:
    for option, actions in by_option().items():
        if option not in {*OTHERS, *TEXTS, "name", "folder", "device", "-o", "profile", "--figure", "--recordings"}:
            assert len({action.help for action in actions.values()}) == 1, f"{option}: {sorted(actions)}"


def test_what_takes_a_value_says_which() -> None:
    for option, actions in by_option().items():
        for name, action in actions.items():
            if option.startswith("-") and action.nargs != 0:
                assert action.metavar or action.choices, f"srl {name} {option}"


@pytest.mark.parametrize(
    ("arguments", "old", "new"),
    [
        (["check", "servo-jog", "--png", "a.pdf"], "--png", "--figure"),
        (["panel", "--port", "70000"], "--port", "--web-port"),
        (["twin", "servo-jog", "--speed", "-1"], "--speed", "--pace"),
        (["twin", "servo-jog", "--rate", "1"], "--rate", "--poll"),
    ],
)
def test_an_old_spelling_does_the_same_and_names_the_new(
    arguments: list[str], old: str, new: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    hint, error = capsys.readouterr().err.splitlines()
    assert hint == f"srl {arguments[0]}: {old} is called {new} now; the next version knows only that"
    assert f"srl {arguments[0]}: {new}" in error
    assert old not in page()[page().index(f"## srl {arguments[0]}") :].split("\n## ")[0].split()


@pytest.mark.parametrize("more", [[], ["--frames"]])
def test_an_old_command_does_the_same_and_names_the_new(more: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["show", "servo-jog", *more]) == 0
    was = capsys.readouterr()
    now = more or ["--all"]
    assert was.err == f"srl show is called `srl check servo-jog {now[0]}` now; the next version knows only that\n"
    assert main(["check", "servo-jog", *now]) == 0
    assert capsys.readouterr().out == was.out


def test_the_page_is_what_the_commands_say() -> None:
    assert (ROOT / PAGE).read_text() == page(), "Run `make commands`"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["run", "sixth-finger", "--simm"], "srl run: unrecognized arguments: --simm. Did you mean '--sim'?"),
        (["chek", "x"], "invalid choice: 'chek'. Did you mean 'check'?"),
        (["calibrate", "sixth-finger", "glov"], "invalid choice: 'glov'. Did you mean 'glove'?"),
        (["run", "sixth-finger", "--duration", "5s"], "invalid float value: '5s'. `srl run --help` lists"),
    ],
)
def test_a_mistyped_word_is_said_with_what_was_probably_meant(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert words in capsys.readouterr().err
