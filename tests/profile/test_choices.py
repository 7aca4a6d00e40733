"""Alternatives of a profile, of which one word picks one."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from helpers.run import call

from srl.runtime.cli import main
from srl.runtime.contracts.errors import ProfileError
from srl.runtime.profile import profile, wiring

BOARD = "{driver: firmata, port: /dev/ttyACM0, servos: {knuckle: {pin: 9, lower: -0.8, upper: 0.8, home: 0.0}}}"
TEXT = f"""name: two-ways
rate: 50
input: client
devices:
  board: {BOARD}
controllers:
  - {{use: joint-setpoint, name: jog, joints: [knuckle], in: {{target: intent.q}},
     out: {{q: board.position_command, q_velocity: board.position_command.velocity}}}}
guard:
  board.position_command: {{velocity: 1.0, acceleration: 5.0}}
stop: {{board: hold}}
sim:
  world: cell
  parts: {{finger: {{part: robotic-finger}}}}
  devices: {{board: {{joints: {{knuckle: abduction}}}}}}
choices:
  input:
    client:
      setpoints:
        client.target: {{shape: [1], unit: rad}}
      controllers:
        - {{use: joint-setpoint, name: intent, joints: [knuckle], in: {{target: client.target}}}}
    ring:
      devices:
        ring: {{driver: ring, debounce: 0.03}}
      controllers:
        - {{use: joint-setpoint, name: intent, joints: [knuckle], unit: rad, in: {{target: ring.buttons}}}}
      sim:
        devices: {{ring: {{presses: [[1.0, 2.0]]}}}}
