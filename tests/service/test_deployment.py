"""The systemd unit, the udev rules, and the notification protocol as systemd would see it.

No systemd is needed here (`test_systemd` boots one): `systemd-analyze` reads the unit, a socket of the test's own
stands for systemd's, and the unit's own syscall rules are put on a run by libseccomp.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from fnmatch import fnmatch
from pathlib import Path

import pytest
from helpers import ROOT
from helpers.own_law import written
from helpers.run import Running, environment, refused, srl

from bench import bus_age
from srl.runtime.ipc.header import State
from srl.runtime.loop import realtime
from srl.runtime.recording.reader import read
from srl.runtime.service import supervisor
from srl.runtime.service.helpers import FINISH

DEPLOY = ROOT / "deploy"
UNIT = DEPLOY / "srl@.service"
LSL_UNIT = DEPLOY / "srl-lsl@.service"
RULES = DEPLOY / "99-srl.rules"
LONGEST_EXPOSURE = 2.5
WATCHDOG = 1.0  # s
needs_analyze = pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd-analyze")


def values(key: str) -> list[str]:
    """A directive's values, in order; an empty one forgets those before it, as in systemd."""
    return re.findall(rf"^{key}=(.*)$", UNIT.read_text(), re.MULTILINE)


def seconds(key: str) -> float:
    """A time span written as a plain number."""
    return float(values(key)[-1])


# The unit


