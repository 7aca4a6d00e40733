"""When the cycle calls its laws, what it does with what they say, and what a law that fails leaves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.toy import SPEED, Bench, Law, _load

from srl.runtime.contracts import registry
from srl.runtime.ipc.header import Cause, State
from srl.runtime.loop.replay import replay


@pytest.mark.parametrize(
    ("word", "cause", "event"),
    [("contact", Cause.CONTACT, "found contact"), ("lost", Cause.INTENT_LOSS, "has lost what it follows")],
)
def test_a_law_that_found_contact_or_lost_what_it_follows_stops_the_limb_until_a_reset(
    tmp_path: Path, word: str, cause: Cause, event: str
) -> None:
    b = Bench(tmp_path)
    law, layout = b.cycle.graph.laws[0].controller, b.cycle.graph.layout

    def script(k: int) -> None:
        b.hand.values["position"][:] = 1.5
        if k == 50:
            setattr(law, word, True)
        if k == 90:
            setattr(law, word, False)
            b.ask("reset")

    b.run(150, script)
    assert b.header("state")[50] in (State.STOPPING, State.STOPPED)
    assert b.header("cause")[50] == cause
    # Contact is the law's own word; what a law has lost is its sensor's.
    assert layout.fault_source(cause, int(b.header("fault_source")[50])) == (law.name if word == "contact" else "hand")
    assert any(event in said for said in b.events)
    assert b.header("state")[89] == State.STOPPED
    assert b.states[-1] == (State.ACTIVE, Cause.NONE)
    assert abs(np.diff(np.array(b.arm.sent)[:, 0])).max() <= SPEED * 0.01 * (1 + 1e-6)


@pytest.mark.parametrize("name", ["input", "output", "applied", "param", "transform"])
def test_a_law_with_arrays_of_its_own_in_the_place_of_the_bound_ones_stops_the_limb(tmp_path: Path, name: str) -> None:
    """It would go on with the values of before, or with what nobody sees."""
    b = Bench(tmp_path)
    law = b.cycle.graph.laws[0].controller

    def script(k: int) -> None:
        b.hand.values["position"][:] = 1.5
        if k == 50:
            setattr(law, name, dict(getattr(law, name)))

    b.run(60, script)
    assert b.header("cause")[50] == Cause.CONTROLLER_ERROR
    assert any("in the place of" in said for said in b.events)


def test_each_time_motion_begins_a_law_is_reset_once_before_its_first_cycle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else it would go on from where it stood before the stop: its filters, its references."""
    b = Bench(tmp_path)
    law, reported = b.cycle.graph.laws[0].controller, ""
    reset, update = law.reset, law.update

    def resets() -> None:
        nonlocal reported
        reported += "r"
        reset()

    def updates(dt: float) -> None:
        nonlocal reported
        reported += "u"
        update(dt)

    monkeypatch.setattr(law, "reset", resets)
    monkeypatch.setattr(law, "update", updates)

    def script(k: int) -> None:
        if k in (50, 100):
            b.ask("stop")
        if k in (80, 130):
            b.ask("reset")

    b.run(150, script)
    motions = "".join("u" if state == State.ACTIVE else " " for state in b.header("state")).split()
    assert len(motions) == 3
    # A cycle's end decides that the limb is active; its laws begin in the next one.
    assert reported == "".join(f"r{motion[1:]}" for motion in motions)


def test_a_law_that_fails_at_its_figures_doesnt_spoil_a_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def metrics(law: Law) -> dict[str, object]:
        raise ArithmeticError("a defect")

    monkeypatch.setattr(Law, "metrics", metrics)
    b = Bench(tmp_path)
    b.run(20, lambda k: None)
    assert b.cycle.metrics() == {}
    assert "a defect" in b.events[-1]


def test_in_a_stop_a_law_weighs_on_until_it_fails_and_again_after_a_reset(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    called: list[tuple[State, float]] = []

    def update_gravity(law: Law, dt: float) -> None:
        called.append((b.cycle.machine.state, dt))
        law.output["q"][:] = len(called) * 1e-3  # what it renews in a stop is in the rows, and replays
        if len(called) == 20:
            raise ValueError("a defect")

    monkeypatch.setattr(Law, "update_gravity", update_gravity)
    b = Bench(tmp_path)

    def script(k: int) -> None:
        if k in (50, 120):
            b.ask("stop")
        if k == 100:
            assert len(called) == 20
            b.ask("reset")

    b.run(150, script)
    assert len(called) > 40
    assert {state for state, _ in called} <= {State.STOPPING, State.STOPPED}
    assert {dt for _, dt in called} == {0.01}
    assert sum("failed in the stop" in said for said in b.events) == 1
    called.clear()
    monkeypatch.setattr(registry, "load", _load)
    assert replay(b.graph.layout, b.rows()[:-1], "toy").identical


def test_in_a_stop_a_law_weighs_what_its_inputs_are_then(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[tuple[float, float]] = []
    monkeypatch.setattr(
        Law, "update_gravity", lambda law, dt: seen.append((law.input["x"][0], b.hand.values["position"][0]))
    )
    b = Bench(tmp_path)

    def script(k: int) -> None:
        b.hand.values["position"][:] = 0.3 * np.sin(0.05 * k)
        if k == 50:
            b.ask("stop")

    b.run(100, script)
    assert len(seen) > 40
    assert all(read == there for read, there in seen)
    assert len({read for read, _ in seen}) > 40
