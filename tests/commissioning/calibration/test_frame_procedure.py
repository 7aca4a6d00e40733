"""The steps of `srl calibrate PROFILE frames`: what is taken for a pose, what isn't, and what the screen says of it."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
from helpers.frame_calibration import POINTS, Leader
from rich.console import Console

from srl.commissioning.calibration.frames import method as frame_method
from srl.commissioning.calibration.frames.fit import Thresholds
from srl.commissioning.calibration.frames.procedure import Kind, Procedure
from srl.commissioning.calibration.frames.samples import Plan
from srl.commissioning.calibration.screen import picture


def test_a_pose_like_another_or_that_moves_isnt_taken() -> None:
    actor = Leader()
    procedure = Procedure(Plan(), Thresholds(turned=3.0))
    feed(actor, procedure, 10.0)
    assert (procedure.step.kind, procedure.step.number) == (Kind.GO, 2)
    assert "it is like pose 1 (turned by" in procedure.view().lack
    procedure = Procedure(Plan(), Thresholds())
    while procedure.step.kind is not Kind.HOLD:
        feed(actor, procedure, 0.1)
    feed(actor, procedure, 0.3)
    actor.pushed = {1: 0.02}
    feed(actor, procedure, 0.8)
    assert (procedure.step.kind, procedure.step.number) == (Kind.GO, 1)


@pytest.mark.parametrize(("option", "holds"), [((), False), (POINTS, True), ((*POINTS, "parent_tip=0,0,0.12"), False)])
def test_what_turns_in_place_isnt_still(option: tuple[str, ...], holds: bool) -> None:
    actor = Leader(option)
    procedure = Procedure(actor.channel_map.options.plan, Thresholds())
    while procedure.step.kind is not Kind.HOLD:
        feed(actor, procedure, 0.1)
    actor.turning = 0.1  # rad/s; its origin stays where it is
    feed(actor, procedure, 1.2)
    assert (procedure.step.number == 2) == holds


@pytest.mark.slow
@pytest.mark.parametrize("gone", [{"lost": (2,)}, {"blind": (2,)}])
def test_the_last_pose_of_lost_cameras_counts_for_nothing(gone: dict[str, Any]) -> None:
    actor = Leader(**gone)
    procedure = Procedure(Plan(), Thresholds())
    feed(actor, procedure, 20.0)
    assert (procedure.step.kind, procedure.step.number) == (Kind.GO, 2)
    assert procedure.view().missing == "what is measured in the parent isn't seen"
    assert procedure.go_on() == "hold it still for 1 s"
    feed(actor, procedure, 5.0)
    assert procedure.step.number == 2
    actor.lost = actor.blind = ()
    feed(actor, procedure, 60.0)
    assert procedure.done


def test_a_pose_left_out_counts_for_nothing() -> None:
    procedure, actor = Procedure(Plan(count=7), Thresholds()), Leader(("count=7",))
    while procedure.step.number != 3:
        feed(actor, procedure, 0.1)
    assert procedure.skip() == ""
    feed(actor, procedure, 60.0)
    assert procedure.done
    assert procedure.view().states[2] == "left out"
    found = frame_method.FrameMethod.compute(
        object.__new__(frame_method.FrameMethod), actor.channel_map,
        [actor.channel_map.samples(np.concatenate(actor.rows))],
        actor.channel_map.date(actor.rows[0]),
    )  # fmt: skip
    assert found.found.numbers == (1, 2, 4, 5, 6, 7)
    assert procedure.redo(1) == ""
    assert procedure.skip() == "6 poses must remain"
    assert procedure.redo(9) == "the poses are 1 to 7"


def test_the_screen_shows_what_to_do_and_what_is_measured() -> None:
    actor, procedure = Leader(), Procedure(Plan(), Thresholds())
    feed(actor, procedure, 0.6)
    console = Console(file=io.StringIO(), width=110, force_terminal=False)
    console.print(picture("calibrate", procedure.view()))
    shown = console.file.getvalue()  # type: ignore[attr-defined]
    for words in ("Bring both bodies to another pose", "in parent", "in frame", "poses ", "q quit"):
        assert words in shown


def feed(actor: Leader, procedure: Procedure, seconds: float) -> None:
    """Goes on for so long, or until it is done."""
    end = actor._t + 50 * seconds
    while actor._t < end and not procedure.done:
        if procedure.step is not actor.step:
            actor.begin(procedure)
        procedure.feed(actor.channel_map.samples(actor.take()))
