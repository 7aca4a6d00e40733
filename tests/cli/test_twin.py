"""`srl twin`: what it prints, what it refuses, faults on demand, and the log."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.srl_twin import ROOT, TwinProcess
from helpers.twin import bound
from helpers.wait import until

from srl.drivers.cyberglove import CyberGlove
from srl.drivers.firmata import Firmata
from srl.runtime.cli import main
from srl.runtime.cli import twin as cli_twin
from srl.runtime.contracts.errors import DeviceLostError
from srl.runtime.contracts.world import World, WorldConfig
from srl.runtime.loop import clock
from srl.runtime.profile import profile


def driver(cls, name: str, port: str):
    checked, _ = profile.load("sixth-finger", [f"devices.{name}.port={port}"])
    made = cls(name, cls.Config(**checked.devices[name].options))
    return bound(made, getattr(made, "home", None))


@pytest.mark.serial  # the pace of the log
def test_both_devices_with_faults_and_log(tmp_path: Path):
    log = tmp_path / "log.npz"
    with TwinProcess("sixth-finger", "--link", str(tmp_path), "--log", str(log), "--control") as twin:
        assert twin.addresses == {"glove": str(tmp_path / "glove"), "finger": str(tmp_path / "finger")}
        assert twin.run[:2] == ["run", "sixth-finger"]
        assert twin.run[-1] == "--confirm"
        checked, _ = profile.load("sixth-finger", [a for a in twin.run if a.startswith("devices.")])
        assert checked.devices["glove"].options["port"] == twin.addresses["glove"]
        glove, finger = (
            driver(CyberGlove, "glove", twin.addresses["glove"]),
            driver(Firmata, "finger", twin.addresses["finger"]),
        )
        glove.open()
        finger.open()
        finger.write(time.monotonic_ns())
        frames = glove.health.frames
        until(lambda: glove.health.frames > frames + 20, lambda: glove.read(time.monotonic_ns()))
        assert twin.control("close finger") == {"control": "close", "device": "finger", "address": ""}
        with pytest.raises(DeviceLostError):
            until(lambda: False, lambda: finger.read(time.monotonic_ns()))
        finger.close()
        assert twin.control("open finger")["address"] == twin.addresses["finger"]
        finger.open()
        unplugged = time.monotonic_ns()
        twin.control("unplug glove")
        until(lambda: "isn't plugged" in glove.health.message, lambda: glove.read(time.monotonic_ns()))
        finger.command_arrays["position_command"][:] = 0.1
        finger.write(time.monotonic_ns())
        until(lambda: not finger._waiting, lambda: finger.read(time.monotonic_ns()))
        finger.close()
        glove.close()
    assert twin.process.returncode == 0, twin.output
    assert not (tmp_path / "glove").is_symlink()
    assert twin.metrics["finger"]["connects"] == 2
    # By what was due in the twin's turn: on a busy machine that is a while ago.
    assert twin.metrics["finger"]["last_command_ns"] >= unplugged - twin.late * 1e9
    rows = np.load(log)
    assert rows["world.finger_position"].shape == (len(rows["t"]), 4)
    np.testing.assert_allclose(np.diff(rows["t"]), 0.01, atol=0.2)
    assert rows["finger.servo_ns"][-1] == twin.metrics["finger"]["last_command_ns"]
    assert bytes(rows["glove.rx"]).startswith(b"^c\x03")
    assert len(rows["glove.sent_ns"]) >= 20


@pytest.mark.slow
def test_ends_by_itself_and_prints_a_line_to_paste():
    done = subprocess.run(
        [sys.executable, "-m", "srl", "twin", "sixth-finger", "glove", "--duration", "0.1", "--set", "rate=50"],
        capture_output=True, text=True, cwd=ROOT, timeout=60, check=True,
    )  # fmt: skip
    address, line = done.stdout.splitlines()
    port = address.split()[1]
    assert line == f"srl run sixth-finger --set rate=50 --set devices.glove.port={port} --confirm"


@pytest.mark.slow
def test_ctrl_c_is_no_error():
    with TwinProcess("sixth-finger") as twin:
        twin.process.send_signal(signal.SIGINT)
        twin.process.wait(timeout=60)
    assert twin.process.returncode == 0


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["no-such-profile"], "no profile has this name"),
        (["sixth-finger", "thumb"], "has no device 'thumb'"),
        (["sixth-finger", "--duration", "0"], "is no duration"),
        (["sixth-finger", "--pace", "-1"], "isn't above 0"),
        (["sixth-finger", "--poll", "10"], "isn't from 100 to 10000"),
        (["sixth-finger", "--link", "/no/such/folder"], "there is no folder"),
        (["sixth-finger", "--log", "log.csv"], "isn't a .npz"),
    ],
)
def test_what_it_refuses(arguments, expected, capsys):
    assert main(["twin", *arguments]) == 2
    assert expected in capsys.readouterr().err


def test_a_driver_without_a_twin_is_named(monkeypatch, capsys):
    from srl.runtime.contracts import registry

    known = registry.names
    monkeypatch.setattr(registry, "names", lambda group: [] if group == "twins" else known(group))
    assert main(["twin", "sixth-finger"]) == 2
    assert "none of its drivers has a twin: cyberglove, firmata" in capsys.readouterr().err


@pytest.mark.slow
def test_a_control_line_that_is_wrong_is_answered_and_changes_nothing():
    with TwinProcess("sixth-finger", "glove", "--control") as twin:
        for wrong in ("explode glove", "close thumb", "restart glove", "close"):
            assert twin.process.stdin is not None
            twin.process.stdin.write(wrong + "\n")
        assert twin.control("mute glove")["control"] == "mute"
    for reported in ("Verbs: close", "no twin 'thumb'", "can't do that", "expected VERB DEVICE"):
        assert reported in twin.output
    assert json.dumps(twin.metrics)


class Laboured(World):
    """A world of which a millisecond takes three to compute, for five seconds of a clock that the test moves."""

    def __init__(self, clock: SimpleNamespace) -> None:
        super().__init__(WorldConfig(), 0)
        self._clock, self._busy_till = clock, clock.now + 5_000_000_000

    def advance(self, until: int) -> None:
        self._clock.now += 3_000_000 if self._clock.now < self._busy_till else 100_000

    def save(self):
        return self._clock.now

    def restore(self, state):
        self._clock.now = state


def test_a_machine_too_slow_for_the_world_leaves_no_client_without_service(monkeypatch: pytest.MonkeyPatch):
    fake = SimpleNamespace(now=10_000_000_000)

    def look() -> int:
        fake.now += 500  # ns that it takes, so that a clock that spins gets on
        return fake.now

    def sleep(seconds: float) -> None:
        fake.now += round(seconds * 1e9)

    fake.monotonic_ns, fake.sleep = look, sleep
    monkeypatch.setattr(clock, "time", fake)
    monkeypatch.setattr(cli_twin, "time", fake)
    served: list[int] = []
    device = SimpleNamespace(address="", service=lambda due: served.append(fake.now))
    args = SimpleNamespace(duration=8.0, pace=1.0, poll=1000.0, control=False, json=False)
    late = cli_twin._Late()
    cli_twin._serve(Laboured(fake), {"device": device}, args, [], None, late)  # type: ignore[arg-type, dict-item]
    assert max(np.diff(served)) < 10_000_000
    assert late.metrics()["times"] == 1
    assert late.metrics()["most"] > 3.0


@pytest.mark.slow
def test_a_twin_that_was_kept_from_running_says_so():
    with TwinProcess("sixth-finger", "glove") as twin:
        glove = driver(CyberGlove, "glove", twin.addresses["glove"])
        glove.open()
        twin.process.send_signal(signal.SIGSTOP)
        time.sleep(0.2)
        twin.process.send_signal(signal.SIGCONT)
        frames = glove.health.frames
        until(lambda: glove.health.frames > frames + 20, lambda: glove.read(time.monotonic_ns()))
        glove.close()
    assert "srl twin: late by" in twin.output
    assert "a client may find them silent" in twin.output
