"""Keeping an arm clear of its wearer: distances against coal's and MuJoCo's, what a cycle costs, and how that grows.

A simulated wearer reaches, and the arm goes through its postures. All compute the same pairs of capsules from the same
places, which nobody's time includes, and their distances must agree. coal is called pair by pair from Python, and by
Pinocchio for all pairs at once, whose results nobody reads. MuJoCo is called pair by pair.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from itertools import cycle, islice
from typing import Any, Final, NamedTuple

import coal
import mujoco
import numpy as np
import pinocchio

from bench.pairs import Pairs, Row, measure
from srl.control.skeleton.body_motion import BodyMotion
from srl.control.skeleton.capsules import between, nearest
from srl.control.skeleton.collision import SPAN, CollisionConfig
from srl.control.skeleton.envelope import link_nodes
from srl.drivers.noitom.skeleton import Skeleton
from srl.runtime.contracts.signals import Array
from srl.runtime.loop.lockstep import Lockstep
from srl.runtime.profile import profile, wiring
from srl.sim.parts.body.motion import Scripted

clock = time.thread_time_ns  # time that other threads take on this processor counts for neither side

_ID: Final = "collision"
_PAIRS: Final = 160
_AIM: Final = 60.0  # us
_FRAMES: Final = 40
_BEGUN: Final = 200  # cycles, until wearer and arm move
_CYCLES: Final = 150
_TIMES: Final = 5  # measurements of a cycle
_UNREAD: Final = "coal by Pinocchio, unread"
_CLOSE: Final = 1e-6  # m, to which the peers' distances agree


class Scene(NamedTuple):
    """One instant, in the frame of what carries the arm.

    Attributes:
        ends, velocity: (s, 2, 3) m, m/s, of the body's segments.
        nodes, speed: (n + 2, 3) m, m/s, of the arm.
    """

    ends: Array
    velocity: Array
    nodes: Array
    speed: Array


def run() -> list[Row]:
    """Distances, then whole cycles."""
    return _distances() + _growth() + _cycles()


@cache
def _scenes() -> tuple[Scene, ...]:
    config = CollisionConfig()
    motion, suit = BodyMotion(config.figure, config.envelope.ends, SPAN), Skeleton("axis-neuron")
    script, arms, made = Scripted("reach", suit, 1.0, 1, "wearer"), config.arms.arms, []
    places, step = suit.offsets.copy(), 1 / 60
    before: Array | None = None
    for k in range(3 * _FRAMES):
        places[0], turns = script.at(k * step)
        motion.take(round(k * step * 1e9), turns, places)
        nodes = link_nodes(arms, config.arm, 0.4 * np.sin(0.01 * k * np.arange(1.0, 8.0))[None])[0]
        if before is not None and k % 3 == 0:
            made.append(Scene(motion.ends, motion.velocity.copy(), nodes, (nodes - before) / step))
        before = nodes
    return tuple(made)


def _chosen(count: int) -> tuple[Any, Any, Any]:
    """Indices of segments and links of so many pairs, and their radii, m; they repeat where there aren't enough."""
    envelope = CollisionConfig().envelope
    pairs = list(islice(cycle(envelope.pairs), count))
    segments, links = np.array([p.segment for p in pairs]), np.array([p.link for p in pairs])
    return segments, links, envelope.radii[segments] + envelope.link_radius


def _ours(count: int) -> Callable[[Scene], Array]:
    """Distances, nearest points and approach speeds, as the law `collision` computes them."""
    segments, links, radii = _chosen(count)

    def once(scene: Scene) -> Array:
        found = nearest(scene.ends, segments, scene.nodes, links)
        on_body, on_arm = found.on_segment, found.on_link
        chain, speed = (np.stack([each[:-1], each[1:]], axis=1) for each in (scene.nodes, scene.speed))
        between(scene.ends, segments, on_body), between(chain, links, on_arm)
        closing = between(scene.velocity, segments, on_body) - between(speed, links, on_arm)
        np.add.reduce(closing * found.normal, axis=0)
        return found.distance - radii

    return once


def _timed(once: Callable[[Scene], Array], prepare: Callable[[Scene], None] | None = None) -> dict[str, float]:
    took = []
    for scene in _scenes():
        if prepare is not None:
            prepare(scene)
        start = clock()
        once(scene)
        took.append((clock() - start) / 1e3)
    return {"p50": statistics.median(took)}


