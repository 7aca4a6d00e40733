"""Overrides written into a profile's text: the same profile as with `--set`, and every other character as before."""

from __future__ import annotations

import difflib

import pytest

from srl.runtime.contracts.errors import ProfileError
from srl.runtime.profile import library, profile
from srl.runtime.profile.edit import as_yaml, edited
from srl.runtime.profile.overrides import value

TEXT = """\
# of the whole
name: one        # of the name
rate: 100
devices:
  # of the glove
  glove: {driver: cyberglove, port: /dev/ttyUSB0}   # of its line
  finger:
    driver: firmata
    port: /dev/ttyACM0     # of the port
    note: |
      two
      lines
    # behind the finger
controllers:
  - use: law     # of the first law
    points: [thumb,   # of the thumb
             index]
  - {use: other}
guard:
  finger.position_command: {velocity: 1.0}
stop: {}
faults:
bus:   # as: it is
sim:
  world: cell  # last
"""


def changes(text: str, *overrides: str) -> list[str]:
    """The lines that went and came."""
    after = edited("one.yaml", text, overrides)
    lines = difflib.unified_diff(text.splitlines(), after.splitlines(), lineterm="", n=0)
    return [line for line in lines if not line.startswith(("---", "+++", "@@"))]


@pytest.mark.parametrize(
    ("override", "line"),
    [
        ("name=two", "name: two        # of the name"),
        ("name=a-longer-name", "name: a-longer-name  # of the name"),
        ("devices.glove.port=tcp://a:1", "  glove: {driver: cyberglove, port: tcp://a:1}      # of its line"),
        ("devices.glove.port=with, comma", '  glove: {driver: cyberglove, port: "with, comma"}  # of its line'),
        ("devices.glove.port='07'", "  glove: {driver: cyberglove, port: '07'}           # of its line"),
        ("devices.finger.port=udp://:7", "    port: udp://:7         # of the port"),
        ("guard.finger.position_command.velocity=2", "  finger.position_command: {velocity: 2}"),
        ("controllers.1.use=third", "  - {use: third}"),
        ("stop={glove: hold}", "stop: {glove: hold}"),
        ("faults={contact: hold}", "faults: {contact: hold}"),
        ("bus={decimate: 5}", "bus: {decimate: 5}  # as: it is"),
        ("sim.world=null", "  world: null  # last"),
    ],
)
def test_one_value_changes(override: str, line: str) -> None:
    _, now = changes(TEXT, override)
    assert now == f"+{line}"


@pytest.mark.parametrize(
    ("override", "lines"),
    [
        ("seed=3", ["+seed: 3"]),
        ("sim.devices.glove.rate=60", ["+  devices: {glove: {rate: 60}}"]),
        ("devices.finger.baud=9600", ["+    baud: 9600"]),
        ("controllers.0.name=law", ["+    name: law"]),
        ("stop.glove=hold", ["-stop: {}", "+stop: {glove: hold}"]),
    ],
)
def test_a_key_that_was_not_there_is_added(override: str, lines: list[str]) -> None:
    assert changes(TEXT, override) == lines


def test_several_at_once() -> None:
    assert len(changes(TEXT, "seed=3", "name=two", "devices.glove.port=x", "devices.glove.hand=left")) == 5


def test_a_text_without_a_last_newline() -> None:
    assert edited("one.yaml", "name: a", ["seed=3"]) == "name: a\nseed: 3"


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("rate", "expected key.path=value"),
        ("rate.x=1", "'x' has no place there"),
        ("rate.x.y=1", "there is no 'x' to go into"),
        ("controllers.7.use=a", "there is no '7' to go into"),
    ],
)
def test_what_has_no_place_is_refused(override: str, words: str) -> None:
    with pytest.raises(ProfileError, match=words):
        edited("one.yaml", TEXT, [override])


@pytest.mark.parametrize("override", ["a={x: 2}", "a.x=2", "b.x=2"])
def test_what_stands_for_several_places_is_not_changed_in_one(override: str) -> None:
    text = "name: n\na: &a {x: 1}\nb: *a\n"
    with pytest.raises(ProfileError, match=r"can't be changed there alone.*by hand"):
        edited("one.yaml", text, [override])


def test_a_choice_is_made_first_and_its_branch_is_changed_in_its_place() -> None:
    _, text, _ = profile.find("ikns-finger")
    now = edited("f.yaml", text, ["devices.ring.port=/dev/ttyACM1", "controllers.0.name=press", "input=ring"])
    assert "        ring: {driver: ring, port: /dev/ttyACM1}\n" in now
    assert "{use: press-toggle, name: press, in" in now
    assert "\ninput: ring                     # or ikns-optitrack" in now


@pytest.mark.parametrize("name", library.shipped())
def test_each_device_of_each_shipped_profile_gets_another_port(name: str) -> None:
    label, text, _ = profile.find(name)
    overrides = [f"devices.{device}.port=/dev/mine-{device}" for device in profile.load(name)[0].devices]
    after = edited(label, text, [*overrides, "name=other"])
    assert profile.tree(label, after)[0] == profile.tree(label, text, [*overrides, "name=other"])[0]
    assert [line.partition("#")[2] for line in after.splitlines()] == [
        line.partition("#")[2] for line in text.splitlines()
    ] or len(after.splitlines()) > len(text.splitlines())


@pytest.mark.parametrize(
    "new", ["x", "a: b", "#", "", " s", "1", "null", "[", "é", "a\nb", 1, 0.5, True, None, [1, "a, b"], {"a b": [None]}]
)
def test_a_value_means_itself_in_a_block_and_in_braces(new: object) -> None:
    words = as_yaml(new)
    assert value(f"k: {words}") == value(f"{{k: {words}}}") == {"k": new}
