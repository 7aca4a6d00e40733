"""`srl migrate`: a profile with the options' old names gets the new ones, and nothing else of it changes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from helpers.run import refused

from srl.runtime.cli import main
from srl.runtime.profile import profile, wiring
from srl.runtime.profile.plausibility import old_names

MAPPING = "    points: [thumb, index, middle, ring, little]\n"
HAND = "wearer: {recording: null}"
CHOICE = """\
way: own
choices:
  way:
    own: {}
    tight:
      controllers:
        - use: hand-kinematics
          name: hand
          in: {angles: glove.position}
        - {use: object-mapping, name: mapping, "leash": 0.1, points: [thumb, index],   # leash: a word of ours
           in: {tips: hand.tips}, out: {q: finger.position_command}}
"""


def text(leash: str, told: str) -> str:
    """sixth-finger with two options by these names, and a comment that has the old one."""
    shipped = profile.find("sixth-finger")[1]
    assert shipped.count(MAPPING) == 1
    made = shipped.replace(MAPPING, f"{MAPPING}    {leash}: 0.2        # m; the leash of our old rig\n")
    return made.replace(HAND, f"wearer: {{ {told}: true, miss: 0.01}}")


@pytest.fixture
def old(tmp_path: Path) -> Path:
    path = tmp_path / "mine.yaml"
    path.write_text(text("leash", "told"))
    return path


def test_the_new_names_are_written_and_all_else_stays(old: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["migrate", str(old)]) == 0
    assert old.read_text() == text("max_following_error", "instructed")
    assert Path(f"{old}.old").read_text() == text("leash", "told")
    said = capsys.readouterr().out.splitlines()
    assert [line.rpartition(": ")[2] for line in said[:2]] == [
        "controllers.1.leash is called max_following_error now", "sim.parts.hand.wearer.told is called instructed now"
    ]  # fmt: skip
    assert f" line {text('leash', 'told').split('leash')[0].count(chr(10)) + 1}: " in said[0]
    assert main(["migrate", str(old)]) == 0
    assert "has no old names" in capsys.readouterr().out
    assert not Path(f"{old}.old.2").exists()


def test_names_in_words_that_arent_chosen_are_renamed_too(tmp_path: Path) -> None:
    shipped = profile.find("sixth-finger")[1]
    begin, end = shipped.index("controllers:"), shipped.index("guard:")
    own = CHOICE.replace(
        "    own: {}\n", "    own:\n" + "".join(f"      {line}\n" for line in shipped[begin:end].splitlines())
    )
    path = tmp_path / "mine.yaml"
    path.write_text(shipped[:begin] + own + shipped[end:])
    assert main(["migrate", str(path)]) == 0
    changed = path.read_text()
    assert changed == (shipped[:begin] + own + shipped[end:]).replace('"leash"', "max_following_error")
    assert not old_names(wiring.build(*profile.load(str(path), ["way=tight"]), []))


def test_a_dry_run_changes_nothing(old: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["migrate", str(old), "--dry-run", "--json"]) == 0
    assert [change["to"] for change in json.loads(capsys.readouterr().out)["changes"]] == [
        "max_following_error", "instructed"
    ]  # fmt: skip
    assert old.read_text() == text("leash", "told")
    assert not Path(f"{old}.old").exists()


def test_what_cant_be_read_stays_as_it_is(old: Path) -> None:
    broken = old.read_text().replace("use: object-mapping", "use: retreat")
    old.write_text(broken)
    assert "no controllers 'retreat'" in refused("migrate", str(old)) or "retreat" in refused("migrate", str(old))
    assert old.read_text() == broken
    assert "no such file" in refused("migrate", "sixth-finger")


def test_a_link_and_the_files_rights_stay(old: Path) -> None:
    old.chmod(0o640)
    link = old.with_name("link.yaml")
    link.symlink_to(old)
    assert main(["migrate", str(link)]) == 0
    assert link.is_symlink()
    assert old.read_text() == text("max_following_error", "instructed")
    assert old.stat().st_mode & 0o777 == Path(f"{old}.old").stat().st_mode & 0o777 == 0o640


def test_what_is_meant_by_its_old_name_is_said(old: Path) -> None:
    old.write_text("meant: [controllers.1.leash]\n" + old.read_text())
    before = old.read_text()
    assert "meant: it names an option by its old name" in refused("migrate", str(old))
    assert old.read_text() == before


@pytest.mark.parametrize(
    "broken", ["name: [", "choices: [a]\n", "a: 1\na: 2\n", "a:\n\t- b\n", "", "[]", "name: x\u2028y"]
)
def test_text_that_is_no_profile_is_named(old: Path, broken: str) -> None:
    old.write_text(broken)
    assert "mine.yaml" in refused("migrate", str(old))
    assert old.read_text() == broken
