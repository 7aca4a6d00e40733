"""What draws a report's picture (`plt`, without a screen), and keeps it: whole, or as it was before."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt

from srl.runtime.models.record_file import RecordError

__all__ = ["plt", "save"]


def save(figure: Any, png: Path) -> None:
    """Writes a matplotlib figure and closes it. Raises RecordError where the folder doesn't take it."""
    scratch = png.with_name(f".{png.name}.{os.getpid()}.new")
    try:
        figure.savefig(scratch, dpi=110, format="png")
        os.replace(scratch, png)
    except OSError as error:
        raise RecordError(str(png), f"it can't be written: {error.strerror}", "Choose another folder") from None
    finally:
        plt.close(figure)
        with contextlib.suppress(OSError):
            scratch.unlink()  # of a disk that is full
