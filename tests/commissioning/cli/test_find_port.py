"""`srl find-port`: what it says of ports, and which one came or went. The list of ports is made up, rights are real."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from helpers import ROOT
from helpers.run import srl
from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from srl.commissioning.cli import find_port
from srl.runtime.cli import main
from srl.runtime.profile.ports import local_path
from srl.runtime.service import serial_ports
from srl.runtime.service.fitness import serial


def info(device: str, usb: str | None = None, maker: str = "", product: str = "", serial: str = "") -> ListPortInfo:
    port = ListPortInfo(device)
    if usb is not None:
        port.vid, port.pid = (int(number, 16) for number in usb.split(":"))
        port.manufacturer, port.product, port.serial_number = maker, product, serial
    return port


@pytest.fixture
def plugged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[ListPortInfo]:
    """What is plugged in; a test fills it."""
    there: list[ListPortInfo] = []
    monkeypatch.setattr(list_ports, "comports", lambda: list(there))
    monkeypatch.setattr(serial_ports, "BY_ID", str(tmp_path / "by-id"))
    monkeypatch.setattr(serial_ports, "BY_PATH", str(tmp_path / "by-path"), raising=False)
    return there


@pytest.fixture
def pty() -> Iterator[str]:
    master, slave = os.openpty()
    path = os.ttyname(slave)
    os.close(slave)
    yield path
    os.close(master)


def output(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main(["find-port", *arguments]) == 0
    return capsys.readouterr().out


def test_no_port_is_said(plugged: list[ListPortInfo], capsys: pytest.CaptureFixture[str]) -> None:
    assert "no serial port is there: check the cable" in output(capsys)
    assert json.loads(output(capsys, "--json")) == {"ports": []}


@pytest.mark.parametrize(
    ("usb", "words"),
    [
        ("2341:0043", r"perhaps firmata \(Arduino"),
        ("1a86:7523", r"perhaps firmata \(Arduino"),
        ("0403:6014", r"probably dynamixel \(.*\), perhaps softhand \("),
        ("0403:6001", r"probably cyberglove \(.*\), perhaps softhand \("),
        ("16d0:117e", r"perhaps can-ft \("),
        ("dead:beef", r"unknown"),
        (None, r"unknown"),
    ],
)
def test_what_a_port_may_be(
    usb: str | None, words: str, plugged: list[ListPortInfo], pty: str, capsys: pytest.CaptureFixture[str]
) -> None:
    plugged.append(info(pty, usb))
    assert re.search(rf"^  {words}", output(capsys), re.MULTILINE)


def test_the_pages_and_rules_name_the_numbers_that_the_drivers_name() -> None:
    for name, (_, ids) in serial_ports.usb_numbers().items():
        text = (ROOT / "docs" / "devices" / f"{name}.md").read_text() + (ROOT / "deploy" / "99-srl.rules").read_text()
        for number in ids:
            vendor, _, product = number.partition(":")
            assert f'ATTRS{{idVendor}}=="{vendor}"' in text, name
            assert not product or f'ATTRS{{idProduct}}=="{product}"' in text, name


def test_a_port_is_named_by_what_stays_with_its_device(
    plugged: list[ListPortInfo], pty: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plugged.append(info(pty, "0403:6014", "FTDI", "USB <-> Serial Converter", "FT3FSNI8"))
    stays = tmp_path / "by-id" / "usb-FTDI_FT3FSNI8-if00"
    assert "no name that stays" in output(capsys)
    stays.parent.mkdir()
    stays.symlink_to(pty)
    text = output(capsys)
    assert text.startswith(f"{stays}\n")
    assert f"now {pty}" in text
    assert "USB 0403:6014 FTDI USB <-> Serial Converter, serial number FT3FSNI8" in text
    (reported,) = json.loads(output(capsys, "--json"))["ports"]
    assert (reported["path"], reported["device"], reported["usb"], reported["serial"]) == (
        str(stays),
        pty,
        "0403:6014",
        "FT3FSNI8",
    )
    assert [(guess["driver"], guess["exact"]) for guess in reported["guesses"]] == [
        ("dynamixel", True),
        ("softhand", False),
    ]


def test_a_port_that_may_not_be_opened_has_its_remedy(
    plugged: list[ListPortInfo], pty: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    plugged.append(info(pty, "2341:0043"))
    assert "  you may open it" in output(capsys)
    monkeypatch.setattr(os, "access", lambda *_: False)
    group = type("Group", (), {"gr_name": "dialout"})
    monkeypatch.setattr(serial_ports.grp, "getgrgid", lambda _: group)
    text = output(capsys)
    assert f"you can't open it: {pty} may not be opened. sudo usermod -aG dialout $USER, then log in again" in text
    (reported,) = json.loads(output(capsys, "--json"))["ports"]
    assert "usermod -aG dialout" in reported["obstacle"]["remedy"]
    (finding,) = serial.ports({"finger": pty})  # `srl doctor` says the same
    assert (finding.verdict, finding.remedy) == ("bad", reported["obstacle"]["remedy"])
    group.gr_name = "root"
    assert "usermod" not in output(capsys)  # nobody is told to join root


def test_who_holds_a_port_is_named(
    plugged: list[ListPortInfo], pty: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    plugged.append(info(pty))
    assert "has it open" not in output(capsys)
    descriptor = os.open(pty, os.O_RDWR | os.O_NOCTTY)
    assert f"({os.getpid()}) has it open" in output(capsys)
    (finding,) = serial.ports({"finger": pty})  # `srl doctor` says the same
    assert finding.verdict == "doubtful"
    assert f"({os.getpid()}) has it open" in finding.found
    os.close(descriptor)


def test_who_locks_a_port_is_named_though_the_process_is_anothers(
    plugged: list[ListPortInfo], pty: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:  # fmt: skip
    """The kernel lists locks for everybody, but a container doesn't show all: so the list is made up."""
    plugged.append(info(pty))
    about = os.stat(pty)
    place = f"{os.major(about.st_dev):02x}:{os.minor(about.st_dev):02x}:{about.st_ino}"
    monkeypatch.setattr(serial_ports, "LOCKS", tmp_path / "locks")
    serial_ports.LOCKS.write_text(f"1: FLOCK  ADVISORY  WRITE {os.getpid()} {place}9 0 EOF\n")
    assert "has it open" not in output(capsys)
    serial_ports.LOCKS.write_text(f"1: FLOCK  ADVISORY  WRITE {os.getpid()} {place} 0 EOF\n")
    assert f"({os.getpid()}) has it open" in output(capsys)


