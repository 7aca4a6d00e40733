"""`srl calibrate PROFILE servos`: hidden trims, senses and scales are found; what can't be used is refused."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.edited import edited

from srl.commissioning.calibration.keyed import Keyed
from srl.commissioning.calibration.request import CalibrationRequest
from srl.commissioning.calibration.servos.method import ServoMethod
from srl.commissioning.calibration.servos.procedure import Kind, Procedure
from srl.commissioning.calibration.servos.samples import Samples, ServoMarksConfig
from srl.commissioning.jog.hold import PAUSE, Hold
from srl.commissioning.jog.profile_subset import subset
from srl.drivers.firmata.driver import COMMAND
from srl.runtime.cli import main
from srl.runtime.contracts.servo_record import ServoRecord
from srl.runtime.ipc.header import DEVICE, LINK_CONNECTED, State
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.models import record_file
from srl.runtime.profile import profile, wiring

PROFILE = """
name: tip
summary: two servos of a finger
rate: 50
devices:
  finger:
    driver: firmata
    port: /dev/ttyACM0
    calibration: tip.json
    servos:
      flexion_2: {pin: 9, lower: -1.571, upper: 1.571, home: 0.3}
      flexion_3: {pin: 10, lower: -1.571, upper: 1.571, home: 0.4}
setpoints:
  client.position: {shape: [2], unit: rad, labels: [flexion_2, flexion_3], max_age: 0.5}
controllers:
  - use: joint-setpoint
    joints: [flexion_2, flexion_3]
    in: {target: client.position}
    out: {q: finger.position_command, q_velocity: finger.position_command.velocity}
guard:
  finger.position_command: {lower: -1.0, upper: 1.2, velocity: 1.0, acceleration: 10.0}
stop: {finger: hold}
frames: {hand: {}, finger: {parent: hand, position: [0.0, 0.3, 0.3]}}
sim:
  world: cell
  parts: {finger: {part: robotic-finger}}
  devices:
    finger:
      characteristic:
        flexion_2: {shortest: 1.40, longest: -1.80}
        flexion_3: {shortest: -1.50, longest: 1.40}
"""
TRUE = {"flexion_2": (1.40, -1.80), "flexion_3": (-1.50, 1.40)}  # rad at 544 and 2400 us
QUICK = ("speed=0.2", "second=0.7", "by=E01")
ERROR = 0.012  # rad, at the reference angles and between them


def method(folder: Path, *overrides: str, option: tuple[str, ...] = QUICK, sim: bool = True) -> ServoMethod:
    order = CalibrationRequest(str(folder / "tip.yaml"), "servos", option=option, sim=sim)
    return ServoMethod(order, *profile.load(order.profile, overrides), folder / "tip.json", lambda _: None)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the profile, its file, and the recording."""
    folder = tmp_path_factory.mktemp("servos")
    (folder / "tip.yaml").write_text(PROFILE)
    options = [part for each in QUICK for part in ("--option", each)]
    record = str(folder / "tip.rrd")
    assert main(["calibrate", str(folder / "tip.yaml"), "servos", "--sim", "--record", record, *options]) == 0
    return folder


def found(folder: Path) -> ServoRecord:
    return record_file.read(ServoRecord, folder / "tip.json")


def test_hidden_trims_senses_and_scales_are_found(made: Path) -> None:
    """The truth is the simulated finger's, which neither the profile nor the calibration reads."""
    record = found(made)
    assert (record.by, record.device, record.driver, record.simulated) == ("E01", "finger", "firmata", True)
    assert [line.direction for line in record.joints.values()] == [-1, 1]
    assert all(line.known for line in record.joints.values())
    (driver,) = wiring.build(*profile.load(str(made / "tip.yaml"), ()), []).devices
    for name, servo in driver.config.joints.items():  # type: ignore[attr-defined]
        at_min, at_max = TRUE[name]
        for q in (0.0, 0.35, 0.7):
            pulse = servo.calibration.pulse(q)
            true = at_min + (at_max - at_min) * (pulse - 544) / (2400 - 544)
            assert abs(true - q) < ERROR, (name, q)
        assert (servo.calibration.shortest, servo.calibration.longest) == (544, 2400)
    assert (made / "tip.json.report.png").stat().st_size > 5000


