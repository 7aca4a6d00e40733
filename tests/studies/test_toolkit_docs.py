"""The page's own examples run on the page's own sheets."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from srl.studies.superman.published import TABLE_I, TABLE_II
from srl.studies.toolkit.statistics import sign_test

PAGE = Path(__file__).parents[2] / "docs" / "user-studies.md"
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def test_the_pages_examples(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    blocks = FENCE.findall(PAGE.read_text())
    sheets = [text for kind, text in blocks if not kind]
    code = [text for kind, text in blocks if kind == "python"]
    monkeypatch.chdir(tmp_path)
    Path("trials.csv").write_text(sheets[0])
    Path("tlx.csv").write_text(sheets[1])
    names: dict[str, object] = {}
    for text in code[:2]:  # the third needs recordings: test_toolkit_semg_record does the same
        exec(text, names)
    assert "177" in capsys.readouterr().out
    assert Path("tlx.png").stat().st_size > 1000


def test_the_pages_p_values_of_twelve_subjects() -> None:
    output = [0.0005, 0.0063, 0.039, 0.15]
    p = [sign_test([1] * (12 - k) + [-1] * k, [0] * 12).p for k in range(4)]
    assert p == pytest.approx(output, rel=0.03)
    assert all(f"{value:g}" in PAGE.read_text() for value in output)


def test_the_pages_errata_are_the_computed_ones() -> None:
    text = PAGE.read_text()
    for table, name in ((TABLE_I, "T"), (TABLE_II, "N_Hl"), (TABLE_II, "T")):
        assert f"({table.measure(name).summary('H').deviation:.2f})" in text
