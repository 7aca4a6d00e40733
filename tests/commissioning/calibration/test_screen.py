"""What the terminal shows, and what its keys do at the end of a session."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from helpers.calibration import PROFILE, Actor, Person
from rich.console import Console

from srl.commissioning.calibration import method, session
from srl.commissioning.calibration.guide import QuitError
from srl.commissioning.calibration.guided import View
from srl.commissioning.calibration.ikns.steps import Kind, Progress, Step
from srl.commissioning.calibration.request import CalibrationRequest
from srl.commissioning.calibration.screen import Screen, Terminal, picture
from srl.control.ikns import record
from srl.runtime.contracts.errors import SrlError

QUICK = ("static=0.5", "exploration=4", "trial=1.5", "settle=0.3", "patience=3", "samples=60")


def text(view: View, typed: str = "", title: str = "calibrate") -> str:
    console = Console(file=io.StringIO(), width=110, force_terminal=False)
    console.print(picture(title, view, typed))
    found = console.file.getvalue()  # type: ignore[attr-defined]
    assert isinstance(found, str)
    return found


def view(**changes: object) -> View:
    values: dict[str, object] = {
        "step": Step(Kind.TRIAL, 2, 0), "task": "Swing the elbow", "lack": "", "share": 0.5, "speed": 0.021,
        "distance": 0.004, "lost": 0.0, "kept": 40, "needed": 100, "range": 0.31, "least_range": 0.15, "box": None,
        "states": ("done", "weak: range 0.1", "now", "left out"),
    }  # fmt: skip
    values |= changes
    task, lack, states = (values.pop(name) for name in ("task", "lack", "states"))
    return Progress(**values).view(task, lack, states)  # type: ignore[arg-type]


def test_the_picture_says_what_counts() -> None:
    shown = text(view(lack="move farther", box=np.array([[0.0, 0.0, 0.0], [0.2, 0.3, 0.4]])))
    for words in (
        "Swing the elbow", "2.1 cm/s", "0.4 cm from the point", "40 of 100 needed", "0.31 rad", "move farther",
        "20 cm deep, 30 cm wide, 40 cm high", "1✓", "2!", "3▶", "4–", "point 2 weak: range 0.1", "q quit",
    ):  # fmt: skip
        assert words in shown
    assert "> r 3" in text(view(), "r 3")


@pytest.mark.parametrize("words", ["recorded in /data/[p07]/run.rrd", "'[/x]' is no command", "[red]"])
def test_every_text_is_shown_as_it_is(words: str) -> None:
    console = Console(file=io.StringIO(), width=110, force_terminal=False)
    Terminal("calibrate", console).say(words)
    assert console.file.getvalue() == f"{words}\n"  # type: ignore[attr-defined]
    assert words in text(view(task=words, lack=words), words)
    assert words in text(view(), title=words)


@pytest.mark.parametrize("kind", list(Kind))
def test_nothing_seen_can_be_shown_at_every_step(kind: Kind) -> None:
    nothing = view(step=Step(kind, 0, 0), speed=np.nan, distance=np.nan, lost=1.0, states=())
    assert "100% of the samples lack angles or hand" in text(nothing)
    assert "not seen" in text(nothing)


@pytest.mark.parametrize("stdin", [None, "closed"])
def test_a_terminal_without_a_keyboard_shows_and_asks_nothing(
    stdin: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = (tmp_path / "in").open("w+")
    file.close()
    monkeypatch.setattr("sys.stdin", None if stdin is None else file)
    console = Console(file=io.StringIO(), width=110, force_terminal=False)
    with Terminal("calibrate", console) as screen:
        screen.show(view())
        assert screen.command() == "none"
        assert screen.ask("?", lambda: None) == ""


class Answers(Screen):
    """Answers the questions at the end."""

    def __init__(self, *answers: str, then: Callable[[], None] = lambda: None) -> None:
        self.answers, self.then, self.output, self.asked = list(answers), then, list[str](), list[str]()

    def show(self, view: View) -> None:
        pass

    def say(self, text: str) -> None:
        self.output.append(text)

    def ask(self, question: str, wait: Callable[[], None]) -> str:
        wait()
        self.asked.append(question)
        if answer := self.answers.pop(0):
            self.then()
        return answer


@pytest.fixture
def actor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Actor:
    (tmp_path / "worn.yaml").write_text(PROFILE)
    monkeypatch.chdir(tmp_path)
    made = Actor()
    monkeypatch.setattr(method, "Simulated", lambda *_: made)
    return made


def ordered(out: str) -> CalibrationRequest:
    return CalibrationRequest("worn.yaml", person="P07", out=Path(out), sim=True, option=QUICK)


@pytest.mark.slow
def test_a_sense_turned_round_stays_so_when_a_point_is_done_again(actor: Actor) -> None:
    screen = Answers("f swivel", "f twist", "r 2", "")
    assert session.run(ordered("a.json"), screen) == 0
    assert any("no degree of freedom 'twist'" in line for line in screen.output)
    assert session.run(ordered("b.json"), Answers("")) == 0
    turned, plain = (record.read(Path(name)).calibration() for name in ("a.json", "b.json"))
    assert (np.sum(turned.directions * plain.directions, axis=2) < -0.99).all()


def test_a_word_that_is_no_command_writes_nothing(actor: Actor, tmp_path: Path) -> None:
    screen = Answers("redo 5", "F swivel", "no", "r", "r x", "q")
    with pytest.raises(QuitError):
        session.run(ordered("a.json"), screen)
    assert sum("is no command" in line for line in screen.output) == 5
    assert not (tmp_path / "a.json").exists()


@pytest.mark.slow
def test_a_refused_point_is_done_again_at_once(actor: Actor) -> None:
    actor.person = Person(wander={3: 0.1})
    screen = Answers("r 99", "r 3", "", then=lambda: setattr(actor, "person", Person()))
    assert session.run(ordered("a.json"), screen) == 0
    assert any(line.startswith("refused: point 3: ") for line in screen.output)
    assert "Enter" not in screen.asked[0]
    assert "Enter" in screen.asked[-1]


@pytest.mark.slow
def test_a_point_without_markers_is_done_again_at_once(actor: Actor) -> None:
    actor.person = Person(hidden={4})
    screen = Answers("r 4", "", then=lambda: setattr(actor, "person", Person()))
    assert session.run(ordered("a.json"), screen) == 0
    assert any("point 4: no sample of its trial has angles and hand" in line for line in screen.output)


@pytest.mark.slow
def test_the_end_can_be_left_without_a_file(actor: Actor, tmp_path: Path) -> None:
    with pytest.raises(QuitError, match="ended without a file"):
        session.run(ordered("a.json"), Answers("q"))
    actor.person = Person(hidden={4})
    with pytest.raises(SrlError, match="point 4: no sample"):
        session.run(ordered("a.json"), Answers(""))
    assert [p.name for p in tmp_path.iterdir()] == ["worn.yaml"]
