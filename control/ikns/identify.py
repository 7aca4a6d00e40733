"""A person's own body from a static trial: segment lengths, joint centres and where the markers sit.

Joint centres by the rules of Plug-in Gait: the shoulder below the acromion's marker, the elbow by the chord rule at
half the elbow's width, the wrist from the bar's middle at half its width. Where the inner epicondyle has a marker, the
elbow's centre is the middle of the two; without a wrist's width the wrist's is the middle of its two markers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from srl.runtime.contracts.errors import SrlError
from srl.runtime.contracts.rotation import euler_angles
from srl.runtime.contracts.signals import Array
from srl.runtime.models.body import Body, Marker, Side

_FRAMES: Final = 100  # of the trial that are used, at most
# An elbow that is straighter hardly shows the axis about which it bends: with markers of the average body the rotation
# of the shoulder is off by 3 degrees at a bend of 60 or more, by 10 at 30, by 17 at 20, by 33 at 10.
LEAST_BEND: Final = float(np.deg2rad(20.0))
_STRAIGHT: Final = float(np.deg2rad(12.0))  # the chord rule finds about as much in any straight arm


class IdentificationError(SrlError):
    """A static trial that doesn't show the body."""


@dataclass(frozen=True)
class Measures:
    """What is measured on an arm, m.

    Attributes:
        shoulder_offset: from the skin over the acromion down to the joint.
        wrist_width: None if the wrist's markers are on the bones, the joint between them.
    """

    shoulder_offset: float = 0.050
    elbow_width: float = 0.090
    wrist_width: float | None = 0.060
    hand_thickness: float = 0.030


@dataclass(frozen=True)
class ArmLandmarks:
    """Marker names on one arm.

    Attributes:
        finger: one or more on the back of the knuckles, whose mean counts.
        inner_elbow: on the inner epicondyle; without it the elbow's width counts.
    """

    acromion: str
    elbow: str
    wrist_thumb: str
    wrist_little: str
    finger: tuple[str, ...]
    measures: Measures = Measures()
    inner_elbow: str | None = None


@dataclass(frozen=True)
class Landmarks:
    """What the rules need.

    Attributes:
        chest: markers at the jugular notch, the seventh cervical vertebra, the xiphoid, the tenth thoracic vertebra.
        arms: by side.
        radius: m, from a marker's centre to the skin.
    """

    chest: tuple[str, str, str, str]
    arms: Mapping[Side, ArmLandmarks]
    radius: float = 0.007

    @property
    def names(self) -> tuple[str, ...]:
        """Every marker that the rules use."""
        found = list(self.chest)
        for arm in self.arms.values():
            found += [arm.acromion, arm.elbow, arm.wrist_thumb, arm.wrist_little, *arm.finger]
            found += [arm.inner_elbow] if arm.inner_elbow else []
        return tuple(found)


def plug_in_gait(measures: Mapping[Side, Measures], radius: float = 0.007) -> Landmarks:
    """The landmarks of the Plug-in Gait set on these sides."""
    arms: dict[Side, ArmLandmarks] = {}
    for side, measured in measures.items():
        s = side[0].upper()
        arms[side] = ArmLandmarks(f"{s}SHO", f"{s}ELB", f"{s}WRA", f"{s}WRB", (f"{s}FIN",), measured)
    return Landmarks(("CLAV", "C7", "STRN", "T10"), arms, radius)


