"""Reads recordings, and draws them (docs/recordings.md)."""

from pathlib import Path

from srl.runtime.recording.reader import Recording, read

__all__ = ["Recording", "draw", "read"]


def draw(recording: Recording, path: Path) -> None:
    """Draws a recording's signals, states and timing as `srl run --figure` does. Loads matplotlib."""
    from srl.runtime.pictures.figure import draw as drawn

    drawn(recording, path)
