"""One runtime's device in another: the driver against the real bus process, over its socket and over mutual TLS."""

from __future__ import annotations

import shutil
import socket
import time
from pathlib import Path
from typing import Any

import pytest
from helpers.bus import FINGERS, JOINTS, Run, spawn
from helpers.wait import until
from helpers.zenoh import bound, certificates, cycles, lost, refusal, reopened

from srl.drivers.zenoh import Zenoh, ZenohConfig
from srl.runtime.contracts.errors import DeviceError
from srl.runtime.ipc.run_folder import RunFolder

PLACE = "srl/one/state/"
SIGNALS: dict[str, Any] = {
    "position": {"key": f"{PLACE}glove/position", "shape": [3], "unit": "rad", "labels": list(reversed(JOINTS))},
    "wrench": {"key": f"{PLACE}glove/wrench", "shape": [6], "unit": "N", "frame": "wrist"},
    "pose": {"key": f"{PLACE}glove/pose", "shape": [7], "unit": "m", "frame": "world"},
    "twist": {"key": f"{PLACE}glove/twist", "shape": [6], "unit": "m/s", "frame": "world"},
    "tips": {
        "key": f"{PLACE}hand/tips",
        "shape": [5, 3],
        "unit": "m",
        "frame": "palm",
        "labels": list(reversed(FINGERS)),
        "components": [["x", "y", "z"]],
    },
}


def remote(port: str, signals: dict[str, Any] = SIGNALS, **options: Any) -> Zenoh:
    return bound(Zenoh("remote", ZenohConfig(port=port, signals=signals, **options)))  # type: ignore[return-value]


class Other:
    """The other runtime: rows, and a bus process."""

    def __init__(self, path: Path, **bus: Any) -> None:
        self.run_folder = RunFolder(path / "one")
        self.run = Run(self.run_folder, 200, decimate=2, **bus)
        self.run.start()
        self.process = spawn(self.run_folder)
        until(self.run_folder.bus_socket.exists, what="the bus's socket")
        self.port = f"unixsock-stream/{self.run_folder.bus_socket}"

    def close(self) -> None:
        if not self.run.ending.is_set():
            self.run.end()
        self.process.kill()
        self.process.wait(10)


@pytest.mark.slow
def test_every_message_of_the_bus_with_the_devices_own_stamps(tmp_path: Path) -> None:
    other = Other(tmp_path)
    device = remote(other.port)
    try:
        reopened(device)
        cycles(device, lambda: device.health.frames > 100, "samples")
        states = device.state_arrays
        assert states["position"][[2, 1]].tolist() == [0.1, 0.2]  # put into the order asked for
        assert states["wrench"].tolist() == [1, 2, 3, 4, 5, 6]
        assert states["pose"].tolist() == [1, 2, 3, 0.5, -0.5, 0.5, -0.5]
        assert states["tips"][::-1].ravel().tolist() == list(range(15))  # an array, too
        assert device.health.errors == 0
        assert device.health.message == ""  # a Float64MultiArray has its stamp in the attachment
        # The cycles end: what stands in the rows isn't repeated for fresh, and the device is lost.
        other.run.paused.set()
        at = time.monotonic_ns()
        assert "nothing new" in lost(device)
        assert device.health.stamp < at + 10_000_000
        other.run.paused.clear()
        reopened(device)
    finally:
        device.close()
        other.close()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("key", "wanted", "output"),
    [
        ("tips", {"labels": ["thumb", "index", "middle", "ring", "pinkie"]}, "has the labels"),
        ("tips", {"components": [["y", "x", "z"]]}, "has the components"),
        ("position", {"labels": ["thumb", "index-1", "index-3"]}, "has the labels"),
    ],
)
def test_a_sender_with_other_names_is_refused(tmp_path: Path, key: str, wanted: dict[str, Any], output: str) -> None:
    other = Other(tmp_path)
    device = remote(other.port, {key: SIGNALS[key] | wanted})
    try:
        assert output in refusal(device)
    finally:
        device.close()
        other.close()


@pytest.mark.slow
def test_the_end_of_the_other_runtime_is_a_loss(tmp_path: Path) -> None:
    other = Other(tmp_path)
    device = remote(other.port, silence=10.0)
    try:
        reopened(device)
        other.run.end()
        output = lost(device, timeout=9.0)
        assert "has gone" in output or "closed" in output
    finally:
        device.close()
        other.close()


@pytest.mark.slow
def test_the_wrong_instance_and_signal_are_named(tmp_path: Path) -> None:
    other = Other(tmp_path)
    try:
        reopened(device := remote(other.port))
        device.close()
        for key, output in ((f"{PLACE}glove/positions", "Did you mean 'srl/one/state/glove/position'"),):
            device = remote(other.port, {"position": SIGNALS["position"] | {"key": key}})
            assert output in refusal(device)
    finally:
        other.close()


@pytest.mark.slow
def test_over_mutual_tls_and_not_without(tmp_path: Path) -> None:
    if shutil.which("openssl") is None:
        pytest.skip("openssl isn't installed; it makes the certificates")
    (tmp_path / "lab").mkdir()
    (tmp_path / "else").mkdir()
    lab = certificates(tmp_path / "lab", ("robot", "client"))
    stranger = certificates(tmp_path / "else", ("client",))["client"]
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    tls, roles = lab["robot"].model_dump(), {"observer": ["client"]}
    other = Other(tmp_path, listen=[f"tls/127.0.0.1:{port}"], tls=tls, roles=roles)
    try:
        device = remote(f"tls://localhost:{port}", tls=lab["client"])
        reopened(device)
        cycles(device, lambda: device.health.frames > 20, "samples")
        device.close()
        forged = stranger.model_copy(update={"ca": lab["client"].ca})
        for refused in (
            remote(f"tls://localhost:{port}", tls=forged),
            remote(f"tcp://127.0.0.1:{port}"),
        ):
            with pytest.raises(DeviceError):
                refused.open()
    finally:
        other.close()