def identify(
    body: Body, trial: Mapping[str, Array], landmarks: Landmarks, least_bend: float = LEAST_BEND
) -> tuple[Body, Array]:
    """Fits a body to a static trial.

    Args:
        body: whose sides and segments of markers are taken; its lengths are replaced.
        trial: markers (frames, 3) by name, m, NaN where hidden. Elbows bent by 60 degrees or more are best.
        landmarks: what the rules need to know.
        least_bend: rad, at least 12 degrees; an elbow whose markers show less is refused.
    Returns:
        The fitted body, and its angles (frames, n) in the frames that show all landmarks.
    Raises:
        IdentificationError: a landmark isn't there, no frame shows all of them, or an elbow is too straight.
    """
    if not _STRAIGHT <= least_bend < np.pi:
        raise _error(
            f"a least bend of {np.rad2deg(least_bend):.3g} degrees shows no axis", "Give 12 to 180 degrees, in rad"
        )
    needed = landmarks.names
    if missing := [name for name in needed if name not in trial]:
        raise _error(f"the trial has no marker '{missing[0]}'", f"It has: {', '.join(trial)}")
    if missing := [name for name in needed if name not in body.markers]:
        raise _error(f"the body has no marker '{missing[0]}'", "Give the body a place for it under `markers:`")
    seen = np.all([np.isfinite(trial[name]).all(axis=1) for name in needed], axis=0)
    if not seen.any():
        least = min(needed, key=lambda name: int(np.isfinite(trial[name]).all(axis=1).sum()))
        raise _error(
            f"no frame shows all {len(needed)} landmarks; '{least}' is seen least", "Record it again, unoccluded"
        )
    frames = np.flatnonzero(seen)
    frames = frames[np.linspace(0, len(frames) - 1, min(len(frames), _FRAMES)).astype(int)]
    one = [_frame(body, {name: trial[name][i] for name in needed}, landmarks, least_bend) for i in frames]
    sizes = {key: np.mean(np.array([size[key] for size, _ in one]), axis=0) for key in one[0][0]}
    found = {part: {s: float(sizes[s, part]) for s in body.sides} for part in ("upper_arm", "forearm", "palm")}
    found["hand"] = {s: found["palm"][s] * body.sizes["hand"][s] / body.sizes["palm"][s] for s in body.sides}
    made = replace(body, shoulder={s: _vector(sizes[s, "shoulder"]) for s in body.sides}, sizes=found)
    angles = np.array([q for _, q in one])
    places: dict[str, list[Array]] = {name: [] for name in body.markers if name in trial}
    for i, q in zip(frames, angles, strict=True):
        poses = made.forward(q)
        for name, measured in places.items():
            pose = poses[body.markers[name].segment]
            measured.append(pose[:3, :3].T @ (trial[name][i] - pose[:3, 3]))
    markers = {
        name: Marker(body.markers[name].segment, _vector(np.nanmean(measured, axis=0)))
        for name, measured in places.items()
        if np.isfinite(measured).any()
    }
    return replace(made, markers=markers), angles


def chord(a: Array, b: Array, toward: Array, distance: float) -> Array:
    """The point c in the plane of a, b, b + toward, |b - c| = distance, right angle at c: Plug-in Gait's chord rule."""
    base = a - b
    size = float(np.linalg.norm(base))
    if size <= distance:
        raise _error("two landmarks are nearer to each other than half a joint's width", "Check the labels")
    along = base / size
    away = toward - (toward @ along) * along
    cosine = distance / size
    return b + distance * (cosine * along + np.sqrt(1.0 - cosine * cosine) * away / np.linalg.norm(away))


def chest_pose(notch: Array, cervical: Array, xiphoid: Array, thoracic: Array, radius: float) -> tuple[Array, Array]:
    """Rotation (3, 3) and origin (3,) of the chest's frame, by the definition of Plug-in Gait's thorax."""
    z = _unit(notch + cervical - xiphoid - thoracic)
    y = _unit(np.cross(z, notch + xiphoid - cervical - thoracic))
    x = np.cross(y, z)
    return np.stack([x, y, z], axis=1), notch - radius * x


