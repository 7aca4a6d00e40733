"""What a client is told when nobody answers: its bus is dead, hangs, came again, or isn't there at all."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import zenoh
from helpers.bus import Instance, reach, spawn
from helpers.wait import until

from srl import NoAnswerError, RequestError
from srl.client import Client, connect
from srl.runtime.bus import session
from srl.runtime.ipc.run_folder import RunFolder

PULL = "object-mapping.pull"
PAGE = Path(__file__).parents[2] / "docs" / "bus.md"
NEEDS_NO_BUS = "`srl stop left`, on its machine, needs no bus"
# What asks, and whether it may have changed something though nobody answered.
ASKS: dict[str, tuple[Callable[[Client], Any], bool]] = {
    "command": (lambda client: client.command("stop"), True),
    "set_param": (lambda client: client.set_param(PULL, 2.0), True),
    "setpoint, answered": (lambda client: client.setpoint("client.force", [1, 2, 3], answer=True), True),
    "get_param": (lambda client: client.get_param(PULL), False),
    "parameters": (lambda client: client.parameters(), False),
    "meta": (lambda client: client.meta(), False),
    "events": (lambda client: client.events(), False),
    "status": (lambda client: client.status(), False),
    "states": (lambda client: list(client.states(timeout=0.2)), False),
    "subscribe": (lambda client: client.subscribe(print), False),
}


@pytest.fixture
def left(tmp_path: Path) -> Iterator[Instance]:
    instance = Instance(tmp_path / "left")
    yield instance
    instance.close()


def kill(instance: Instance) -> None:
    instance.process.kill()
    instance.process.wait()
    until(lambda: not instance.client._presence.there)


def again(instance: Instance) -> None:
    """A bus in the place of the dead one, as the supervisor starts it."""
    assert instance.process.stderr is not None
    instance.process.stderr.close()
    instance.process = spawn(instance.run_folder, stderr=subprocess.PIPE)


@contextmanager
def plain(instance: Instance) -> Iterator[zenoh.Session]:
    """A client that isn't ours."""
    with session.join(f"unixsock-stream/{instance.run_folder.bus_socket}") as opened:
        yield opened


# The client's methods


def test_what_is_asked_of_a_dead_bus_is_an_error_that_says_that_nothing_was_sent(left: Instance) -> None:
    left.client.setpoint("client.force", [1, 2, 3])
    kill(left)
    for name, (ask, _) in ASKS.items():
        with pytest.raises(NoAnswerError, match=r"instance 'left' \(srl/left/") as caught:
            ask(left.client)
        output = str(caught.value)
        assert "\n" not in output, name
        assert NEEDS_NO_BUS in output, name
        assert "isn't known" not in output, name
    with pytest.raises(NoAnswerError, match="nobody is there, so nothing is sent"):
        left.client.setpoint("client.force", [1, 2, 3])
    assert not left.client.alive()
    assert left.run.taken == []


def test_what_is_asked_of_a_bus_that_hangs_may_have_been_carried_out_and_the_error_says_so(left: Instance) -> None:
    with connect(left.run_folder) as client:
        client._timeout = 0.1  # connected: all asks end long before the connection does, in 10 s
        client.setpoint("client.force", [1, 2, 3])
        heard = iter(client.states())
        next(heard)
        os.kill(left.process.pid, signal.SIGSTOP)
        try:
            for name, (ask, changes) in ASKS.items():
                with pytest.raises(NoAnswerError) as caught:
                    ask(client)
                output = str(caught.value)
                assert ("Whether it was carried out isn't known" in output) is changes, name
                assert NEEDS_NO_BUS in output, name
        finally:
            os.kill(left.process.pid, signal.SIGCONT)
    until(lambda: left.run.taken)  # and so it was


def test_what_is_asked_as_the_bus_dies_may_have_been_carried_out(left: Instance) -> None:
    """It dies with the request in its hands, after which zenoh has no answers and no error."""
    os.kill(left.process.pid, signal.SIGSTOP)
    killer = subprocess.Popen(["sh", "-c", f"sleep 0.3; kill -9 {left.process.pid}"])
    with pytest.raises(NoAnswerError, match="Whether it was carried out isn't known"):
        left.client.command("stop")
    killer.wait()


