"""The control law `arm-angles`: joint angles of the wearer's arm from motion capture, markers or segments."""

from __future__ import annotations

from dataclasses import replace
from typing import Final, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from srl.control.ikns.markers import MarkerFit
from srl.runtime.contracts import rotation
from srl.runtime.contracts.controller import Controller, ControllerConfig
from srl.runtime.contracts.errors import OptionError, ProfileError, nearest
from srl.runtime.contracts.frames import IDENTITY, Placement, as_pose
from srl.runtime.contracts.signals import Array, Signal
from srl.runtime.contracts.terms import POINT, POSE
from srl.runtime.models.body import Body, Marker, Side
from srl.runtime.models.models import BodyOption, named

_STARTS: Final = 6  # postures that a reset tries
_LEVER: Final = 0.1  # m, from a segment's origin to the points that stand for its axes

_NODES: Final = ("chest", "shoulder", "elbow", "wrist", "palm")

Chain = Literal["torso", "clavicle", "arm"]


class SegmentPlace(Placement):
    """A segment that motion capture measures. The pose is that of the body's segment in the measured one."""

    segment: str = Field(description="torso, or SIDE_clavicle, SIDE_upper_arm, SIDE_forearm, SIDE_hand")


class ArmAnglesConfig(ControllerConfig):
    """Options of `arm-angles`."""

    body: BodyOption = named("body")
    side: Side = Field(default="right", description="which arm")
    chains: tuple[Chain, ...] = Field(
        default=("arm",), min_length=1, description="whose angles are given, in this order"
    )
    segments: dict[str, SegmentPlace] = Field(
        default_factory=dict,
        description="instead of markers, the device's segments: NAME: {segment: right_hand, position, quaternion}",
    )
    chest: str | None = Field(default=None, description="frame of the profile's tree that the output `chest` measures")
    forearm: str | None = Field(
        default=None, description="frame of the profile's tree that the output `forearm` measures"
    )
    max_hold: float = Field(
        default=2.0,
        gt=0,
        description="s for which torso or clavicle may be held, less what they were seen since; beyond that the person "
        "is lost, and the limb stops. .inf: never",
    )
    gate: float = Field(default=0.04, gt=0, le=0.5, description="m, how far a marker may be from its place on the body")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        body = self.body.body
        if self.side not in body.sides:
            raise OptionError(f"the body has no {self.side} arm", f"It has: {', '.join(body.sides)}")
        body = one_arm(body, self.side)
        for name, place in self.segments.items():
            if place.segment not in body.segments:
                raise OptionError(
                    f"segments.{name}: a body has no segment '{place.segment}'", nearest(place.segment, body.segments)
                )
        return self


