"""Events in words for the person at the panel."""

from __future__ import annotations

import time

import pytest

from srl.runtime.ipc.events import Event, Level
from srl.runtime.web.operator.event_words import described


@pytest.mark.parametrize(
    ("text", "words", "remedy"),
    [
        (
            "stopped (intent_loss suit)",
            "Stopped: loss of intent: a sensor the motion follows is stale or gone: suit",
            "See that suit gives new data again",
        ),
        ("stopping (request)", "Stopping: stopped on request", "then reset"),
        ("active", "Active", ""),
        ("homing (none)", "Homing (none)", ""),
        ("'arm.command' is held: a/b is 0.01 m apart", "'arm.command' is held: a/b is 0.01 m apart", "Make room"),
        ("'arm.command' is held no longer", "'arm.command' is held no longer", ""),
        ("refused: reset (bus): refused_latch", "Refused: reset (bus): refused_latch", "latches"),
        ("parameter 'a.b': 1 -> 2, changed by 'x' (bus)", "Parameter 'a.b': 1 -> 2, changed by 'x' (bus)", ""),
    ],
)
def test_what_happened_is_said_with_what_to_do(text: str, words: str, remedy: str) -> None:
    found = described(4, Event(time.monotonic_ns(), Level.WARNING, 9, text))
    assert found["words"] == words
    assert remedy in found["remedy"]
    assert bool(found["remedy"]) == bool(remedy)
    assert (found["number"], found["level"]) == (4, "warning")


def test_the_time_is_that_of_the_event_on_this_machines_clock() -> None:
    found = described(1, Event(time.monotonic_ns() - 3600 * 10**9, Level.INFO, 0, "x"))
    hour_ago = time.localtime(time.time() - 3600)
    assert found["at"][:2] == time.strftime("%H", hour_ago) or found["at"][3:5] in ("00", "59")