def test_a_run_goes_where_it_is_told_only_with_the_file(made: Path) -> None:
    def off(*overrides: str) -> float:
        run = subset(*profile.load(str(made / "tip.yaml"), overrides), None, 0.1, [])
        lockstep, graph = Lockstep(run.graph), run.graph
        terminal = graph.row.devices[graph.layout.devices.index("terminal")]
        terminal[DEVICE.link] = LINK_CONNECTED
        for i in range(100):
            terminal[DEVICE.stamp] = (i + 1) * lockstep.period
            lockstep.step()
        assert lockstep.cycle.machine.state is State.ACTIVE
        (finger,) = graph.devices
        return float(np.abs(finger.looks() - finger.home[COMMAND]).max())  # type: ignore[attr-defined]

    assert off() < 0.03
    assert off("devices.finger.calibration=null") > 0.2


def test_a_changed_calibration_begins_without_a_jump(made: Path) -> None:
    """The calibration leaves each joint where the next run's first command is; and begins where a run begins."""
    (now,) = wiring.build(*profile.load(str(made / "tip.yaml"), ()), []).devices
    first = [s.calibration.pulse(s.home) for s in now.config.joints.values()]  # type: ignore[attr-defined]
    channel_map, rows = _recording(made)
    last = channel_map.samples(rows).angles[-1]
    bare = [s.calibration for s in now.config.servos.values()]  # type: ignore[attr-defined]
    left = [servo.pulse(angle) for servo, angle in zip(bare, last, strict=True)]
    assert np.abs(np.subtract(first, left)).max() <= 0.011 * 590.8 + 1  # 0.01 rad: what `home` allows
    before = [s.pulse(s_.home) for s, s_ in zip(bare, now.config.servos.values(), strict=True)]  # type: ignore[attr-defined]
    assert np.abs(np.subtract(first, before)).max() > 100  # without that it would jump
    again = method(made).driven.actuator.home  # with the file there: not from the profile's own home
    assert again is not None
    assert np.abs(np.subtract([s.pulse(a) for s, a in zip(bare, again.tolist(), strict=True)], first)).max() <= 1


def _recording(made: Path) -> tuple[Any, Any]:
    from srl.commissioning.calibration.sources import recorded

    return recorded(made / "tip.rrd", method(made).channel_map)


def test_a_recording_gives_the_same_file_and_the_old_one_is_kept(made: Path) -> None:
    before = (made / "tip.json").read_bytes()
    arguments = ["calibrate", str(made / "tip.yaml"), "servos", "--recording", str(made / "tip.rrd")]
    assert main(arguments) == 2
    assert main([*arguments, "--yes"]) == 0
    assert (made / "tip.json").read_bytes() == before
    assert (made / "tip.json.old").read_bytes() == before
    assert main([*arguments, "--yes", "--option", "share=0.01"]) == 2
    assert (made / "tip.json").read_bytes() == before


def change(key: str, value: object) -> Callable[[Any], None]:
    def changed(plain: Any) -> None:
        *path, last = key.split(".")
        for each in path:
            plain = plain[each]
        plain[last] = value

    return changed


def renamed(plain: Any) -> None:
    plain["joints"]["thumb"] = plain["joints"].pop("flexion_2")


@pytest.mark.parametrize(
    ("what", "words"),
    [
        (change("device", "other"), "it is of the device 'other', this one is 'finger'"),
        (change("driver", "feetech"), "it is of servos of 'feetech', the device is a 'firmata'"),
        (renamed, "this one has no joint 'thumb'"),
        (lambda plain: plain["joints"].pop("flexion_2"), "it says nothing of the joint 'flexion_2'"),
        (change("joints.flexion_2.trim", 0.61), "a trim of 0.61 rad is no servo's: 0.6 rad at most"),
        (change("joints.flexion_2.scale", 1.3), "a scale of 1.3 is no servo's: it may be off by 25% at most"),
        (change("joints.flexion_2.direction", 0), "joints.flexion_2.direction"),
        (change("joints.flexion_2.entry.pin", 10), "it was made with pin 10, the profile says 9"),
        (change("joints.flexion_2.entry.reversed", True), "it was made with reversed true, the profile says false"),
    ],
)
def test_files_that_check_and_run_refuse(
    what: Callable[[Any], object], words: str, made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "tip.yaml").write_text(PROFILE)
    edited(made / "tip.json", what, tmp_path / "tip.json")
    for command in ("check", "run"):
        assert main([command, str(tmp_path / "tip.yaml"), "--sim"]) == 2
        assert words in capsys.readouterr().err


