"""`srl new`: a profile of one's own in an empty folder, which passes the check and can be calibrated."""

from __future__ import annotations

import json
import os
import pty
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from helpers.run import call, environment, refused, srl
from helpers.wait import until
from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from srl.commissioning.cli import new, new_questions
from srl.commissioning.jog.profile_subset import subset
from srl.runtime.cli import main
from srl.runtime.cli.check import examine
from srl.runtime.profile import library, profile
from srl.runtime.profile.edit import content
from srl.runtime.service import serial_ports


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def comments(text: str) -> list[str]:
    return re.findall(r"#.*", text)


@pytest.mark.sampled(8)
@pytest.mark.parametrize("template", library.shipped())
def test_each_shipped_profile_begins_one_that_passes(
    template: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["new", "mine", "--from", template]) == 0
    text = (folder / "mine.yaml").read_text()
    assert comments(text)[1:] == comments(profile.find(template)[1])
    assert text.startswith(f"# Begun as {template} of srl ")
    checked, source = profile.load("mine.yaml")
    assert checked.name == "mine"
    for word, branches in content(text).get("choices", {}).items():
        for branch in branches:  # what another word needs is there, too
            assert main(["check", "mine.yaml", "--sim", "--set", f"{word}={branch}"]) == 0
    if not source.chosen:
        assert main(["check", "mine.yaml", "--sim"]) == 0
    assert "  srl run mine.yaml --sim\n" in capsys.readouterr().out


def test_values_and_ports_are_written(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    port = "/dev/serial/by-id/usb-Arduino_75735-if00"
    code = main(["new", "mine", "--from", "sixth-finger", "--port", f"finger={port}", "--set", "rate=50"])
    assert code == 0
    before = profile.find("sixth-finger")[1].splitlines()
    after = (folder / "mine.yaml").read_text().splitlines()[1:]
    changed = [line for old, line in zip(before, after, strict=True) if old != line]
    assert changed == ["name: mine", "rate: 50                        # Hz, the glove's own", f"    port: {port}"]
    output = capsys.readouterr().out
    assert f"not yet: port of finger: {port} isn't there" in output
    assert "srl doctor mine.yaml" in output


@pytest.mark.slow
def test_a_calibration_comes_along_under_the_new_name_and_a_persons_takes_its_place(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two profiles begun as one have a file each: who calibrates for one doesn't change the other."""
    assert main(["new", "a", "--from", "ikns-finger"]) == 0
    assert main(["new", "b", "--from", "ikns-finger"]) == 0
    assert {path.name for path in folder.iterdir()} == {
        "a.yaml", "a.calibration.json", "b.yaml", "b.calibration.json",
    }  # fmt: skip
    output = capsys.readouterr().out
    assert "srl calibrate b.yaml ikns --person P07 --yes" in output
    assert "it was made in simulation" in output


@pytest.mark.slow
def test_a_file_that_is_there_is_kept(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "mine.yaml").write_text("mine before\n")
    (folder / "mine.calibration.json").write_bytes(
        (profile.find("ikns-finger")[2] / "ikns-finger.calibration.json").read_bytes() + b"\n"
    )
    persons = (folder / "mine.calibration.json").read_bytes()
    arguments = ["new", "mine", "--from", "ikns-finger"]
    assert "mine.yaml: a file is there already. Add --yes to replace it (it is kept as .old)" in refused(*arguments)
    assert (folder / "mine.yaml").read_text() == "mine before\n"
    assert main([*arguments, "--yes"]) == 0
    assert (folder / "mine.yaml.old").read_text() == "mine before\n"
    assert (folder / "mine.calibration.json").read_bytes() == persons
    output = capsys.readouterr().out
    assert "the one before is mine.yaml.old" in output
    assert "mine.calibration.json: was there already, and is used as it is" in output
    assert main([*arguments, "--yes"]) == 0
    assert (folder / "mine.yaml.old.2").exists()


@pytest.mark.slow
def test_another_folder_and_a_file_that_was_typed_from_here(folder: Path) -> None:
    """A path that is typed begins here, one in a profile beside it: it leads to the same file."""
    (folder / "sub").mkdir()
    shutil.copy(profile.find("ikns-two")[2] / "ikns-two.calibration.json", "p07.json")
    file = "sub/arm.yml"
    assert main(["new", "arm", "--from", "ikns-two", "-o", file, "--set", "controllers.1.calibration=p07.json"]) == 0
    assert "calibration: ../p07.json " in (folder / file).read_text()
    assert not (folder / "sub" / "ikns-two.calibration.json").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["My Limb", "--from", "servo-jog"], "'My Limb' is no name.*For example my-limb"),
        (["my-limb.yaml", "--from", "servo-jog"], "'my-limb.yaml' is no name.*For example my-limb;"),
        (["a", "--from", "servo-jug.yaml"], "servo-jug.yaml: no profile that comes.*Did you mean 'servo-jog'"),
        (["7", "--from", "servo-jog"], "'7' is no name.*For example my-limb"),
        (["servo-jog", "--from", "servo-jog"], "a profile that comes with srl.*such as my-servo-jog"),
        (["a", "--from", "servo-jug"], "servo-jug: no profile that comes with srl.*Did you mean 'servo-jog'"),
        (["a", "--from", "servo-jog", "--port", "hand=/dev/x"], "servo-jog has no device 'hand'. Known: finger"),
        (["a", "--from", "servo-jog", "--port", "finger"], "expected DEVICE=PORT"),
        (["a", "--from", "servo-jog", "--set", "rate=fast"], "--set rate: .*number of Hz"),
        (
            ["a", "--from", "servo-jog", "--set", "guard.finger.position_command.velocity=-1"],
            "guard.finger.position_command.velocity.*greater",
        ),
        (["a", "--from", "servo-jog", "--set", "sim.parts.finger.axes.distal.model=MX-1"], "--set sim.*"),
        (["a", "--from", "servo-jog", "-o", "a.txt"], "doesn't end in .yaml. Name it like a.yaml"),
        (["a", "--from", "servo-jog", "-o", "no/a.yaml"], "no: the folder can't be written"),
        (["a", "--from", "servo-jog", "-o", "."], "it is a folder. Name a file in it: -o ./a.yaml"),
        (["a" * 300, "--from", "servo-jog"], "a.yaml: it can't be written: File name too long. Choose"),
        (["a", "--from", "servo-jog", "--set", "name=b"], "--set name=b: the new profile's name is said already: a. L"),
        (["a"], "--from: it isn't said what the new profile begins as. For example srl new a --from"),
    ],
)
def test_what_is_wrong_is_refused_and_nothing_written(arguments: list[str], words: str, folder: Path) -> None:
    output = refused("new", *arguments)
    assert re.search(words, output), output
    assert list(folder.iterdir()) == []