def test_nothing_is_opened(plugged: list[ListPortInfo], pty: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Opening restarts most Arduino boards."""
    plugged.append(info(pty, "2341:0043"))
    opened: list[object] = []
    watching = [True]
    sys.addaudithook(lambda event, given: opened.append(given[0]) if event == "open" and watching else None)
    output(capsys)
    watching.clear()  # a hook stays for ever
    assert opened  # of /proc, so the hook works
    assert pty not in opened


def test_the_port_that_came_is_named_once_it_has_settled(
    plugged: list[ListPortInfo], pty: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    plugged.append(info("/dev/ttyS0"))
    stays = tmp_path / "by-id" / "usb-Arduino-if00"

    def link() -> None:
        stays.parent.mkdir()
        stays.symlink_to(pty)

    plays = iter([lambda: None, lambda: plugged.append(info(pty, "2341:0043", serial="75735")), link])
    monkeypatch.setattr(find_port.time, "sleep", lambda _: next(plays, lambda: None)())
    text = output(capsys, "--wait")
    assert text.startswith(f"came: {stays}\n  perhaps firmata")
    assert "ttyS0" not in text


def test_the_port_that_went_is_named(
    plugged: list[ListPortInfo], pty: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    plugged.append(info(pty, "0403:6014", serial="FT1"))
    plays: Iterator[Callable[[], object]] = iter([plugged.clear])
    monkeypatch.setattr(find_port.time, "sleep", lambda _: next(plays, lambda: None)())
    reported = json.loads(output(capsys, "--wait", "--json"))
    assert reported["came"] == []
    assert [port["serial"] for port in reported["went"]] == ["FT1"]


def test_ctrl_c_ends_the_wait(plugged: list[ListPortInfo], monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(_: float) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(find_port.time, "sleep", interrupt)
    assert main(["find-port", "--wait"]) == 130


@pytest.mark.slow
def test_the_process_lists_this_machines_ports(tmp_path: Path) -> None:
    done = subprocess.run(
        srl("find-port", "--json"), cwd=tmp_path, capture_output=True, text=True, timeout=100, check=True
    )
    assert isinstance(json.loads(done.stdout)["ports"], list)


# What may be mistaken


def test_an_adapter_without_a_serial_number_has_no_name_that_stays(
    plugged: list[ListPortInfo], pty: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its link by id is that of its kind: another one of the kind gets the same."""
    plugged.append(info(pty, "1a86:7523", product="USB Serial"))
    kind = tmp_path / "by-id" / "usb-1a86_USB_Serial-if00-port0"
    kind.parent.mkdir()
    kind.symlink_to(pty)
    text = output(capsys)
    assert text.startswith(f"{pty}\n")
    assert "it has no name that stays with the device" in text
    socket = tmp_path / "by-path" / "pci-0000:00:14.0-usb-0:2:1.0-port0"
    socket.parent.mkdir()
    socket.symlink_to(pty)
    text = output(capsys)
    assert text.startswith(f"{socket}\n")
    assert "this name is the USB socket's" in text
    assert json.loads(output(capsys, "--json"))["ports"][0]["path"] == str(socket)


def test_two_adapters_with_one_serial_number_have_no_name_that_stays(
    plugged: list[ListPortInfo], pty: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Many CP2102 are all numbered 0001; udev gives the link to the one that came last."""
    plugged.extend([info(pty, "10c4:ea60", serial="0001"), info("/dev/ttyUSB7", "10c4:ea60", serial="0001")])
    kind = tmp_path / "by-id" / "usb-Silicon_Labs_0001-if00-port0"
    kind.parent.mkdir()
    kind.symlink_to(pty)
    assert str(kind) not in output(capsys)


def test_a_port_that_goes_while_it_is_looked_at_is_told_as_gone(
    plugged: list[ListPortInfo], pty: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    plugged.append(info(pty, "2341:0043"))
    monkeypatch.setattr(os, "access", lambda *_: False)

    def gone(_: str) -> os.stat_result:
        raise FileNotFoundError(2, "No such file or directory")

    monkeypatch.setattr(serial_ports.os, "stat", gone)
    monkeypatch.setattr(serial_ports.os.path, "exists", lambda _: True)
    assert f"you can't open it: {pty} isn't there" in output(capsys)


def test_what_a_device_says_of_itself_does_nothing_to_the_terminal(
    plugged: list[ListPortInfo], pty: str, capsys: pytest.CaptureFixture[str]
) -> None:
    plugged.append(info(pty, "2341:0043", "Evil\x1b[2J", "you may\nopen it", "7\x07"))
    text = output(capsys)
    assert "USB 2341:0043 Evil\\x1b[2J you may\\nopen it, serial number 7\\x07\n" in text


@pytest.mark.parametrize(
    ("port", "path"),
    [
        ("/dev/ttyUSB0", "/dev/ttyUSB0"),
        ("ports/finger", "ports/finger"),
        ("spy:a.log:/dev/ttyUSB0", "/dev/ttyUSB0"),
        ("spy:a.log:tcp://host:5", None),
        ("tcp://host:5", None),
        ("can://socketcan/can0", None),
        ("auto", None),
        ("input", None),
    ],
)
def test_which_ports_are_paths_of_this_machine(port: str, path: str | None) -> None:
    assert local_path(port) == path
    lack = serial_ports.obstacle(port)
    assert (lack is not None and lack.problem == f"{path} isn't there") == (path is not None)
    assert len(list(serial.ports({"finger": port}))) == (path is not None)