def _distances() -> list[Row]:
    ours, others = _ours(_PAIRS), {"coal": _coal(), _UNREAD: _pinocchio(), "mj_geomDistance": _mujoco()}
    for scene in _scenes()[::7]:
        for name, (prepare, theirs) in others.items():
            prepare(scene)
            apart = np.abs(theirs(scene) - ours(scene)).max()
            if not apart < _CLOSE:
                raise RuntimeError(f"{name}: a distance differs from ours by {apart:.2g} m")
    pairs = measure(
        lambda: _timed(ours),
        {"the aim": lambda: {"p50": _AIM}}
        | {name: partial(_timed, theirs, prepare) for name, (prepare, theirs) in others.items()},
    )
    what = f"{_PAIRS} pairs: distances, nearest points"
    first = pairs.row(_ID, f"{what}, speeds", "p50", "the aim", "us")
    return [
        replace(first, aim=f"at most {_AIM:g} us", holds=first.ours <= _AIM),
        *(pairs.row(_ID, what, "p50", name, "us", "faster", lambda r: r < 1.0) for name in others if name != _UNREAD),
        pairs.row(_ID, what, "p50", _UNREAD, "us"),
    ]


Peer = tuple[Callable[[Scene], None], Callable[[Scene], Array]]


def _frames(starts: Array, stops: Array) -> tuple[Array, Array, Array]:
    """Middles (k, 3) m, rotations (k, 3, 3) whose z is along the axis, and lengths (k,) m."""
    way = stops - starts
    length = np.linalg.norm(way, axis=1)
    z = np.where(length[:, None] > 0.0, way / np.maximum(length, 1e-12)[:, None], [0.0, 0.0, 1.0])
    x = np.cross(z, np.where(np.abs(z[:, :1]) < 0.7, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return (starts + stops) / 2, np.stack([x, np.cross(z, x), z], axis=2), length


def _capsules(scene: Scene) -> tuple[Array, Array, Array]:
    """`_frames` of all segments, then all links."""
    return _frames(np.vstack([scene.ends[:, 0], scene.nodes[:-1]]), np.vstack([scene.ends[:, 1], scene.nodes[1:]]))


def _shapes() -> tuple[list[Any], list[tuple[int, int]]]:
    """coal's capsules of all segments and links, of no length yet, and the indices of the pairs."""
    envelope = CollisionConfig().envelope
    radii = [*envelope.radii.tolist(), *[envelope.link_radius] * len(envelope.links)]
    segments, links, _ = _chosen(_PAIRS)
    both = [(int(i), len(envelope.segments) + int(j)) for i, j in zip(segments, links, strict=True)]
    return [coal.Capsule(r, 0.0) for r in radii], both


def _coal() -> Peer:
    shapes, both = _shapes()
    request, result, places = coal.DistanceRequest(), coal.DistanceResult(), list[Any]()
    request.enable_signed_distance = True

    def prepare(scene: Scene) -> None:
        middles, turns, lengths = _capsules(scene)
        for shape, length in zip(shapes, lengths.tolist(), strict=True):
            shape.halfLength = length / 2  # fingers bend, J5 slides
        places[:] = [coal.Transform3s(R, p) for R, p in zip(turns, middles, strict=True)]

    def once(_: Scene) -> Array:
        made, points = np.empty(len(both)), np.empty((len(both), 2, 3))
        for k, (i, j) in enumerate(both):
            result.clear()
            made[k] = coal.distance(shapes[i], places[i], shapes[j], places[j], request, result)
            points[k, 0], points[k, 1] = result.getNearestPoint1(), result.getNearestPoint2()
        return made

    return prepare, once


def _pinocchio() -> Peer:
    shapes, both = _shapes()
    model = pinocchio.GeometryModel()
    for k, shape in enumerate(shapes):
        model.addGeometryObject(pinocchio.GeometryObject(f"{k}", 0, 0, pinocchio.SE3.Identity(), shape))
    for i, j in both:
        model.addCollisionPair(pinocchio.CollisionPair(i, j))
    data = pinocchio.GeometryData(model)

    def prepare(scene: Scene) -> None:
        middles, turns, lengths = _capsules(scene)
        for k, (R, p, length) in enumerate(zip(turns, middles, lengths.tolist(), strict=True)):
            data.oMg[k] = pinocchio.SE3(R, p)
            model.geometryObjects[k].geometry.halfLength = length / 2
        pinocchio.computeDistances(model, data)
        read[:] = [each.min_distance for each in data.distanceResults]

    def once(_: Scene) -> Array:
        pinocchio.computeDistances(model, data)
        return read

    read = np.empty(len(both))
    return prepare, once


def _mujoco() -> Peer:
    shapes, both = _shapes()
    spec = mujoco.MjSpec()
    for shape in shapes:
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[shape.radius, 0.1, 0.0])
    model = spec.compile()
    data = mujoco.MjData(model)

    def prepare(scene: Scene) -> None:
        middles, turns, lengths = _capsules(scene)
        model.geom_size[:, 1] = lengths / 2
        data.geom_xpos[:], data.geom_xmat[:] = middles, turns.reshape(-1, 9)

    def once(_: Scene) -> Array:
        made, points = np.empty(len(both)), np.empty((len(both), 6))
        for k, (i, j) in enumerate(both):
            made[k] = mujoco.mj_geomDistance(model, data, i, j, 10.0, points[k])
        return made

    return prepare, once


def _growth() -> list[Row]:
    """More pairs against 40. Two arms of 197 pairs each are 394."""
    counts = (80, 160, 394)
    kernels = {count: _ours(count) for count in (40, *counts)}

    def all_of_them() -> dict[str, float]:
        return {f"{count}": _timed(kernels[count])["p50"] for count in counts}

    few = measure(all_of_them, {"40": lambda: dict.fromkeys(map(str, counts), _timed(kernels[40])["p50"])})
    return [few.row(_ID, f"{count} pairs against 40", f"{count}", "40", "us") for count in counts]


def _cycles() -> list[Row]:
    """A cycle's laws and guard, p50 and p99, with `clear` and without, and with two arms; limit: the period."""
    one, without, two = (
        _stepped(*arguments)
        for arguments in (
            ("human-srl",),
            ("human-srl", "guard.arm.position_command.clear=null"),
            ("human-srl-two",),
        )
    )
    period = 1e6 / 100
    pairs = measure(
        one,
        {"the period": lambda: dict.fromkeys(_METRICS, period), "no clear": without, "human-srl-two": two},
        _TIMES,
    )
    return [
        *_rows(pairs, "the period", _METRICS),
        *_rows(pairs, "no clear", ("guard p50", "laws and guard p50")),
        *_rows(pairs, "human-srl-two", ("laws and guard p50",)),
    ]


_METRICS: Final = tuple(f"{what} {share}" for what in ("laws", "guard", "laws and guard") for share in ("p50", "p99"))


def _rows(pairs: Pairs, other: str, metrics: tuple[str, ...]) -> list[Row]:
    return [pairs.row(_ID, f"a cycle of human-srl: {figure}", figure, other, "us") for figure in metrics]


def _stepped(name: str, *overrides: str) -> Callable[[], dict[str, float]]:
    """Steps a simulated profile on and on; each call goes on where the last one ended."""
    lockstep = Lockstep(wiring.build(*profile.load(name, overrides), []))
    for _ in range(_BEGUN):
        lockstep.step()
    took = dict[str, list[float]](laws=[], guard=[])
    steps = lockstep.cycle
    for figure, step in (("laws", steps.control), ("guard", steps.guard)):
        setattr(steps, step.__name__, lambda step=step, times=took[figure]: times.append(_us(step)))

    def once() -> dict[str, float]:
        for times in took.values():
            times.clear()
        for _ in range(_CYCLES):
            lockstep.step()
        whole = np.add(took["laws"], took["guard"])
        every = {"laws": took["laws"], "guard": took["guard"], "laws and guard": whole}
        return {
            f"{what} p{share}": float(np.percentile(times, share))
            for what, times in every.items()
            for share in (50, 99)
        }

    return once


def _us(step: Callable[[], None]) -> float:
    start = clock()
    step()
    return (clock() - start) / 1e3


if __name__ == "__main__":
    for row in run():
        print(f"{row.what}: {row.ours:g} us, {row.other_name} {row.other:g}, ratio {row.ratio:g}, A/A {row.control:g}")