def _frame(
    body: Body, at: Mapping[str, Array], marks: Landmarks, least_bend: float
) -> tuple[dict[tuple[Side, str], Array | float], Array]:
    """Sizes and angles (n,) in one frame."""
    sizes: dict[tuple[Side, str], Array | float] = {}
    notch, cervical, xiphoid, thoracic = (at[name] for name in marks.chest)
    C, origin = chest_pose(notch, cervical, xiphoid, thoracic, marks.radius)
    yaw, lean, side_lean = euler_angles(C[None], "ZYX")[0]
    values = dict(zip(("x", "y", "z", "yaw", "lean", "side"), (*origin, yaw, lean, side_lean), strict=True))
    q = {f"torso_{name}": float(value) for name, value in values.items()}
    for side in body.sides:
        m = 1.0 if side == "left" else -1.0
        names = marks.arms[side]
        shoulder, elbow, wrist, bar, knuckle = _centres(at, names, marks, C, origin, m)
        sizes[side, "shoulder"] = C.T @ (shoulder - origin) - np.array(body.sternum[side])
        sizes[side, "upper_arm"] = float(np.linalg.norm(elbow - shoulder))
        sizes[side, "forearm"] = float(np.linalg.norm(wrist - elbow))
        sizes[side, "palm"] = float(np.linalg.norm(knuckle - wrist))
        z = _unit(shoulder - elbow)
        y = np.cross(z, wrist - elbow)
        U = np.stack([np.cross(_unit(y), z), _unit(y), z], axis=1)
        along = U.T @ (wrist - elbow)
        bent = float(np.arctan2(along[0], -along[2]))
        # The chord rule finds some bend in a straight arm, too: there its markers must show one.
        lateral = at[names.elbow]
        raw = _unit(lateral - shoulder) @ _unit(0.5 * (at[names.wrist_thumb] + at[names.wrist_little]) - lateral)
        shown = bent if names.inner_elbow is not None else min(bent, float(np.arccos(np.clip(raw, -1.0, 1.0))))
        if shown < least_bend:
            found, least = np.rad2deg((shown, least_bend))
            raise _error(
                f"the {side} elbow is almost straight: bent by {found:.0f} degrees, {least:.0f} are needed",
                "Stand with both elbows bent by 90 degrees; or give a smaller `least_bend`, and a worse shoulder",
            )
        a, b, c = euler_angles((C.T @ U)[None], "XYZ")[0]
        F = U @ _about_y(-bent)
        z = _unit(wrist - knuckle)
        y = _unit(np.cross(z, bar))
        H = np.stack([np.cross(y, z), y, z], axis=1)
        pronation, flexion, deviation = euler_angles((F.T @ H)[None], "ZXY")[0]
        arm = (m * a, -b, -m * c, bent, -m * pronation, -m * flexion, deviation)
        q |= {f"{side}_clavicle_protraction": 0.0, f"{side}_clavicle_elevation": 0.0}
        q |= {body.names[i]: float(value) for i, value in zip(body.chains[f"{side}_arm"], arm, strict=True)}
    return sizes, np.array([q[name] for name in body.names])


def _centres(
    at: Mapping[str, Array], names: ArmLandmarks, marks: Landmarks, C: Array, origin: Array, m: float
) -> tuple[Array, Array, Array, Array, Array]:
    """Centres of shoulder, elbow and wrist, the direction to the thumb's side, and the centre of the hand (3,)."""
    up = m * np.cross(C[:, 0], at[names.acromion] - origin)
    shoulder = chord(origin, at[names.acromion], -up, names.measures.shoulder_offset + marks.radius)
    lateral = at[names.elbow]
    middle = 0.5 * (at[names.wrist_thumb] + at[names.wrist_little])
    if names.inner_elbow is not None:
        elbow = 0.5 * (lateral + at[names.inner_elbow])
    else:
        inward = -m * np.cross(shoulder - lateral, middle - lateral)
        elbow = chord(shoulder, lateral, inward, names.measures.elbow_width / 2 + marks.radius)
    bar = _unit(at[names.wrist_thumb] - at[names.wrist_little])
    palmar = -m * _unit(np.cross(elbow - middle, bar))
    wrist = (
        middle
        if names.measures.wrist_width is None
        else middle + (names.measures.wrist_width / 2 + marks.radius) * palmar
    )
    finger = np.mean([at[name] for name in names.finger], axis=0)
    knuckle = chord(wrist, finger, palmar, names.measures.hand_thickness / 2 + marks.radius)
    return shoulder, elbow, wrist, bar, knuckle


def _about_y(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def _unit(v: Array) -> Array:
    made: Array = v / np.linalg.norm(v)
    return made


def _vector(v: Sequence[float] | Array) -> tuple[float, float, float]:
    x, y, z = (float(e) for e in v)
    return (x, y, z)


def _error(problem: str, remedy: str) -> IdentificationError:
    return IdentificationError("static trial", problem, remedy)
