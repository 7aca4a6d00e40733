"""The base's driver against its twin over real zenoh: it drives, and stops by itself."""

from __future__ import annotations

import os
import signal
import time
from typing import Any

import pytest
from helpers.base import robot
from helpers.wait import until
from helpers.zenoh import cycles
from pydantic import ValidationError

from srl.drivers.base import BaseConfig, MobileBase
from srl.drivers.base.driver import COMMAND
from srl.runtime.contracts.errors import DeviceError
from srl.runtime.contracts.signals import Kind, Stop


@pytest.mark.serial  # its twin is a process: where it stands still for a second, the robot counts as lost
@pytest.mark.parametrize(
    ("options", "clock"),
    [({}, 0.0), ({"message": "TwistStamped"}, 86400.0), ({"middleware": "rmw_zenoh", "message": "TwistStamped"}, -3.0)],
)
def test_it_drives_and_says_where_it_is(options: dict[str, Any], clock: float) -> None:
    with robot(sim={"clock": clock, "noise": 0.0}, **options) as r:
        r.base.open()
        r.drive()
        cycles(r.base, lambda: r.base.state_arrays["pose"][0] > 0.3, "30 cm", write=True)
        pose = r.base.state_arrays["pose"]
        assert pose == pytest.approx(r.served.do(r.fake.base.odometry)[0], abs=0.05)
        assert r.twin.refused == 0  # also with a clock that is a day ahead
        health = r.base.health
        assert health.connected
        assert health.frames > 10
        assert health.errors == 0
        assert health.stamp <= time.monotonic_ns()


@pytest.mark.slow
def test_a_silent_loop_means_zero_velocity() -> None:
    with robot() as r:
        r.base.open()
        r.drive()
        sent = r.served.do(lambda: len(r.twin.taken))
        cycles(r.base, lambda: r.speed() < 0.01, "the stop")  # reads, and doesn't write
        taken = r.served.do(lambda: r.twin.taken[sent:])
        assert taken[-1][1] == (0.0, 0.0, 0.0)
        moving = [at for at, velocity in taken if any(velocity)]
        assert len(moving) <= 1  # what was on its way
        r.drive()  # and it goes on when the loop does


@pytest.mark.slow
def test_a_loop_that_dies_leaves_a_stop_frame() -> None:
    with robot(expiry=0.5) as r:
        r.base.open()
        fileno = r.base.fileno()
        assert fileno is not None
        duplicate = os.dup(fileno)
        r.drive()
        before = r.served.do(lambda: len(r.twin.taken))
        os.write(duplicate, *r.base.stop_frames(Stop.BRAKE))
        cycles(r.base, lambda: r.speed() < 0.01, "the stop")
        assert r.served.do(lambda: r.twin.taken[before + 1 :])[0][1] == (0.0, 0.0, 0.0)
        os.close(duplicate)


@pytest.mark.slow
def test_the_process_stops_it_when_the_driver_is_gone() -> None:
    with robot(expiry=0.5) as r:
        r.base.open()
        r.drive()
        process = r.base._link._helper._process
        assert process is not None
        r.base._link._helper._end.close()  # type: ignore[union-attr]  # as the kernel does when the loop is killed
        until(lambda: r.speed() < 0.01)
        assert r.served.do(lambda: r.twin.taken[-1][1]) == (0.0, 0.0, 0.0)
        assert process.wait(20) == 0


@pytest.mark.slow
def test_a_process_that_hung_delivers_nothing_old() -> None:
    with robot() as r:
        r.base.open()
        r.drive(0.3)
        pid = r.base._link.pid()
        assert pid is not None
        os.kill(pid, signal.SIGSTOP)
        try:
            r.command[:] = -0.7, 0.0, 0.0
            end = time.monotonic() + 0.6
            while time.monotonic() < end:  # several commands fall due; at most one is on its way
                r.base.write(time.monotonic_ns())
                time.sleep(0.005)
            assert r.base._link.untaken
            until(lambda: r.speed() < 0.01, what="the robot's own time-out")
        finally:
            os.kill(pid, signal.SIGCONT)
        time.sleep(0.3)  # in which nothing old may come
        assert all(velocity[0] >= 0.0 for _, velocity in r.served.do(lambda: list(r.twin.taken)))


@pytest.mark.slow
def test_stop_and_close_stop_it() -> None:
    with robot(expiry=0.5) as r:
        r.base.open()
        r.drive()
        r.base.stop(Stop.BRAKE)
        cycles(r.base, lambda: r.speed() < 0.01, "the stop")
        r.drive()
        r.base.close()
        r.base.close()
        until(lambda: r.speed() < 0.01)
        assert r.served.do(lambda: r.twin.taken[-1][1]) == (0.0, 0.0, 0.0)


@pytest.mark.slow
def test_the_emergency_stop_is_a_fault_while_it_lasts() -> None:
    with robot(sim={"pressed": ((1.5, 3.0),)}) as r:
        r.base.open()
        cycles(r.base, lambda: "emergency" in r.base.health.fault, "the e-stop")
        r.base.recover(time.monotonic_ns())
        assert r.base.health.fault  # a person releases it at the robot
        cycles(r.base, lambda: not r.base.health.fault, "its release")
        r.drive()


def test_what_it_declares() -> None:
    base = MobileBase("base", BaseConfig(port="tcp://127.0.0.1:7447", sideways=False))
    (command,) = base.commands
    assert (command.kind, command.feedback, command.shape) == (Kind.VELOCITY, "pose", (3,))
    assert [s.name for s in base.states] == ["pose", "twist"]
    assert base.limits[COMMAND].velocity == pytest.approx([0.75, 0.0, 0.785])
    with pytest.raises(DeviceError, match="open"):
        base.read(0)
    base.stop(Stop.BRAKE)
    base.close()


@pytest.mark.parametrize(
    ("options", "output"),
    [
        ({"port": "tcp://192.168.0.200:7447"}, "unencrypted_network"),
        ({"port": "tls://192.168.0.200:7447"}, "tls"),
        ({"port": "/dev/ttyUSB0"}, "tcp://HOST:PORT"),
        ({"port": "tcp://127.0.0.1:0"}, "tcp://HOST:PORT"),
        ({"speed": (2.0, 0.5, 0.5)}, "at most"),
        ({"acceleration": (0.6, 0.6, 9.0)}, "at most"),
        ({"rate": 10, "expiry": 0.15}, "at least 0.2 s"),
        ({"command": "cmd vel"}, "topic"),
        ({"namespace": "a b"}, "namespace"),
    ],
)
def test_bad_options_are_refused(options: dict[str, Any], output: str) -> None:
    with pytest.raises(ValidationError, match=output):
        BaseConfig(**({"port": "tcp://127.0.0.1:7447"} | options))


def test_the_network_takes_a_loud_word() -> None:
    assert BaseConfig(port="tcp://192.168.0.200:7447", unencrypted_network=True).endpoint == "tcp/192.168.0.200:7447"
