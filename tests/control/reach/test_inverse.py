"""Postures that put a tool at its goal."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from srl.control.reach.inverse import Inverse


@given(st.integers(0, 10_000))
@settings(max_examples=20, deadline=None)
def test_found_postures_put_the_tool_there(seed: int) -> None:
    """A plane arm of three links, by its own formulae."""
    lengths = np.array([0.5, 0.4, 0.2])
    rng = np.random.default_rng(seed)

    def tool(path: np.ndarray) -> np.ndarray:
        turned = np.cumsum(path, axis=1)
        return np.stack([(lengths * np.cos(turned)).sum(axis=1), (lengths * np.sin(turned)).sum(axis=1)], axis=1)

    low, high = np.full(3, -2.5), np.full(3, 2.5)
    goal = tool(rng.uniform(low, high, (1, 3)))[0]

    def residual(path: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        turned = np.cumsum(path, axis=1)
        x, y = lengths * np.cos(turned), lengths * np.sin(turned)
        J = np.stack([-np.cumsum(y[:, ::-1], axis=1)[:, ::-1], np.cumsum(x[:, ::-1], axis=1)[:, ::-1]], axis=1)
        return goal - tool(path), J

    search = Inverse(residual, low, high, np.zeros(3), seed)
    found = search.step()
    while not len(found) and search.iterations < 400:
        found = search.step()
    assert len(found)
    assert all(np.linalg.norm(tool(q[None])[0] - goal) < 1e-3 for q in found)
    assert all(((q >= low) & (q <= high)).all() for q in found)
