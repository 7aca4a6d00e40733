"""A calibration over the wire: Vicon's twin, the driver, the cut profile as a service of its own, the guide."""

from __future__ import annotations

import json
import subprocess
import time
from pathlib import Path

import pytest
from helpers.background import repeating
from helpers.calibration import PROFILE, Actor
from helpers.run import environment, srl
from helpers.wait import until

from srl.commissioning.calibration.guide import Guide
from srl.commissioning.calibration.ikns.channel_map import channel_map
from srl.commissioning.calibration.ikns.procedure import Plan, Procedure
from srl.commissioning.calibration.ikns.result import compute
from srl.commissioning.calibration.live import Live
from srl.commissioning.calibration.profile_subset import build, subset
from srl.commissioning.calibration.screen import Plain
from srl.commissioning.calibration.sources import Rows, recorded
from srl.commissioning.calibration.target import write_record
from srl.control.ikns.thresholds import Thresholds
from srl.runtime.contracts.wearer import Instruction
from srl.runtime.ipc.control_socket import send_request
from srl.runtime.ipc.header import CYCLE, DEVICE, LINK_CONNECTED, LINK_STALE, Cause, Latch, State
from srl.runtime.ipc.run_folder import running
from srl.runtime.profile import profile
from srl.runtime.service.supervisor import state_dir
from srl.sim.devices.vicon.fake import FakeVicon
from srl.sim.devices.vicon.twin import ViconTwin

PLAN = Plan(static=1.0, exploration=12.0, trial=3.0, settle=0.3, patience=20.0)
FEW = Thresholds(points=8, samples=60)


