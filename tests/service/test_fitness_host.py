"""What `srl doctor` says of the kernel's preemption, of input devices and of a way through a router."""

from __future__ import annotations

import ipaddress
import os
import re
from pathlib import Path
from types import SimpleNamespace

import pytest
from helpers import ROOT

from srl.runtime.cli import main
from srl.runtime.service.fitness import events, network, processor

DYNAMIC = "#1 SMP PREEMPT_DYNAMIC Debian 6.1"


@pytest.mark.parametrize(
    ("version", "mode", "booted", "verdict", "words"),
    [
        ("#1 SMP PREEMPT_RT", "", "", "good", "PREEMPT_RT"),
        ("#1 SMP PREEMPT", "", "", "good", "preemptible"),
        ("#1 SMP", "", "", "doubtful", "not preemptible"),
        (DYNAMIC, "none voluntary (full)", "preempt=none", "good", "preempt=full"),
        (DYNAMIC, "(none) voluntary full", "", "doubtful", "not preemptible now (preempt=none)"),
        (DYNAMIC, "", "quiet preempt=voluntary", "doubtful", "not preemptible now (preempt=voluntary)"),
        (DYNAMIC, "", "preempt=none quiet preempt=full", "good", "preempt=full"),
        (DYNAMIC, "", "quiet", "doubtful", "only root may read"),
    ],
)
def test_a_kernel_is_called_preemptible_only_if_it_is(
    version: str, mode: str, booted: str, verdict: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mode").write_text(mode)
    (tmp_path / "booted").write_text(booted)
    monkeypatch.setattr(processor, "_MODE", str(tmp_path / "mode"))
    monkeypatch.setattr(processor, "_BOOTED", str(tmp_path / "booted"))
    monkeypatch.setattr(os, "uname", lambda: SimpleNamespace(version=version, release="none-here"))
    found = processor.kernel()
    assert found.verdict == verdict
    assert words in found.found


def test_input_devices_have_a_line_each(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(events, "NODES", str(tmp_path / "event*"))

    def verdicts() -> dict[str, tuple[str, str]]:
        wanted = {"pad": "auto", "ring": str(tmp_path / "event3")}
        return {f.what: (f.verdict, f.command) for f in events.inputs(wanted)}

    assert {verdict for verdict, _ in verdicts().values()} == {"bad"}
    (tmp_path / "event3").touch()
    assert verdicts() == {"input of pad": ("good", ""), "input of ring": ("good", "")}
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    assert set(verdicts().values()) == {("bad", "sudo usermod -aG input $USER")}


def test_a_profiles_pad_is_an_input_and_no_serial_port(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(events, "NODES", str(tmp_path / "event*"))
    monkeypatch.setenv("SRL_RUNTIME_DIR", str(tmp_path))
    profile = tmp_path / "pad.yaml"
    profile.write_text(
        "name: pad\nrate: 100\ndevices: {pad: {driver: gamepad}, ring: {driver: ring, port: /dev/input/event99}}\n"
    )
    assert main(["doctor", str(profile), "--recordings", str(tmp_path)]) == 1
    said = capsys.readouterr().out
    assert "input of pad: no input device is there" in said
    assert "input of ring: /dev/input/event99 isn't there" in said
    assert "port of" not in said


def test_no_address_is_typed_onto_the_way_out(monkeypatch: pytest.MonkeyPatch) -> None:
    out = network._Route("wan0", ipaddress.IPv4Network("0.0.0.0/0"), ipaddress.IPv4Address("10.0.0.1"), 3)
    monkeypatch.setattr(network, "_routes", lambda: iter([out]))
    (way,) = (f for f in network.devices({"arm": "tcp://172.16.0.2:1337"}) if f.what == "network of arm")
    assert (way.verdict, way.command) == ("doubtful", "sudo ip addr add 172.16.0.3/24 dev INTERFACE")
    assert "wan0 is the way out" in way.remedy


def test_the_service_waits_for_the_network_and_may_read_input_devices() -> None:
    unit = (ROOT / "deploy" / "srl@.service").read_text()
    assert "Wants=network-online.target\nAfter=network-online.target\n" in unit
    assert "SupplementaryGroups=dialout input\n" in unit
    rules = (ROOT / "deploy" / "99-srl.rules").read_text()
    assert set(re.findall(r'GROUP="(\w+)"', rules)) <= {"dialout", "input", "srl"}
