"""What is taken by name in a running loop: outputs, what is read back, feedback; the same bits in a replay."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.toy import JOINTS, Bench, Law, Toy, ToyConfig, _load

from srl.runtime.contracts import registry
from srl.runtime.contracts.controller import ControllerConfig
from srl.runtime.contracts.errors import RecordingError
from srl.runtime.loop.replay import replay

TURNED = JOINTS[::-1]


class TurnedLaw(Law):
    """Copies; it knows the joints in another order than the devices, and starts where they are."""

    def __init__(self, name: str, config: ControllerConfig) -> None:
        super().__init__(name, config)
        self.inputs = tuple(replace(s, labels=TURNED) for s in self.inputs)
        self.outputs = tuple(replace(s, labels=TURNED) for s in self.outputs)
        self.began: list[float] = []

    def reset(self) -> None:
        self.began = self.applied["q"].tolist()


class TurnedArm(Toy):
    """Its position comes in another order than its command."""

    def __init__(self, name: str, config: ToyConfig) -> None:
        super().__init__(name, config)
        if config.part == "arm":
            self.states = tuple(replace(s, labels=TURNED) for s in self.states)
            self.values["position"][:] = 0.2, 0.1  # elbow, shoulder

    def write(self, now: int) -> None:
        super().write(now)
        self.values["position"][:] = self.sent[-1][::-1]


@pytest.fixture
def turned(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("helpers.toy.Law", TurnedLaw)
    monkeypatch.setattr("helpers.toy.Toy", TurnedArm)
    monkeypatch.setattr(registry, "load", _load)


@pytest.mark.usefixtures("turned")
def test_each_joint_follows_its_own_name_and_a_replay_finds_no_difference(tmp_path: Path) -> None:
    b = Bench(tmp_path)

    def move(k: int) -> None:
        b.hand.values["position"][:] = 0.5 * np.sin(k / 40), 1.0  # shoulder, elbow

    b.run(300, move)
    rows = b.rows()[:-1]
    layout = b.graph.layout
    asked, applied, hand = (
        layout.value(rows, name) for name in ("arm.command", "arm.command.applied", "hand.position")
    )
    started = int(np.argmax(asked.any(axis=1)))
    np.testing.assert_array_equal(asked[started:], hand[started:])
    np.testing.assert_allclose(applied[-1], hand[-1], atol=0.05)
    # It began where the arm was measured, and each joint went its own way from there.
    (law,) = b.graph.controllers
    assert isinstance(law, TurnedLaw)
    assert law.began == [0.2, 0.1]
    np.testing.assert_allclose(applied[started], [0.1, 0.2], atol=0.02)
    assert replay(layout, rows, "toy").identical


def test_a_recording_in_another_order_of_joints_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "load", _load)
    b = Bench(tmp_path)
    b.run(10, lambda k: None)
    monkeypatch.setattr("helpers.toy.Toy", TurnedArm)
    with pytest.raises(RecordingError, match=r"'arm.position' was recorded as .*Use srl-runtime"):
        replay(b.graph.layout, b.rows()[:-1], "toy")


@pytest.mark.usefixtures("turned")
def test_a_recording_of_a_profile_that_went_by_places_is_refused_with_words(tmp_path: Path) -> None:
    b = Bench(tmp_path)
    b.run(10, lambda k: None)
    layout = b.graph.layout
    layout.meta["profile"] = layout.meta["profile"].replace("element: first", "index: 0")
    with pytest.raises(RecordingError, match=r"emergency.0: `index: 0` is a place.*Use srl-runtime"):
        replay(layout, b.rows()[:-1], "toy")


def test_what_isnt_installed_is_named_in_place_of_another_version(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    load = registry.load
    monkeypatch.setattr(registry, "load", _load)
    b = Bench(tmp_path)
    b.run(10, lambda k: None)
    monkeypatch.setattr(registry, "load", load)  # which has no toy
    with pytest.raises(RecordingError, match=r"no driver is called 'toy'\. Install the package") as caught:
        replay(b.graph.layout, b.rows()[:-1], "toy")
    assert "srl-runtime" not in str(caught.value)
