"""A profile in lockstep for a trial: its order of keys, its end, its signals."""

from __future__ import annotations

import numpy as np
import pytest

from srl.runtime.ipc.header import Cause
from srl.runtime.profile import profile
from srl.studies.simulated import Run, Setup, controllers, largest, merged, parsed, simulate, without_hand
from srl.studies.toolkit.errors import StudyError

TEXT = profile.find("kairos-man")[1]


def test_changes_are_merged_key_by_key_and_keep_the_order_of_a_profiles_keys() -> None:
    assert merged({"a": {"b": 1, "c": 2}, "d": [1]}, {"a": {"b": None, "e": 3}, "d": [2]}) == {
        "a": {"c": 2, "e": 3}, "d": [2],
    }  # fmt: skip
    found = parsed(TEXT, {"devices": {"panel": {"port": "/dev/other"}}}, 7)
    assert list(found["devices"]["panel"]["buttons"]) == ["A", "M", "G", "P"]  # guide-buttons knows them by their place
    assert (found["devices"]["panel"]["port"], found["seed"]) == ("/dev/other", 7)


def test_options_of_one_controller_are_changed_and_the_grippers_left_out() -> None:
    entries = controllers(TEXT, "guide", tank=None)
    assert next(e for e in entries if e["name"] == "guide")["tank"] is None
    assert [e["name"] for e in without_hand(entries)] == ["keys", "tool", "guide", "held", "body"]
    with pytest.raises(StudyError, match="0 called 'nobody'"):
        controllers(TEXT, "nobody")


def test_a_run_says_why_and_when_it_stopped() -> None:
    causes = np.array([0, 0, Cause.DEVICE_FAULT, Cause.DEVICE_FAULT])
    stopped = Run(np.arange(4.0), {}, causes, False)
    assert (stopped.cause, stopped.stopped_at) == ("device fault", 2.0)
    ended = Run(np.arange(4.0), {}, np.array([0, 0, 0, Cause.END]), True)
    assert (ended.cause, ended.stopped_at) == ("", None)


def test_the_greatest_length() -> None:
    assert largest(np.array([[3.0, 4.0, 0.0], [0.0, 0.0, 1.0]])) == 5.0
    assert largest(np.zeros((0, 3))) == 0.0


def test_a_run_ends_with_its_plan_and_is_the_same_each_time() -> None:
    text = """
name: waiting
rate: 100
devices:
  emg: {driver: trigno, port: "tcp://192.168.1.30", channels: {biceps: 1}}
sim:
  world: cell
  ends_with: person
  devices: {emg: {part: person}}
  parts:
    person: {part: person, at: {position: [0, 0, 1]}, plan: [{do: wait, seconds: 0.5}]}
"""
    names = ("world.person_tool", "world.person_progress")
    runs = [simulate(text, Setup("waiting", {}, 5.0), 3, names) for _ in range(2)]
    assert runs[0].ended
    assert 0.5 < runs[0].t[-1] < 1.0
    assert runs[0].value("world.person_progress").shape == (len(runs[0].t), 3)
    np.testing.assert_array_equal(runs[0].value("world.person_tool"), runs[1].value("world.person_tool"))
    late = simulate(text, Setup("waiting", {}, 0.2), 3, names)
    assert not late.ended
    assert len(late.t) == 20
    with pytest.raises(StudyError, match=r"no world\.nothing"):
        simulate(text, Setup("waiting", {}, 0.2), 3, ("world.nothing",))
