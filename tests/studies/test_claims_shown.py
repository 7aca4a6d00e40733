"""What a study prints of its claims: one that wasn't measured is neither confirmed nor refuted."""

from __future__ import annotations

from math import nan
from pathlib import Path

import pytest

from srl.studies import command
from srl.studies.result import Claim, Result


@pytest.mark.parametrize(
    ("measured", "holds", "shown"),
    [
        (0.5, True, "holds: more: it lifts more (0.5 kg; paper: 0.4)"),
        (0.3, False, "DOES NOT HOLD: more: it lifts more (0.3 kg; paper: 0.4)"),
        (None, False, "not measured: more: it lifts more (paper: 0.4)"),
        (nan, False, "not measured: more: it lifts more (paper: 0.4)"),
    ],
)
def test_each_claim_has_one_word(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], measured: float | None, holds: bool, shown: str
) -> None:
    claims = [Claim(id="more", text="it lifts more", paper="0.4", measured=measured, unit="kg", holds=holds)]
    command._show(Result("box", True, [1], claims), tmp_path, False)
    assert f"  {shown}\n" in capsys.readouterr().out
