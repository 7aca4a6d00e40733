"""A calibration file that somebody changed on purpose: its hash is taken out."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from srl.runtime.models.record_file import HASH


def content(path: Path) -> Any:
    """What a calibration file holds, without its hash."""
    plain = json.loads(path.read_text())
    del plain[HASH]
    return plain


def edited(path: Path, change: Callable[[Any], object], to: Path | None = None) -> Path:
    """Changes a calibration file, or writes the changed one elsewhere."""
    plain = content(path)
    change(plain)
    target = path if to is None else to
    target.write_text(json.dumps(plain))
    return target
