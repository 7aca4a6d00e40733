"""What is no text is no key, and no traceback either."""

import pytest

from srl.runtime.web.panel.access import _same


@pytest.mark.parametrize("given", ["\udcff", "\ud800x", "é", ""])
def test_no_text_is_no_key(given: str) -> None:
    assert not _same(given, "secret")
    assert not _same(given, "")
