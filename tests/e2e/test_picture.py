"""The profile `human-srl` from the run to its pictures: what a viewer, the page and the paper draw of its recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.run import call

from srl.runtime.ipc.header import State
from srl.runtime.recording.reader import read
from srl.runtime.recording.shapes import UNKNOWN, distance_colors
from srl.runtime.web.panel.picture import View


@pytest.mark.exhaustive
@pytest.mark.slow
def test_a_recording_of_human_srl_has_its_picture(tmp_path: Path) -> None:
    file, png = tmp_path / "run.rrd", tmp_path / "run.png"
    call(tmp_path, "run", "human-srl", "--sim", "--fast", "--duration", "4", "--record", str(file))
    recording = read(file)
    layout = recording.layout
    active = np.flatnonzero(recording.int("state") == State.ACTIVE)
    view = View(layout)
    things = {thing["name"]: thing for thing in view.scene["things"]}
    skeleton, envelope = things["skeleton.nodes"], things["collision.envelope"]
    assert sum(len(link) - 1 for link in skeleton["links"]) == 89
    assert sorted(map(skeleton["groups"].count, set(skeleton["groups"]))) == [9, 9, 72]
    assert len(set(skeleton["colors"])) == 3
    frame = view.frame(recording.rows[active[-2]], [10.0, 1.0])
    drawn = dict(zip(things, frame["things"], strict=True))
    nodes = np.array(drawn["skeleton.nodes"]).reshape(90, 3)
    names = list(skeleton["labels"])
    assert nodes[names.index("Head"), 2] > nodes[names.index("Hips"), 2] + 0.4  # z is up
    truth = np.array(drawn["world.wearer_position"]).reshape(-1, 3)
    body = [names.index(name) for name in things["world.wearer_position"]["labels"]]
    assert np.linalg.norm(truth - nodes[body], axis=1).max() < 0.1  # one place, but for the suit's delay
    capsules = np.array(drawn["collision.envelope"]).reshape(-1, 10)
    own = recording.value("collision.envelope")[active[-2]]
    assert len(capsules) == len(envelope["labels"]) == len(own)
    assert capsules[:, 7:].tolist() == distance_colors(own[:, 7]).tolist()
    assert [tuple(c) for c in capsules[np.isnan(own[:, 7]), 7:].tolist()] == [UNKNOWN]  # the base's link
    assert np.nanmin(own[:, 7]) == recording.value("collision.least")[active[-2], 0]
    titles = [plot["title"] for plot in view.scene["plots"]]
    assert titles[0] == "Distance of the arm from the body"
    assert titles[-2:] == ["arm.position", "Loop"]
    call(tmp_path, "export", str(file), "--stills", str(png))
    assert png.read_bytes().startswith(b"\x89PNG")
