"""The service under a real systemd: installed as docs/deployment.md says, on twins, killed in every way, upgraded.

The machine is `helpers.machine`'s. What differs from a user's: the twins' ports are pseudo-terminals, which the unit
closes to a service; no udev daemon runs; the packages come from this environment; and where this machine's root may
not raise limits, the service gets the same two rights as capabilities.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers import ROOT
from helpers.machine import Machine, booted, why_not
from helpers.wait import until

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(600),  # the tree takes a minute, on a loaded machine several
    pytest.mark.serial,  # a loop that another test holds up is stopped, as it should be
    pytest.mark.skipif(bool(why_not()), reason=why_not()),
]

NAME = "sixth-finger"
UNIT = f"srl@{NAME}"
PAGE = (ROOT / "docs" / "deployment.md").read_text()
PORTS = " ".join(f"--set devices.{device}.port=/run/twins/{device}" for device in ("glove", "finger"))
TWINS = (
    "systemd-run --quiet --collect --unit=twins --uid=srl -p RuntimeDirectory=twins"
    f" /opt/srl/bin/srl twin {NAME} --link /run/twins"
)
DROP_IN = "[Service]\nDeviceAllow=char-pts rw\n"
RIGHTS = "CapabilityBoundingSet=CAP_SYS_NICE CAP_IPC_LOCK\nAmbientCapabilities=CAP_SYS_NICE CAP_IPC_LOCK\n"


def typed(heading: str, number: int = 0) -> list[str]:
    """The commands of a section's block, as the page has them; our wheel is what pip installs."""
    section = re.split(r"^## ", PAGE.split(f"\n## {heading}\n")[1], flags=re.MULTILINE)[0]
    return re.findall(r"^```\n(.*?)^```", section, re.MULTILINE | re.DOTALL)[number].splitlines()


def follow(machine: Machine, lines: list[str], wheel: str) -> None:
    """Types them one by one in the checkout. No udev daemon runs in a machine without hardware."""
    for output in lines:
        if "udevadm control" in output:
            continue
        line = output.replace("install .", f"install --quiet --no-deps --no-index /wheels/{wheel}/*.whl")
        line = line.replace("srl@left", UNIT).replace("/etc/srl/left.yaml", NAME)
        machine.call(f"cd /checkout && {line}")
        if made := re.match(r"sudo python3 -m venv (\S+)", line):
            pth = f"{made[1]}/lib/python3.11/site-packages/packages.pth"
            machine.call(f"printf '/packages\\nimport cmeel_pth\\n' > {pth}")


def wheel(folder: Path, version: str, sources: Path) -> None:
    """Builds a wheel of that version into `folder`."""
    copy = sources / version
    leave = shutil.ignore_patterns(".*", "build", "*.egg-info", "out", "dist", "tests", "bench")
    shutil.copytree(ROOT, copy, ignore=leave, symlinks=True)
    for file, before in (
        ("pyproject.toml", '^version = "'),
        ("pyproject.toml", 'SRL_VERSION="'),
        ("srl/__init__.py", '^__version__ = "'),
    ):
        text = (copy / file).read_text()
        (copy / file).write_text(re.sub(rf'({before})[^"]*"', rf'\g<1>{version}"', text, flags=re.MULTILINE))
    subprocess.run(
        [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation",
         "--wheel-dir", str(folder / version), str(copy)],
        check=True,
    )  # fmt: skip


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Machine]:
    """Booted, with srl 0.1.0 installed as the page says, and twins at /run/twins."""
    folder = tmp_path_factory.mktemp("machine")
    for version in ("0.1.0", "0.2.0"):
        wheel(folder / "wheels", version, folder / "sources")
    with booted(folder, folder / "wheels") as found:
        follow(found, typed("Install"), "0.1.0")
        drop_in = f"/etc/systemd/system/{UNIT}.service.d"
        granted = found.call("systemd-run --quiet --wait --pipe -p LimitRTPRIO=80 bash -c 'ulimit -r'")
        text = DROP_IN if granted.strip() == "80" else DROP_IN + RIGHTS
        found.call(f"mkdir -p {drop_in} /etc/srl && printf '{text}' > {drop_in}/twins.conf")
        found.call(f"echo 'SRL_OPTIONS={PORTS}' > /etc/srl/{NAME}.env && systemctl daemon-reload")
        found.call(TWINS)
        until(lambda: "finger" in found.call("ls /run/twins", code=None), what="the twins")
        yield found


