"""The fault campaign: what it judges is judged rightly, a broken runtime is caught, and its table reaches the page."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import ROOT
from helpers.run import refused

from srl.drivers.cyberglove.driver import CyberGlove
from srl.runtime.cli import main
from srl.runtime.contracts import registry
from srl.runtime.contracts.signals import Command, Kind, Limits
from srl.runtime.guard import GUARDS
from srl.runtime.guard.base import CommandGuard
from srl.runtime.guard.position import PositionGuard
from srl.runtime.ipc.header import Origin, State
from srl.runtime.ipc.requests import Request, RequestKind
from srl.runtime.loop.cycle import Cycle
from srl.runtime.loop.faults import FaultFinder
from srl.runtime.testing.faults import FAULTS
from srl.studies.faults import live_run, process_trial, study, wire_trial
from srl.studies.faults.device_faults import JUMPS, KINDS, LATE
from srl.studies.faults.device_trial import trial
from srl.studies.faults.process_faults import FAULTS as PROCESS
from srl.studies.faults.steps import Sent, shares
from srl.studies.result import Result
from srl.studies.tasks.task import Row, TrialTask, flat


def run(profile: str, device: str, fault: str, seed: int = 1) -> dict[str, Any]:
    return dict(flat(trial("", {"profile": profile, "choices": [], "device": device, "fault": fault}, seed)))


# What is expected holds, and each expectation can fail


@pytest.mark.parametrize(
    ("device", "fault", "cause"),
    [
        ("glove", "silent", "intent_loss"),
        ("glove", "clock-back", "intent_loss"),
        ("glove", "clock-forward", "intent_loss"),
        ("glove", "garbage", "intent_loss"),
        ("glove", "out-of-range", "intent_loss"),
        ("glove", "wrong-sample", "none"),
        ("finger", "misreporting", "device_fault"),
        ("finger", "disconnected", "device_loss"),
        ("finger", "refusing", "device_fault"),
        ("finger", "deaf", "none"),
    ],
)
def test_the_finger_does_what_is_expected(device: str, fault: str, cause: str) -> None:
    found = run("sixth-finger", device, fault)
    assert found["wrong"] == ""
    assert found["cause"] == cause
    assert fault == "misreporting" or 0.0 < found["step"] <= 1.0
    assert found["recorded"]


@pytest.mark.slow
def test_a_jogged_arm_that_falls_silent_doesnt_go_on_when_it_heals() -> None:
    assert run("panda-jog", "arm", "silent")["wrong"] == ""


def blind(patch: pytest.MonkeyPatch) -> None:
    """Nobody looks for faults."""
    patch.setattr(FaultFinder, "find", lambda self, now: None)


def without_guard(patch: pytest.MonkeyPatch) -> None:
    """What is asked is applied."""

    def step(self: CommandGuard, desired: Any, rate: Any, dt: float) -> None:
        self._begin()
        self.applied[...] = desired

    patch.setattr(PositionGuard, "step", step)


def by_itself(patch: pytest.MonkeyPatch) -> None:
    """A stop is over with its cause."""
    check = Cycle.check

    def eager(self: Cycle, missed: int, request: Any = None, *rest: Any) -> Any:
        if self.machine.state is State.STOPPED and request is None:
            request = Request(0, RequestKind.RESET, 0, 0, np.empty(0), Origin.LOCAL)
        return check(self, missed, request, *rest)

    patch.setattr(Cycle, "check", eager)


def late(patch: pytest.MonkeyPatch) -> None:
    """Samples may be three times as old."""
    ages = FaultFinder._ages
    patch.setattr(FaultFinder, "_ages", lambda self: [3 * age for age in ages(self)])


@pytest.mark.parametrize(
    ("broken", "profile", "device", "fault", "words"),
    [
        (blind, "sixth-finger", "glove", "silent", "went on, and intent_loss is due"),
        (late, "sixth-finger", "glove", "silent", "the stop begins after 0.3"),
        (without_guard, "finger-jog", "client", "garbage", "of what the limits allow was sent"),
        (by_itself, "sixth-finger", "glove", "disconnected", "began again by itself"),
    ],
    ids=["no-watchdog", "slow-watchdog", "no-guard", "no-latch"],
)
def test_a_broken_runtime_is_caught(
    monkeypatch: pytest.MonkeyPatch,
    broken: Callable[[pytest.MonkeyPatch], None],
    profile: str,
    device: str,
    fault: str,
    words: str,
) -> None:
    broken(monkeypatch)
    assert words in run(profile, device, fault)["wrong"]


# The steps


def sent(
    values: list[float],
    left: list[int],
    started: list[int] | None = None,
    measured: Any = None,
    late: float = 0.0,
    led: bool = False,
) -> Sent:
    """`late`: s, of the last one; `led`: the device was commanded all the time."""
    count = len(values)
    time = np.arange(count) * 0.01
    time[-1] += late
    return Sent(
        np.array(values)[:, None], np.isin(np.arange(count), left), np.array(started or [0] * count),
        None if measured is None else np.array(measured)[:, None], np.full(count, led), time, 0.01,
    )  # fmt: skip


def guard(kind: Kind) -> CommandGuard:
    command = Command(name="c", shape=(1,), unit="rad", kind=kind, period=0.02)
    one = np.ones(1)
    limits = Limits(velocity=one, acceleration=2 * one, effort=5 * one, effort_rate=10 * one, inertia=one)
    return GUARDS[kind]("guard.x.c", command, limits, 0.01)


def most(kind: Kind, given: Sent) -> float:
    return max(share for _, share, _ in shares(guard(kind), given))


def test_a_step_counts_by_the_time_since_the_last_one_left() -> None:
    assert most(Kind.POSITION, sent([0.0, 0.01, 0.02], [0, 1, 2])) == pytest.approx(1.0, abs=1e-5)
    assert most(Kind.POSITION, sent([0.0, 0.0, 0.02], [0, 2])) == pytest.approx(1.0, abs=1e-5)
    assert most(Kind.POSITION, sent([0.0, 0.015], [0, 1], late=0.005)) == pytest.approx(1.0, abs=1e-5)
    assert most(Kind.POSITION, sent([0.0] * 50 + [0.5], [0, 50])) > 8  # a stall may not be made up for
    assert most(Kind.VELOCITY, sent([0.0, 0.02, 0.06], [0, 1, 2])) == pytest.approx(2.0, abs=1e-5)
    assert most(Kind.VELOCITY, sent([1.2], [0])) > 1.19
    assert most(Kind.TORQUE, sent([0.0, 0.2], [0, 1])) == pytest.approx(2.0, abs=1e-5)
    assert most(Kind.TORQUE, sent([6.0], [0])) > 1.19


def test_after_a_reset_a_position_begins_where_it_is_measured() -> None:
    values, started, there = [0.0, 0.3, 0.3], [1, 2, 2], [0.0, 0.3, 0.3]
    assert most(Kind.POSITION, sent(values, [0, 1, 2], started, there)) < 1e-5
    assert most(Kind.POSITION, sent(values, [0, 1, 2], started, [0.0, 0.0, 0.0])) > 29
    assert most(Kind.POSITION, sent(values, [0, 1, 2], [1, 1, 1], there)) > 29


def test_what_is_no_number_is_beyond_every_limit() -> None:
    assert most(Kind.POSITION, sent([0.0, float("nan")], [0, 1])) == float("inf")


# The catalogue


def test_every_fault_of_the_lab_is_in_the_campaign() -> None:
    of_lab = {{**dict.fromkeys(LATE, "late"), **dict.fromkeys(JUMPS, "clock-jump")}.get(kind, kind) for kind in KINDS}
    assert of_lab == set(FAULTS)


@pytest.mark.slow
def test_the_campaign_has_every_profile_device_and_fault() -> None:
    tasks = study.device_tasks()
    assert len(tasks) + len(study.process_tasks()) >= 2000
    given = [task.parameters for task in tasks]
    assert {g["profile"] for g in given} == {file.stem for file in (ROOT / "profiles").glob("*.yaml")}
    assert {g["fault"] for g in given} == set(KINDS)
    assert {(g["device"], g["fault"]) for g in given if g["profile"] == "sixth-finger"} >= {
        ("glove", "silent"), ("finger", "deaf"), ("finger", "refusing"),
    }  # fmt: skip
    assert {t.parameters["fault"] for t in study.process_tasks() if t.profile == study.MAIN} == set(PROCESS)


# Wires


@pytest.mark.parametrize(
    ("kind", "fault", "entered"),
    [("cyberglove", "hang", "stale"), ("dynamixel", "cut", "device_loss"), ("dynamixel", "foreign", "stale"),
     ("dynamixel", "other-device", "refused"), ("can-ft", "hang", "stale")],
)  # fmt: skip
def test_a_driver_knows_that_its_wire_fails(kind: str, fault: str, entered: str) -> None:
    found = wire_trial.trial("", {"kind": kind, "fault": fault, "other": "cyberglove"}, 1)
    assert (found["wrong"], found["entered"]) == ("", entered)


def test_a_driver_that_makes_a_sample_of_nothing_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    read = CyberGlove.read

    def eager(self: CyberGlove, now: int) -> None:
        read(self, now)
        self.health.stamp = now

    monkeypatch.setattr(CyberGlove, "read", eager)
    found = wire_trial.trial("", {"kind": "cyberglove", "fault": "hang", "other": ""}, 1)
    assert "its sample is stale never" in str(found["wrong"])


# Runs with real processes


def live(fault: str) -> dict[str, Any]:
    return dict(flat(process_trial.trial("", {"profile": "sixth-finger", "choices": [], "fault": fault}, 1)))


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["loop-killed", "no-shared-memory"])
def test_a_real_run_does_what_is_expected(fault: str) -> None:
    found = live(fault)
    assert found["wrong"] == ""
    assert found["recorded"]


PATIENT = (
    "import srl.runtime.service.supervisor as s; s.HUNG = 3_000_000_000; from srl.runtime.cli import main; import sys; "
)
"""A supervisor that waits for three seconds before it takes a loop for hung."""


@pytest.mark.slow
def test_a_supervisor_that_waits_too_long_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_run, "SRL", [live_run.SRL[0], "-c", PATIENT + "sys.exit(main(sys.argv[1:]))"])
    assert "0.5 s is due" in live("loop-stopped")["wrong"]


# The page


def row(device: str, fault: str, wrong: str = "", **more: Any) -> Row:
    given = {"profile": "sixth-finger", "choices": [], "device": device, "fault": fault}
    values = {
        "entered": "stopped", "cause": "intent_loss", "fault_source": device, "safe": 0.13, "due": 0.3, "step": 0.9,
        "where": "", "recorded": True, "cycles": 100, "wrong": wrong,
    } | more  # fmt: skip
    return Row("k", TrialTask("faults", "faults-device", 1, given, "sixth-finger"), "", "done", values, "", 0.1, "", {})


def test_the_page_has_a_line_a_fault_and_names_what_was_not_as_expected() -> None:
    made = study.page([row("glove", "silent"), row("glove", "silent", "it went on"), row("finger", "deaf")], 4)
    assert f"{study.PART} 3 of 4 trials" in made
    assert "3 trials: 3 of devices" in made
    assert (
        "| `silent`: connected, and nothing comes any more | 2 (1) | intent_loss 2 | 130 (130) | 0.90 | all | 1 |"
        in made
    )
    assert "- `sixth-finger glove`, silent: it went on" in made


def small(folder: Path, quick: bool) -> Result:
    return Result("faults", True, [1], page="| new |\n")


def test_the_tables_go_between_the_marks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    load = registry.load
    monkeypatch.setattr(registry, "load", lambda group, *rest: small if group == "studies" else load(group, *rest))
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- faults: made by a command -->\n| old |\n<!-- end -->\nafter\n")
    arguments = ["study", "faults", "--out", str(tmp_path), "--write", str(page)]
    assert main(arguments) == 0
    assert page.read_text() == "before\n<!-- faults: made by a command -->\n| new |\n<!-- end -->\nafter\n"
    page.write_text("nothing\n")
    assert "it has no room for this study" in refused(*arguments)
    assert "Leave out --sweep" in refused(*arguments, "--sweep")
    assert "Name a page that is there" in refused(*arguments[:-1], str(tmp_path / "none.md"))
