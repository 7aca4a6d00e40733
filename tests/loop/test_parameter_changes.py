"""What changes a parameter is an event: which, from what to what, and who."""

from __future__ import annotations

import re
import time
from pathlib import Path

import numpy as np
import pytest
from helpers.run import Running, call
from helpers.wait import until

from srl.runtime.ipc.events import EventReader
from srl.runtime.ipc.header import Origin
from srl.runtime.ipc.requests import Request, RequestKind, RequestReader, RequestWriter
from srl.runtime.loop.monitors import REPORT_EVERY, ParameterChanges

KNOWN = [{"name": "body.gain", "unit": "N/m"}, {"name": "body.share", "unit": "1"}]


def request(target: int, value: float, sender: str = "", origin: Origin = Origin.BUS) -> Request:
    return Request(1, RequestKind.PARAMETER, target, 0, np.array([value]), origin, sender)


def test_a_change_is_reported_at_once_with_who_made_it() -> None:
    changes = ParameterChanges(KNOWN)
    changes.add(request(0, 92.0, "the panel"), 10.0)
    assert changes.due(5) == ["parameter 'body.gain': 10 -> 92 N/m, changed by 'the panel' (bus)"]
    changes.add(request(1, 0.5, origin=Origin.ENGINEER), 0.25)
    assert changes.due(6) == ["parameter 'body.share': 0.25 -> 0.5, changed by a client (engineer)"]
    assert changes.due(7) == []


def test_many_changes_of_one_are_reported_once_a_second_from_the_first_to_the_last() -> None:
    changes = ParameterChanges(KNOWN)
    changes.add(request(0, 1.0), 0.0)
    changes.due(0)
    for step in range(1, 10):
        changes.add(request(0, 1.0 + step, "x"), float(step))
        assert changes.due(step) == []
    assert changes.due(REPORT_EVERY) == ["parameter 'body.gain': 1 -> 10 N/m, changed by 'x' (bus)"]


@pytest.mark.parametrize(
    ("given", "read"), [("the panel", "the panel"), ("", ""), ("é" * 40, "é" * 16), ("a\x1b[2Jb\n", "a[2Jb")]
)
def test_a_senders_name_goes_through_the_ring_without_what_is_not_printed(
    tmp_path: Path, given: str, read: str
) -> None:
    RequestWriter.create(tmp_path / "ring")
    writer, reader = RequestWriter(tmp_path / "ring"), RequestReader(tmp_path / "ring")
    writer.send(RequestKind.PARAMETER, time.monotonic_ns(), 3, np.array([2.0]), Origin.BUS, given)
    writer.send(RequestKind.STOP, time.monotonic_ns())
    found, stop = reader.take()
    assert (found.sender, found.values.tolist(), found.target) == (read, [2.0], 3)
    assert stop.sender == ""


@pytest.mark.slow
def test_a_change_by_a_command_is_in_the_events_and_on_the_terminal(tmp_path: Path) -> None:
    with Running(tmp_path, "sixth-finger", "--sim", "--confirm") as run:
        run.started()
        run.until(run.run_folder.bus_socket.exists, "the bus")
        done = call(tmp_path, "set", "sixth-finger", "mapping.drift_pull", "1.5")
        before = re.search(r"([\d.]+) \S* ?->", done.stdout)
        assert before is not None, done.stdout
        events = EventReader(run.run_folder.events)
        found: list[str] = []
        until(lambda: found.extend(e.text for e in events.take()) or any("drift_pull" in text for text in found))
        events.close()
        (text,) = [text for text in found if "drift_pull" in text]
        wanted = f"parameter 'mapping.drift_pull': {before[1]} -> 1.5"
        assert text.startswith(wanted)
        assert text.endswith("changed by 'srl set' (bus)")
        run.process.terminate()
        assert wanted in run.process.communicate(timeout=60)[1]
