"""`srl doctor` on a host where everything is as it should be, and on one with what a lab meets at two in the morning.

The host is real: mounts and interfaces in namespaces of its own, ptys, limits and capabilities of a process, files.
"""

from __future__ import annotations

import datetime
import json
import os
import pty
import shlex
import subprocess
import tty
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from cryptography import x509
from helpers import ROOT
from helpers.run import call, environment, srl

from srl.runtime import __version__
from srl.runtime.bus import certificates
from srl.runtime.bus.certificate_warnings import warnings
from srl.runtime.bus.certificates import authority, sign
from srl.runtime.cli import main
from srl.runtime.contracts import compiled
from srl.runtime.contracts.tls import TlsConfig
from srl.runtime.ipc.ring import RingReader, RingWriter
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.service.fitness import can, processor, storage

SOMEBODY = 12345  # a user's number
PROFILE = """
name: host
rate: 500
devices:
  glove: {driver: cyberglove, port: GLOVE, sensors: 22}
  finger:
    driver: firmata
    port: FINGER
    servos: {swing: {pin: 9, lower: -1.571, upper: 1.571, home: 0.0}}
  trunk: {driver: bno085, port: TRUNK, frame: trunk}
  handle: {driver: ati-netft, port: "udp://172.16.0.2", frame: trunk}
controllers:
  - use: joint-setpoint
    joints: [swing]
    in: {target: client.position}
    out: {q: finger.position_command, q_velocity: finger.position_command.velocity}
setpoints: {client.position: {shape: [1], unit: rad, labels: [swing], max_age: 0.5}}
guard: {finger.position_command: {velocity: 1.0, acceleration: 5.0}}
stop: {finger: hold}
frames: {trunk: {}}
bus:
  listen: [tls/127.0.0.1:7447]
  tls: {ca: FOLDER/ca.pem, certificate: FOLDER/robot.pem, key: FOLDER/robot.key}
  roles: {operator: [anna]}
"""
SETUP = """
set -e
mount -t sysfs sysfs /sys
ip link set lo up
for over in /sys/bus /sys/devices/system/cpu /etc/udev /etc/systemd/system /opt; do mount -t tmpfs tmpfs $over; done
mkdir -p /sys/bus/usb-serial/devices/ttyUSB0 /sys/devices/system/cpu/cpu0/cpufreq /etc/udev/rules.d /opt/srl/bin
echo $LATENCY > /sys/bus/usb-serial/devices/ttyUSB0/latency_timer
echo $GOVERNOR > /sys/devices/system/cpu/cpu0/cpufreq/scaling_governor
mount -t tmpfs -o size=$MEMORY tmpfs /dev/shm
mount -t tmpfs -o size=$DISK tmpfs $FOLDER/recordings
cp $ROOT/deploy/srl@.service /etc/systemd/system/
ln -s $INTERPRETER /opt/srl/bin/python
printf '#!/opt/srl/bin/python\\n' > /opt/srl/bin/srl
if [ $SOUND = yes ]; then
    cp $ROOT/deploy/99-srl.rules /etc/udev/rules.d/
    ip link add arm0 type $KIND
    ip addr add 172.16.0.1/24 dev arm0
    ip link set arm0 up
    exec "$@"
fi
python3 -c '
import socket
with socket.create_server(("127.0.0.1", 7447)) as taken:
    print("up", flush=True)
    taken.accept()' > $FOLDER/up &
trap "kill $!" EXIT
while [ ! -s $FOLDER/up ]; do sleep 0.01; done
prlimit --rtprio=0 --memlock=65536 setpriv --bounding-set -sys_nice,-ipc_lock,-dac_override,-dac_read_search "$@"
"""
SOUND = {"SOUND": "yes", "LATENCY": "1", "GOVERNOR": "performance", "MEMORY": "400m", "DISK": "4g"}
ILL = {"SOUND": "no", "LATENCY": "16", "GOVERNOR": "powersave", "MEMORY": "8m", "DISK": "100m"}
# What is found of the ill host, and a part of what is to be typed.
SEEDED = {
    "real-time priority": ("bad", "is refused", "rtprio 80"),
    "locked memory": ("bad", "limited to 0.0625 MiB", "memlock unlimited"),
    "processor clock": ("doubtful", "powersave", "echo performance"),
    "runtime folder": ("bad", "8 MiB free; a run's rows take", "mount -o remount,size="),
    "recordings' folder": ("bad", "100 MiB free", "srl recordings"),
    "service": ("bad", "203/EXEC", "/usr/bin/python3 -m venv"),
    "port of glove": ("bad", "may not be opened", "usermod -aG"),
    "port of finger": ("bad", "isn't there", "srl find-port"),
    "port of trunk": ("doubtful", "has it open", "fuser -v"),
    "USB latency of ttyUSB0": ("doubtful", "16 ms", "echo 1"),
    "udev rules": ("doubtful", "no *-srl.rules", "deploy/99-srl.rules"),
    "network of handle": ("bad", "no route leads to 172.16.0.2", "ip addr add 172.16.0.3/24"),
    "bus at tls/127.0.0.1:7447": ("bad", "already in use", "sport = :7447"),
    "certificates of the bus": ("bad", "has expired", "srl keys"),
}


