"""Names of signals as people read them."""

from __future__ import annotations

import pytest

from srl.runtime.ipc.layout import Layout
from srl.runtime.recording.readable import said


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("mapping.skeleton", "skeleton (mapping)"), ("world.arm_tip", "arm tip, as simulated"),
        ("object-mapping.new_goal", "new goal (object-mapping)"), ("left_arm", "left arm"),
        ("left_arm.position", "position (left arm)"),
        ("left_arm.position (simulated)", "position (left arm), simulated"),
        ("Height (of the arm)", "Height (of the arm)"), ("Distance of the_arm", "Distance of the_arm"),
    ],
)  # fmt: skip
def test_a_name_is_said_with_its_owner(name: str, words: str) -> None:
    layout = Layout(devices=["left_arm"])
    for signal in ("mapping.skeleton", "world.arm_tip", "object-mapping.new_goal", "left_arm.position_command"):
        layout.add(signal, "internal", (1,), "1")
    assert said(layout, name) == words
