"""The supervisor at the loop's death: what it holds, in which order it acts, and what it needs no more."""

from __future__ import annotations

import contextlib
import os
import resource
import select
import shutil
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from helpers.loop_double import LoopDouble
from helpers.run import alive
from helpers.wait import until

from srl.runtime.ipc.header import State
from srl.runtime.loop import realtime
from srl.runtime.loop.control_end import ControlEnd
from srl.runtime.recording.reader import read
from srl.runtime.service import supervisor as service
from srl.runtime.service.helpers import Helper


@pytest.fixture
def loop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[LoopDouble]:
    double = LoopDouble(tmp_path, monkeypatch)
    yield double
    double.close()


def pipe() -> tuple[int, int]:
    """Its ends: for the device, and for the loop."""
    ours, theirs = os.pipe()
    os.set_blocking(ours, False)
    return ours, theirs


def taken(end: int) -> bytes:
    try:
        return os.read(end, 4096)
    except BlockingIOError:
        return b""


def fill(end: int) -> None:
    """Writes until the device would take no more."""
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(end, bytes(4096))


def use_up(filler: list[int]) -> None:
    """Opens descriptors until there are none."""
    with contextlib.suppress(OSError):
        while True:
            filler.append(os.open(os.devnull, os.O_RDONLY))


def hang_up(loop: LoopDouble) -> None:
    """The channel closes, as when the process dies; the process itself is still there."""
    loop.channel.socket.close()
    until(lambda: not loop.supervisor.step())


def test_frames_go_out_before_the_dead_process_is_reaped_and_again_after(loop: LoopDouble) -> None:
    ours, theirs = pipe()
    loop.hand_over(0, theirs, b"stop")
    loop.run()
    until(lambda: loop.supervisor.step() and loop.supervisor.running)
    before: list[bytes] = []
    loop.process.before_wait = lambda: before.append(taken(ours))
    hang_up(loop)
    assert before == [b"stop"]
    assert taken(ours) == b"stop"


def test_a_process_that_is_half_dead_is_killed(loop: LoopDouble) -> None:
    loop.run()
    until(lambda: loop.supervisor.step() and loop.supervisor.running)
    hang_up(loop)
    assert not alive(loop.process.pid)
    assert loop.supervisor.death is not None
    assert "SIGKILL" in loop.supervisor.death.how


