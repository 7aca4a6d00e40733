"""The simulated world of a sensor that a person has in the hands: what it is mounted on is left out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from srl.commissioning.calibration.calibrated_device import part_of

HOLDER: Final = "calibration-hands"
_HELD: Final = f"{HOLDER}/held"
_PERSON: Final = "person"  # a part: whoever led the robot has let go of the handle


def take_in_hand(plain: dict[str, Any], device: str, frame: str | None, place: str) -> None:
    """Changes a cut profile's `sim` and `frames`: only the sensor's part is left, and what is mounted on it.

    Args:
        plain: the cut profile.
        device: the sensor.
        frame: in which it measures, if its part stands there.
        place: of the profile, for errors.
    Raises:
        ProfileError: there is no part of the sensor's, or several.
    """
    sim, frames = plain.get("sim") or {}, plain.get("frames") or {}
    own, sensor = part_of(sim, device, "ft-sensor", place)
    parts: dict[str, Any] = sim["parts"]
    kept = {own}
    while True:
        more = {
            name
            for name, part in parts.items()
            if name not in kept and part.get("part") != _PERSON and _carrier(name, part, parts, frames) in kept
        }
        if not more:
            break
        kept |= more
    if frame in frames:
        plain["frames"] = {frame: {"parent": _HELD}}
    else:
        plain["frames"] = {}
        sensor["at"] = _HELD
    plain["frames"] |= {name: entry for name, entry in frames.items() if _owner(name, parts, frames) in kept - {own}}
    sim["parts"] = {HOLDER: {"part": "hands"}, own: sensor, **{n: p for n, p in parts.items() if n in kept - {own}}}


def _carrier(name: str, part: Mapping[str, Any], parts: Mapping[str, Any], frames: Mapping[str, Any]) -> str | None:
    """The part on which a part is mounted."""
    at = part.get("at", name)
    if isinstance(at, Mapping):
        at = at.get("parent")
    return None if at is None else _owner(at, parts, frames, name)


def _owner(at: str | None, parts: Mapping[str, Any], frames: Mapping[str, Any], but: str = "") -> str | None:
    """The part that carries a frame or body."""
    while at is not None:
        owner = at.partition("/")[0]
        if owner in parts and owner != but:
            return owner
        at = (frames.get(at) or {}).get("parent")
    return None
