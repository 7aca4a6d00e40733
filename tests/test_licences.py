"""Nothing that a user installs is under the GPL; what development has of it is named (docs/dependencies.md)."""

from __future__ import annotations

from helpers import ROOT

from bench.licences import licences, strong_copyleft


def test_a_user_gets_nothing_under_the_gpl() -> None:
    found = licences()
    assert strong_copyleft(found) == []
    assert found["python-can"] == "LGPL-3.0-only"
    assert {"numpy", "pin", "mujoco", "rerun-sdk", "aiohttp"} <= found.keys()  # with all the extras


def test_what_development_has_of_it_is_named() -> None:
    page = (ROOT / "docs" / "dependencies.md").read_text()
    of_development = strong_copyleft(licences(of_development=True))
    assert "TMotorCANControl" in of_development  # so it finds one
    for name in of_development:
        assert f"{name} (GPL" in page


def test_the_lgpl_and_others_are_told_from_the_gpl() -> None:
    output = {
        "a": "LGPL-3.0-only", "b": "GNU Lesser General Public License v3 (LGPLv3)", "c": "GPL-3.0-or-later",
        "d": "GNU Affero General Public License v3", "e": "AGPL-3.0", "f": "MIT", "g": "GNU GPL v2",
        "h": "GPL-2.0-only AND LGPL-2.1-only", "i": "LGPL-2.1-or-later AND MIT",
    }  # fmt: skip
    assert strong_copyleft(output) == ["c", "d", "e", "g", "h"]
