"""A whole calibration of a person made of formulas: the file, refusals, a point done again, a recording."""

from __future__ import annotations

import datetime
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.calibration import FEW, QUICK, Actor, Person
from helpers.recording import make_layout

from srl.commissioning.calibration.guide import Guide, QuitError
from srl.commissioning.calibration.ikns import report
from srl.commissioning.calibration.ikns.channel_map import channel_map
from srl.commissioning.calibration.ikns.marks import mark_of
from srl.commissioning.calibration.ikns.procedure import Procedure
from srl.commissioning.calibration.ikns.result import Result, compute
from srl.commissioning.calibration.ikns.samples import joined, trials
from srl.commissioning.calibration.ikns.steps import Kind, View
from srl.commissioning.calibration.marks import stretch_of
from srl.commissioning.calibration.screen import Plain, Screen
from srl.commissioning.calibration.sources import RowFile, Rows, recorded
from srl.commissioning.calibration.target import write_record
from srl.control.ikns import record
from srl.control.ikns.calibration import CalibrationError
from srl.runtime.contracts.errors import RecordingError, RequestError
from srl.runtime.ipc.header import CYCLE, State

DAY = datetime.date(2023, 11, 14)  # of the actor's rows


class Typist(Screen):
    """Types when the procedure comes to a step."""

    def __init__(self, typed: dict[tuple[int, str], list[str]] | None = None) -> None:
        self.typed, self.output, self.views = typed or {}, list[str](), list[View]()

    def show(self, view: View) -> None:
        self.views.append(view)

    def say(self, text: str) -> None:
        self.output.append(text)

    def command(self) -> str:
        if not self.views:
            return "none"
        step = self.views[-1].step
        waiting = self.typed.get((step.point + 1, step.kind.value))
        return waiting.pop(0) if waiting else "none"


def guided(actor: Actor, screen: Screen | None = None, dofs: tuple[str, ...] = ("swivel",)) -> Guide:
    guide = Guide(actor, Procedure(dofs, FEW, QUICK), screen or Typist(), lambda: False)
    guide.run()
    return guide


def result_of(actor: Actor, guide: Guide) -> Result:
    assert guide.first is not None
    return compute(actor.channel_map, guide.samples, actor.channel_map.date(guide.first))


def done(actor: Actor, screen: Screen | None = None, dofs: tuple[str, ...] = ("swivel",)) -> Result:
    return result_of(actor, guided(actor, screen, dofs))


@pytest.fixture(scope="module")
def good() -> tuple[Actor, Result]:
    actor = Actor()
    return actor, done(actor)


@pytest.mark.parametrize("dofs", [("swivel",), ("swivel", "shrug", "protraction")])
def test_the_calibration_reads_the_dofs(dofs: tuple[str, ...], tmp_path: Path) -> None:
    actor = Actor(dofs)
    result = done(actor, dofs=dofs)
    assert result.refusals == ()
    assert result.numbers == tuple(range(1, 11))
    assert result.date == DAY
    write_record(tmp_path / "p07.json", result.record(), replacing=False)
    made = record.read(tmp_path / "p07.json")
    assert (made.person, made.dofs, made.frame, made.rate) == ("P07", dofs, "chest", 100.0)
    assert made.joints == actor.channel_map.joints
    found = made.calibration()
    assert found.upper - found.lower == pytest.approx(np.ones((10, len(dofs))), abs=0.1)
    reported = report.crosstalk(result)
    assert reported is None if len(dofs) == 1 else reported is not None and reported < 0.05


def test_the_points_of_the_file_are_those_of_the_guide(good: tuple[Actor, Result]) -> None:
    actor, result = good
    procedure = actor._procedure
    assert procedure.points is not None
    assert np.linalg.norm(result.found.sites - procedure.points, axis=1).max() < QUICK.near


@pytest.mark.parametrize(
    ("person", "words"),
    [
        (Person(wander={3: 0.1}), r"point 3: samples kept: \d+, needed: 60; the hand was faster than 0.05 m/s"),
        (Person(swing={5: 0.02}), "point 5: the range is 0.02 rad, 0.15 rad are needed"),
        (Person(hidden={4}), "point 4: no sample of its trial has angles and hand: markers were missing"),
        (Person(hidden={1, 2, 3, 4}), "point 1: no sample of its trial has angles and hand: markers were missing"),
        (Person(flat=True), "points: .*(plane|flat|volume)"),
    ],
)
def test_what_cant_work_is_refused_with_the_place(person: Person, words: str) -> None:
    with pytest.raises(CalibrationError, match=words):
        _refused(person)


def _refused(person: Person) -> None:
    for reason in done(Actor(person=person)).refusals:
        raise reason


def test_a_point_done_again_repairs_it(good: tuple[Actor, Result]) -> None:
    actor = Actor(person=Person(wander={3: 0.1}))
    guide = guided(actor)
    assert any(r.place == "point 3" for r in result_of(actor, guide).refusals)
    actor.person = Person()
    assert guide._procedure.redo(3) == ""
    guide.run()
    again = result_of(actor, guide)
    assert again.refusals == ()
    first = good[1].found
    assert np.abs(again.found.sites - first.sites).max() < 0.01
    assert np.abs(again.found.directions @ first.directions.swapaxes(1, 2) - 1.0).max() < 0.01


