"""The bus process, spawned, with clients beside it."""

from __future__ import annotations

import json
import signal
import stat
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import zenoh
from helpers.bus import JOINTS, Instance, Run, reach, sockets, spawn
from helpers.run import alive
from helpers.wait import until

from srl.runtime.bus import session
from srl.runtime.bus.client import connect
from srl.runtime.contracts.errors import RequestError
from srl.runtime.ipc import run_folder
from srl.runtime.ipc.header import State
from srl.runtime.ipc.requests import RequestKind
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.messages import cdr, messages

PULL = "object-mapping.pull"


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Instance]:
    instance = Instance(tmp_path_factory.mktemp("bus") / "sixth-finger")
    yield instance
    instance.close()


@pytest.fixture
def one(shared: Instance) -> Instance:
    shared.run.state, shared.run.fault = State.READY, False
    shared.run.setpoints.clear()
    shared.run.taken.clear()
    return shared


@pytest.fixture
def own(tmp_path: Path) -> Iterator[Instance]:
    instance = Instance(tmp_path / "own")
    yield instance
    instance.close()


def test_another_process_reads_states(one: Instance) -> None:
    script = f"""
import json
from srl.runtime.bus.client import connect
found = {{}}
with connect({str(one.run_folder.path)!r}) as client:
    for update in client.states(timeout=5):
        found[update.name] = [update.kind, update.labels, update.values.tolist(), update.stamp]
        if len(found) == 7:
            break
    print(json.dumps([found, client.meta()]))
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=30, check=True)
    found, meta = json.loads(done.stdout)
    kind, labels, values, stamp = found["glove/position"]
    assert (kind, labels, values[:2]) == ("sensor_msgs/msg/JointState", list(JOINTS), [0.1, 0.2])
    assert abs(stamp - time.time()) < 10
    assert found["glove/pose"][2] == [1, 2, 3, 0.5, -0.5, 0.5, -0.5]
    assert found["hand/tips"][2] == np.arange(15.0).reshape(5, 3).tolist()
    assert found["finger/position_command/applied"][2][1] == 1.0
    assert meta["hand/tips"] == {
        "name": "hand.tips",
        "role": "internal",
        "type": "std_msgs/msg/Float64MultiArray",
        "unit": "m",
        "frame": "palm",
        "labels": ["thumb", "index", "middle", "ring", "little"],
        "slots": False,
        "components": [["x", "y", "z"]],
        "shape": [5, 3],
    }


def test_every_tenth_row_is_published(one: Instance) -> None:
    stamps: list[float] = []
    for update in one.client.states("glove/position", timeout=5):
        assert update.stamp is not None
        stamps.append(update.stamp)
        if len(stamps) == 21:
            break
    # The rows' own times, so no judgement on this machine's speed: 10 cycles of 5 ms, on average.
    assert (stamps[-1] - stamps[0]) / 20 == pytest.approx(0.05, rel=0.5)


def test_status_tells_state_rate_and_devices(one: Instance) -> None:
    status = one.client.status()
    assert (status["instance"], status["state"], status["level"]) == ("sixth-finger", "ready", 0)
    assert status["rate_nominal_hz"] == 200
    assert (status["read_us"], status["log_us"], status["cycle_p50_us"]) == (20, 3, 80)
    assert status["devices"]["glove"]["driver"] == "cyberglove"
    assert status["devices"]["glove"]["age_ms"] == 2.0
    assert status["devices"]["finger"]["message"] == "connected, active"
    assert status["devices"]["client"]["age_ms"] == -1.0
    assert [n["text"] for n in one.client.events()] == ["ready"]


def test_start_stop_reset(one: Instance) -> None:
    assert one.client.command("start") == {"ok": True, "state": "active"}
    with pytest.raises(RequestError, match="not possible while active"):
        one.client.command("start")
    assert one.client.command("stop") == {"ok": True, "state": "stopped"}
    one.run.fault = True
    with pytest.raises(RequestError, match=r"still there: an actuator is stale or gone \(finger\)"):
        one.client.command("reset")
    one.run.fault = False
    assert one.client.command("reset") == {"ok": True, "state": "active"}
    with pytest.raises(RequestError, match="there is no such command"):
        one.client.command("sotp")


def test_a_change_of_state_is_told_at_once(one: Instance) -> None:
    reported: list[str] = []
    subscriber = one.client.subscribe_status(lambda s: reported.append(s["message"]))
    for name in ("start", "stop", "reset"):
        one.client.command(name)
    until(lambda: reported and reported[-1] == "active")
    subscriber.undeclare()
    assert "stopped: stopped on request" in reported


def test_parameters(one: Instance) -> None:
    assert one.client.set_param(PULL, 2.5)["value"] == 2.5
    found = one.client.get_param(PULL)
    assert (found["value"], found["lower"], found["upper"], found["unit"]) == (2.5, 0.0, 5.0, "N")
    assert list(one.client.parameters()) == [PULL]
    taken = len(one.run.taken)
    for value, output in (
        (float("nan"), "NaN"),
        (float("inf"), "infinite"),
        (5.01, "out of bounds"),
        (-1, "0 to 5 N"),
    ):
        with pytest.raises(RequestError, match=output):
            one.client.set_param(PULL, value)
    assert len(one.run.taken) == taken
    assert one.client.get_param(PULL)["value"] == 2.5
    for wrong in ([1.0, 2.0], [1.0], "1.5", None, {"value": 1.0}, True):
        with pytest.raises(RequestError, match=r"param/object_mapping/pull: a parameter takes one number, not"):
            one.client.set_param(PULL, wrong)  # type: ignore[arg-type]
    assert len(one.run.taken) == taken
    assert one.client.set_param(PULL, np.float32(2.0))["value"] == 2.0


def test_a_name_that_is_not_there_is_answered_with_those_that_are(one: Instance) -> None:
    with pytest.raises(RequestError, match=r"no parameter 'object_mapping.push'.*Did you mean 'object-mapping.pull'"):
        one.client.get_param("object-mapping.push")
    with pytest.raises(RequestError, match=r"no setpoint 'client.torque'.*client.force"):
        one.client.setpoint("client.torque", [1.0, 2.0, 3.0])
    with session.join(f"unixsock-stream/{one.run_folder.bus_socket}") as stranger:
        (answer,) = stranger.get("srl/sixth_finger/cmd/sotp", timeout=5)
        assert answer.ok is not None
        content = json.loads(answer.ok.payload.to_bytes())
        assert content["ok"] is False
        assert "there is no command 'sotp'. Did you mean 'stop'?" in content["error"]
        before = one.client.status()["rejected_setpoints"]
        stranger.put("srl/sixth_finger/setpoint/client/torque", "[1, 2, 3]")
        status = until(lambda: (s := one.client.status())["rejected_setpoints"] == before + 1 and s)
        assert "there is no setpoint 'client.torque'" in status["last_rejection"]
    assert (one.run.taken, one.run.setpoints) == ([], [])
    (known,) = [answer.ok for answer in _ask(one, "srl/sixth_finger/cmd/stop")]
    assert known is not None  # one answer only: the one for other names is silent
    assert json.loads(known.payload.to_bytes()) == {"ok": True, "state": "stopped"}


def _ask(one: Instance, key: str) -> list[zenoh.Reply]:
    with session.join(f"unixsock-stream/{one.run_folder.bus_socket}") as stranger:
        return list(stranger.get(key, timeout=5))


def test_an_instance_is_found_by_its_name_in_the_services_folder(
    own: Instance, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SRL_RUNTIME_DIR", str(tmp_path / "other"))
    with pytest.raises(RequestError, match=r"no bus listens at .*other/own/zenoh.sock.*SRL_RUNTIME_DIR"):
        connect("own")
    monkeypatch.setattr(run_folder, "SERVICES", tmp_path)
    monkeypatch.setattr(run_folder, "check_owners", lambda _: None)  # of what is above a test's folder
    own.run_folder.claim()
    try:
        with connect("own") as client:
            assert client.instance == "own"
    finally:
        own.run_folder.release()


def test_a_setpoint_that_is_read_is_described(one: Instance) -> None:
    (answer,) = _ask(one, "srl/sixth_finger/setpoint/client/force")
    assert answer.ok is not None
    reported = json.loads(answer.ok.payload.to_bytes())
    assert (reported["ok"], reported["name"], reported["shape"], reported["unit"]) == (True, "client.force", [3], "N")
    assert reported["max_age"] == 0.5


def test_nothing_is_said_to_be_well_before_a_first_setpoint_has_arrived(own: Instance) -> None:
    output = own.client.status()["devices"]["client"]
    assert (output["message"], output["level"]) == ("no setpoint yet", 1)
    own.client.setpoint("client.force", [1.0, 2.0, 3.0], answer=True)
    assert own.run.setpoints  # the answer came after the loop had it
    output = until(lambda: (d := own.client.status()["devices"]["client"])["level"] == 0 and d)
    assert output["message"] == "connected"


def test_many_requests_at_once_are_all_answered(one: Instance) -> None:
    answers: list[float] = []
    threads = [
        threading.Thread(target=lambda v=v: answers.append(one.client.set_param(PULL, v / 10)["value"]))
        for v in range(12)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(answers) == [v / 10 for v in range(12)]


@pytest.mark.parametrize("pattern", ["cmd/*", "**", "cmd/stop/**", "param/**", "setpoint/**"])
def test_a_wildcard_moves_nothing(one: Instance, pattern: str) -> None:
    before = one.client.get_param(PULL)["value"]
    with session.join(f"unixsock-stream/{one.run_folder.bus_socket}") as stranger:
        answers = list(stranger.get(f"srl/sixth_finger/{pattern}", payload="[1, 2, 3]", timeout=2))
        answers += list(stranger.get(f"srl/sixth_finger/{pattern}", payload="1", timeout=2))
    found = [a.ok for a in answers if a.ok is not None and str(a.ok.encoding) == messages.JSON]
    contents = [json.loads(ok.payload.to_bytes()) for ok in found]
    assert all("exact key" in c["error"] for c in contents if isinstance(c, dict) and "ok" in c)
    one.client.status()
    assert (one.run.taken, one.run.setpoints) == ([], [])
    assert one.client.get_param(PULL)["value"] == before


def test_setpoints_reach_the_loop(one: Instance) -> None:
    def last() -> list[float]:
        return one.run.setpoints[-1][1].tolist() if one.run.setpoints else []

    asked = time.monotonic_ns()
    one.client.setpoint("client.force", [1.0, 2.0, 3.0], answer=True)
    until(lambda: last() == [1, 2, 3])
    expires = one.run.setpoints[-1][0]
    assert asked + 500_000_000 <= expires <= time.monotonic_ns() + 500_000_000
    one.client.setpoint("client.force", np.array([4.0, 5, 6]))
    until(lambda: last() == [4, 5, 6])
    header = {"stamp": messages.time_of(0), "frame_id": ""}
    joints = {"header": header, "name": [], "position": [0, 0, 0], "velocity": [], "effort": [7, 8, 9]}  # in N
    with session.join(f"unixsock-stream/{one.run_folder.bus_socket}") as stranger:
        key = "srl/sixth_finger/setpoint/client/force"
        stranger.put(key, cdr.encode(messages.JOINT_STATE, joints), encoding=messages.encoding(messages.JOINT_STATE))
        until(lambda: last() == [7, 8, 9])
        stranger.put(key, "[0, 1, 2]")
        until(lambda: last() == [0, 1, 2])


def test_bad_setpoints_are_refused_and_counted(one: Instance) -> None:
    before = one.client.status()["rejected_setpoints"]
    with pytest.raises(RequestError, match="NaN or infinite"):
        one.client.setpoint("client.force", [1, float("nan"), 3], answer=True)
    one.client.setpoint("client.force", [1, 2])
    status = until(lambda: (s := one.client.status())["rejected_setpoints"] == before + 2 and s)
    assert "2 values came where the signal has 3" in status["last_rejection"]
    assert one.run.setpoints == []


def test_nobody_else_speaks_for_the_instance(one: Instance) -> None:
    heard: list[bytes] = []
    endpoint = f"unixsock-stream/{one.run_folder.bus_socket}"
    with session.join(endpoint) as listener, session.join(endpoint) as forger:
        subscriber = listener.declare_subscriber("srl/**", lambda s: heard.append(s.payload.to_bytes()))
        until(lambda: heard)
        forger.put("srl/sixth_finger/state/glove/position", b"forged")
        forger.put("srl/sixth_finger/status", b"forged")
        forger.put("srl/sixth_finger/setpoint/client/force", "[1, 1, 1]")
        until(lambda: one.run.setpoints)
        count = len(heard)
        until(lambda: len(heard) > count + 5)
        subscriber.undeclare()
    assert b"forged" not in heard


def test_it_listens_on_its_unix_socket_and_nowhere_else(one: Instance) -> None:
    assert sockets(one.process.pid) == {f"unix {one.run_folder.bus_socket}"}
    assert stat.S_IMODE(one.run_folder.bus_socket.stat().st_mode) == 0o660


def test_two_instances_do_not_see_each_other(one: Instance, own: Instance) -> None:
    for mine, other in ((one, own), (own, one)):
        names: list[str] = []
        with session.join(f"unixsock-stream/{mine.run_folder.bus_socket}") as listener:
            subscriber = listener.declare_subscriber(
                "srl/**", lambda s, names=names: names.append(str(s.key_expr).split("/")[1])
            )
            until(lambda names=names: names)
            own_state = mine.run.cause, other.run.taken.copy()
            mine.client.command("stop")
            heard = len(names)
            until(lambda names=names, heard=heard: len(names) > heard + 50)
            subscriber.undeclare()
            assert set(names) == {mine.client.keys.root.split("/")[1]}
            assert list(listener.get(f"{other.client.keys.root}/cmd/stop", timeout=1)) == []
            assert other.run.taken == own_state[1]


def test_a_killed_bus_comes_back(own: Instance) -> None:
    updates: list[float] = []
    own.client.subscribe(lambda u: updates.append(u.values[2]), "glove/position")
    until(lambda: updates)
    head = own.run.ring.head
    own.process.kill()
    own.process.wait()
    assert not own.client.alive()
    count = len(updates)
    replaced, own.process = own.process, spawn(own.run_folder, stderr=subprocess.PIPE)
    assert replaced.stderr is not None
    replaced.stderr.close()
    until(own.client.alive)
    until(lambda: len(updates) > count)  # the same subscription, on the same client
    assert own.client.command("start") == {"ok": True, "state": "active"}
    assert own.client.set_param(PULL, 3.0)["value"] == 3.0
    assert own.run.taken == [RequestKind.START, RequestKind.PARAMETER]
    assert own.run.ring.head > head
    assert sockets(own.process.pid) == {f"unix {own.run_folder.bus_socket}"}


def test_a_dead_loop_is_said_clearly(own: Instance) -> None:
    own.run.paused.set()
    status = until(lambda: (s := own.client.status())["level"] == 3 and s)
    assert status["message"] == "the loop gives no sign of life (last: ready)"
    with pytest.raises(RequestError, match="no sign of life"):
        own.client.command("stop")
    with pytest.raises(RequestError, match="no sign of life"):
        own.client.setpoint("client.force", [1, 2, 3], answer=True)
    assert own.client.get_param(PULL)["value"] == 1.0
    own.run.paused.clear()
    until(lambda: own.client.status()["level"] == 0)
    assert own.client.command("stop")["ok"]


@pytest.mark.parametrize("how", ["closed", "SIGTERM"])
def test_it_ends_in_order(tmp_path: Path, how: str) -> None:
    instance = Instance(tmp_path / "one")
    if how == "closed":
        instance.run.end()
    else:
        instance.process.send_signal(signal.SIGTERM)
    assert instance.process.wait(10) == 0
    assert not instance.client.alive()
    instance.close()
    with pytest.raises(RequestError, match="no bus listens"):
        connect(instance.run_folder)


def test_it_does_not_outlive_its_supervisor(tmp_path: Path) -> None:
    run = Run(RunFolder(tmp_path / "one"), 100)
    run.start()
    script = (
        "import subprocess, sys, time\n"
        "p = subprocess.Popen([sys.executable, '-m', 'srl.runtime.bus', sys.argv[1]])\n"
        "print(p.pid, flush=True)\ntime.sleep(60)\n"
    )
    supervisor = subprocess.Popen([sys.executable, "-c", script, str(run.run_folder.path)], stdout=subprocess.PIPE)
    assert supervisor.stdout is not None
    pid = int(supervisor.stdout.readline())
    reach(run.run_folder).close()
    supervisor.kill()
    supervisor.wait()
    supervisor.stdout.close()
    until(lambda: not alive(pid), what="the bus's end")
    run.end()


def test_a_run_directory_that_is_none_is_said(tmp_path: Path) -> None:
    process = spawn(RunFolder(tmp_path), stderr=subprocess.PIPE)
    _, output = process.communicate(timeout=30)
    assert process.returncode == 2
    assert b"Traceback" not in output
