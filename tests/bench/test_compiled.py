"""The rows of the bench on compiled laws are decided on for more than one lap."""

from __future__ import annotations

import pytest

from bench.superman import Decisions


@pytest.mark.slow
@pytest.mark.parametrize("name", ["moca-man", "kairos-man", "sixth-finger"])
def test_the_limb_stays_active_through_laps(name: str) -> None:
    with Decisions(name, span=1.3) as decisions:
        assert all(took > 0.0 for took in decisions.cycles(2500).values())