def test_what_is_left_of_the_loop_is_killed_before_the_frames_go_out(
    loop: LoopDouble, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that hung and wakes up would move the limb after its stop."""
    done: list[object] = []
    kill, stop = os.kill, loop.supervisor._actuators.stop
    monkeypatch.setattr(service.os, "kill", lambda pid, how: (done.append(how), kill(pid, how))[1])
    monkeypatch.setattr(loop.supervisor._actuators, "stop", lambda: (done.append("frames"), stop())[1])
    loop.run()
    until(lambda: loop.supervisor.step() and loop.supervisor.running)
    hang_up(loop)
    assert done == [signal.SIGKILL, "frames", "frames"]


def test_a_death_is_seen_before_the_channel_closes(loop: LoopDouble) -> None:
    """The kernel frees a dead process's memory first and closes its descriptors afterwards."""
    ours, theirs = pipe()
    loop.hand_over(0, theirs, b"stop")
    loop.run()
    until(lambda: loop.supervisor.step() and loop.supervisor.running)
    loop.process.kill()
    assert not loop.supervisor.step()
    assert taken(ours) == b"stopstop"
    assert loop.supervisor.death is not None
    assert "SIGKILL" in loop.supervisor.death.how


def test_an_actuator_that_was_handed_over_just_before_the_death_is_stopped(loop: LoopDouble) -> None:
    ours, theirs = pipe()
    loop.run()
    until(lambda: loop.supervisor.step() and loop.supervisor.running)
    loop.slots.write(3, (b"stop",))
    loop.supervisor._exit.seen = loop_handing_over(loop, theirs)  # type: ignore[method-assign]
    assert not loop.supervisor.step()
    assert taken(ours) == b"stopstop"


def test_an_end_in_order_isnt_called_a_death_where_the_supervisor_was_held_up_between_two_looks(
    loop: LoopDouble,
) -> None:
    loop.run()
    until(lambda: loop.supervisor.step() and loop.supervisor.running)

    def seen() -> bool:
        loop.ring.finish()  # the last row and the end of the process come between the two looks
        return True

    loop.supervisor._exit.seen = seen  # type: ignore[method-assign]
    assert loop.supervisor.step()
    assert loop.supervisor.death is None


def loop_handing_over(loop: LoopDouble, descriptor: int) -> Callable[[], bool]:
    """The loop's last words come after the supervisor has listened; then it is seen to die."""

    def seen() -> bool:
        loop.channel.send({"say": "actuator", "slot": 3, "name": "servo 3"}, descriptor)
        return True

    return seen


def test_after_a_stall_of_the_whole_machine_the_loop_has_one_check_to_show_that_it_goes_on(
    loop: LoopDouble, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = time.monotonic_ns()
    monkeypatch.setattr(service.time, "monotonic_ns", lambda: now)
    loop.run(period=1_000_000, unpaced=False)
    until(lambda: loop.supervisor.step() and loop.supervisor.running)
    assert loop.supervisor.step()
    for goes_on in (True, False):
        now += 500_000_000  # neither the loop nor its supervisor ran
        assert loop.supervisor.step()
        if goes_on:
            loop.ring.touch(now)
        now += 5_000_000
        assert loop.supervisor.step() is goes_on
    assert not alive(loop.process.pid)


def test_a_hung_loop_is_found_though_every_check_is_late(loop: LoopDouble, monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a container whose share of the processor is used up."""
    now = time.monotonic_ns()
    monkeypatch.setattr(service.time, "monotonic_ns", lambda: now)
    loop.run(period=1_000_000, unpaced=False)
    until(lambda: loop.supervisor.step() and loop.supervisor.running)
    for goes_on in (True, False):  # after 60 ms, and 120 ms of silence: the loop showed no sign of life in between
        now += 60_000_000
        assert loop.supervisor.step() is goes_on
    assert not alive(loop.process.pid)


def test_where_nothing_is_commanded_a_loop_may_be_silent_for_longer(
    loop: LoopDouble, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A calibration of minutes isn't lost to a machine that is busy for a moment."""
    started = now = time.monotonic_ns()
    monkeypatch.setattr(service.time, "monotonic_ns", lambda: now)
    loop.run(period=1_000_000, unpaced=False, moves=False)
    until(lambda: loop.supervisor.step() and loop.supervisor.running)
    for silent, goes_on in ((1_002_000_000, True), (1_002_000_001, False)):
        now = started + silent
        loop.supervisor._checked = now  # checked all the time
        assert loop.supervisor.step() is goes_on
    assert not alive(loop.process.pid)


@pytest.mark.parametrize("state", [State.STARTING, State.READY])
def test_before_its_start_a_limb_may_be_silent_for_longer(
    loop: LoopDouble, monkeypatch: pytest.MonkeyPatch, state: State
) -> None:
    started = now = time.monotonic_ns()
    monkeypatch.setattr(service.time, "monotonic_ns", lambda: now)
    loop.run(period=1_000_000, unpaced=False, state=state)
    until(lambda: loop.supervisor.step() and loop.supervisor.running)
    for silent, goes_on in ((1_000_000_000, True), (1_000_000_001, False)):
        now = started + silent
        loop.supervisor._checked = now  # checked all the time
        assert loop.supervisor.step() is goes_on
    assert not alive(loop.process.pid)


@pytest.mark.parametrize(
    ("period", "unpaced", "patience"),
    [(10_000_000, False, 120_000_000), (1_000_000, False, 102_000_000), (10_000_000, True, 10_000_000_000)],
)
def test_a_loop_without_a_sign_of_life_is_killed_and_the_limb_stopped(
    loop: LoopDouble, monkeypatch: pytest.MonkeyPatch, period: int, unpaced: bool, patience: int
) -> None:
    """After 100 ms and two periods, on a clock of the test's own: not a nanosecond before, and none later."""
    started = now = time.monotonic_ns()
    monkeypatch.setattr(service.time, "monotonic_ns", lambda: now)
    ours, theirs = pipe()
    loop.hand_over(0, theirs, b"stop")
    loop.run(period=period, unpaced=unpaced)
    until(lambda: loop.supervisor.step() and loop.supervisor.running)
    now = started + patience
    assert loop.supervisor.step()
    assert (alive(loop.process.pid), taken(ours)) == (True, b"")
    now += 1
    assert not loop.supervisor.step()
    assert not alive(loop.process.pid)
    assert taken(ours) == b"stopstop"
    assert loop.supervisor.death is not None
    assert "no sign of life" in loop.supervisor.death.how


@pytest.mark.parametrize(("name", "reported"), [("bus", True), ("recorder", False)])
def test_the_loop_is_told_of_the_buss_death_and_the_bus_comes_back(loop: LoopDouble, name: str, reported: bool) -> None:
    """What it does then is for `faults.bus-loss` to say."""
    asked = ControlEnd(loop.run_folder.stop_socket)
    helper = Helper(name, ["sleep", "1000"])
    loop.supervisor.helpers.append(helper)
    loop.run()
    until(lambda: loop.supervisor.step() and helper.process is not None)
    first = helper.process
    assert first is not None
    assert asked.take() is None
    first.kill()
    until(lambda: loop.supervisor.step() and helper.process not in (None, first))
    datagram = asked.take()
    assert (datagram and datagram.content) == ({"ask": "fault", "cause": "bus_loss"} if reported else None)
    asked.close()
    loop.supervisor.helpers.clear()
    helper.process.kill()
    helper.process.wait()


@pytest.mark.parametrize("refused", [False, True])
def test_a_loop_gives_up_its_priority_before_it_is_killed(
    loop: LoopDouble, monkeypatch: pytest.MonkeyPatch, refused: bool
) -> None:
    """Its end takes long, and would take the supervisor's processor before the frames are out."""
    living: list[bool] = []

    def leave(pid: int) -> None:
        living.append(alive(pid))
        if refused:
            raise PermissionError

    monkeypatch.setattr(realtime, "leave", leave)
    loop.run()
    until(lambda: loop.supervisor.step() and loop.supervisor.running)
    hang_up(loop)
    assert living == [True]
    assert not alive(loop.process.pid)


def test_a_device_that_takes_nothing_delays_no_other(loop: LoopDouble, monkeypatch: pytest.MonkeyPatch) -> None:
    full, theirs = pipe()
    ours, other = pipe()
    os.set_blocking(theirs, False)
    fill(theirs)
    loop.hand_over(0, theirs, b"stop")
    loop.hand_over(1, other, b"halt")
    loop.run()
    until(lambda: loop.supervisor.step() and loop.supervisor.running)
    before: list[bytes] = []
    poll = select.poll
    monkeypatch.setattr(select, "poll", lambda: before.append(taken(ours)) or poll())
    hang_up(loop)
    assert before[0] == b"halt", "before anything was waited for"
    assert any("'servo 0' can't be reached for its stop: it took no bytes" in line for line in loop.output)
    os.close(full)


def test_a_device_that_has_gone_delays_no_other(loop: LoopDouble) -> None:
    gone, theirs = pipe()
    os.close(gone)
    ours, other = pipe()
    loop.hand_over(0, theirs, b"stop")
    loop.hand_over(1, other, b"halt")
    loop.run()
    until(lambda: loop.supervisor.step() and loop.supervisor.running)
    hang_up(loop)
    assert taken(ours) == b"halthalt"
    assert loop.output == ["'servo 0' can't be reached for its stop: Broken pipe"]


def test_a_device_that_hangs_up_after_its_stop_isnt_reported(loop: LoopDouble) -> None:
    ours, theirs = pipe()
    loop.hand_over(0, theirs, b"stop")
    loop.run()
    until(lambda: loop.supervisor.step() and loop.supervisor.running)
    with open(ours, "rb") as end:
        loop.process.before_wait = end.close
        hang_up(loop)
    assert loop.output == []


def test_the_box_is_written_from_memory(loop: LoopDouble) -> None:
    ours, theirs = pipe()
    loop.hand_over(0, theirs, b"stop")
    loop.run()
    until(lambda: loop.supervisor.step() and loop.supervisor.running)
    shutil.rmtree(loop.run_folder.path)
    hang_up(loop)
    assert taken(ours) == b"stopstop"
    assert loop.supervisor.death is not None
    assert loop.supervisor.death.black_box is not None
    assert len(read(loop.supervisor.death.black_box).rows) == 3


def test_a_state_folder_that_cant_be_written_is_said(loop: LoopDouble) -> None:
    ours, theirs = pipe()
    loop.state.touch()
    loop.hand_over(0, theirs, b"stop")
    loop.run()
    until(lambda: loop.supervisor.step() and loop.supervisor.running)
    hang_up(loop)
    assert taken(ours) == b"stopstop"
    assert any("the black box can't be saved" in line for line in loop.output)
    loop.supervisor.finish()
    assert loop.ring.closed
    assert not loop.ring.settled  # so that the next start tries again


def test_an_actuator_is_taken_over_with_the_last_descriptor(loop: LoopDouble) -> None:
    """And its stop and the black box need no more than that one."""
    ours, theirs = pipe()
    loop.run()
    until(lambda: loop.supervisor.step() and loop.supervisor.running)
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    used = max(int(name) for name in os.listdir("/proc/self/fd")) + 1
    filler = []
    resource.setrlimit(resource.RLIMIT_NOFILE, (used, hard))
    try:
        use_up(filler)
        loop.hand_over(0, theirs, b"stop")
        assert any("no descriptor can be kept" in line for line in loop.output)
        os.close(filler.pop())
        assert loop.supervisor.step()
        loop.channel.send({"say": "lost", "slot": 5})
        assert loop.supervisor.step()
        hang_up(loop)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
        for descriptor in filler:
            os.close(descriptor)
    assert taken(ours) == b"stopstop"
    assert loop.supervisor.death is not None
    assert loop.supervisor.death.black_box is not None


def test_a_loop_that_cant_be_watched_gets_to_move_nothing(loop: LoopDouble) -> None:
    loop.say_running()
    until(lambda: not loop.supervisor.step())
    assert loop.supervisor.death is not None
    assert "can't be watched" in loop.supervisor.death.how
    assert "layout.json" in loop.supervisor.death.how
    assert not alive(loop.process.pid)


def test_an_end_with_an_error_is_a_death_even_after_the_last_row(loop: LoopDouble) -> None:
    """It may have died before it had told its devices to stop."""
    ours, theirs = pipe()
    loop.hand_over(0, theirs, b"stop")
    loop.run()
    until(lambda: loop.supervisor.step() and loop.supervisor.running)
    loop.ring.finish()
    loop.process.kill()
    hang_up(loop)
    assert loop.supervisor.death is not None
    assert taken(ours) == b"stopstop"
