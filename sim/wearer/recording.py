"""Reads recordings of a hand: CSV, NPZ and BVH files, told apart by their suffix, and folders of topics."""

from __future__ import annotations

from pathlib import Path

from runtime.contracts.errors import RecordingError
from sim.wearer.motion import SampledWearer, Wearer, join


def load_wearer(recording: str | Path, *, episode: int | None = None, speed: float = 1.0, loop: bool = False) -> Wearer:
    """Loads a wearer that moves as recorded.

    Args:
        recording: a .csv, .npz or .bvh file, or a folder with one CSV per joint; `FILE#episode=3` is one episode.
        episode: the only episode to play; default: all of them, blended into each other.
        speed: 1 is the recorded speed.
        loop: start again at the end, with a blend of 0.5 s.
    Raises:
        RecordingError: with file and line or column, what was expected, and the remedy.
    """
    from sim.wearer import bvh_hand, tables, topics

    path, named = _split(str(recording))
    if named is not None and episode is not None and named != episode:
        raise RecordingError(
            str(recording), f"the option 'episode' asks for {episode}", "Name the episode in one place only"
        )
    episode = named if named is not None else episode
    if not path.exists():
        raise RecordingError(str(path), "there is no such file or folder", "Check the path of the wearer's recording")
    if path.is_dir():
        parts = [topics.read(path)]
    elif reader := {".csv": tables.read_csv, ".npz": tables.read_npz, ".bvh": bvh_hand.read}.get(path.suffix.lower()):
        parts = reader(path)
    else:
        raise RecordingError(
            str(path),
            f"'{path.suffix}' is no kind of hand recording",
            "Give a .csv, .npz or .bvh file or a folder",
        )
    if episode is not None:
        if not 0 <= episode < len(parts):
            raise RecordingError(str(path), f"there is no episode {episode}", f"It has {len(parts)}, numbered from 0")
        parts = [parts[episode]]
    return SampledWearer(*join(parts), speed=speed, loop=loop)


def _split(spec: str) -> tuple[Path, int | None]:
    path, mark, selector = spec.partition("#")
    if not mark:
        return Path(path).expanduser(), None
    key, _, number = selector.partition("=")
    if key != "episode" or not number.isdigit():
        raise RecordingError(spec, f"'#{selector}' selects nothing", "Write FILE#episode=NUMBER, from 0")
    return Path(path).expanduser(), int(number)
