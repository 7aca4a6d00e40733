"""A device on another machine: against the twin of its runtime, and senders that misbehave."""

from __future__ import annotations

import os
import signal
import time
from typing import Any

import numpy as np
import pytest
from helpers.zenoh import Served, Still, bound, cycles, lost, reopened
from pydantic import ValidationError

from srl.drivers.zenoh import Zenoh, ZenohConfig, driver
from srl.runtime.contracts.errors import DeviceError
from srl.runtime.messages import messages
from srl.sim.devices.zenoh.fake import FakeZenoh, FakeZenohOptions
from srl.sim.devices.zenoh.twin import ZenohTwin

KEY = "srl/other/state/glove/position"
GLOVE = {"key": KEY, "shape": [3], "unit": "rad"}
TOPIC = {"key": "robot/imu", "shape": [7], "unit": "m", "type": messages.POSE}


def twin_of(signals: dict[str, Any], **options: Any) -> ZenohTwin:
    fake = FakeZenoh(
        "remote", ZenohConfig(port="tcp://127.0.0.1:1", signals=signals), Still(), FakeZenohOptions(**options)
    )
    bound(fake)
    return ZenohTwin(fake)


def device(address: str, signals: dict[str, Any], **options: Any) -> Zenoh:
    return bound(Zenoh("remote", ZenohConfig(port=address, signals=signals, **options)))  # type: ignore[return-value]


def test_signals_of_a_runtime_and_of_a_bridge() -> None:
    signals = {"position": GLOVE | {"labels": ["a", "b", "c"]}, "pose": TOPIC}
    twin = twin_of(signals)
    with Served(twin.fake.world, twin):
        remote = device(twin.address, signals)
        remote.open()
        cycles(remote, lambda: remote.health.frames > 50, "samples")
        values = np.concatenate([remote.state_arrays["position"], remote.state_arrays["pose"]])
        assert np.abs(values).max() <= 0.1
        assert np.abs(values).max() > 0.0
        age = time.monotonic_ns() - remote.health.stamp
        assert 0 <= age < 10**9
        assert (remote.health.errors, remote.health.message) == (0, "")
        remote.close()
        remote.close()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("wanted", "output"),
    [
        ({"shape": [2]}, r"the shape \[3\]"),
        ({"unit": "deg"}, "unit 'rad'"),
        ({"labels": ["a", "b", "x"]}, "labels"),
        ({"frame": "lab"}, "frame"),
        ({"type": messages.POSE}, "JointState"),
        ({"key": "srl/other/state/glove/positio"}, f"Did you mean '{KEY}'"),
        ({"key": "srl/nobody/state/glove/position"}, "no runtime 'nobody'"),
        ({"key": "robot/nothing"}, "nothing came"),
    ],
)
def test_another_signal_is_refused_with_words(
    wanted: dict[str, Any], output: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(driver, "FIRST", 0.8)
    twin = twin_of({"position": GLOVE})
    with Served(twin.fake.world, twin):
        remote = device(twin.address, {"position": GLOVE | wanted})
        with pytest.raises(DeviceError, match=output):
            remote.open()
        assert not remote.health.connected


def test_a_message_of_another_size_is_refused() -> None:
    twin = twin_of({"pose": TOPIC | {"shape": [6], "type": messages.WRENCH}})
    with Served(twin.fake.world, twin):
        remote = device(twin.address, {"pose": TOPIC | {"shape": [5], "type": messages.WRENCH}})
        with pytest.raises(DeviceError, match="6 values, the signal 5"):
            remote.open()


@pytest.mark.slow
def test_a_runtime_that_ends_is_lost_at_once() -> None:
    signals = {"position": GLOVE}
    twin = twin_of(signals)
    with Served(twin.fake.world, twin) as served:
        remote = device(twin.address, signals, silence=10.0)
        remote.open()
        served.do(twin.close)
        output = lost(remote, timeout=5.0)
        assert "has gone" in output or "closed" in output
        with pytest.raises(DeviceError, match="no connection"):
            remote.open()
        served.do(twin.open)
        reopened(remote)
        assert remote.health.reconnects == 1


@pytest.mark.slow
def test_a_runtime_that_hangs_is_lost_and_comes_back() -> None:
    signals = {"position": GLOVE}
    twin = twin_of(signals)
    with Served(twin.fake.world, twin):
        remote = device(twin.address, signals, silence=0.4)
        remote.open()
        twin.muted = True
        assert "nothing new" in lost(remote)
        twin.muted = False
        reopened(remote)
        cycles(remote, lambda: remote.health.frames > 20, "samples")
        os.kill(remote._link.pid(), signal.SIGKILL)  # type: ignore[arg-type]
        assert "process" in lost(remote)
        reopened(remote)
        assert remote.health.reconnects == 2


@pytest.mark.parametrize(
    ("options", "output"),
    [
        ({"signals": {}}, "at least 1"),
        ({"signals": {"Position": GLOVE}}, "signal's name"),
        ({"signals": {"p": GLOVE | {"key": "srl/*/state"}}}, "wildcards"),
        ({"signals": {"p": GLOVE | {"shape": [0]}}}, "above 0"),
        ({"signals": {"p": GLOVE | {"type": "sensor_msgs/msg/JointStat"}}}, "Did you mean"),
        ({"port": "tcp://10.0.0.1:7447"}, "unencrypted_network"),
    ],
)
def test_bad_options_are_refused(options: dict[str, Any], output: str) -> None:
    with pytest.raises(ValidationError, match=output):
        ZenohConfig(**({"port": "tcp://127.0.0.1:7447", "signals": {"p": GLOVE}} | options))


@pytest.mark.parametrize(
    "reported", [{"shape": 3, "unit": "rad"}, {"shape": [3], "unit": "rad", "labels": [1, "a"]}, {}]
)
def test_metadata_that_are_nonsense_are_refused(reported: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    remote = device("tcp://127.0.0.1:1", {"position": GLOVE | {"labels": ["a", "b", "c"]}})
    monkeypatch.setattr(remote, "_ask", lambda key: {key: reported})
    with pytest.raises(DeviceError, match="the profile expects"):
        remote._check(remote._sources[0])
