"""docs/safety.md says what the code does: causes, reactions, who ends which stop, times, promises and their tests."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from srl.runtime.bus import requests
from srl.runtime.contracts import registry
from srl.runtime.ipc import control_socket, latches
from srl.runtime.ipc.header import CLIENTS, Cause, Latch, Origin, State
from srl.runtime.ipc.requests import Answer, RequestKind
from srl.runtime.loop import device, monitors, process, realtime
from srl.runtime.loop.machine import Machine
from srl.runtime.profile import profile
from srl.runtime.service import actuators, supervisor
from srl.studies.faults import wire_trial
from srl.studies.faults.device_faults import KINDS
from srl.studies.faults.process_faults import FAULTS as PROCESS
from srl.studies.faults.study import OF_CLIENT, PART, TITLES

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"


def test_the_safety_page_knows_every_cause_that_stops() -> None:
    text = (DOCS / "safety.md").read_text()
    causes = {c.name.lower() for c in Cause} - {"none", "end", "supervisor_loss"}
    table = set(re.findall(r"^\| `([a-z_]+)` \| ", text, re.MULTILINE))
    assert causes <= table


def test_the_safety_pages_defaults_are_the_machines() -> None:
    """Each fault of the table, put to a machine with default faults that is under way."""
    rows = re.findall(
        r"^\| `([a-z_]+)` \| [^|]* \| `faults\.[a-z-]+` \| `([a-z]+)` \|",
        (DOCS / "safety.md").read_text(),
        re.M,
    )
    assert len(rows) == 8
    for cause, reaction in rows:
        machine = Machine(profile.Faults(), (), automatic=True)
        machine.start_if_ready(None)
        machine.settle(at_rest=True)
        assert machine.state is State.ACTIVE
        machine.request(RequestKind.FAULT, Origin.SERVICE, int(Cause[cause.upper()]), None)
        assert (machine.state is State.ACTIVE) == (reaction == "ignore"), cause
        assert machine.override is None


def test_the_safety_page_says_who_may_end_which_stop_as_the_code_does() -> None:
    """Write it anew: replace what stands between the two comments by `python -m srl.runtime.ipc.latches`."""
    text = (DOCS / "safety.md").read_text()
    (written,) = re.findall(r"<!-- latches: [^\n]* -->\n(.*?)\n<!-- end -->", text, re.DOTALL)
    assert written == latches.table()


def test_each_promise_of_safety_has_tests_that_are_there() -> None:
    text = (DOCS / "safety.md").read_text()
    (table,) = re.findall(r"^\| hazard \| promised \| tests \|\n\|.*\n((?:\|.*\n)+)", text, re.MULTILINE)
    for line in table.splitlines():
        named = re.findall(r"`(tests/\S+\.py)::(\w+)`", line)
        assert named, line
        for file, test in named:
            assert re.search(rf"^def {test}\(", (ROOT / file).read_text(), re.MULTILINE), f"{file}::{test}"


def test_safety_has_room_for_the_fault_campaign_and_a_line_for_each_fault() -> None:
    """Write it anew by `srl study faults --write docs/safety.md`."""
    text = (DOCS / "safety.md").read_text()
    (written,) = re.findall(r"<!-- faults: [^\n]* -->\n(.*?)<!-- end -->", text, re.DOTALL)
    words = [f"| `{kind}`: {what} |" for kind, what in (KINDS | wire_trial.KINDS).items()]
    words += [f"| {f.what} |" for f in PROCESS.values()]
    if PART not in written:
        assert [each for each in words if each not in written] == []
    lines = re.findall(r"^\| .*? \|", written, re.MULTILINE)
    known = {*words, *(f"| {text} |" for text in OF_CLIENT.values()), *(f"| {title} |" for title in TITLES.values())}
    assert lines
    assert set(lines) <= known | {"| --- |"}


def test_the_safety_pages_times_and_counts_are_the_codes() -> None:
    text = (DOCS / "safety.md").read_text()
    overrun = profile.Faults().overrun
    ages = {name: registry.load("drivers", name, "").max_age for name in ("cyberglove", "firmata", "panda")}
    lives = (control_socket.LIFETIME * 1e-9, requests.TIMEOUT * 1e-9)
    promised: dict[str, tuple[float, ...]] = {
        r"is stale after `max_age` \((\S+) s\)": (ages["cyberglove"],),
        r"board stops answering \| It is stale after (\S+) s": (ages["firmata"],),
        r"arm is silent \| It is stale after (\S+) ms": (ages["panda"] * 1e3,),
        r"at a hang after (\d+) ms and two periods": (supervisor.HUNG * 1e-6,),
        r"As above, after (\d+) ms plus two periods": (supervisor.HUNG * 1e-6,),
        r"as they can: (\d+) s\.": (supervisor.HUNG_UNPACED * 1e-9,),
        r"as in a calibration: (\d+) s\.\)": (supervisor.HUNG_STILL * 1e-9,),
        r"late by more than (\d+) ms, .* one check more, (\d+) ms": (supervisor.HELD_UP * 1e-6, supervisor.POLL * 1e3),
        r"kills the loop after (\d+) ms plus two periods": (realtime.STUCK * 1e-6,),
        r"tries for (\S+) s, twice": (actuators.TIMEOUT,),
        r"open the glove again every (\S+) s": (device.RETRY,),
        r"the ring holds about (\d+) s of rows": (process.KEPT,),
        r"released for (\d+) ms or more": (monitors.RELEASED * 1e-6,),
        r"limited to (\d+) at once and (\d+) a second": (monitors.BURST, 1e9 / monitors.REFILL),
        r"expire after (\d+) s \(from the bus: (\d+) s\)": lives,
        r"(\d+) periods missed within (\d+) s\. Up to (\d+)": (overrun.stop, overrun.window, overrun.tolerate),
    }
    for pattern, values in promised.items():
        found = re.findall(pattern, text)
        assert found, pattern
        for each in found:
            numbers = (each,) if isinstance(each, str) else each
            assert tuple(map(float, numbers)) == pytest.approx(values), pattern


@pytest.mark.parametrize("latch", latches.ALL)
@pytest.mark.parametrize("origin", list(Origin)[1:])
def test_the_machine_ends_the_stops_that_the_safety_page_says(latch: Latch, origin: Origin) -> None:
    (row,) = (line for line in latches.table().splitlines() if f"| `{latches.names(latch)[0]}` |" in line)
    column = Origin.BUS if origin in CLIENTS else origin  # a role in the network is a client like any other
    output = row.split(" | ")[1 + column].strip("| ")
    for granted in (latches.NONE, latches.GRANTED, latches.GRANTABLE):
        machine = Machine(profile.Faults(), (), automatic=True, latched=latch, granted=granted)
        done = machine.request(RequestKind.RESET, origin, 0, None) is Answer.DONE
        expected = output == "yes" or (output != "no" and bool(latch & granted))
        assert done == expected, (output, granted)