@pytest.mark.exhaustive
@pytest.mark.slow
def test_a_wearer_before_cameras_is_calibrated_live(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SRL_RUNTIME_DIR", str(tmp_path / "run"))
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    world_of = build(*subset(*profile.parse("worn.yaml", PROFILE), "P07", ("swivel",), FEW, sim=True), sim=True)
    (fake,) = world_of.devices
    world = world_of.world
    assert isinstance(fake, FakeVicon)
    assert world is not None
    assert world.wearer is not None
    wearer, reported = world.wearer, list[Instruction]()
    twin = ViconTwin(fake)
    twin.open()
    start = time.monotonic_ns()

    def turn() -> None:
        if reported:
            wearer.instruct(reported.pop(0))
        now = time.monotonic_ns() - start
        world.advance(now)
        twin.service(now)

    lines: list[str] = []
    try:
        with repeating(turn, 0.002):
            text = PROFILE.replace("tcp://192.168.10.1:801", twin.address)
            made, source = subset(*profile.parse("worn.yaml", text), "P07", ("swivel",), FEW)
            live = Live(
                source, channel_map, made.name, tmp_path / "live.rrd", False, lines.append, instruct=reported.append
            )
            guide = Guide(live, Procedure(("swivel",), FEW, PLAN), Plain(lines.append), lambda: False)
            try:
                guide.run()
            finally:
                live.close()
    finally:
        twin.close()
    assert guide.first is not None
    found = compute(live.channel_map, guide.samples, live.channel_map.date(guide.first))
    assert [str(reason) for reason in found.refusals] == [], lines
    assert (found.found.upper - found.found.lower).min() > 1.0
    where, rows = recorded(tmp_path / "live.rrd", channel_map)
    again = compute(where, [where.samples(rows)], where.date(rows))
    write_record(tmp_path / "a.json", found.record(), replacing=False)
    write_record(tmp_path / "b.json", again.record(), replacing=False)
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()
    assert running() == []


@pytest.mark.slow
def test_a_run_that_doesnt_start_says_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SRL_RUNTIME_DIR", str(tmp_path / "run"))
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    text = PROFILE.replace("tcp://192.168.10.1:801", "tcp://127.0.0.1:9")
    _, source = subset(*profile.parse("worn.yaml", text), "P07", ("swivel",), FEW)
    with pytest.raises(Exception, match="mocap"):
        Live(source, channel_map, "worn", None, False, lambda text: None)
    assert running() == []


def started(folder: Path, monkeypatch: pytest.MonkeyPatch, lines: list[str]) -> Live:
    for name, value in environment(folder).items():
        monkeypatch.setenv(name, value)
    _, source = subset(*profile.parse("worn.yaml", PROFILE), "P07", ("swivel",), FEW, sim=True)
    return Live(source, channel_map, "worn", None, False, lines.append, sim=True)


@pytest.mark.slow
def test_what_somebody_stopped_stays_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lines: list[str] = []
    live = started(tmp_path, monkeypatch, lines)
    rows: list[Rows] = []

    def newest(state: State) -> bool:
        rows.extend(live.take())
        return bool(rows) and int(rows[-1][CYCLE.state]) == state

    try:
        until(lambda: newest(State.ACTIVE))
        before = rows[-1]
        subprocess.run(srl("stop", "worn"), env=environment(tmp_path), check=True, capture_output=True, timeout=60)
        until(lambda: newest(State.STOPPED))
        assert any("latched: person), so nothing counts: `srl reset worn` goes on" in line for line in lines)
        # The calibration's own reset is of what it had seen, and a stop that came since refuses it.
        answer = send_request(live.folder, "reset", since=int(before[CYCLE.wake]))
        assert answer is not None
        assert not answer["ok"]
        stopped = len(rows)
        until(lambda: newest(State.STOPPED) and len(rows) > stopped + 200)
        assert {int(row[CYCLE.state]) for row in rows[stopped:]} == {State.STOPPED}
        subprocess.run(srl("reset", "worn"), env=environment(tmp_path), check=True, capture_output=True, timeout=60)
        until(lambda: newest(State.ACTIVE))
    finally:
        live.close()


@pytest.mark.slow
def test_the_latches_of_the_limb_stand(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    state = state_dir("worn")
    state.mkdir(parents=True)
    text = json.dumps({"latches": ["emergency", "person"]})
    (state / "latches.json").write_text(text)
    lines: list[str] = []
    live = started(tmp_path, monkeypatch, lines)
    try:
        rows = until(lambda: list(live.take()))
        assert {int(row[CYCLE.state]) for row in rows} == {State.STOPPED}
        assert any("latched: person, emergency" in line for line in lines)
        subprocess.run(srl("reset", "worn"), env=environment(tmp_path), check=True, capture_output=True, timeout=60)
        until(lambda: any(int(row[CYCLE.state]) == State.ACTIVE for row in live.take()))
    finally:
        live.close()
    assert (state / "latches.json").read_text() == text  # they are the limb's run's to end


@pytest.mark.parametrize(
    ("state", "cause", "standing", "link", "again"),
    [
        (State.STOPPED, Cause.INTENT_LOSS, Latch.FAULT, LINK_CONNECTED, True),
        (State.STOPPED, Cause.INTENT_LOSS, Latch.FAULT, LINK_CONNECTED | LINK_STALE, False),
        (State.STOPPED, Cause.INTENT_LOSS, Latch.FAULT | Latch.PERSON, LINK_CONNECTED, False),
        (State.STOPPED, Cause.INTENT_LOSS, Latch.FAULT | Latch.EMERGENCY, LINK_CONNECTED, False),
        (State.STOPPED, Cause.REQUEST, Latch.PERSON, LINK_CONNECTED, False),
        (State.STOPPED, Cause.REQUEST, Latch(0), LINK_CONNECTED, False),
        (State.STOPPED, Cause.RESTART, Latch.FAULT, LINK_CONNECTED, False),
        (State.ACTIVE, Cause.NONE, Latch(0), LINK_CONNECTED, False),
    ],
)
def test_only_the_loss_of_a_device_ends_by_itself(
    state: State, cause: Cause, standing: Latch, link: int, again: bool
) -> None:
    actor = Actor()
    row = actor.graph.row
    row.ints[[CYCLE.state, CYCLE.cause, CYCLE.latches]] = state, cause, standing
    row.devices[:, DEVICE.link] = link
    assert actor.channel_map.may_begin_again(row.words) is again