def test_a_disk_that_is_full_leaves_the_old_file(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "mine.yaml").write_text("mine before\n")

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    output = refused("new", "mine", "--from", "servo-jog", "--yes")
    assert "mine.yaml.old: it can't be written: No space left on device" in output
    assert (folder / "mine.yaml").read_text() == "mine before\n"
    assert [path.name for path in folder.iterdir()] == ["mine.yaml"]


def test_what_is_asked(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    uno = ListPortInfo("/dev/ttyACM7")
    uno.vid, uno.pid = 0x2341, 0x43
    monkeypatch.setattr(list_ports, "comports", lambda: [uno])
    monkeypatch.setattr(new_questions, "_terminal", lambda: True)
    number = str(library.shipped().index("sixth-finger") + 1)
    answers = iter(["", "none", "99", number, "/dev/glove", "2", "1"])
    asked = []
    monkeypatch.setattr("builtins.input", lambda question: (asked.append(question), next(answers))[1])
    assert main(["new", "mine"]) == 0
    checked, _ = profile.load("mine.yaml")
    assert {n: d.options["port"] for n, d in checked.devices.items()} == {
        "glove": "/dev/glove",
        "finger": "/dev/ttyACM7",
    }
    output = capsys.readouterr().out
    assert "'none' is none of them" in output
    assert "there is no port number 2" in output
    assert "/dev/ttyACM7: perhaps firmata" in output
    assert asked[-1] == "Port of finger (firmata)? Number, a path, or Enter for /dev/ttyACM0: "


@pytest.mark.slow
def test_on_a_terminal_it_asks_and_ctrl_d_writes_nothing(folder: Path) -> None:
    """The real thing, on a pty."""
    for typed, code in ((b"servo-jog\n\n", 0), (b"servo-jog\n\x04", 2), (b"\x03", 130)):
        pid, terminal = pty.fork()
        if pid == 0:
            os.execve(srl()[0], srl("new", "mine"), environment(folder))
        shown = bytearray()
        sent = list(re.findall(rb"[^\n]*\n|[^\n]+$", typed))

        def reads(terminal: int = terminal, shown: bytearray = shown) -> bool:
            try:
                shown += os.read(terminal, 4096)
            except OSError:  # its end
                return False
            return True

        for each in sent:
            mark = len(shown)
            until(
                lambda mark=mark, shown=shown: b": " in shown[mark:] and shown.rstrip(b" ").endswith(b":"), step=reads
            )
            os.write(terminal, each)
        while reads():
            pass
        _, status = os.waitpid(pid, 0)
        os.close(terminal)
        assert os.waitstatus_to_exitcode(status) == code, shown.decode()
        assert b"Traceback" not in shown
        assert (folder / "mine.yaml").exists() == (code == 0)
        (folder / "mine.yaml").unlink(missing_ok=True)


@pytest.mark.slow
def test_the_commands_it_tells_work_in_that_folder(folder: Path) -> None:
    output = call(folder, "new", "mine", "--from", "sixth-finger").stdout
    assert "  srl run mine.yaml --sim\n" in output
    done = call(folder, "run", "mine.yaml", "--sim", "--fast", "--duration", "1", "--json")
    assert json.loads(done.stdout.splitlines()[-1])
    assert subprocess.run(
        srl("doctor", "mine.yaml"), env=environment(folder), cwd=folder, capture_output=True, timeout=100, check=False
    ).returncode in (0, 1)


# What may be mistaken


@pytest.fixture
def plugged(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An Arduino at a path that exists, with a name that stays; gives the folder of the ports."""
    ports = tmp_path_factory.mktemp("ports")
    (ports / "ttyACM0").touch()
    (ports / "by-id").mkdir()
    (ports / "by-id" / "usb-Arduino_75735-if00").symlink_to(ports / "ttyACM0")
    uno = ListPortInfo(str(ports / "ttyACM0"))
    uno.vid, uno.pid, uno.serial_number = 0x2341, 0x43, "75735"
    monkeypatch.setattr(list_ports, "comports", lambda: [uno])
    monkeypatch.setattr(serial_ports, "BY_ID", str(ports / "by-id"))
    monkeypatch.setattr(serial_ports, "BY_PATH", str(ports / "by-path"))
    return ports


def test_two_devices_at_one_port_are_doubted(folder: Path, plugged: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """By whatever names they are given."""
    one, other = plugged / "ttyACM0", plugged / "by-id" / "usb-Arduino_75735-if00"
    arguments = ["new", "mine", "--from", "sixth-finger", "--port", f"glove={one}", "--port", f"finger={other}"]
    assert main(arguments) == 0
    warning = "devices.finger.port: glove is at this port, too, and only one can have it open"
    assert warning in capsys.readouterr().out
    assert main(["check", "mine.yaml"]) == 0
    assert warning in capsys.readouterr().out
    assert main(["check", "mine.yaml", "--sim"]) == 0
    assert "is at this port" not in capsys.readouterr().out


def test_addresses_may_be_alike(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "moca-man", "--set", "devices.sensor.port=udp://172.16.0.2"]) == 0
    assert "is at this port" not in capsys.readouterr().out


def test_a_port_that_changes_and_one_of_another_device_are_told(
    plugged: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stays = plugged / "by-id" / "usb-Arduino_75735-if00"
    assert main(["new", "a", "--from", "finger-jog", "--port", f"finger={plugged / 'ttyACM0'}"]) == 0
    assert f"another order of plugging in changes {plugged / 'ttyACM0'}; {stays} stays" in capsys.readouterr().out
    assert main(["new", "b", "--from", "finger-jog", "--port", f"finger={stays}"]) == 0
    assert "port of finger" not in capsys.readouterr().out
    assert main(["new", "c", "--from", "servo-jog", "--port", f"finger={stays}"]) == 0
    assert "port of finger: perhaps firmata (Arduino" in (output := capsys.readouterr().out)
    assert "Is it dynamixel's?" in output


def test_a_port_that_another_program_has_open_is_told(plugged: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with open(plugged / "ttyACM0"):
        assert main(["new", "a", "--from", "finger-jog", "--port", f"finger={plugged / 'ttyACM0'}"]) == 0
    assert f"({os.getpid()}) has it open" in capsys.readouterr().out


def test_a_relative_port_that_isnt_there_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["new", "a", "--from", "finger-jog", "--port", "finger=ports/finger"]) == 0
    assert "not yet: port of finger: ports/finger isn't there" in capsys.readouterr().out


@pytest.mark.parametrize("yes", [[], ["--yes"]])
def test_what_is_beside_and_spoilt_leaves_all_as_it_was(yes: list[str], folder: Path) -> None:
    (folder / "mine.calibration.json").write_text("{}")
    if yes:
        (folder / "mine.yaml").write_text("mine before\n")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert "mine.calibration.json" in refused("new", "mine", "--from", "ikns-finger", *yes)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_ctrl_c_in_the_check_leaves_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(name: str, *given: Any, **more: Any) -> Any:
        if name.endswith(".yaml"):
            raise KeyboardInterrupt
        return examine(name, *given, **more)

    monkeypatch.setattr(new, "examine", interrupted)
    assert main(["new", "mine", "--from", "ikns-finger"]) == 130
    assert not list(folder.iterdir())


@pytest.mark.slow
def test_the_limb_is_jogged_before_it_follows_anybody(capsys: pytest.CaptureFixture[str]) -> None:
    """The sense of a joint, and which is which, no check can know."""
    assert main(["new", "mine", "--from", "kairos-man"]) == 0
    lines = [line.strip() for line in capsys.readouterr().out.splitlines()]
    jogs = [f"srl jog mine.yaml {device}" for device in ("arm", "base", "hand")]
    assert sorted(line for line in lines if line.startswith("srl jog")) == jogs
    assert (
        lines.index("srl doctor mine.yaml") < lines.index(jogs[0]) < lines.index("srl run mine.yaml --set start=manual")
    )
    assert main(["new", "seen", "--from", "suit-station"]) == 0
    assert "srl jog" not in capsys.readouterr().out
    assert main(["new", "worn", "--from", "human-srl"]) == 0  # it keeps clear of what isn't there while it is jogged
    line = "srl jog worn.yaml --set guard.arm.position_command.clear=null  # nobody wears it or is near it"
    assert f"  {line}\n" in capsys.readouterr().out
    subset(*profile.load("worn.yaml", ["guard.arm.position_command.clear=null"]), None, 0.1, sim=None)


def test_answers_that_are_odd(
    folder: Path, plugged: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(new_questions, "_terminal", lambda: True)
    answers = iter(["²", "\udcff\x1b[2J", "sixth-finger", "²", "1", "1", "no", "\x1b[A/dev/x", "/dev/sixth finger"])
    monkeypatch.setattr("builtins.input", lambda _: next(answers))
    assert main(["new", "mine"]) == 0
    checked, _ = profile.load("mine.yaml")
    assert checked.devices["glove"].options["port"] == str(plugged / "by-id" / "usb-Arduino_75735-if00")
    assert checked.devices["finger"].options["port"] == "/dev/sixth finger"
    output = capsys.readouterr().out
    assert "'²' is none of them" in output
    assert "'\\udcff\\x1b[2J' is none of them" in output
    assert "it is glove's already" in output
    assert "'no' is no path" in output


def test_its_name_alone_names_the_file_that_is_meant(folder: Path) -> None:
    """Not another limb whose name is alike."""
    assert main(["new", "moca-fingers", "--from", "servo-jog"]) == 0
    for command in ("check", "run"):
        assert "no profile has this name. Did you mean moca-fingers.yaml, which is here?" in refused(
            command, "moca-fingers"
        )
    assert "Copy moca-fingers.yaml" in refused("new", "b", "--from", "moca-fingers")


def test_what_only_a_person_can_compare_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    reported = "its limits, directions and ids are those of finger-jog's limb: compare them with yours before it moves"
    assert main(["new", "mine", "--from", "finger-jog"]) == 0
    assert reported in capsys.readouterr().out
    assert main(["new", "seen", "--from", "suit-station"]) == 0
    assert "compare them" not in capsys.readouterr().out


def test_a_port_does_nothing_to_the_terminal(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["new", "mine", "--from", "finger-jog", "--port", "finger=/dev/x\x1b[2J\nchecked: all is well"]) == 0
    assert "port of finger: /dev/x\\x1b[2J\\nchecked: all is well isn't there" in capsys.readouterr().out
