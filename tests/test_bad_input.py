"""Bad input: one paragraph with the place and the remedy, exit code 2, no traceback."""

from __future__ import annotations

from pathlib import Path

import pytest

from srl.runtime.cli import main
from srl.runtime.contracts.errors import UNAVAILABLE
from srl.runtime.profile import profile

TEXT = profile.find("sixth-finger")[1]

# (what is changed in the profile's text, what the message must name)
WRONG_TEXTS = {
    "unknown driver": (
        ("driver: cyberglove", "driver: cyberglov"),
        ["devices.glove.driver", "line", "'cyberglov'", "cyberglove"],
    ),
    "unknown controller": (("use: object-mapping", "use: object-maping"), ["controllers.1.use", "object-mapping"]),
    "unbound signal": (("    in: {angles: glove.position}\n", ""), ["controllers.0.in", "angles", "isn't bound"]),
    "signal that isn't there": (
        ("in: {tips: hand.tips}", "in: {tips: hand.tip}"),
        ["controllers.1.in.tips", "hand.tips"],
    ),
    "elements that aren't there": (
        ("sensors: 22", "sensors: 18"),
        ["names differ", "hand.angles has thumb_roll", "glove.position has thumb_roll", "no 'index_dij'", "map: {"],
    ),
    "limits by place where the profile chooses the order": (
        ("velocity: 4.0 ", "velocity: [4.0, 4.0, 4.0, 4.0] "),
        ["guard.finger.position_command.velocity", "{abduction: 4, flexion_1: 4"],
    ),
    "a limit of no joint": (
        ("lower: {abduction: ", "lower: {abdukt: "),
        ["guard.finger.position_command.lower", "abdukt", "flexion_3", "abduction"],
    ),
    "wrong unit": (("in: {angles: glove.position}", "in: {angles: mapping.q}"), ["controllers.0.in.angles"]),
    "two writers": (
        ("    out: {q: finger", "    out: {target: hand.tips, q: finger"),
        ["two writers", "hand.tips", "controller 'hand'", "controller 'mapping'"],
    ),
    "no such command": (
        ("out: {q: finger.position_command,", "out: {q: finger.position,"),
        ["controllers.1.out.q", "isn't a command"],
    ),
    "nobody writes the command": (
        ("    out: {q: finger.position_command, q_velocity: finger.position_command.velocity}\n", ""),
        ["finger.position_command", "no controller writes"],
    ),
    "misspelt key": (("rate: 100 ", "rat: 100 "), ["'rat'", "rate"]),
    "misspelt key below": (("velocity: 4.0", "velocty: 4.0"), ["guard.finger.position_command.velocty", "velocity"]),
    "misspelt option of a driver": (("sensors: 22", "sensor: 22"), ["devices.glove.sensor", "sensors"]),
    "misspelt option of a controller": (("    points: [", "    point: ["), ["controllers.1.point", "points"]),
    "a sample that is never stale": (
        ("sensors: 22}", "sensors: 22, max_age: .inf}"),
        ["devices.glove.max_age", "finite number"],
    ),
    "aliases of aliases": (
        ("frames:\n", "a: &a {x: 1}\nb: &b {y: *a, z: *a}\nframes:\n"),
        ["line", "the alias '*a'", "Write one of the two out"],
    ),
    "rate out of range": (("rate: 100 ", "rate: 0 "), ["rate", "1 to 10000"]),
    "an age that the loop would take for none": (
        ("sensors: 22}", "sensors: 22, max_age: 1.0e-10}"),
        ["devices.glove.max_age", "0.000001"],
    ),
    "an age beyond all counting": (
        ("sensors: 22}", "sensors: 22, max_age: 1.0e+300}"),
        ["devices.glove.max_age", "1000000"],
    ),
    "a window without end": (
        ("window: 1.0,", "window: .inf,"),
        ["faults.overrun.window", "finite number"],
    ),
    "key twice": (("rate: 100 ", "rate: 100\nrate: 100 "), ["line", "rate"]),
    "not YAML": (("devices:", "devices: ["), ["line", "YAML"]),
    "category it can't do": (("stop: {finger: hold}", "stop: {finger: damp}"), ["stop.finger", "damp", "hold"]),
    "limits missing": (("    velocity: 4.0  ", "    jerk: 4.0  "), ["guard.finger.position_command", "velocity"]),
    "wrong number of limits": (
        ("velocity: 4.0 ", "velocity: [4.0, 4.0] "),
        ["guard.finger.position_command", "2", "4"],
    ),
    "unknown frame parent": (("  hand: {}", "  hand: {parent: world}"), ["frames.hand.parent", "world"]),
    "stop of no device": (("stop: {finger: hold}", "stop: {finge: hold}"), ["stop.finge", "finger"]),
    "truth as input": (("in: {tips: hand.tips}", "in: {tips: world.hand_tips}"), ["controllers.1.in.tips"]),
    "a world that is made of parts now": (
        ("  world: cell", "  world: augmented-hand"),
        ["line", "sim.world", "made of parts now", "human-hand", "robotic-finger"],
    ),
    "home outside": (("home: 0.0}", "home: 9.0}"), ["finger"]),
    "a person's stop for the bus": (
        ("frames:\n", "reset: {bus: [bus, person]}\nframes:\n"),
        ["line", "reset.bus", "may not release 'person'", "srl reset", "may be granted: bus, fault"],
    ),
    "no latch": (("frames:\n", "reset: {bus: [buss]}\nframes:\n"), ["reset.bus", "'buss' is no latch", "bus, fault"]),
    "reset by no signal": (
        ("frames:\n", "reset: {inputs: [{signal: glove.button}]}\nframes:\n"),
        ["line", "reset.inputs.0", "'glove.button'", "glove.position"],
    ),
    "reset by no element": (
        ("frames:\n", "reset: {inputs: [{signal: glove.position, element: pinky}]}\nframes:\n"),
        ["reset.inputs.0", "no element 'pinky'", "pinkie_mpj"],
    ),
    "reset by it isn't said which": (
        ("frames:\n", "reset: {inputs: [{signal: glove.position}]}\nframes:\n"),
        ["reset.inputs.0", "22 elements", "`element:`", "wrist_yaw"],
    ),
    "an e-stop by its place": (
        ("frames:\n", "emergency: [{signal: glove.buttons, index: 0}]\nframes:\n"),
        ["emergency.0", "`index: 0` is a place", "`element:` with one of: wrist_switch"],
    ),
    "an e-stop that is a point": (
        ("frames:\n", "emergency: [{signal: hand.tips, element: thumb}]\nframes:\n"),
        ["emergency.0", "'hand.tips' has no elements that are one number"],
    ),
    "a plot by its place": (
        ('world.hand_tips[thumb]"]\n        finger to middle', 'hand.tips[0]"]\n        finger to middle'),
        ["record.plots.0", "0 is a place", "thumb, index"],
    ),
    "a plot of a component by its place": (
        ("  plots:\n", '  plots:\n    - {title: Thumb, unit: m, lines: {y: "hand.tips[thumb,1]"}}\n'),
        ["record.plots.0", "'hand.tips[thumb,1]'", "1 is a place", "Write one of: x, y, z"],
    ),
    "a plot of no component": (
        ("  plots:\n", '  plots:\n    - {title: Thumb, unit: m, lines: {y: "hand.tips[thumb,q]"}}\n'),
        ["record.plots.0", "has no 'q'", "Known: x, y, z"],
    ),
    "a plot of no element": (
        ("hand.skeleton[middle_base]", "hand.skeleton[middle_bas]"),
        ["record.plots.0", "no 'middle_bas'", "middle_base"],
    ),
    "reset by a law": (
        ("frames:\n", "reset: {inputs: [{signal: hand.tips}]}\nframes:\n"),
        ["reset.inputs.0", "'hand.tips' isn't the state of a device", "glove.position"],
    ),
    "reset by an emergency input": (
        (
            "frames:\n",
            "emergency: [{signal: glove.buttons}]\nreset: {inputs: [{signal: glove.buttons, when: 0}]}\nframes:\n",
        ),
        ["reset.inputs.0", "is an emergency input"],
    ),
    "a button that is never pressed": (
        ("frames:\n", "reset: {inputs: [{signal: glove.position, when: .nan}]}\nframes:\n"),
        ["reset.inputs.0.when", "finite"],
    ),
}


