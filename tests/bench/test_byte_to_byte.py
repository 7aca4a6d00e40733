"""The loops of the bench `byte-to-byte` answer the sensor and end with the bench; without gcc it says so."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import socket
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench import byte_to_byte as bench
from bench.by_hand import compiled
from bench.byte_ends import Arm, Handle, frame, values
from bench.pairs import PartlyError
from srl.runtime.contracts import registry

ANGLES = st.floats(allow_nan=False, allow_infinity=False)


@given(st.lists(ANGLES), st.data())
def test_frames_are_found_wherever_a_read_cuts_them(angles: list[float], data: st.DataObject) -> None:
    stream = b"\x00\x01" + b"".join(map(frame, angles))
    cut = data.draw(st.integers(0, len(stream)))
    first, rest = values(stream[:cut])
    second, rest = values(rest + stream[cut:])
    assert first + second == angles
    assert len(rest) < len(frame(0.0))


def test_without_a_compiler_ours_is_compared_with_the_period_and_it_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    def none(name: str) -> None:
        raise RuntimeError("there is no C compiler")

    monkeypatch.setattr(bench, "compiled", none)
    monkeypatch.setattr(bench, "metrics", lambda rate, start: dict.fromkeys(bench._NAMES, 5e5 / rate))
    with pytest.raises(PartlyError, match="there is no C compiler") as error:
        bench.run()
    assert {row.ratio for row in error.value.rows} == {0.5}
    assert {row.other_name for row in error.value.rows} == {"the period"}


@pytest.fixture(params=["ours", "C by hand"])
def start(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[int], bench.Start]]:
    """Starts a loop at a rate."""
    load, drivers = registry.load, {"byte-handle": Handle, "byte-arm": Arm}
    monkeypatch.setattr(registry, "load", lambda group, name, place: drivers.get(name) or load(group, name, place))
    if request.param == "ours":
        yield lambda rate: partial(bench._ours, rate)
    elif shutil.which("gcc") is None and shutil.which("cc") is None:
        pytest.skip("there is no C compiler")
    else:
        with compiled("byte_to_byte") as program:
            yield lambda rate: partial(bench._c, program, rate)


@pytest.mark.sampled(1)
@pytest.mark.slow
def test_a_loop_answers_the_sensor_within_a_period_and_its_work(
    start: Callable[[int], bench.Start], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(bench.FRAMES, 100, 5)
    found = bench.metrics(100, start(100))
    assert 0.0 < found["p50"] <= found["p99"] < 1e6 * bench._ANSWER


@pytest.mark.slow
def test_a_loop_ends_with_the_process_that_started_it(
    start: Callable[[int], bench.Start], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(bench, "LONGEST", 600.0)
    ends = [end for _ in range(2) for end in socket.socketpair()]
    sensor, its_sensor, its_actuator, actuator = ends
    its_sensor.setblocking(False)
    its_actuator.setblocking(False)
    actuator.settimeout(20.0)
    sensor.send(frame(1e-4))
    hear, tell = os.pipe()
    parent = os.fork()
    if parent == 0:
        try:
            os.write(tell, str(start(100)(tmp_path, its_sensor.fileno(), its_actuator.fileno())).encode())
            time.sleep(600)
        finally:
            os._exit(1)
    loop = int(os.read(hear, 32))
    try:
        actuator.recv(1)  # it runs
        assert _lives(loop)
        os.kill(parent, signal.SIGKILL)
        os.waitpid(parent, 0)
        until = time.monotonic() + 30.0
        while _lives(loop) and time.monotonic() < until:
            time.sleep(0.01)
        assert not _lives(loop)
    finally:
        for pid in (parent, loop):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        for end in ends:
            end.close()
        os.close(hear)
        os.close(tell)


def _lives(pid: int) -> bool:
    """Whether it is there and isn't just waiting to be buried."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False
