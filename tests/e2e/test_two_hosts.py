"""Two computers: the glove on one, the finger on the other, mutual TLS between them; the network is cut, or slow.

The computers are network namespaces joined by a veth pair; only root may make them.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.run import Running, environment, srl
from helpers.slow_link import SlowLink
from helpers.zenoh import certificates

from srl.drivers.cyberglove.protocol import LABELS
from srl.drivers.zenoh import Zenoh
from srl.runtime.ipc.header import CYCLE, LINK_STALE, Cause, State
from srl.runtime.ipc.run_folder import RunFolder
from srl.studies.faults.device_trial import Bench
from srl.studies.faults.steps import ROUNDING, largest

GLOVE, FINGER = "10.77.5.1", "10.77.5.2"
PORT, RELAY = 7447, 7448
DELAY = 100_000_000  # ns that a sample may take on this machine, with room (seen: 14 ms)

pytestmark = [pytest.mark.slow, pytest.mark.serial]  # how late samples are


def ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True)


class Hosts:
    """Two namespaces with a cable between them."""

    def __init__(self) -> None:
        mark = f"{os.getpid() % 100000}"
        self.names = (f"srl-a{mark}", f"srl-b{mark}")
        self.cables = (f"va{mark}", f"vb{mark}")
        for name in self.names:
            ip("netns", "add", name)
        ip("link", "add", self.cables[0], "type", "veth", "peer", "name", self.cables[1])
        for name, cable, address in zip(self.names, self.cables, (GLOVE, FINGER), strict=True):
            ip("link", "set", cable, "netns", name)
            ip("-n", name, "addr", "add", f"{address}/24", "dev", cable)
            ip("-n", name, "link", "set", cable, "up")
            ip("-n", name, "link", "set", "lo", "up")

    def cable(self, plugged: bool) -> None:
        ip("-n", self.names[0], "link", "set", self.cables[0], "up" if plugged else "down")

    def close(self) -> None:
        for name in self.names:
            subprocess.run(["ip", "netns", "del", name], check=False, capture_output=True)


@pytest.fixture
def hosts() -> Iterator[Hosts]:
    if shutil.which("ip") is None or shutil.which("openssl") is None:
        pytest.skip("needs the commands ip and openssl")
    try:
        made = Hosts()
    except subprocess.CalledProcessError as error:
        pytest.skip(f"no network namespaces here: {error.stderr.decode().strip()}")
    yield made
    made.close()


def reset(host: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """`srl reset` by a person at that host: abstract addresses, at which the loop answers, end with it."""
    return subprocess.run(
        ["ip", "netns", "exec", host, *srl("reset")],
        env=environment(folder), cwd=folder, capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip


class On(Running):
    """`srl run` on one of the hosts. `ip netns exec` becomes the command itself: its process is the supervisor's."""

    def __init__(self, host: str, folder: Path, *arguments: str) -> None:
        folder.mkdir()
        self.folder = folder
        self.run_folder = RunFolder(folder / "run" / "sixth-finger")
        self.process = subprocess.Popen(
            ["ip", "netns", "exec", host, *srl("run", *arguments, "--json")],
            env=environment(folder), cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        self._reader = None
        self._layout = None


def overrides(**values: Any) -> list[str]:
    return [
        word for key, value in values.items() for word in ("--set", f"{key.replace('__', '.')}={json.dumps(value)}")
    ]


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("silence", "seconds"),
    [
        (10.0, 0.0),  # the link outlives the cut, and delivers what waited in it
        (1.0, 3.0),  # it is opened anew
    ],
)
def test_a_cut_cable_stops_the_limb_and_nothing_old_moves_it(
    hosts: Hosts, tmp_path: Path, silence: float, seconds: float
) -> None:
    with both(hosts, tmp_path, PORT, silence) as (glove, finger):
        cut, plugged = _cut_and_mended(hosts, finger, tmp_path / "b", seconds)
        some_rows(finger)
        late = lateness(glove, finger, finger.reader.take())
        assert late[:, 0].min() < cut < plugged < late[:, 0].max()
        # Both hosts have the same CLOCK_MONOTONIC here: no sample is given out for newer than it is.
        assert late[:, 1].min() >= 0
        assert late[:, 1].max() < DELAY
        assert (finger.header("glove.reconnects") >= 1) == (seconds > silence)


@contextlib.contextmanager
def both(hosts: Hosts, folder: Path, port: int, silence: float = 10.0) -> Iterator[tuple[Running, Running]]:
    """The glove's run and the finger's, which moves; the finger reaches the glove at this port."""
    tls = certificates(folder, ("glove", "finger"), (GLOVE, FINGER))
    bus = {"decimate": 1, "listen": [f"tls/{GLOVE}:{PORT}"], "tls": tls["glove"].model_dump()}
    bus["roles"] = {"observer": ["finger"]}
    glove = On(hosts.names[0], folder / "a", "sixth-finger", "--sim", *overrides(bus=bus))
    remote = {
        "driver": "zenoh",
        "port": f"tls://{GLOVE}:{port}",
        "tls": tls["finger"].model_dump(),
        "silence": silence,
        "signals": {
            "position": {
                "key": "srl/sixth_finger/state/glove/position",
                "shape": [22],
                "unit": "rad",
                "labels": list(LABELS[22]),
            },
        },
    }
    with glove:
        glove.started()
        glove.until(glove.run_folder.bus_socket.exists, "the bus")
        words = overrides(devices__glove=remote)
        with On(hosts.names[1], folder / "b", "sixth-finger", "--sim", "finger", *words) as finger:
            finger.started()
            finger.until(lambda: finger.header("state") == State.ACTIVE, "motion")
            some_rows(finger)
            yield glove, finger