@pytest.mark.parametrize("case", WRONG_TEXTS)
def test_wrong_profiles(case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (old, new), names = WRONG_TEXTS[case]
    assert TEXT.count(old) == 1, f"the profile has changed; '{old}' is to be found once"
    path = tmp_path / "wrong.yaml"
    path.write_text(TEXT.replace(old, new))
    assert main(["check", str(path)]) == 2
    output = capsys.readouterr().err
    assert output.startswith("srl check: ")
    assert "Traceback" not in output
    assert len(output.strip().splitlines()) == 1
    for name in names:
        assert name in output, f"'{name}' isn't in: {output}"


def test_buttons_of_other_names_than_the_laws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = profile.find("moca-man")[1]
    assert "{A: {pin: 2}, M: {pin: 3}, G: {pin: 4}, P: {pin: 5}}" in text
    path = tmp_path / "wrong.yaml"
    path.write_text(text.replace("{A: {pin: 2}, M: {pin: 3}, G:", "{stop: {pin: 2}, go: {pin: 3}, left:"))
    assert main(["check", str(path)]) == 2
    output = capsys.readouterr().err
    for part in (
        "controllers.0.in.buttons",
        "A, M, G, P",
        "stop, go, left, P",
        "{from: panel.buttons, map: {A: NAME}}",
    ):
        assert part in output


WRONG_CALLS = {
    "no such profile": (["check", "sixth-fingr"], ["sixth-finger"]),
    "no such file": (["check", "nowhere/my.yaml"], ["nowhere/my.yaml", "No such file"]),
    "odd override": (["check", "sixth-finger", "--set", "rate"], ["--set rate", "key.path=value"]),
    "override of nothing": (["check", "sixth-finger", "--set", "rate.x.y=1"], ["--set"]),
    "override with a wrong key": (
        ["check", "sixth-finger", "--set", "devices.glove.prt=/dev/x"],
        ["--set devices.glove.prt", "port"],
    ),
    "simulate no device": (["check", "sixth-finger", "--sim", "glov"], ["--sim glov", "glove"]),
    "negative duration": (["run", "sixth-finger", "--sim", "--duration", "-1"], ["--duration"]),
    "fast with real devices": (["run", "sixth-finger", "--sim", "glove", "--fast"], ["--fast", "finger"]),
    "wearer without simulation": (["run", "sixth-finger", "--wearer", "x.csv"], ["--wearer", "--sim"]),
    "recording with another name": (["run", "sixth-finger", "--sim", "--record", "x.bag"], ["x.bag", ".rrd"]),
    "wearer of no hand": (
        ["run", "hand-jog", "--sim", "--wearer", "x.csv"],
        ["--wearer", "no hand", "human-hand"],
    ),
    "no such wearer": (["run", "sixth-finger", "--sim", "--wearer", "nowhere.csv", "--duration", "1"], ["nowhere.csv"]),
    "missing port": (
        ["run", "sixth-finger", "--sim", "finger", "--set", "devices.glove.port=/dev/ttyUSB99", "--duration", "1"],
        ["glove", "/dev/ttyUSB99"],
    ),
    "nothing runs": (["stop"], ["nothing runs"]),
    "no such recording": (["replay", "nowhere.rrd"], ["nowhere.rrd"]),
    "odd rate": (["doctor", "--rate", "fast"], ["--rate", "fast"]),
}


@pytest.mark.parametrize("case", WRONG_CALLS)
def test_wrong_calls(
    case: str, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SRL_RUNTIME_DIR", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    arguments, names = WRONG_CALLS[case]
    assert main(arguments) == (UNAVAILABLE if case == "missing port" else 2)
    output = capfd.readouterr().err
    assert "Traceback" not in output
    for name in names:
        assert name in output, f"'{name}' isn't in: {output}"