def test_a_reader_without_a_timeout_ends_when_its_instance_has_gone(
    left: Instance, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("srl.runtime.bus.client.AWAY", 0.3)
    heard = left.client.states()
    next(heard)
    kill(left)
    with pytest.raises(NoAnswerError, match=r"nothing comes any more.*`srl stop left`"):
        for _ in heard:
            pass


def test_a_reader_outlives_a_bus_that_is_started_again(left: Instance) -> None:
    heard = left.client.states("glove/position")
    next(heard)
    kill(left)
    again(left)
    seen = time.time()
    assert until(lambda: (next(heard).stamp or 0.0) > seen)


def test_a_reader_of_a_signal_that_isnt_there_is_told_so(left: Instance) -> None:
    with pytest.raises(RequestError, match=r"no signal has such a name\. Did you mean 'glove/position'"):
        next(left.client.states("glove/positon"))
    with pytest.raises(RequestError, match="no signal has such a name"):
        left.client.subscribe(print, "nothing/**")


def test_an_instance_that_begins_anew_is_asked_anew_for_its_setpoints(left: Instance) -> None:
    left.client.setpoint("client.force", [1, 2, 3])
    kill(left)
    text = left.run_folder.layout.read_text()
    left.run_folder.layout.write_text(text.replace("client.force", "client.other"))
    again(left)
    until(lambda: left.client._presence.there)
    with pytest.raises(RequestError, match=r"no setpoint 'client.force'.*client.other"):
        left.client.setpoint("client.force", [1, 2, 3])


def test_a_client_is_told_when_the_bus_goes_and_comes(left: Instance) -> None:
    told: list[bool] = []
    left.client.subscribe_alive(told.append)
    until(lambda: told == [True])
    kill(left)
    until(lambda: told == [True, False])
    again(left)
    until(lambda: told == [True, False, True])
    assert left.client.command("stop")["ok"]


def test_a_socket_that_a_dead_bus_has_left_is_no_instance(left: Instance) -> None:
    kill(left)
    with pytest.raises(NoAnswerError, match=r"zenoh.sock\): nobody answered: no connection.*`srl stop` needs no bus"):
        connect(left.run_folder, timeout=0.3)
    with pytest.raises(NoAnswerError, match="instance 'right': no bus listens at"):
        connect(left.run_folder.path.parent / "right")


def test_of_several_instances_behind_one_router_the_one_that_is_named_is_asked(left: Instance, tmp_path: Path) -> None:
    right = Instance(tmp_path / "right-arm")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    content = {
        "mode": "router",
        "scouting": {"multicast": {"enabled": False}},
        "listen": {"endpoints": [endpoint]},
        "connect": {"endpoints": [f"unixsock-stream/{i.run_folder.bus_socket}" for i in (left, right)]},
    }
    with zenoh.open(zenoh.Config.from_json5(json.dumps(content))) as router:
        until(lambda: len(list(router.liveliness().get("srl/*/alive"))) == 2)
        with pytest.raises(RequestError, match=r"several instances are alive there: left, right_arm\. Name one"):
            connect(endpoint)
        with pytest.raises(NoAnswerError, match=r"no instance 'middle' is alive there.*left, right_arm"):
            connect(endpoint, instance="middle", timeout=0.3)
        with connect(endpoint, instance="right-arm") as client:
            assert client.command("stop")["ok"]
            assert (len(right.run.taken), left.run.taken) == (1, [])
            kill(right)
            until(lambda: not client._presence.there)
            with pytest.raises(NoAnswerError, match="instance 'right-arm'"):
                client.command("stop")
    right.close()


# Any zenoh client


def example(what: str = "session.get(") -> str:
    """The page's program for any zenoh client that does that."""
    (found,) = [code for code in re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL) if what in code]
    return found


def run_example(folder: RunFolder, instance: str) -> subprocess.CompletedProcess[str]:
    code = example()
    places = {"/run/srl/sixth-finger/zenoh.sock": str(folder.bus_socket), "srl/sixth_finger": f"srl/{instance}"}
    for old, new in places.items():
        assert old in code
        code = code.replace(old, new)
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)


def test_the_pages_program_says_whether_it_was_heard(left: Instance) -> None:
    done = run_example(left.run_folder, "left")
    assert (done.returncode, done.stdout, done.stderr) == (0, "stopped\n", "")
    done = run_example(left.run_folder, "nobody")
    assert (done.returncode, done.stdout) == (1, "")
    assert "nobody answered" in done.stderr
    assert "srl stop sixth-finger" in done.stderr
    left.run.paused.set()
    until(lambda: left.client.status()["level"] == 3)
    done = run_example(left.run_folder, "left")
    assert (done.returncode, done.stdout) == (1, "")
    assert "no sign of life" in done.stderr
    left.run.paused.clear()
    os.kill(left.process.pid, signal.SIGSTOP)
    killer = subprocess.Popen(["sh", "-c", f"sleep 1; kill -9 {left.process.pid}"])
    assert run_example(left.run_folder, "left").returncode == 1
    killer.wait()


@pytest.mark.parametrize("key", ["srl/*/alive", "srl/left/alive", "srl/**", "**"])
def test_a_liveliness_token_is_there_as_long_as_its_bus(left: Instance, key: str) -> None:
    heard: list[tuple[zenoh.SampleKind, str]] = []
    with plain(left) as client:
        assert [str(a.ok.key_expr) for a in client.liveliness().get(key, timeout=5) if a.ok] == ["srl/left/alive"]
        client.liveliness().declare_subscriber(key, lambda s: heard.append((s.kind, str(s.key_expr))), history=True)
        until(lambda: heard == [(zenoh.SampleKind.PUT, "srl/left/alive")])
        kill(left)
        until(lambda: heard[1:] == [(zenoh.SampleKind.DELETE, "srl/left/alive")])
        assert list(client.liveliness().get(key, timeout=5)) == []