def expired(folder: Path, name: str, patch: pytest.MonkeyPatch) -> None:
    """Signs a certificate that was valid until yesterday."""
    started = certificates._begun
    now = datetime.datetime.now(datetime.UTC)

    def before(*given: Any) -> x509.CertificateBuilder:
        made = started(*given)
        made._not_valid_before = made._not_valid_after = None
        return made.not_valid_before(now - datetime.timedelta(9)).not_valid_after(now - datetime.timedelta(1))

    with patch.context() as meanwhile:
        meanwhile.setattr(certificates, "_begun", before)
        sign(folder, name, ["localhost"], 1)


@pytest.fixture
def ports() -> Iterator[list[tuple[str, int]]]:
    """Three ptys: their path, and a descriptor of the other end."""
    made = [pty.openpty() for _ in range(3)]
    found = []
    for master, slave in made:
        tty.setraw(slave)
        found.append((os.ttyname(slave), master))
        os.close(slave)
    yield found
    for master, _ in made:
        os.close(master)


def needs_namespaces() -> str | None:
    """A kind of interface that can be made here; None: no host of one's own can be made."""
    if os.geteuid() != 0:
        return None
    for kind in ("dummy", "ifb"):
        trial = ["unshare", "-mn", "sh", "-c", f"mount -t sysfs sysfs /sys && ip link add arm0 type {kind}"]
        if subprocess.run(trial, capture_output=True, check=False).returncode == 0:
            return kind
    return None


def examined(folder: Path, host: dict[str, str], ports: list[tuple[str, int]]) -> tuple[int, dict[str, Any], str]:
    """Exit code, findings by what was checked, and the same as people read it."""
    kind = needs_namespaces()
    if kind is None:
        pytest.skip("mounts and interfaces of one's own take root, unshare and ip")
    paths = [path for path, _ in ports]
    if host is ILL:
        os.chown(paths[0], SOMEBODY, SOMEBODY)
        os.chmod(paths[0], 0o600)
        paths[1] = "/dev/ttyUSB9"
    text = PROFILE.replace("FOLDER", str(folder))
    for name, path in zip(("GLOVE", "FINGER", "TRUNK"), paths, strict=True):
        text = text.replace(name, path)
    (folder / "host.yaml").write_text(text)
    (folder / "recordings").mkdir(exist_ok=True)
    reported = environment(folder) | host | {"FOLDER": str(folder), "ROOT": str(ROOT), "KIND": kind}
    reported |= {"INTERPRETER": "/home/lab/python3" if host is ILL else "/bin/true", "SRL_RUNTIME_DIR": "/dev/shm/srl"}
    found = []
    held = os.open(paths[2], os.O_RDWR | os.O_NOCTTY) if host is ILL else -1
    for form in ("--json", None):
        words = srl("doctor", "host.yaml", "--recordings", str(folder / "recordings"), *filter(None, [form]))
        command = ["unshare", "-mn", "sh", "-c", SETUP, "sh", *words]
        done = subprocess.run(
            command, env=reported, cwd=folder, capture_output=True, text=True, timeout=200, check=False
        )
        found.append(done)
        assert "Traceback" not in found[-1].stderr
        assert found[-1].stdout, found[-1].stderr
    if held >= 0:
        os.close(held)
    return found[0].returncode, {f["what"]: f for f in json.loads(found[0].stdout)["findings"]}, found[1].stdout