"""


def parse(text: str = TEXT, *overrides: str) -> tuple[profile.Profile, profile.Source]:
    return profile.parse("two.yaml", text, overrides)


def line(text: str, what: str) -> int:
    """The number of the line that `what` is on."""
    return text[: text.index(what)].count("\n") + 1


def test_a_word_picks_the_branch_and_leaves_the_other_out() -> None:
    client, source = parse()
    assert source.chosen == {"input": "client"}
    assert list(client.devices) == ["board"]
    assert list(client.setpoints) == ["client.target"]
    assert [law.name for law in client.controllers] == ["intent", "jog"]
    ring, source = parse(TEXT, "input=ring")
    assert source.chosen == {"input": "ring"}
    assert set(ring.devices) == {"board", "ring"}
    assert not ring.setpoints
    assert ring.sim is not None
    assert set(ring.sim.devices) == {"board", "ring"}


def test_the_chosen_branch_is_as_if_it_were_written_in_the_profile() -> None:
    plain = TEXT[: TEXT.index("choices:")].replace("input: client\n", "")
    plain = plain.replace("guard:", "setpoints:\n  client.target: {shape: [1], unit: rad}\nguard:").replace(
        "controllers:\n",
        "controllers:\n  - {use: joint-setpoint, name: intent, joints: [knuckle], in: {target: client.target}}\n",
    )
    assert parse(plain)[0] == parse()[0]


def test_only_the_chosen_branchs_devices_are_built() -> None:
    graph = wiring.build(*parse(), [])
    assert graph.simulated == ["board"]
    assert graph.world is not None
    graph.world.close()


@pytest.mark.parametrize(
    ("old", "new", "overrides", "where", "what"),
    [
        ("input: client\n", "", (), "choices:", "nothing says which 'input'"),
        ("input: client", "input: clinet", (), "input: clinet", "isn't one of the choices of 'input'"),
        ("    ring:\n", "    Ring:\n", (), "Ring:", "isn't a valid name"),
        ("      setpoints:\n", "      rate:\n", (), "      rate:", "can't have the key 'rate'"),
        ("debounce: 0.03", "debounce: 3", ("input=ring",), "debounce", "less than or equal to 0.5"),
        ("name: jog, joints: [knuckle]", "name: jog, joint: [k]", (), "name: jog", "'joint'"),
        ("joints: [knuckle], in: {target: c", "jo: [k], in: {target: c", (), "jo: [k]", "'jo'"),
    ],
)  # fmt: skip
def test_errors_name_the_line_where_it_is_written(
    old: str, new: str, overrides: tuple[str, ...], where: str, what: str
) -> None:
    assert TEXT.count(old) == 1
    text = TEXT.replace(old, new)
    with pytest.raises(ProfileError) as caught:
        wiring.build(*parse(text, *overrides))
    found = line(text, where) + (where == "choices:")
    assert caught.value.place.startswith(f"two.yaml line {found}: "), caught.value.place
    assert what in caught.value.problem


def test_an_unknown_word_is_refused_with_those_there_are() -> None:
    with pytest.raises(ProfileError) as caught:
        parse(TEXT, "input=glove")
    assert caught.value.place == "--set input"
    assert "client, ring" in caught.value.remedy


def test_what_a_choice_brings_can_be_overridden_like_the_rest_of_the_profile() -> None:
    # The order doesn't matter: the choice is made first.
    ring, source = parse(TEXT, "devices.ring.debounce=0.1", "input=ring")
    assert ring.devices["ring"].options["debounce"] == 0.1
    assert source.place("devices.ring.debounce") == "--set devices.ring.debounce"
    ring, source = parse(TEXT, "choices.input.ring.devices.ring.debounce=0.2", "input=ring")
    assert ring.devices["ring"].options["debounce"] == 0.2
    assert source.place("devices.ring.debounce") == "--set choices.input.ring.devices.ring.debounce"


def test_a_key_given_twice_is_refused_unless_the_contents_are_equal() -> None:
    again = TEXT.replace("        ring: {driver: ring", f"        board: {BOARD}\n        ring: {{driver: ring")
    assert parse(again, "input=ring")[0] == parse(TEXT, "input=ring")[0]
    other = again.replace("pin: 9", "pin: 10", 1)
    assert parse(other)[1].chosen == {"input": "client"}  # in a branch that isn't chosen nothing collides
    with pytest.raises(ProfileError, match="given twice") as caught:
        parse(other, "input=ring")
    assert "devices.board.servos.knuckle.pin" in caught.value.problem


def test_two_choices_come_in_their_order_and_must_not_collide() -> None:
    branches = "  more:\n    a: {controllers: [{use: gripper}]}\n    b: {setpoints: {client.target: {shape: [2]}}}\n"
    more = TEXT.replace("input: client", "input: client\nmore: a") + branches
    assert [law.use for law in parse(more)[0].controllers] == ["joint-setpoint", "gripper", "joint-setpoint"]
    _, source = parse(more)
    assert source.place("controllers.0.use").endswith("choices.input.client.controllers.0.use")
    assert source.place("controllers.1.use").endswith("choices.more.a.controllers.0.use")
    assert source.place("controllers.2.use") == f"two.yaml line {line(more, '- {use')}: controllers.0.use"
    with pytest.raises(ProfileError, match="given twice"):
        parse(more, "more=b")


def test_a_choice_may_not_be_called_like_a_key_of_the_profile() -> None:
    with pytest.raises(ProfileError, match="a key of every profile"):
        parse(TEXT.replace("  input:\n", "  guard:\n"))


@pytest.mark.parametrize("choices", ["3", "[a]", "{input: 3}", "{input: {}}", "{input: {client: []}}"])
def test_malformed_choices_are_refused(choices: str) -> None:
    with pytest.raises(ProfileError):
        parse(TEXT[: TEXT.index("choices:")] + f"choices: {choices}\n")


@pytest.mark.slow
def test_srl_check_shows_the_word_and_refuses_another_without_a_traceback(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "two.yaml").write_text(TEXT)
    assert main(["check", str(tmp_path / "two.yaml")]) == 0
    assert "choice input: client" in capsys.readouterr().out
    assert main(["check", str(tmp_path / "two.yaml"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["chosen"] == {"input": "client"}
    refused = call(tmp_path, "check", "two.yaml", "--set", "input=glove", code=2)
    assert "client, ring" in refused.stderr
    assert "Traceback" not in refused.stderr


def test_the_recording_holds_the_word() -> None:
    assert wiring.build(*parse()).layout.meta["chosen"] == {"input": "client"}


def test_a_text_that_is_read_again_has_nothing_of_the_first_readings_overrides() -> None:
    first, _ = parse(TEXT, "guard.board.position_command.velocity=2.0", "sim.parts.finger={part: robotic-finger}")
    again, source = parse()
    assert (first.guard["board.position_command"].velocity, again.guard["board.position_command"].velocity) == (
        2.0,
        1.0,
    )
    assert source.place("stop") == "two.yaml line 11: stop"
