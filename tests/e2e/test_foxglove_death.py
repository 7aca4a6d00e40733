"""The process that serves Foxglove's app is killed in a run: the loop goes on, and the recording has every row."""

from __future__ import annotations

import asyncio
import os
import re
import signal
from pathlib import Path

import pytest
from helpers.foxglove import viewing
from helpers.run import Running
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from srl.runtime.recording.reader import read


@pytest.mark.slow
def test_the_limb_is_seen_live_and_a_killed_server_costs_the_run_nothing(tmp_path: Path) -> None:
    async def look(address: str) -> tuple[bytes, str]:
        async with viewing(address) as viewer:
            await viewer.subscribe("/scene", "/tf", "/joint_states", "/robot_description")
            await viewer.until("/scene", "/tf", "/joint_states", "/robot_description")
            return viewer.data["/scene"][-1][1], viewer.channels["/scene"]["schema"]

    with Running(tmp_path, "sixth-finger", "--sim", "--duration", "20", "--record", "x.rrd", "--foxglove") as run:
        run.started()
        assert run.process.stderr is not None
        address = next(found[1] for line in run.process.stderr if (found := re.match(r"foxglove: (ws://\S+)", line)))
        payload, schema = asyncio.run(look(address))
        old = run.children()["foxglove"]
        os.kill(old, signal.SIGKILL)
        run.until(lambda: run.children().get("foxglove", old) != old, "the server again")
        mark = run.reader.head
        run.until(lambda: run.reader.head > mark + 100, "another second of rows")
        found = run.finish()
    assert found["restarts"] == {"bus": 0, "recorder": 0, "foxglove": 1}
    assert "foxglove ended (killed by SIGKILL); it is started again, the loop goes on" in run.stderr
    recording = read(tmp_path / "x.rrd")
    assert recording.missing == []
    assert len(recording.rows) == found["cycles"]
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(schema, "visualization_msgs/msg/MarkerArray"))
    markers = store.deserialize_cdr(payload, "visualization_msgs/msg/MarkerArray").markers
    assert {"hand.skeleton", "mapping.sphere"} <= {marker.ns for marker in markers}
