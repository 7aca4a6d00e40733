"""`srl check` refuses what `srl run` refuses before it begins, in the same words."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from srl.runtime.cli import main
from srl.runtime.profile import profile


def refused(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """What both commands say, without their own names; they must say the same."""
    output = []
    for command in ("check", "run"):
        assert main([command, *arguments]) == 2, command
        output.append(capsys.readouterr().err.removeprefix(f"srl {command}: "))
    assert output[0] == output[1]
    assert "Traceback" not in output[0]
    return output[0]


@pytest.fixture(autouse=True)
def _folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SRL_RUNTIME_DIR", str(tmp_path / "run"))
    monkeypatch.setenv("SRL_STATE_DIR", str(tmp_path / "state"))


GLOVE = "devices.glove.calibration"
WHOLE = "person: P01\ndate: 2026-11-23\nhand: right\nsensors: {}\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, ["there is no file"]),
        ("a: 1\n", ["hand.yaml", "'a' isn't known", "docs/devices/cyberglove.md"]),
        ("person: P01\nsensors: {\n", ["hand.yaml", "line", "valid YAML"]),
        (WHOLE, ["hand.yaml: sensors.thumb_roll", "the sensor is missing"]),
    ],
)
def test_a_glove_calibration(
    text: str | None, words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "hand.yaml"
    if text is not None:
        file.write_text(text)
    output = refused(["sixth-finger", "--set", f"{GLOVE}={file}"], capsys)
    assert all(word in output for word in words), output


@pytest.mark.parametrize(
    ("name", "key"), [("ikns-two", "controllers.1.calibration"), ("suit-intention", "controllers.0.recogniser")]
)
def test_a_persons_calibration_that_is_incomplete(
    name: str, key: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "own.json").write_text("{}")
    output = refused([name, "--sim", "--set", f"{key}={tmp_path / 'own.json'}"], capsys)
    assert "own.json" in output
    assert "Calibrate again" in output


def test_a_recording_that_is_played(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = profile.find("suit-station")[1]
    driver = text.index("driver: noitom")
    line = text[text.rindex("\n", 0, driver) : text.index("\n", driver)]
    given = f"\n  suit: {{driver: replay, recording: {tmp_path}/none.rrd, device: suit}}"
    (tmp_path / "own.yaml").write_text(text.replace(line, given))
    assert "none.rrd" in refused([str(tmp_path / "own.yaml")], capsys)


def test_a_clock_that_is_no_device(capsys: pytest.CaptureFixture[str]) -> None:
    output = refused(["sixth-finger", "--sim", "--set", "clock=globe"], capsys)
    assert output == "--set clock: there is no device 'globe'. Did you mean 'glove'? Known: finger, glove, monotonic.\n"


def test_a_pin_that_the_board_does_not_have(capsys: pytest.CaptureFixture[str]) -> None:
    output = refused(["sixth-finger", "--set", "devices.finger.servos.abduction.pin=99"], capsys)
    assert "devices.finger.servos.abduction.pin" in output
    assert "an ATmega328P board" in output
    assert "not 99" in output


@pytest.fixture
def pair(tmp_path: Path) -> tuple[Path, Path]:
    """A certificate that signs itself, and its key."""
    certificate, key = tmp_path / "own.pem", tmp_path / "own.key"
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-subj", "/CN=robot", "-days", "2",
         "-keyout", str(key), "-out", str(certificate)],
        check=True, capture_output=True,
    )  # fmt: skip
    return certificate, key


def test_certificates_of_the_bus(pair: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    certificate, key = pair
    other = tmp_path / "other.txt"
    other.write_text("nothing\n")

    def with_tls(ca: Path, certificate: Path, key: Path) -> list[str]:
        roles = "bus.roles={observer: [otto]}"
        tls = f"bus.tls={{ca: {ca}, certificate: {certificate}, key: {key}}}"
        return ["sixth-finger", "--sim", "--set", "bus.listen=[tls/127.0.0.1:7447]", "--set", tls, "--set", roles]

    assert main(["check", *with_tls(certificate, certificate, key)]) == 0
    capsys.readouterr()
    missing = refused(with_tls(certificate, certificate, tmp_path / "none.key"), capsys)
    assert "tls.key: there is no file" in missing
    assert "holds no certificate" in refused(with_tls(other, certificate, key), capsys)
    assert "aren't a certificate and its key" in refused(with_tls(certificate, certificate, other), capsys)
