"""Ports that are taken away, or come and go between two looks; and whose a run is that has the name already."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from helpers import environment
from helpers.run import ended
from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from srl.runtime.cli import main
from srl.runtime.contracts.errors import HostError
from srl.runtime.ipc.run_folder import RunFolder
from srl.runtime.service import serial_ports
from srl.runtime.service.fitness import serial

Capture = pytest.CaptureFixture[str]
# Lines of the rules as Ubuntu 22.04 has them (85-brltty.rules).
CH340 = 'ENV{PRODUCT}=="1a86/7523/*", ENV{BRLTTY_BRAILLE_DRIVER}="bm", GOTO="brltty_usb_run"\n'
CP210X = (
    'ENV{PRODUCT}=="10c4/ea60/*", ATTRS{manufacturer}=="Silicon Labs", ENV{BRLTTY_BRAILLE_DRIVER}="sk", '
    'GOTO="brltty_usb_run"\n'
)


def info(device: str, usb: str, serial: str = "") -> ListPortInfo:
    port = ListPortInfo(device)
    port.vid, port.pid = (int(number, 16) for number in usb.split(":"))
    port.serial_number = serial
    return port


@pytest.fixture
def plugged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[ListPortInfo]:
    """What is plugged in; a test fills it."""
    there: list[ListPortInfo] = []
    monkeypatch.setattr(list_ports, "comports", lambda: list(there))
    monkeypatch.setattr(serial_ports, "BY_ID", str(tmp_path / "by-id"))
    monkeypatch.setattr(serial_ports, "BY_PATH", str(tmp_path / "by-path"))
    return there


@pytest.fixture
def folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, Path]:
    """The folders of udev's rules, the stronger one first."""
    found = tmp_path / "etc", tmp_path / "lib"
    for folder in found:
        folder.mkdir()
    monkeypatch.setattr(serial, "_RULES", tuple(map(str, found)))
    return found


@pytest.fixture
def pty() -> Iterator[str]:
    master, slave = os.openpty()
    path = os.ttyname(slave)
    os.close(slave)
    yield path
    os.close(master)


# brltty


def of_brltty(port: str) -> list[tuple[str, str]]:
    """Verdict and remedy of each finding about it, where a profile wants this port."""
    return [
        (finding.verdict, f"{finding.found} {finding.remedy} {finding.command}")
        for finding in serial.rules({"finger": port})
        if "brltty" in f"{finding.what} {finding.found}"
    ]


@pytest.mark.parametrize(("rule", "usb"), [(CH340, "1a86:7523"), (CP210X, "10c4:ea60")])
def test_rules_that_take_an_adapter_away_are_found(
    folders: tuple[Path, Path], pty: str, plugged: list[ListPortInfo], rule: str, usb: str
) -> None:
    (folders[0] / "99-srl.rules").touch()
    assert not of_brltty(pty)
    (folders[1] / "85-brltty.rules").write_text(rule)
    ((verdict, text),) = of_brltty(pty)
    assert verdict != "good"
    assert usb in text
    assert "brltty" in text


@pytest.mark.parametrize("how", ["masked", "commented", "of other devices"])
def test_rules_that_take_nothing_away_are_no_finding(
    folders: tuple[Path, Path], pty: str, plugged: list[ListPortInfo], how: str
) -> None:
    """A file of the same name in the stronger folder stands in place of the other."""
    (folders[0] / "99-srl.rules").touch()
    taken = folders[1] / "85-brltty.rules"
    if how == "masked":
        taken.write_text(CH340)
        (folders[0] / "85-brltty.rules").symlink_to(os.devnull)
    elif how == "commented":
        taken.write_text(f"# {CH340}")
    else:
        taken.write_text(CH340.replace("1a86/7523", "0f4e/0100"))
    assert not of_brltty(pty)


def test_who_finds_no_port_hears_of_brltty(
    folders: tuple[Path, Path], plugged: list[ListPortInfo], capsys: Capture
) -> None:
    assert main(["find-port"]) == 0
    assert "brltty" not in capsys.readouterr().out
    (folders[1] / "85-brltty.rules").write_text(CH340 + CP210X)
    assert main(["find-port"]) == 0
    assert "brltty" in capsys.readouterr().out


# What comes and goes


def still() -> None:
    """Nothing happens."""


def waited(monkeypatch: pytest.MonkeyPatch, capsys: Capture, *plays: Callable[[], object]) -> dict[str, list[str]]:
    """What `--wait` says came and went, as in each pause one of the plays happens, then nothing; it ends in time."""
    left = [*plays, *[still] * 30]

    def pause(_: float) -> None:
        if not left:
            raise KeyboardInterrupt
        left.pop(0)()

    monkeypatch.setattr(time, "sleep", pause)
    assert main(["find-port", "--wait", "--json"]) == 0
    reported = json.loads(capsys.readouterr().out)
    return {what: [port["serial"] for port in found] for what, found in reported.items()}


@pytest.mark.parametrize("rests", [0, 1])
def test_a_port_that_was_there_for_one_look_is_told(
    rests: int, plugged: list[ListPortInfo], pty: str, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """It came, and something took it away at once, as brltty does."""
    plugged.append(info("/dev/ttyS0", "2341:0043", "stays"))
    come = info(pty, "1a86:7523", "brief")
    reported = waited(monkeypatch, capsys, lambda: plugged.append(come), *[still] * rests, plugged.pop)
    assert reported["came"] == ["brief"]
    assert "stays" not in reported["went"]
    if not rests:
        assert reported["went"] == ["brief"]


def test_a_port_that_was_away_for_one_look_is_told(
    plugged: list[ListPortInfo], pty: str, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    """Who pulls a plug out and puts it in again at once has named the port."""
    port = info(pty, "2341:0043", "mine")
    plugged.extend([info("/dev/ttyS0", "2341:0043", "stays"), port])
    reported = waited(monkeypatch, capsys, plugged.pop, lambda: plugged.append(port))
    assert reported["went"] == ["mine"]
    assert "stays" not in reported["came"]


# Whose run it is

CLAIM = """
import sys
from pathlib import Path
from srl.runtime.ipc.run_folder import RunFolder
RunFolder(Path(sys.argv[1])).claim()
print("claimed", flush=True)
sys.stdin.read()
"""


def test_the_other_run_of_a_name_is_said_to_be_whose_it_is(tmp_path: Path) -> None:
    """The first remedy moves nobody's limb."""
    command = [sys.executable, "-c", CLAIM, str(tmp_path / "arm")]
    with ended(command, stdin=subprocess.PIPE, env=environment()) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "claimed\n"
        with pytest.raises(HostError, match="running already") as raised:
            RunFolder(tmp_path / "arm").claim()
    error = raised.value
    assert str(other.pid) in error.problem
    assert "since" in error.problem
    assert 0 <= error.remedy.find("--instance") < (error.remedy + "srl stop").find("srl stop")


def test_a_claim_that_has_ended_is_named_no_more(tmp_path: Path) -> None:
    first, second = RunFolder(tmp_path / "arm"), RunFolder(tmp_path / "arm")
    first.claim()
    first.release()
    second.claim()
    with pytest.raises(HostError) as raised:
        RunFolder(tmp_path / "arm").claim()
    assert str(os.getpid()) in raised.value.problem