def test_a_point_done_again_in_another_session_repairs_it() -> None:
    bad = Actor(person=Person(wander={3: 0.1}))
    before = guided(bad).samples
    again = Actor()
    explored = joined(before).hand[stretch_of(joined(before).marks, 2)]
    procedure = Procedure(("swivel",), FEW, QUICK, explored)
    assert procedure.redo(3) == ""
    guide = Guide(again, procedure, Typist(), lambda: False)
    guide.run()
    assert compute(bad.channel_map, [*before, *guide.samples], DAY).refusals == ()


def test_keys_redo_and_leave_out(good: tuple[Actor, Result]) -> None:
    screen = Typist({(2, "go"): ["s"], (4, "trial"): ["r 1", "x"], (6, "go"): [""], (7, "trial"): ["r 99"]})
    actor = Actor()
    result = done(actor, screen)
    assert result.refusals == ()
    assert result.numbers == (1, 3, 4, 5, 6, 7, 8, 9, 10)
    assert any("'x' is no command" in line for line in screen.output)
    assert "the points are 1 to 10" in screen.output
    assert joined([actor.channel_map.samples(np.concatenate(actor.rows))]).marks.max() == mark_of(9, 0)


@pytest.mark.parametrize(
    "typed",
    [
        {(3, "trial"): [*["none"] * 5, "s"]},  # while it runs: its first half is no trial
        {
            (5, "go"): ["r 3"],
            (3, "go"): ["none", "none"],
            (3, "trial"): [*["none"] * 20, "s"],
        },  # done, redone, left out
        {(10, "go"): ["r 3", "s"]},
    ],
)
def test_a_point_left_out_is_in_no_file(typed: dict[tuple[int, str], list[str]]) -> None:
    actor = Actor()
    guide = guided(actor, Typist(typed))
    assert guide._procedure.view().states[2] == "left out"
    result = result_of(actor, guide)
    assert result.numbers == (1, 2, 4, 5, 6, 7, 8, 9, 10)
    assert result.refusals == ()
    again = compute(actor.channel_map, [actor.channel_map.samples(np.concatenate(actor.rows))], DAY)
    assert (again.found.sites == result.found.sites).all()


class Stopping(Actor):
    """An actor whose run is stopped for a while at the first sample of some steps, without markers."""

    def __init__(self, *where: tuple[int, Kind]) -> None:
        super().__init__()
        self.where, self.left, self.stopped = list(where), 0, 0

    def begin(self, procedure: Any) -> None:
        super().begin(procedure)
        at = procedure.step.point, procedure.step.kind
        if at in self.where:
            self.where.remove(at)
            self.left = 120  # longer than any step with its patience

    def take(self) -> Rows:
        rows = super().take()
        if self.left:
            self.left -= 1
            self.stopped += len(rows)
            rows[:, CYCLE.state] = State.STOPPED
        return rows


def test_no_step_goes_on_while_the_run_is_stopped() -> None:
    where = [(-1, Kind.STATIC), (-1, Kind.EXPLORATION), (2, Kind.GO), (2, Kind.TRIAL), (4, Kind.GO)]
    actor, screen = Stopping(*where), Typist()
    result = done(actor, screen)
    assert actor.stopped > 5000
    assert result.refusals == ()
    assert result.numbers == tuple(range(1, 11))
    assert screen.views[-1].states == ("done",) * 10


def test_quitting_and_a_signal_end_it() -> None:
    with pytest.raises(QuitError, match="ended before it was complete"):
        guided(Actor(), Typist({(2, "go"): ["q"]}))
    asked = iter([False] * 50 + [True] * 2)
    with pytest.raises(QuitError):
        Guide(Actor(), Procedure(("swivel",), FEW, QUICK), Typist(), lambda: next(asked)).run()


def test_plain_lines_say_each_step_once() -> None:
    lines: list[str] = []
    done(Actor(), Plain(lines.append))
    assert len(lines) == 2 + 2 * 10 + 1
    assert lines[0] == "Sit still, the forearm in front of you"
    assert lines[-1] == "All points are done"


def test_turning_the_sense_round_turns_c_round(good: tuple[Actor, Result]) -> None:
    before = good[1].found
    after = good[1].flipped("swivel").found
    q = good[1].recording.angles[::50]
    for i in range(len(before.sites)):
        c, d = ((q @ f.directions[i, 0] - f.lower[i, 0]) / (f.upper[i, 0] - f.lower[i, 0]) for f in (before, after))
        assert c + d == pytest.approx(1.0)
    twice = good[1].flipped("swivel").flipped("swivel").found
    assert (twice.directions == before.directions).all()
    with pytest.raises(RequestError, match="no degree of freedom 'shrug'"):
        good[1].flipped("shrug")