def test_a_number_that_was_changed_and_a_simulated_file_on_real_servos_are_refused(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(made / "tip.yaml")]) == 2
    assert "devices.finger.calibration: it was made in simulation, and this device is real" in capsys.readouterr().err
    (tmp_path / "tip.yaml").write_text(PROFILE)
    assert main(["check", str(tmp_path / "tip.yaml"), "--sim"]) == 2
    assert "srl calibrate PROFILE servos" in capsys.readouterr().err  # there is no file
    plain = json.loads((made / "tip.json").read_text())
    plain["joints"]["flexion_2"]["trim"] += 0.1
    (tmp_path / "tip.json").write_text(json.dumps(plain))
    assert main(["check", str(tmp_path / "tip.yaml"), "--sim"]) == 2
    assert "it was changed after it was written" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ("first=thumb:0.1", "the device has no joint 'thumb'"),
        ("second=fast", "'fast' is no angle in rad"),
        ("trim=2", "--option"),
        ("device=hand", "'hand' is no device that is calibrated by 'servos'"),
    ],
)
def test_options_that_are_refused(option: str, words: str, made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["calibrate", str(made / "tip.yaml"), "servos", "--sim", "-o", str(made / "x.json")]
    assert main([*arguments, "--option", option]) == 2
    assert words in capsys.readouterr().err


def test_the_bounds_meanwhile_hold_wherever_the_zeros_are(made: Path) -> None:
    """Guard -1.0 to 1.2: either way round, 0.6 rad and a quarter off, and never beyond the pulses."""
    wide = method(made).driven
    limits = wide.profile.guard["finger.position_command"].to_limits((2,), "test", tuple(wide.speed), True)
    np.testing.assert_allclose(limits.lower, [-1.571] * 2)  # the pulses' ends: -1.2 / 0.75 - 0.6 is beyond
    np.testing.assert_allclose(limits.upper, [1.571] * 2)
    narrow = method(made, "guard.finger.position_command.lower=-0.3", "guard.finger.position_command.upper=0.6").driven
    limits = narrow.profile.guard["finger.position_command"].to_limits((2,), "test", tuple(wide.speed), True)
    np.testing.assert_allclose(limits.lower, [-0.6 / 0.75 - 0.6] * 2)
    np.testing.assert_allclose(limits.upper, [0.6 / 0.75 + 0.6] * 2)
    assert "calibration" not in wide.profile.devices["finger"].options
    assert not wide.profile.setpoints.keys() - {"terminal.way", "terminal.press"}


def options(folder: Path, **more: Any) -> ServoMarksConfig:
    plain = {key: value for key, value in method(folder)._marked().items() if key not in ("use", "name")}
    return ServoMarksConfig.model_validate(plain | more)


class Hand:
    """Samples of two joints for a procedure, at 50 Hz."""

    def __init__(self, procedure: Procedure) -> None:
        self.procedure, self.t, self.at = procedure, 0.0, np.array([0.3, 0.4])

    def stay(self, seconds: float, **to: float) -> None:
        self.at = np.array([to.get("one", self.at[0]), to.get("two", self.at[1])])
        for _ in range(round(seconds * 50)):
            self.t += 0.02
            mark = np.array([self.procedure.step.mark])
            self.procedure.feed(Samples(np.array([self.t]), self.at[None].copy(), mark))

    def joint(self, name: str, first: float, second: float, home: float | None) -> None:
        self.stay(0.1, **{name: first})
        assert self.procedure.go_on() == ""
        self.stay(2.0)
        self.stay(0.1, **{name: second})
        assert self.procedure.go_on() == ""
        self.stay(2.0)
        if home is not None:
            assert self.procedure.step.kind is Kind.HOME
            assert self.procedure.go_on() == "hold a key until it is home, within 0.01 rad"
            self.stay(1.0)
            assert self.procedure.step.kind is Kind.HOME
            self.stay(1.0, **{name: home})


def test_the_procedure_goes_on_only_where_it_should(made: Path) -> None:
    procedure = Procedure(options(made), None)
    hand = Hand(procedure)
    hand.stay(0.1, one=0.1)
    assert procedure.step.moves == 0
    assert procedure.go_on() == ""
    assert procedure.step.moves is None  # no key moves it while it is taken
    hand.stay(0.8)
    assert procedure.step.kind is Kind.HOLD
    hand.stay(0.1, one=0.2)
    assert procedure.step.kind is Kind.SETTLE  # it was moved: it begins anew
    hand.stay(2.0)
    assert procedure.go_on() == "move it further: by 0.25 rad at least"
    hand.stay(0.1, one=0.9)
    procedure.go_on()
    hand.stay(2.0)
    assert procedure.step == procedure.step.__class__(Kind.HOME, 1)
    hand.stay(1.0, one=0.5)  # home 0.3, the places are 0.2 and 0.9 for 0 and 0.7
    hand.joint("two", 0.5, -0.2, 0.1)  # it turns the other way: its home is at 0.5 - 0.4
    assert procedure.done
    assert procedure.step.moves is None
    assert procedure.view().states == ("done", "done")


def test_a_weak_joint_is_told_and_done_again_or_left_out(made: Path) -> None:
    procedure = Procedure(options(made), None)
    hand = Hand(procedure)
    hand.joint("one", 0.9, 1.5, None)  # a trim of 0.9
    assert procedure.view().states[0].startswith("weak: its trim is")
    assert procedure.redo(3) == "the joints are 1 to 2"
    assert procedure.redo(1) == ""
    assert procedure.skip() == ""
    hand.stay(0.1)
    assert procedure.step.kind is Kind.HOME  # where the profile says
    assert procedure.skip() == "bring it home first: the next run begins there"
    hand.stay(1.0, one=0.3)
    assert procedure.skip() == "one joint must remain"
    hand.joint("two", 0.0, 0.7, 0.4)
    assert procedure.view().states == ("left out", "done")
    assert procedure.done


def test_a_key_that_is_held_into_the_next_step_moves_nothing() -> None:
    hold = Hold(("one", "two"), 0.03)
    hold.guide(0, 0.0)
    hold.key("right", 0.01)
    assert hold.moving == 1.0  # no key was held before
    hold.guide(1, 0.1)
    for t in (0.11, 0.5, 1.2, 1.9):
        hold.key("right", t)
        assert not hold.at(t)[0].any()
    hold.key("right", 1.9 + PAUSE)
    np.testing.assert_array_equal(hold.at(1.9 + PAUSE)[0], [0.0, 1.0])
    hold.key("1", 2.8)
    assert hold.joint == 1  # the guide chooses
    hold.press(0, 1.0, 9.0, 2.9)
    assert not hold.at(2.9)[0].any()
    hold.press(1, 1.0, 9.0, 2.9 + PAUSE)
    assert hold.at(3.8)[0].tolist() == [0.0, 1.0]
    hold.guide(1, 3.8)  # the next step is of the same joint
    for t in (3.82, 4.0, 4.6):
        hold.press(1, 1.0, t + 0.04, t)
        assert not hold.at(t)[0].any()
    hold.press(1, 0.0, 9.0, 4.7)  # let go
    hold.press(1, -1.0, 9.0, 4.61 + PAUSE)
    assert hold.at(6.0)[0].tolist() == [0.0, -1.0]
    hold.guide(None, 7.0)
    hold.press(1, 1.0, 9.5, 9.0)
    assert not hold.at(9.0)[0].any()
    hold.key("left", 9.0)
    assert not hold.at(9.0)[0].any()


def test_keys_guide_or_move() -> None:
    screen = Keyed("test")
    assert not any(screen.key(key, State.ACTIVE) for key in ("left", "right", ",", ".", "space", "esc", "x"))
    assert screen.command() == "none"
    assert not screen.key("s", State.READY)  # starts
    assert not screen.key("r", State.STOPPED)  # resets
    for key in ("enter", "s", "r", "3", "9", "backspace", "1", "enter", "q"):
        assert screen.key(key, State.ACTIVE), key
    assert [screen.command() for _ in range(5)] == ["", "s", "r 31", "q", "none"]


def test_no_terminal_moves_nothing(
    made: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO())
    arguments = ["calibrate", str(made / "tip.yaml"), "servos", "-o", str(tmp_path / "x.json")]
    assert main(arguments) == 2
    assert "standard input is no terminal, so no key can be read" in capsys.readouterr().err
    assert not (tmp_path / "x.json").exists()