@pytest.fixture
def limb(machine: Machine) -> Machine:
    """The service has been started afresh, and the limb moves."""
    machine.call(f"systemctl stop {UNIT}; systemctl reset-failed {UNIT}; systemctl start {UNIT}")
    until(lambda: show(machine)["state"], what="its rows")
    if show(machine)["state"] == "stopped":  # an earlier test's kill: its stop lasts
        machine.call(f"srl reset {NAME}")
    else:
        machine.call(f"srl start {NAME}")
    until(lambda: show(machine)["state"] == "active", what="motion")
    return machine


def show(machine: Machine) -> dict[str, Any]:
    """What `srl top` says of the instance; empty while it says nothing."""
    output = machine.call(f"srl top {NAME} --once --json 2>/dev/null", code=None)
    found: dict[str, Any] = json.loads(output) if output.startswith("{") else {"state": ""}
    return found


def unit(machine: Machine, key: str) -> str:
    """A property of the unit."""
    return machine.call(f"systemctl show {UNIT} --property {key} --value").strip()


def pids(machine: Machine) -> dict[str, int]:
    """The service's processes by name, as the machine counts them."""
    output = machine.call(
        f"for p in $(cat /sys/fs/cgroup/systemd/system.slice/system-srl.slice/{UNIT}.service/cgroup.procs"
        f" /sys/fs/cgroup/system.slice/system-srl.slice/{UNIT}.service/cgroup.procs 2>/dev/null);"
        " do echo $p $(tr '\\0' ' ' < /proc/$p/cmdline); done 2>/dev/null",
    )
    found = {}
    for line in output.splitlines():
        number, _, command = line.partition(" ")
        if not command:  # it ended meanwhile
            continue
        module = re.search(r"-m srl\.runtime\.(\w+)", command)
        found[module[1] if module else "supervisor"] = int(number)
    return found


def entries(machine: Machine, *terms: str) -> list[dict[str, str]]:
    """The journal's entries of the unit."""
    output = machine.call(f"journalctl --unit {UNIT} --output json --no-pager {' '.join(terms)}")
    return [json.loads(line) for line in output.splitlines() if line.startswith("{")]


def test_it_starts_and_waits_for_a_person(machine: Machine) -> None:
    machine.call(f"systemctl start {UNIT}")
    assert unit(machine, "ActiveState") == "active"
    until(lambda: show(machine)["state"], what="its rows")
    assert show(machine)["state"] == "ready"
    assert set(pids(machine)) == {"supervisor", "loop", "bus"}
    found = machine.call(f"chrt -p {pids(machine)['loop']}; grep VmLck /proc/{pids(machine)['loop']}/status")
    assert "SCHED_FIFO" in found
    assert "VmLck:\t       0 kB" not in found
    assert {device["message"] for device in show(machine)["devices"].values()} == {"connected"}


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("line", "cause"),
    [
        ("kill -KILL {loop}", "killed by SIGKILL"),
        ("kill -STOP {loop}", "no sign of life"),
        ("kill -SEGV {loop}", "killed by SIGSEGV"),
        ("kill -KILL {supervisor}", ""),
        ("kill -STOP {supervisor} {loop}", ""),  # systemd's own watchdog
        ("kill -KILL {supervisor} {loop} {bus}", ""),
    ],
)
def test_a_death_ends_in_a_start_into_the_stop(limb: Machine, line: str, cause: str) -> None:
    """Whoever dies, systemd starts the service again, and the limb stays where it is until a person lets it move."""
    before = pids(limb)
    limb.call(line.format(**before))
    until(lambda: unit(limb, "NRestarts") == "1" and unit(limb, "ActiveState") == "active", what="a restart")
    until(lambda: (show(limb)["state"], show(limb)["cause"]) == ("stopped", "restart"), what="the stop")
    assert not set(before.values()) & set(pids(limb).values())
    if cause:
        output = [entry["MESSAGE"] for entry in entries(limb, "--since=-60s", "--priority=err")]
        assert any(cause in text for text in output), output
    if "{supervisor}" not in line:
        assert "blackbox" in limb.call(f"ls /var/lib/srl/{NAME}")
    limb.call(f"srl reset {NAME}")
    until(lambda: show(limb)["state"] == "active", what="motion after the reset")