@needs_analyze
def test_systemd_accepts_the_unit(tmp_path: Path) -> None:
    command = tmp_path / "srl"
    command.symlink_to(sys.executable)  # verify wants the program to be there
    copy = tmp_path / UNIT.name
    copy.write_text(UNIT.read_text().replace("/opt/srl/bin/srl", str(command)))
    done = subprocess.run(["systemd-analyze", "verify", str(copy)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert UNIT.name not in done.stderr, done.stderr  # an unknown key is a remark only
    copy.write_text(copy.read_text().replace("WatchdogSec=", "WatchdogSecs="))
    done = subprocess.run(["systemd-analyze", "verify", str(copy)], capture_output=True, text=True, check=False)
    assert "WatchdogSecs" in done.stderr


@needs_analyze
def test_systemd_accepts_the_unit_of_lsl(tmp_path: Path) -> None:
    command = tmp_path / "srl"
    command.symlink_to(sys.executable)
    for unit in (UNIT, LSL_UNIT):
        (tmp_path / unit.name).write_text(unit.read_text().replace("/opt/srl/bin/srl", str(command)))
    copy = tmp_path / LSL_UNIT.name
    done = subprocess.run(["systemd-analyze", "verify", str(copy)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert LSL_UNIT.name not in done.stderr, done.stderr
    # liblsl listens everywhere: without these two lines the signals are in the network.
    assert {"IPAddressDeny=any", "IPAddressAllow=localhost"} <= set(copy.read_text().splitlines())


@needs_analyze
@pytest.mark.parametrize("unit", [UNIT, LSL_UNIT], ids=lambda unit: unit.name)
def test_the_unit_is_exposed_no_more_than_it_must(unit: Path, tmp_path: Path) -> None:
    copy = tmp_path / unit.name
    shutil.copy(unit, copy)
    done = subprocess.run(
        ["systemd-analyze", "security", "--offline=true", "--no-pager", str(copy)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    found = re.search(r"Overall exposure level for .*: ([0-9.]+)", done.stdout)
    assert found is not None, done.stderr
    print(f"exposure {found[1]}")
    assert float(found[1]) <= LONGEST_EXPOSURE


def test_the_unit_agrees_with_the_code() -> None:
    assert seconds("LimitRTPRIO") == realtime.PRIORITY
    assert values("LimitMEMLOCK") == ["infinity"]
    assert seconds("Nice") == bus_age.NICE
    assert not values("RestrictRealtime")  # would refuse SCHED_FIFO
    assert not values("PrivateDevices")  # would hide the ports
    assert not values("PrivateNetwork")  # `srl stop` is answered at an abstract socket of the host's
    assert seconds("WatchdogSec") * 1e9 > 2 * supervisor.HUNG  # the supervisor stops the actuators first
    assert seconds("TimeoutStopSec") > FINISH
    assert values("Environment")[-1] == "SRL_RUNTIME_DIR=/run/srl"
    assert values("RuntimeDirectory") == ["srl/%i"]
    # The mark of a crash must outlive the unit, or the next start isn't into the stop.
    assert values("RuntimeDirectoryPreserve") == ["yes"]
    # With `mixed` the loop would be killed at once when its supervisor has died.
    assert values("KillMode") == ["control-group"]


def test_the_unit_is_as_the_page_says_and_never_moves_a_limb_by_itself() -> None:
    page = (ROOT / "docs" / "deployment.md").read_text()
    (table,) = re.findall(r"^\| directive \| reason \|\n\|.*\n((?:\|.*\n)+)", page, re.MULTILINE)
    output = 0
    for line in table.splitlines():
        cell = line.split("|")[1].strip()
        for key, value in re.findall(r"`(\w+)(?:=([^`]*))?`", cell):
            found = values(key)
            assert bool(found) is not cell.startswith("not "), key
            assert not value or found == [value], key
            output += 1
    assert output > 15
    assert " --set start=manual $SRL_OPTIONS" in values("ExecStart")[0]


def test_the_service_runs_no_code_of_a_file_unless_its_options_say_so(tmp_path: Path) -> None:
    profile = written(tmp_path, "raise AssertionError('it was run')")
    command = values("ExecStart")[0].replace("${SRL_PROFILE}", str(profile)).replace("%i", "left")
    found = {}
    for options in ("", "--run-code"):
        _, *arguments = command.replace("$SRL_OPTIONS", options).split()
        found[options] = refused(*arguments)
    assert "isn't run: code in files was turned off here. Turn it on with --run-code" in found[""]
    assert "AssertionError: it was run" in found["--run-code"]


@pytest.mark.slow
def test_the_units_command_is_one_that_srl_takes(tmp_path: Path) -> None:
    """With the specifiers filled in, and a duration so that it ends."""
    command = values("ExecStart")[0].replace("${SRL_PROFILE}", "sixth-finger").replace("%i", "left")
    program, *arguments = command.replace("$SRL_OPTIONS", "--sim --duration 0.5 --set bus=null").split()
    assert program == "/opt/srl/bin/srl"
    done = subprocess.run(
        srl(*arguments), env=environment(tmp_path), cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "ready" in done.stderr
    assert "active" not in done.stderr  # a service doesn't move a limb unasked
    assert (tmp_path / "run" / "left").is_dir()


# What systemd hears


@contextmanager
def listening(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    """A NOTIFY_SOCKET, and the watchdog's period, in the environment of what is started meanwhile."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as ours:
        ours.bind(str(folder / "notify"))
        monkeypatch.setenv("NOTIFY_SOCKET", str(folder / "notify"))
        monkeypatch.setenv("WATCHDOG_USEC", str(round(WATCHDOG * 1e6)))
        yield ours


def hear(ours: socket.socket, timeout: float) -> bytes:
    """The next message; b"" if none comes in time."""
    ours.settimeout(timeout)
    try:
        return ours.recv(4096)
    except TimeoutError:
        return b""


@pytest.mark.slow
def test_ready_then_watchdog_then_a_safe_stop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments = ("sixth-finger", "--sim", "--duration", "60", "--set", "bus=null")
    with listening(tmp_path, monkeypatch) as ours, Running(tmp_path, *arguments) as run:
        heard = hear(ours, 40)
        while heard == b"WATCHDOG=1":  # the first cycle may ping before it says that it is up
            heard = hear(ours, 10)
        assert heard == b"READY=1"
        assert run.reader.head >= 1  # the loop itself said so
        begun = time.monotonic()
        for _ in range(6):
            assert hear(ours, 5) == b"WATCHDOG=1"
        print(f"6 pings in {time.monotonic() - begun:.2f} s")
        run.until(lambda: run.header("state") == State.ACTIVE, "motion")
        run.process.send_signal(signal.SIGTERM)
        found = run.finish(code=0)
    assert (found["state"], found["cause"]) == ("ended", "request")
    assert "(request)" in run.stderr


@pytest.mark.exhaustive
@pytest.mark.slow
def test_the_watchdog_falls_silent_with_the_loop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The supervisor can't speak for a loop that hangs. Both are halted here, as a stuck machine would do."""
    arguments = ("sixth-finger", "--sim", "--duration", "60", "--set", "bus=null")
    with listening(tmp_path, monkeypatch) as ours, Running(tmp_path, *arguments) as run:
        run.started()
        run.until(lambda: "loop" in run.children(), "the loop")
        loop = run.children()["loop"]
        os.kill(run.process.pid, signal.SIGSTOP)
        os.kill(loop, signal.SIGSTOP)
        ours.setblocking(False)
        time.sleep(0.1)
        with contextlib.suppress(BlockingIOError):  # what came before
            while ours.recv(4096):
                pass
        assert hear(ours, 2 * WATCHDOG) == b""
        os.kill(run.process.pid, signal.SIGCONT)  # the supervisor finds the silence and ends the loop
        found = run.finish(code=1)
    assert "no sign of life" in found["death"]["how"]


@pytest.mark.slow
def test_a_stop_signal_to_all_processes_is_a_safe_stop(tmp_path: Path) -> None:
    """What `systemctl stop` does with KillMode=control-group."""
    with Running(tmp_path, "sixth-finger", "--sim", "--duration", "60", "--record", "x.rrd") as run:
        run.started()
        run.until(lambda: set(run.children()) == {"loop", "bus", "recorder"}, "all processes")
        run.until(run.run_folder.bus_socket.exists, "the bus's socket")
        run.until(lambda: run.reader.consumed > 0, "recorded rows")
        run.until(lambda: run.header("state") == State.ACTIVE, "motion")
        for pid in (run.process.pid, *run.children().values()):
            os.kill(pid, signal.SIGTERM)
        found = run.finish(code=0)
    assert (found["state"], found["cause"]) == ("ended", "request")
    assert found["recording_complete"] is True
    recording = read(tmp_path / "x.rrd")
    assert recording.missing == []
    assert len(recording.rows) == found["cycles"]


# What the unit's syscall rules let a run do

ALLOW, EPERM, MASKED = 0x7FFF0000, 0x00050001, 7
WRITE, EXEC = 2, 4
FAMILIES = {"AF_UNIX": 1, "AF_INET": 2, "AF_INET6": 10, "AF_NETLINK": 16, "AF_CAN": 29}


class Comparison(ctypes.Structure):
    """libseccomp's `scmp_arg_cmp`."""

    _fields_ = (("arg", ctypes.c_uint), ("op", ctypes.c_int), ("a", ctypes.c_uint64), ("b", ctypes.c_uint64))


def members(group: str) -> set[str]:
    """The system calls of one of systemd's groups."""
    done = subprocess.run(["systemd-analyze", "syscall-filter", group], capture_output=True, text=True, check=True)
    found: set[str] = set()
    for line in done.stdout.splitlines()[1:]:
        word = line.strip()
        if word and not word.startswith("#"):
            found |= members(word) if word.startswith("@") else {word}
    return found


def confine() -> None:
    """Puts SystemCallFilter=, MemoryDenyWriteExecute= and RestrictAddressFamilies= on this process for good."""
    lib = ctypes.CDLL("libseccomp.so.2")
    lib.seccomp_init.restype = ctypes.c_void_p
    lib.seccomp_init.argtypes = [ctypes.c_uint32]
    lib.seccomp_rule_add_array.argtypes = [
        ctypes.c_void_p, ctypes.c_uint32, ctypes.c_int, ctypes.c_uint, ctypes.POINTER(Comparison)
    ]  # fmt: skip
    lib.seccomp_load.argtypes = [ctypes.c_void_p]
    context = lib.seccomp_init(EPERM)

    def allow(name: str, *when: tuple[int, int, int]) -> None:
        number = lib.seccomp_syscall_resolve_name(name.encode())
        rules = (Comparison * len(when))(*(Comparison(arg, MASKED, mask, value) for arg, mask, value in when))
        if number >= 0:
            assert lib.seccomp_rule_add_array(context, ALLOW, number, len(when), rules) == 0

    allowed = members("@default")
    for words in values("SystemCallFilter"):
        for word in words.removeprefix("~").split():
            allowed = allowed - members(word) if words.startswith("~") else allowed | members(word)
    for name in allowed - {"mmap", "mprotect", "pkey_mprotect", "socket"}:
        allow(name)
    assert values("MemoryDenyWriteExecute") == ["yes"]
    for protection in (0, WRITE, EXEC):
        allow("mmap", (2, WRITE | EXEC, protection))
    allow("mprotect", (2, EXEC, 0))
    for family in values("RestrictAddressFamilies")[0].split():
        allow("socket", (0, 0xFFFFFFFF, FAMILIES[family]))
    assert ctypes.CDLL(None).prctl(38, 1, 0, 0, 0) == 0  # PR_SET_NO_NEW_PRIVS
    assert lib.seccomp_load(context) == 0


CONFINED = """
import mmap, os, socket, sys
sys.path[:0] = [sys.argv.pop(1), sys.argv.pop(1), sys.argv.pop(1)]
import test_deployment
test_deployment.confine()
refused = 0
for forbidden in (lambda: os.chown(".", -1, -1), lambda: os.chroot("/"),
                  lambda: mmap.mmap(-1, 4096, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC),
                  lambda: socket.socket(socket.AF_PACKET, socket.SOCK_RAW)):
    try:
        forbidden()
    except PermissionError:
        refused += 1
print("refused", refused, flush=True)
os.execv(sys.executable, [sys.executable, "-m", "srl", *sys.argv[1:]])
"""


@pytest.mark.slow
@needs_analyze
def test_a_run_lives_within_the_units_syscall_rules(tmp_path: Path) -> None:
    """Simulated devices, with bus and recorder; serial ports only add what a terminal needs (@io-event, ioctl)."""
    try:
        ctypes.CDLL("libseccomp.so.2")
    except OSError:
        pytest.skip("no libseccomp")
    arguments = ("run", "sixth-finger", "--sim", "--duration", "1.5", "--record", "x.rrd", "--json")
    done = subprocess.run(
        [sys.executable, "-c", CONFINED, str(Path(__file__).parent), str(ROOT), str(ROOT / "tests"), *arguments],
        env=environment(tmp_path), cwd=tmp_path, capture_output=True, text=True, timeout=100, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "refused 4" in done.stdout  # the rules were there
    assert '"restarts": {"bus": 0, "recorder": 0}' in done.stdout
    assert (tmp_path / "x.rrd").exists()


# The container


def test_the_container_is_well_formed_and_starts_the_command() -> None:
    hadolint = shutil.which("hadolint", path=str(Path(sys.executable).parent))
    assert hadolint is not None  # of the development's packages
    file = ROOT / "deploy" / "Containerfile"
    done = subprocess.run([hadolint, str(file)], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout) == (0, "")
    text = file.read_text()
    assert 'ENTRYPOINT ["srl"]' in text
    wheel = re.search(r'pip install --no-cache-dir "\$\(ls (/wheels/\S+)\)', text)
    assert wheel is not None
    assert fnmatch("/wheels/srl_runtime-0.1.0-cp311-abi3-linux_x86_64.whl", wheel[1])


# udev


def test_udev_rules_are_well_formed() -> None:
    """`udevadm verify` isn't everywhere; the shape of a rule is: KEY OP "value", at least one of them an assignment."""
    item = re.compile(
        r'^(ACTION|SUBSYSTEMS?|KERNELS?|DRIVERS|ATTRS?\{\w+\}|ENV\{\w+\}|GROUP|MODE|SYMLINK)(==|\+=|=)"([^"]+)"$'
    )
    text = RULES.read_text()
    rules = [line for line in text.splitlines() if line and not line.startswith("#")]
    samples = [line.removeprefix("# ") for line in text.splitlines() if line.startswith("# SUBSYSTEM")]
    assert rules
    assert samples
    for rule in rules + samples:
        parts = [item.match(part.strip()) for part in rule.split(", ")]
        assert all(parts), rule
        operators = {part[1]: part[2] for part in parts if part}
        assert set(operators.values()) > {"=="} or set(operators.values()) & {"=", "+="}
        assert "==" in operators.values(), f"matches everything: {rule}"
        # ATTRS matches a parent and can't be written; ATTR is the device's own.
        assert operators.get("ATTR{latency_timer}", "=") == "="
        assert all(op == "==" for key, op in operators.items() if key.startswith(("ATTRS", "SUBSYSTEM", "KERNEL")))
