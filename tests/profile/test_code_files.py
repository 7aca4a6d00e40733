"""A law or device in a file beside the profile: what is run, what is refused, and how that is said."""

from __future__ import annotations

import json
import os
import pickle
from pathlib import Path

import pytest
from helpers.own_law import LAW, PROFILE, written
from helpers.run import refused

from srl.commissioning.jog.profile_subset import subset
from srl.runtime.cli import main
from srl.runtime.contracts import code_file
from srl.runtime.contracts.errors import ProfileError
from srl.runtime.profile import profile, wiring
from srl.testing import Lab, check_controller
from srl.testing import bound as bound_law


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_law_and_a_sensor_of_a_file_run_and_are_named_after_their_class(home: Path) -> None:
    with Lab(written(home)) as run:
        run.until("active")
        run.run(1.0)
        assert run["follow-twice.y"] == pytest.approx(0.5 * run["knob.angle"])
        assert run["knob.angle"] > 0.5


def test_check_says_whose_code_is_run_and_where_it_is(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    written(home / "there")
    for options in ([], ["--sim"]):
        assert main(["check", "there/own.yaml", "--json", *options]) == 0
        shown = json.loads(capsys.readouterr().out)
        assert shown["files"]["controllers.0.use"]["path"] == str(home / "there" / "follow.py")
        assert "there/own.yaml line 6: controllers.0.use: the code in ./follow.py is run" in shown["remarks"]
        assert "there/own.yaml line 4: devices.knob.driver: the code in ./follow.py is run" in shown["remarks"]
    assert main(["check", "there/own.yaml"]) == 0
    assert "the code in ./follow.py is run" in capsys.readouterr().out
    assert main(["check", "--all", "there/own.yaml"]) == 0
    assert "follow-twice (./follow.py:FollowTwice)" in capsys.readouterr().out


def test_a_path_that_is_typed_begins_where_srl_runs(home: Path) -> None:
    written(home / "there")
    (home / "other.py").write_text(LAW.replace("gain: float = 0.5", "gain: float = 2.0"))
    typed = ["controllers.0.use=other.py:FollowTwice"]
    graph = wiring.build(*profile.load("there/own.yaml", typed))
    assert graph.controllers[0].config.gain == 2.0  # type: ignore[attr-defined]
    assert set(graph.source.files.kept) == {"./follow.py", "--set other.py"}


def test_the_conformance_of_laws_is_for_one_in_a_file_too(home: Path) -> None:
    _, source = profile.load(str(written(home)))
    law = source.load("controllers", "./follow.py:FollowTwice", "controllers.0.use")
    check_controller(bound_law(law("follow", law.Config(gain=0.1))), {"x": [0.3]}, {})


def test_profiles_whose_files_have_the_same_name_have_their_own_code(home: Path) -> None:
    own = [written(home / "a"), written(home / "b", LAW.replace("self.config.gain *", "3.0 *"))]
    made = [wiring.build(*profile.load(str(path))).controllers[0] for path in own]
    made.append(wiring.build(*profile.load(str(own[0]))).controllers[0])
    assert type(made[0]) is type(made[2])  # an unchanged file isn't run again
    answers = []
    for law in made:
        bound_law(law).input["x"][0] = 1.0
        law.update(0.01)
        answers.append(law.output["y"][0])
    assert answers == [0.5, 3.0, 0.5]


def test_a_changed_file_is_read_anew_and_a_failed_one_leaves_nothing(home: Path) -> None:
    path = written(home, "raise ValueError('not yet')")
    with pytest.raises(code_file.CodeError, match="not yet"):
        wiring.build(*profile.load(str(path)))
    written(home)
    before = wiring.build(*profile.load(str(path))).controllers[0]
    written(home, LAW.replace("gain: float = 0.5", "gain: float = 0.7"))
    assert wiring.build(*profile.load(str(path))).controllers[0].config.gain == 0.7  # type: ignore[attr-defined]
    assert before.config.gain == 0.5  # type: ignore[attr-defined]


def test_what_was_read_with_the_profile_is_run_though_the_file_is_changed_meanwhile(home: Path) -> None:
    path = written(home)
    checked, source = profile.load(str(path))
    wiring.build(checked, source)
    written(home, "raise ValueError('changed')")
    wiring.build(checked, source)


def test_a_class_and_its_objects_can_be_pickled_in_its_process(home: Path) -> None:
    law = wiring.build(*profile.load(str(written(home)))).controllers[0]
    assert pickle.loads(pickle.dumps(law.config)) == law.config


def test_a_file_behind_a_link_is_read(home: Path) -> None:
    path = written(home / "there")
    (home / "there" / "follow.py").rename(home / "elsewhere.py")
    (home / "there" / "follow.py").symlink_to("../elsewhere.py")
    wiring.build(*profile.load(str(path)))


def _broken(old: str, new: str) -> str:
    assert old in LAW
    return LAW.replace(old, new)


LINE = 1 + LAW[: LAW.index("class FollowTwice")].count("\n")
CODE: dict[str, tuple[str, str]] = {
    "no Python": (_broken("class FollowTwice(Controller)", "class FollowTwice(Controller"), f"line {LINE}: this isn't"),
    "fails": (_broken("class FollowTwice", "1 / 0\n\n\nclass FollowTwice"), f"line {LINE}: ZeroDivisionError"),
    "exits": (_broken("class FollowTwice", "raise SystemExit(0)\n\n\nclass FollowTwice"), f"line {LINE}: SystemExit"),
    "no class": (_broken("class FollowTwice", "class Follow_Twice"), "has no class 'FollowTwice'"),
    "no class but a function": (
        _broken("class FollowTwice(Controller):", "def FollowTwice(): ...\n\n\nclass Other(Controller):"),
        "isn't a class",
    ),
    "another base": (_broken("FollowTwice(Controller)", "FollowTwice"), "isn't derived from Controller"),
    "a sensor": (_broken("class Knob(", "FollowTwice = Sensor\n\n\nclass Knob("), "isn't derived from Controller"),
    "no update": (_broken("def update", "def renew"), "lacks update"),
    "no options": (_broken("FollowConfig(ControllerConfig)", "FollowConfig"), "isn't derived from ControllerConfig"),
    "options of a device": (_broken("Config = FollowConfig", "Config = DeviceConfig"), "ControllerConfig"),
    "an old name": (_broken("    def reset", "    def doubts(self): ...\n\n    def reset"), "now called 'warnings'"),
    "no such module": (_broken("import numpy as np", "import nowhere_at_all"), "No module named 'nowhere_at_all'"),
    "no such name": (_broken("import Controller,", "import Kontroller, Controller,"), "Kontroller"),
    "fails when made": (_broken("self.inputs = (Sig", "self.inputs = (config.nothing, Sig"), "line 20: AttributeError"),
    "no super": (_broken("super().__init__(name, config)\n        self.inputs", "self.inputs"), "Begin its `__init__`"),
    "another constructor": (_broken("self, name: str, config: FollowConfig", "self"), "takes 1 positional"),
    "another fake's": (_broken("class FakeKnob(Sensor, Fake)", "class FakeKnob(Knob, Fake)"), "takes 3 positional"),
    "no shape": (_broken('name="x", shape=(1,)', 'name="x", shape=(2,)'), "neither `labels` nor `slots`"),
    "no text": ("\0\1\2", "follow.py"),
    "deep": (f"x = {'(' * 500}1{')' * 500}", "too many nested"),
    "no UTF-8": ("é", "isn't UTF-8 text"),
}


@pytest.mark.parametrize("what", CODE)
def test_code_that_cant_be_used_is_one_line_with_its_file_and_line(what: str, home: Path) -> None:
    text, words = CODE[what]
    path = written(home)
    (home / "follow.py").write_bytes(text.encode("latin-1" if what == "no UTF-8" else "utf-8"))
    found = refused("check", str(path), "--sim")
    assert words in found
    assert "follow.py" in found or what == "no shape"
    assert found.count("\n") == 1, found


def test_what_reads_as_a_comment_is_none_by_no_coding(home: Path) -> None:
    hidden = "# +AAo-raise ValueError('hidden')"
    assert "\nraise" in hidden.encode().decode("utf-7")
    wiring.build(*profile.load(str(written(home, f"# coding: utf-7\n{hidden}\n{LAW}"))))
    wiring.build(*profile.load(str(written(home, f"\ufeff{LAW}"))))


def test_a_file_beside_it_is_no_module(home: Path) -> None:
    (home / "helper.py").write_text("")
    path = written(home, _broken("import numpy as np", "import helper"))
    assert "./follow.py line 5: ModuleNotFoundError: No module named 'helper'" in (found := refused("check", str(path)))
    assert "The file must stand alone" in found


NAMES = {
    "./nowhere.py:FollowTwice": "there is no file",
    "./follow.py": "doesn't say which class",
    "./follow.py:": "'' is no class's name",
    "./follow.py:os.system": "'os.system' is no class's name",
    "./follow.py:np.ndarray": "is no class's name",
    "./follow.py:__import__": "is no class's name",
    "./follow.py:A:B": "there is no file",
    "follow:FollowTwice": "no controller is called 'follow:FollowTwice'",
    "./folder.py:FollowTwice": "Is a directory",
    "./pipe.py:FollowTwice": "a pipe, not a file",
    "./big.py:FollowTwice": "KiB",
    "~nobody-here/x.py:FollowTwice": "no user's home",
    "./follow.py:Controller": "lacks reset, update",
    "./follow.py:FollowTwise": "Did you mean 'FollowTwice'",
}


@pytest.mark.parametrize("name", NAMES)
def test_a_name_that_means_no_class_is_refused_with_its_place(name: str, home: Path) -> None:
    (home / "folder.py").mkdir()
    os.mkfifo(home / "pipe.py")
    (home / "big.py").write_text("#" * (1 << 21))
    path = written(home, profile=PROFILE.replace("./follow.py:FollowTwice", json.dumps(name)))
    found = refused("check", str(path))
    assert NAMES[name] in found
    assert "own.yaml line 6: controllers.0.use" in found


def test_a_sensor_that_nothing_simulates_says_what_is_missing(home: Path) -> None:
    path = written(home, LAW.replace("real = Knob", "pass"))
    wiring.build(*profile.load(str(path)))
    assert "./follow.py has no class that simulates Knob" in (found := refused("check", str(path), "--sim"))
    assert "with real = Knob" in found
    written(home, profile=PROFILE.replace(":Knob", ":FakeKnob"))
    assert "'FakeKnob' of ./follow.py is a simulated device" in refused("check", str(path))


def test_who_reads_a_profile_for_somebody_else_runs_no_code(home: Path) -> None:
    path = written(home, "raise AssertionError('run')")
    with pytest.raises(ProfileError, match=r"controllers\.0|devices\.knob.*isn't run.*--run-code"):
        wiring.build(*profile.parse(str(path), PROFILE))
    with pytest.raises(ProfileError, match="isn't run"):
        wiring.build(*profile.load(str(path), run_code=False))
    for command in ("run", "check"):
        found = refused(command, str(path), *(["--no-run-code"] if command == "run" else []))
        assert ("isn't run" in found) == (command == "run")
    assert "AssertionError: run" in refused("run", str(path), "--no-run-code", "--run-code")  # the last one counts


def test_the_schema_takes_a_file_too(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "--schema"]) == 0
    definitions = json.loads(capsys.readouterr().out)["$defs"]
    for entry, key in (("ControllerEntry", "use"), ("DeviceEntry", "driver")):
        *named, pattern = definitions[entry]["properties"][key]["anyOf"]
        assert pattern["pattern"] == code_file.PATTERN
        assert {"ikns", "firmata"} & {each["const"] for each in named}


