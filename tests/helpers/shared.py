"""The reference material beside the checkout (recordings, fact sheets); tests that need it skip without it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(os.environ.get("SRL_SHARED", Path(__file__).resolve().parents[3] / "shared"))


def shared(relative: str) -> Path:
    """The path of a file or folder of the reference material; skips the test where it isn't there."""
    path = ROOT / relative
    if not path.exists():
        pytest.skip(f"no reference material '{relative}' (set SRL_SHARED to the folder that holds it)")
    return path
