"""Reads recordings of a hand: CSV, NPZ and BVH files, told apart by their suffix, and folders of topics."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.signals import Array
from srl.runtime.models.human_hand import RANGES
from srl.sim.wearer.fitting import check, fit
from srl.sim.wearer.motion import SampledWearer, Wearer, join


def load_wearer(
    recording: str | Path,
    *,
    ranges: Array = RANGES,
    episode: int | None = None,
    speed: float = 1.0,
    loop: bool = False,
) -> Wearer:
    """Loads a wearer that moves as recorded, as far as the joints' ranges allow: its `fitted` says how far.

    A file is fitted as a whole, so that all its episodes are one hand's.

    Args:
        recording: a .csv, .npz or .bvh file, or a folder with one CSV per joint; `FILE#episode=3` is one episode.
        ranges: (20, 2) rad, lower and upper limit of each joint of the wearer.
        episode: the only episode to play; default: all of them, blended into each other.
        speed: 1 is the recorded speed.
        loop: start again at the end, with a blend of 0.5 s.
    Raises:
        RecordingError: with file and line or column, what was expected, and the remedy; too little of it fits into the
            ranges.
    """
    from srl.sim.wearer import bvh_hand, tables, topics

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
    fitted = fit(np.concatenate([position for _, position in parts]), ranges)
    check(path, fitted)
    if path.suffix.lower() in (".csv", ".npz"):
        fitted = replace(fitted, unused=tables.unused_columns(path))
    ends = np.cumsum([len(time) for time, _ in parts])[:-1]
    parts = [(time, q) for (time, _), q in zip(parts, np.split(fitted.position, ends), strict=True)]
    if episode is not None:
        if not 0 <= episode < len(parts):
            raise RecordingError(str(path), f"there is no episode {episode}", f"It has {len(parts)}, numbered from 0")
        parts = [parts[episode]]
    return SampledWearer(*join(parts), ranges=ranges, fitted=fitted, speed=speed, loop=loop)


def _split(spec: str) -> tuple[Path, int | None]:
    path, mark, selector = spec.partition("#")
    if not mark:
        return Path(path).expanduser(), None
    key, _, number = selector.partition("=")
    if key != "episode" or not number.isdigit():
        raise RecordingError(spec, f"'#{selector}' selects nothing", "Write FILE#episode=NUMBER, from 0")
    return Path(path).expanduser(), int(number)