def test_a_recording_gives_the_same_file_to_the_bit(good: tuple[Actor, Result], tmp_path: Path) -> None:
    actor, result = good
    file = RowFile(actor.graph.layout, tmp_path / "run.rrd")
    for rows in actor.rows:
        file.add(rows)
    file.close()
    where, rows = recorded(tmp_path / "run.rrd", channel_map)
    again = compute(where, [where.samples(rows)], where.date(rows))
    write_record(tmp_path / "a.json", result.record(), replacing=False)
    write_record(tmp_path / "b.json", again.record(), replacing=False)
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()


def test_a_recording_without_marks_has_clusters_alone(good: tuple[Actor, Result]) -> None:
    actor, result = good
    samples = actor.channel_map.samples(np.concatenate(actor.rows))
    plain = actor.channel_map.__class__(**{**vars(actor.channel_map), "mark": None})
    keep = samples.marks >= mark_of(0, 0)
    some = type(samples)(samples.times[keep], samples.angles[keep], samples.hand[keep], samples.marks[keep])
    found = compute(plain, [some], DAY)
    assert found.refusals == ()
    gaps = np.linalg.norm(found.found.sites[:, None] - result.found.sites, axis=2).min(axis=1)
    assert gaps.max() < 0.01
    options = actor.channel_map.options.model_copy(update={"dofs": ("swivel", "shrug")})
    two = actor.channel_map.__class__(**{**vars(plain), "options": options})
    with pytest.raises(CalibrationError, match="can't tell 2 degrees of freedom apart"):
        compute(two, [some], DAY)


def test_too_few_points_are_refused(good: tuple[Actor, Result]) -> None:
    actor, _ = good
    samples = actor.channel_map.samples(np.concatenate(actor.rows))
    samples.marks[samples.marks >= mark_of(7, 0)] = 0
    with pytest.raises(CalibrationError, match="points: 7 points have a trial of each DoF, 8 are needed"):
        trials(samples, 1)


@pytest.fixture
def readonly(tmp_path: Path) -> Iterator[Path]:
    folder = tmp_path / "ro"
    folder.mkdir()
    folder.chmod(0o500)
    yield folder
    folder.chmod(0o700)


def test_a_file_that_is_there_is_kept_and_replaced_only_on_request(good: tuple[Actor, Result], tmp_path: Path) -> None:
    path = tmp_path / "p07.json"
    write_record(path, good[1].record(), replacing=False)
    first = path.read_bytes()
    with pytest.raises(record.RecordError, match="a calibration is there already"):
        write_record(path, good[1].flipped("swivel").record(), replacing=False)
    assert path.read_bytes() == first
    write_record(path, good[1].flipped("swivel").record(), replacing=True)
    assert path.read_bytes() != first
    assert (tmp_path / "p07.json.old").read_bytes() == first


def test_a_full_disk_leaves_nothing_half(
    good: tuple[Actor, Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(record.RecordError, match="it can't be written: No space left on device"):
        write_record(tmp_path / "p07.json", good[1].record(), replacing=False)
    assert list(tmp_path.iterdir()) == []


def test_a_report_that_the_disk_has_no_room_for_leaves_nothing(
    good: tuple[Actor, Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(self: object, scratch: Path, **_: object) -> None:
        scratch.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("matplotlib.figure.Figure.savefig", full)
    with pytest.raises(record.RecordError, match=r"png: it can't be written: No space left on device"):
        report.draw(good[1], tmp_path / "p07.png")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_isnt_there_is_named(good: tuple[Actor, Result], tmp_path: Path) -> None:
    with pytest.raises(record.RecordError, match="the folder can't be written"):
        write_record(tmp_path / "none" / "p07.json", good[1].record(), replacing=False)


@pytest.mark.slow
def test_the_report_says_what_was_found(good: tuple[Actor, Result], tmp_path: Path) -> None:
    _, result = good
    reported = report.metrics(result)
    assert result.person == "P07"
    assert [p["number"] for p in reported["points"]] == list(range(1, 11))
    assert reported["points"][0]["dofs"]["swivel"]["range"] == pytest.approx(1.0, abs=0.1)
    assert 0.0 < reported["noise_per_mm"]["swivel"] < 0.1
    assert reported["refusals"] == []
    assert len(report.lines(result)) == 2 + 10 + 1
    report.draw(result, tmp_path / "p07.json.report.png")
    assert (tmp_path / "p07.json.report.png").read_bytes()[:4] == b"\x89PNG"
    bad = done(Actor(person=Person(wander={3: 0.1}, swing={5: 0.02})))
    assert {r["place"] for r in report.metrics(bad)["refusals"]} == {"point 3", "point 5"}
    report.draw(bad, tmp_path / "bad.png")


def test_a_recording_of_something_else_is_refused(good: tuple[Actor, Result], tmp_path: Path) -> None:
    actor, _ = good
    layout = make_layout()
    layout.meta |= {"label": "made-up", "profile": "name: x\nrate: 10\ndevices: {a: {driver: ring}}", "overrides": []}
    with pytest.raises(RecordingError, match="has no marks"):
        channel_map(layout, "x.rrd")
    with pytest.raises(RecordingError, match=r"no pose 'arm\.hand' in it"):
        channel_map(layout, "x.rrd", actor.channel_map.options)