@pytest.mark.slow
@pytest.mark.timeout(420)  # two examinations of 200 s at most, of ordinary priority beside loops of real time
def test_each_of_what_was_seeded_is_found_with_what_to_type(
    tmp_path: Path, ports: list[tuple[str, int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    authority(tmp_path)
    expired(tmp_path, "robot", monkeypatch)
    code, findings, output = examined(tmp_path, ILL, ports)
    assert code == 1
    for what, (verdict, words, command) in SEEDED.items():
        finding = findings[what]
        assert (finding["verdict"], words in finding["found"], command in finding["command"]) == (verdict, True, True)
        assert f"{what}: {finding['found'].split(' (')[0]}" in output
        assert f"      $ {finding['command']}" in output
    assert f"({os.getpid()})" in findings["port of trunk"]["found"]
    shlex.split(" ".join(finding["command"] for finding in findings.values()))  # a shell takes them


@pytest.mark.slow
@pytest.mark.timeout(420)
def test_a_sound_host_has_none_of_it(tmp_path: Path, ports: list[tuple[str, int]]) -> None:
    authority(tmp_path)
    sign(tmp_path, "robot", ["localhost"], 300)
    _, findings, _ = examined(tmp_path, SOUND, ports)
    assert {what: findings[what]["found"] for what in SEEDED if findings[what]["verdict"] != "good"} == {}


@pytest.fixture
def interface(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A CAN interface as the kernel shows it, and an `ip` that says 500 kbit/s: this kernel may have no CAN."""
    monkeypatch.setattr(can, "NETWORK", tmp_path)
    at = tmp_path / "can0"
    at.mkdir()
    for name, content in {"flags": "0x40041", "type": "280", "tx_queue_len": "1000"}.items():
        (at / name).write_text(content)
    output = [{"linkinfo": {"info_data": {"state": "ERROR-ACTIVE", "bittiming": {"bitrate": 500000}}}}]
    program = tmp_path / "ip"
    program.write_text(f"#!/bin/sh\necho {shlex.quote(json.dumps(output))}\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    return at


BRING_UP = "sudo ip link set can0 up type can bitrate 1000000 restart-ms 100"


def test_a_can_interface_is_there_and_up_at_the_devices_bit_rate(interface: Path) -> None:
    def found(bitrate: float = 1e6, bus: str = "can://socketcan/can0") -> list[tuple[str, str]]:
        return [(f.found, f.command) for f in can.interfaces({bus: bitrate}) if f.verdict != "good"]

    assert found(5e5) == found(bus="can://udp_multicast/239.74.163.2") == []
    assert found() == [("can0 has 500000 bit/s, the devices 1000000", f"sudo ip link set can0 down && {BRING_UP}")]
    assert found(bus="can://socketcan/can7") == [("there is no interface can7", BRING_UP.replace("can0", "can7"))]
    (interface / "tx_queue_len").write_text("10")
    assert found(5e5)[0][1] == "sudo ip link set can0 txqueuelen 1000"
    (interface / "type").write_text("1")
    assert found(5e5)[0][0] == "can0 is no CAN interface"
    (interface / "flags").write_text("0x40040")
    assert found() == [("can0 is down", BRING_UP)]


def test_keys_that_others_read_and_certificates_of_others_are_doubted(tmp_path: Path) -> None:
    for lab in ("ours", "theirs"):
        (tmp_path / lab).mkdir()
        authority(tmp_path / lab)
        sign(tmp_path / lab, "robot", ["localhost"], 300)
    ours, theirs = tmp_path / "ours", tmp_path / "theirs"

    def output(ca: Path, certificate: Path, key: Path, days: int = 0) -> list[tuple[bool, str, str]]:
        tls = TlsConfig(ca=str(ca), certificate=str(certificate), key=str(key))
        at = datetime.datetime.now(datetime.UTC) + datetime.timedelta(days)
        return [(warning.bad, warning.problem, warning.command) for warning in warnings(tls, at)]

    whole = (ours / "ca.pem", ours / "robot.pem", ours / "robot.key")
    anew = "srl keys FOLDER robot --host NAME"
    assert output(*whole) == []
    ((bad, problem, command),) = output(*whole, days=290)
    assert (bad, "robot.pem expires on" in problem, command) == (False, True, anew)
    assert ["isn't valid before" in problem for _, problem, _ in output(*whole, days=-1)] == [True, True]
    ((bad, problem, command),) = output(theirs / "ca.pem", *whole[1:])
    assert (bad, "isn't signed by" in problem, command) == (True, True, anew)
    ((bad, problem, command),) = output(*whole[:2], theirs / "robot.key")
    assert (bad, "isn't the certificate's key" in problem) == (True, True)
    whole[2].chmod(0o644)
    ((bad, problem, command),) = output(*whole)
    assert (bad, "mode 644" in problem, command) == (True, True, f"chmod 600 {whole[2]}")
    whole[2].chmod(0o640)  # the service's group
    assert output(*whole) == []
    whole[2].unlink()
    assert "can't be read" in output(*whole)[0][1]


def test_c_of_another_version_is_not_used_and_is_found_with_how_to_build_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    built = tmp_path / "_compiled.abi3.so"
    built.touch()
    made = SimpleNamespace(compiler="gcc", version=__version__, __file__=str(built))
    (tmp_path / "law.c").touch()
    os.utime(built, (2e9, 2e9))
    assert compiled.stale(made, tmp_path) == ""
    os.utime(tmp_path / "law.c", (2e9 + 1, 2e9 + 1))
    assert compiled.stale(made, tmp_path) == "the C here is older than its source: law.c"
    assert f'-DSRL_VERSION="{__version__}"' in (ROOT / "pyproject.toml").read_text()  # else all would be found stale
    made.version = "0.0.9"
    monkeypatch.setattr(compiled.importlib, "import_module", lambda name: made)
    for name, value in zip(("extension", "_missing", "_old"), compiled._load(), strict=True):
        monkeypatch.setattr(compiled, name, value)
    with pytest.raises(compiled.NotCompiledError, match=r"is of 0\.0\.9"):
        compiled.bind("law")
    finding = processor.laws()
    assert (finding.verdict, finding.found) == ("doubtful", f"the C here is of 0.0.9, the package of {__version__}")
    assert shlex.split(finding.command)[1:4] == ["-m", "pip", "install"]


def test_rows_that_a_dead_run_left_are_found_and_those_of_others_are_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SRL_RUNTIME_DIR", str(tmp_path))
    rings = {}
    for name in ("ended", "dead", "runs"):
        folder = RunFolder(tmp_path / name)
        folder.claim()
        rings[name] = RingWriter.create(folder.rows, 1, 8)
        rings[name].append(np.zeros(1, np.int64))
        if name != "runs":
            folder.release()
    rings["ended"].finish()
    with RingReader(RunFolder(tmp_path / "ended").rows, marks=True) as read:
        read.set_consumed(1)
    (finding,) = storage.leftovers()
    assert (finding.what, finding.verdict) == ("run folder of dead", "doubtful")
    assert "didn't end properly" in finding.found
    subprocess.run(finding.command, shell=True, check=True)
    assert [f.verdict for f in storage.leftovers()] == ["good"]
    assert {path.name for path in tmp_path.iterdir()} == {"ended", "runs"}


def test_a_runtime_folder_that_another_user_could_replace_is_bad(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o777)
    monkeypatch.setenv("SRL_RUNTIME_DIR", str(tmp_path / "open" / "srl"))
    found = storage.memory(0)
    assert (found.verdict, "others may write this folder" in found.found) == ("bad", True)


@pytest.mark.slow
def test_a_calibration_that_is_not_there_is_one_finding_among_the_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    call(tmp_path, "new", "mine", "--from", "ikns-finger")
    (tmp_path / "mine.calibration.json").unlink()
    monkeypatch.chdir(tmp_path)
    assert main(["doctor", "mine.yaml", "--json"]) == 1
    findings = {f["what"]: f for f in json.loads(capsys.readouterr().out)["findings"]}
    assert "mine.calibration.json" in findings["profile"]["found"]
    assert findings["profile"]["command"] == "srl check mine.yaml"
    assert "kernel" in findings