def test_the_pages_program_follows_the_token(left: Instance) -> None:
    code = example().partition("with zenoh.open")[0] + example("liveliness()")
    code = code.replace("/run/srl/sixth-finger/zenoh.sock", str(left.run_folder.bus_socket))
    program = subprocess.Popen([sys.executable, "-u", "-c", code], stdout=subprocess.PIPE, text=True)
    assert program.stdout is not None
    with program:
        assert program.stdout.readline() == "['srl/left/alive']\n"
        assert program.stdout.readline() == "SampleKind.PUT srl/left/alive\n"
        kill(left)
        assert program.stdout.readline() == "SampleKind.DELETE srl/left/alive\n"
        again(left)
        assert program.stdout.readline() == "SampleKind.PUT srl/left/alive\n"
        program.kill()


@pytest.mark.slow
def test_the_token_of_a_bus_that_hangs_goes_after_zenohs_lease(left: Instance) -> None:
    os.kill(left.process.pid, signal.SIGSTOP)
    begun = time.monotonic()
    until(lambda: not left.client._presence.there, pause=0.01)
    assert 5 < time.monotonic() - begun < 15
    with pytest.raises(NoAnswerError, match="nothing is sent"):
        left.client.setpoint("client.force", [1, 2, 3])
    os.kill(left.process.pid, signal.SIGCONT)
    until(lambda: left.client._presence.there, pause=0.01)


def test_the_token_goes_with_the_run(tmp_path: Path) -> None:
    instance = Instance(tmp_path / "left")
    told: list[bool] = []
    instance.client.subscribe_alive(told.append)
    until(lambda: told == [True])
    instance.run.end()
    until(lambda: told == [True, False])
    instance.close()


@pytest.mark.parametrize("key", ["**", "srl/**", "srl/left/**", "*/left/**"])
def test_who_hears_everything_hears_what_is_published_and_no_other_client(left: Instance, key: str) -> None:
    heard: set[str] = set()
    with plain(left) as client, plain(left) as other:
        client.declare_subscriber(key, lambda sample: heard.add(str(sample.key_expr)))
        until(lambda: {"srl/left/status", "srl/left/state/glove/position"} <= heard)
        other.put("srl/left/setpoint/client/force", "[1, 2, 3]")
        until(lambda: left.run.setpoints)
        heard.clear()
        until(lambda: "srl/left/status" in heard)
    assert not [name for name in heard if "setpoint" in name]


@pytest.mark.parametrize("key", ["**", "srl/**", "srl/left/**"])
def test_who_asks_for_everything_gets_all_that_can_be_read(left: Instance, key: str) -> None:
    with plain(left) as client:
        answers = [answer.ok for answer in client.get(key, timeout=5)]
        published = next(left.client.states("glove/position"))
    found = {str(ok.key_expr): ok for ok in answers if ok is not None}
    assert len(found) == len(answers)  # none twice, no error
    assert {"srl/left/status", "srl/left/events", "srl/left/param/object_mapping/pull"} <= set(found)
    assert json.loads(found["srl/left/state/glove/position/meta"].payload.to_bytes())["unit"] == "rad"
    sample = found["srl/left/state/glove/position"]
    assert left.client._update(sample).values[:2].tolist() == published.values[:2].tolist()  # type: ignore[arg-type]
    refused = json.loads(found["srl/left/cmd/stop"].payload.to_bytes())
    assert (refused["ok"], "exact key" in refused["error"]) == (False, True)


@pytest.mark.parametrize(
    "key",
    [
        *("**", "srl/**", "srl/**/stop", "srl/*/cmd/stop", "srl/*/cmd/start", "*/left/cmd/reset", "srl/left/cmd/st$*"),
        *(
            "srl/*/param/**",
            "srl/*/setpoint/**",
            "srl/left/setpoint/**",
            "srl/*/as/*/cmd/stop",
            "srl/l$*/setpoint/client/force",
        ),
    ],
)
def test_no_wildcard_moves_or_stops_anything(left: Instance, key: str) -> None:
    with plain(left) as client:
        for payload in (None, "2", "[1, 2, 3]"):
            answers = [answer.ok for answer in client.get(key, payload=payload, timeout=5)]
            assert answers
            assert all(ok is not None for ok in answers)
        client.put(key, "[1, 2, 3]")
        client.delete(key)
        left.client.events()  # it comes after them on the bus's thread; the loop then has all it ever gets
    head = left.run.ring.head
    until(lambda: left.run.ring.head > head + 2)
    assert (left.run.taken, left.run.setpoints) == ([], [])
    assert left.client.get_param(PULL)["value"] == 1.0
    reach(left.run_folder).close()