def test_a_bus_that_dies_is_started_again_and_the_limb_goes_on(limb: Machine) -> None:
    before = pids(limb)
    limb.call(f"kill -KILL {before['bus']}")
    until(lambda: pids(limb).get("bus", before["bus"]) != before["bus"], what="another bus")
    assert pids(limb)["loop"] == before["loop"]
    assert (show(limb)["state"], unit(limb, "NRestarts")) == ("active", "0")


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "line", [f"systemctl stop {UNIT}", f"systemctl kill --signal TERM {UNIT}", f"srl stop --exit {NAME}"]
)
def test_an_asked_end_is_no_failure(limb: Machine, line: str) -> None:
    limb.call(line)
    until(lambda: unit(limb, "ActiveState") == "inactive", what="the end")
    assert (unit(limb, "Result"), unit(limb, "NRestarts")) == ("success", "0")
    limb.call(f"systemctl start {UNIT}")
    until(lambda: show(limb)["state"], what="its rows")
    assert show(limb)["state"] == "ready"  # no stop is left over


def test_a_wrong_profile_is_not_tried_again(machine: Machine) -> None:
    machine.call("echo 'name: [' > /etc/srl/wrong.yaml; echo SRL_PROFILE=/etc/srl/wrong.yaml > /etc/srl/wrong.env")
    machine.call("systemctl start srl@wrong", code=1)
    output = machine.call("systemctl show srl@wrong --property ExecMainStatus,NRestarts,ActiveState --value")
    assert set(output.split()) == {"2", "0", "failed"}
    assert "/etc/srl/wrong.yaml" in machine.call("journalctl --unit srl@wrong --no-pager")


def test_a_device_that_comes_later_is_waited_for(machine: Machine) -> None:
    machine.call(f"systemctl stop {UNIT}; systemctl reset-failed {UNIT}; systemctl stop twins")
    machine.call(f"systemctl start {UNIT}", code=1)
    assert unit(machine, "ExecMainStatus") == "69"
    until(lambda: int(unit(machine, "NRestarts")) >= 1, what="another try")
    machine.call(TWINS)
    until(lambda: show(machine)["state"] == "ready", what="its rows")
    assert set(pids(machine)) == {"supervisor", "loop", "bus"}


def test_the_journal_has_fields_to_search_by(limb: Machine) -> None:
    """An instance, its state and cause are fields: no text is searched."""
    limb.call(f"srl stop {NAME}")
    until(lambda: show(limb)["state"] == "stopped", what="the stop")
    terms = (f"SRL_INSTANCE={NAME}", "SRL_STATE=stopped", "SRL_CAUSE=request")
    found = until(lambda: entries(limb, *terms, "--since=-60s"), what="the entry of the stop")
    assert all(entry["SYSLOG_IDENTIFIER"] == "srl" and int(entry["SRL_CYCLE"]) >= 0 for entry in found)
    assert any("stopped" in entry["MESSAGE"] for entry in found)


def test_an_upgrade_and_the_way_back(limb: Machine) -> None:
    """By the page's own commands. A person's stop lasts over both."""
    limb.call(f"srl stop {NAME}")
    until(lambda: show(limb)["state"] == "stopped", what="the stop")
    version = "readlink -f /opt/srl; /opt/srl/bin/srl --version"
    assert "0.1.0" in limb.call(version)
    follow(limb, typed("Upgrade"), "0.2.0")
    assert "0.2.0" in limb.call(version)
    assert "/opt/srl-2/" in limb.call(
        f"tr '\\0' ' ' < /proc/{pids(limb)['supervisor']}/cmdline; readlink -f /opt/srl/bin/srl"
    )
    until(lambda: show(limb)["state"] == "stopped", what="the stop after the upgrade")
    assert "person" in show(limb)["latches"]
    follow(limb, typed("Upgrade", 1), "")
    assert "0.1.0" in limb.call(version)
    until(lambda: show(limb)["state"] == "stopped", what="the stop after the way back")
    assert "person" in show(limb)["latches"]
    limb.call(f"srl reset {NAME}")
    until(lambda: show(limb)["state"] == "active", what="motion")