class ArmAngles(Controller):
    """Fits the body to what motion capture sees, in each cycle.

    Inputs: `markers` (k, 3) m and `marker_visible` (k,), by the markers' names in lower case; with the option
    `segments` instead `pose` (k, 7) and `visible` (k,). In whatever frame the device names.

    Outputs: `angles` (n,) rad, of the joints' ranges; `held` (n,) 1 where this frame shows nothing of the joint, or its
    angle is about to change its turn, or near straight forward has two readings: it stays, and may jump where `held`
    falls. While a joint of torso or clavicle is held, so are the arm's joints, and `hand` stays;
    `hand` (7,), the pose of the palm's middle in the chest's frame; `chest` (7,), the chest's pose in the inputs'
    frame; `forearm` (7,), that of the forearm (origin in the elbow), and `nodes` (5, 3) m, in the inputs' frame, for
    pictures; `residual` (1,) m, rms of the used markers; `used` (k,) 1 used, 0 not seen, -1 rejected. These poses
    and nodes are NaN until the chest was seen after a reset, `residual` is in a frame that fits nothing.

    A torso or clavicle that is held for longer than `max_hold` is the loss of the person.
    """

    Config = ArmAnglesConfig
    summary = "joint angles of the wearer's arm and pose of its hand, from motion capture"

    def __init__(self, name: str, config: ArmAnglesConfig) -> None:
        super().__init__(name, config)
        body, side = one_arm(config.body.body, config.side), config.side
        self._offsets = [_corners(place.placed()) for place in config.segments.values()]
        if config.segments:
            places = {n: p.segment for n, p in config.segments.items()}
            corners = _corners(IDENTITY).tolist()
            body = replace(
                body,
                markers={
                    f"{n} {i}": Marker(s, (x, y, z)) for n, s in places.items() for i, (x, y, z) in enumerate(corners)
                },
            )
            names, (what, seen) = tuple(places), ("pose", "visible")
            first = Signal(name=what, shape=(len(names), 7), unit="m", labels=names, components=(POSE,))
        else:
            names, (what, seen) = tuple(n.lower() for n in body.markers), ("markers", "marker_visible")
            first = Signal(name=what, shape=(len(names), 3), unit="m", labels=names, components=(POINT,))
        self.inputs = (first, Signal(name=seen, shape=(len(names),), unit="1", labels=names))
        _check(f"controllers.{name}", body, "segments" if config.segments else "markers")
        self._what, self._seen = what, seen
        self._fit = MarkerFit(body, gate=config.gate)
        self._timeout = config.max_hold
        self._names, self._each = names, len(body.markers) // len(names)
        fit = self._fit
        chains = [chain if chain == "torso" else f"{side}_{chain}" for chain in config.chains]
        turns = [i for c in chains for i in fit.body.chains[c] if not fit.body.joints[i].slides]
        self._given = np.array(turns)
        self._torso = np.array(fit.body.chains["torso"])
        self._way = np.array([*self._torso, *fit.body.chains[f"{side}_clavicle"]])  # from the room to the shoulder
        joints = tuple(fit.body.names[i] for i in turns)
        self.outputs = (
            Signal(name="angles", shape=(len(joints),), unit="rad", labels=joints),
            Signal(name="held", shape=(len(joints),), unit="1", labels=joints),
            Signal(name="hand", shape=(7,), unit="m", frame=config.chest, labels=POSE),
            Signal(name="chest", shape=(7,), unit="m", frame=f"={what}", of=config.chest, labels=POSE),
            Signal(name="forearm", shape=(7,), unit="m", frame=f"={what}", of=config.forearm, labels=POSE),
            Signal(
                name="nodes",
                shape=(len(_NODES), 3),
                unit="m",
                frame=f"={what}",
                labels=_NODES,
                components=(POINT,),
                visual="skeleton",
                links=(tuple(range(len(_NODES))),),
            ),
            Signal(name="residual", shape=(1,), unit="m"),
            Signal(name="used", shape=(len(names),), unit="1", labels=names),
        )
        self._hand, self._forearm = f"{side}_hand", f"{side}_forearm"
        self._shown = (f"{side}_upper_arm", self._forearm, self._hand)
        self._grip: rotation.Pose = (*fit.body.grip(side), 1.0, 0.0, 0.0, 0.0)
        self._clear()

    def _clear(self) -> None:
        self._frames = self._misfits = 0
        self._missing, self._rejected = np.zeros(len(self._names), int), np.zeros(len(self._names), int)
        self._last: dict[str, rotation.Quaternion] = {}
        self._seen_once = False  # whether the poses are anybody's
        self._gone = 0.0  # s without torso or clavicle, less s with them
        self.lost = False

    def reset(self) -> None:
        """Finds the posture from nothing."""
        self._clear()
        self._fit.reset()
        self._solve(0.0, _STARTS)

    def update(self, dt: float) -> None:
        self._solve(dt, 1)

    def metrics(self) -> dict[str, object]:
        """Returns the figures since the last reset: frames, frames that fitted nothing, and for each marker (or
        segment) the share of frames in which it wasn't seen, and in which it was rejected."""
        count = max(self._frames, 1)
        share = lambda counts: {n: c / count for n, c in zip(self._names, counts.tolist(), strict=True) if c}  # noqa: E731
        return {
            "frames": self._frames,
            "misfits": self._misfits,
            "missing": share(self._missing),
            "rejected": share(self._rejected),
        }

    def _solve(self, dt: float, starts: int) -> None:
        fit, each, out = self._fit, self._each, self.output
        points, visible = self.input[self._what], self.input[self._seen] > 0.5
        if self._offsets:
            poses = zip(self._offsets, points, strict=True)
            points = np.concatenate([_carried(corners, as_pose(pose)) for corners, pose in poses])
        fitted = fit.solve(points, np.repeat(visible, each), dt, starts)
        used, rejected = (mask.reshape(-1, each).any(axis=1) for mask in (fit.used, fit.rejected))
        self._frames += 1
        self._misfits += not fitted
        self._missing += ~visible
        self._rejected += rejected
        out["angles"][:] = fit.angles[self._given]
        out["held"][:] = fit.held[self._given]
        out["residual"][0] = fit.residual if fitted else np.nan
        out["used"][:] = used
        out["used"][rejected] = -1.0
        self._gone = self._gone + dt if fit.held[self._way].any() else max(0.0, self._gone - dt)
        self.lost = self._gone > self._timeout
        self._seen_once |= not fit.held[self._torso].any()
        if not self._seen_once:
            for name in ("chest", "hand", "forearm", "nodes"):
                out[name][:] = np.nan
            return
        chest = self._pose("torso")
        hand = self._pose(self._hand)
        palm = rotation.composed(hand, self._grip)
        out["nodes"][:] = [chest[:3], *(self._fit.pose(s).translation for s in self._shown), palm[:3]]
        out["forearm"][:] = self._pose(self._forearm)
        out["chest"][:] = chest
        out["hand"][:] = self._kept("hand", rotation.composed(rotation.inverted(chest), palm))

    def _pose(self, segment: str) -> rotation.Pose:
        """A segment's pose in the frame of the inputs, with the sign of its quaternion kept."""
        place = self._fit.pose(segment)
        x, y, z = place.translation.tolist()
        return self._kept(segment, (x, y, z, *rotation.of_rows(*place.rotation.ravel().tolist())))

    def _kept(self, what: str, pose: rotation.Pose) -> rotation.Pose:
        x, y, z, *q = pose
        turn = (q[0], q[1], q[2], q[3])
        self._last[what] = turn = rotation.nearer(turn, self._last.get(what, (1.0, 0.0, 0.0, 0.0)))
        return (x, y, z, *turn)