def some_rows(run: Running, count: int = 100) -> None:
    """Waits for some rows more; 100 are a second."""
    mark = run.reader.head
    run.until(lambda: run.reader.head > mark + count, "some more rows")


def test_a_slow_network_makes_samples_old_and_no_jump(hosts: Hosts, tmp_path: Path) -> None:
    with (
        SlowLink(hosts.names[0], (GLOVE, RELAY), (GLOVE, PORT)) as link,
        both(hosts, tmp_path, RELAY) as (glove, finger),
    ):
        begun = [finger.reader.head]
        for delay, jitter in ((0.02, 0.0), (0.02, 0.06)):
            link.delay(delay, jitter)
            some_rows(finger, 200)
            begun.append(finger.reader.head)
        assert finger.header("state") == State.ACTIVE  # nothing was older than `max_age`
        link.delay(0.5)
        finger.until(lambda: finger.header("cause") == Cause.INTENT_LOSS, "the loss of intent")
        begun.append(finger.reader.head)
        link.delay(0.0)
        finger.until(lambda: finger.header("state") == State.STOPPED, "the stop")
        finger.until(lambda: not finger.header("glove.link") & LINK_STALE, "freshness")
        some_rows(finger)
        assert finger.header("state") == State.STOPPED  # as long as nobody resets it
        assert reset(hosts.names[1], tmp_path / "b").returncode == 0
        finger.until(lambda: finger.header("state") == State.ACTIVE, "motion again")
        some_rows(finger, 50)

        rows = finger.reader.take()
        late = lateness(glove, finger, rows)
        assert late[:, 1].min() >= 0
        assert late[:, 1].max() < DELAY  # what waited in the network isn't given out for new
        age = (rows[:, CYCLE.now] - finger.layout.header(rows, "glove.stamp")) * 1e-9
        plain, slow, jittery = (np.median(age[a:b]) for a, b in pairwise([0, *begun[:3]]))
        print(f"median age {plain:.3f} s, with 20 ms {slow:.3f}, with jitter {jittery:.3f}")
        assert plain + 0.015 < slow < jittery
        stale = (finger.layout.header(rows, "glove.link") & LINK_STALE) != 0
        assert (stale == (age > Zenoh.max_age))[begun[0] :].all()
        with Bench("sixth-finger", [], 1) as bench:
            share, where = largest(finger.layout, rows, bench.graph, bench.guards)
        assert share <= 1.0 + ROUNDING, where


def _cut_and_mended(hosts: Hosts, finger: Running, folder: Path, seconds: float) -> tuple[int, int]:
    """Pulls the cable, puts it back, resets. When it was pulled and put back."""
    hosts.cable(False)
    cut = time.monotonic_ns()
    finger.until(lambda: finger.header("cause") == Cause.INTENT_LOSS, "the loss of intent")
    assert finger.header("state") in (State.STOPPING, State.STOPPED)
    time.sleep(seconds)  # unplugged
    assert finger.header("glove.stamp") < cut + DELAY  # nothing is newer than the cut
    if seconds:
        refused = reset(hosts.names[1], folder)
        assert refused.returncode == 2
        assert "refused" in refused.stderr

    plugged = time.monotonic_ns()
    hosts.cable(True)
    finger.until(lambda: finger.header("glove.stamp") > plugged, "new samples", timeout=60)
    finger.until(lambda: not finger.header("glove.link") & LINK_STALE, "freshness")
    assert finger.header("state") == State.STOPPED
    granted = reset(hosts.names[1], folder)
    assert granted.returncode == 0, granted.stderr
    finger.until(lambda: finger.header("state") == State.ACTIVE, "motion again")
    mark = finger.reader.head
    finger.until(lambda: finger.reader.head > mark + 50, "half a second of motion")
    return cut, plugged


def lateness(glove: Running, finger: Running, here: np.ndarray) -> np.ndarray:
    """(k, 2) ns of each sample that arrived: when it was taken by the sender's account, and how much newer it seems.

    `here`: the finger's rows. Of two samples with the same values, the one that is nearer in time was meant.
    """
    there = glove.reader.take()
    stamps = glove.layout.header(there, "glove.stamp").tolist()
    values = glove.layout.value(there, "glove.position")
    taken: dict[bytes, list[int]] = {}
    for stamp, value in zip(stamps, values, strict=True):
        taken.setdefault(value.tobytes(), []).append(stamp)
    found = {}
    arrived = finger.layout.value(here, "glove.position")
    for stamp, value in zip(finger.layout.header(here, "glove.stamp").tolist(), arrived, strict=True):
        if stamp >= 0 and (sent := taken.get(value.tobytes())):  # the first samples don't count yet
            at = min(sent, key=lambda each: abs(stamp - each))
            found[at] = stamp - at
    return np.array(list(found.items()))