BOARD = '''"""The driver firmata and what simulates it, by another name."""

from srl.drivers.firmata import Firmata
from srl.sim.devices.firmata.fake import FakeFirmata


class Board(Firmata):
    pass


class FakeBoard(FakeFirmata):
    real = Board
'''
LIMB = """name: limb
rate: 50
devices:
  board: {driver: ./follow.py:Board, port: /dev/none, servos: {knuckle: {pin: 9, lower: -0.8, upper: 0.8, home: 0.0}}}
controllers:
  - {use: posture-cycle, postures: [{knuckle: 0.2}, {knuckle: 0.4}], in: {position: board.position_command.sent}}
guard: {board.position_command: {velocity: 1.0, acceleration: 5.0}}
sim: {world: cell, parts: {finger: {part: robotic-finger}}, devices: {board: {joints: {knuckle: abduction}}}}
"""


@pytest.mark.parametrize("typed", [(), ("devices.board.driver=there/follow.py:Board",)])
def test_a_limb_whose_driver_is_in_a_file_can_be_jogged(typed: tuple[str, ...], home: Path) -> None:
    """The part of the profile that `srl jog` runs is a profile of its own, with the same file and the same leave."""
    path = written(home / "there", BOARD, LIMB)
    made = subset(*profile.load(str(path), typed), "board", 0.1, sim=[])
    assert type(made.graph.devices[0]).__name__ == "FakeBoard"
    assert set(made.source.files.kept) == {"--set there/follow.py" if typed else "./follow.py"}
    if not typed:
        written(home / "there", BOARD.replace("    pass", "    def __init__(self, name, config):\n        1 / 0"), LIMB)
        assert "./follow.py line 9: ZeroDivisionError" in refused("jog", str(path), "--sim")
    with pytest.raises(ProfileError, match="isn't run"):
        subset(*profile.load(str(path), typed, run_code=False), "board", 0.1, sim=[])