def one_arm(body: Body, side: Side) -> Body:
    """The body with this arm alone."""
    markers = {n: m for n, m in body.markers.items() if m.segment == "torso" or m.segment.startswith(side)}
    return replace(body, sides=(side,), markers=markers)


def _check(place: str, body: Body, what: str) -> None:
    """Refuses markers or segments that can't show the body."""
    if sum(marker.segment == "torso" for marker in body.markers.values()) < 3:
        wanted = "three markers of the torso" if what == "markers" else "the torso's segment"
        raise ProfileError(place, f"the chest can't be found without {wanted}", f"Add {wanted}")
    fit = MarkerFit(body)
    unseen = [n for n, seen in zip(body.names, fit.observed(fit.names), strict=True) if not seen]
    if unseen:
        parts = dict.fromkeys("hand" if "wrist" in n else "forearm" if "forearm" in n else "arm" for n in unseen)
        raise ProfileError(
            place, f"these {what} don't show {', '.join(unseen)}", f"Add {what} of the {', the '.join(parts)}"
        )


def _corners(pose: rotation.Pose) -> Array:
    """(4, 3) m: the origin of a frame, and a point on each axis."""
    T = rotation.homogeneous(pose)
    return np.vstack([T[:3, 3], T[:3, 3] + _LEVER * T[:3, :3].T])


def _carried(points: Array, pose: rotation.Pose) -> Array:
    """Points (k, 3) of a frame with this pose, in the outer frame."""
    T = rotation.homogeneous(pose)
    moved: Array = points @ T[:3, :3].T + T[:3, 3]
    return moved
